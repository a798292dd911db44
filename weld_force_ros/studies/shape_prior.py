"""The shapes that the paper's text allows each of its five welds: sums of Gaussian terms (`data/inference.yaml`)."""

import hashlib
from collections.abc import Sequence
from functools import cached_property
from importlib import resources
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.spectra import Spectrum
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies import passage_records
from weld_force_ros.studies.study_context import Profile

WHEEL_RADIUS_M = 0.45
MOST_CURVATURE = 0.85  # of the wheel's own
_HALF_LENGTH_M, _STEP_M, _TAPER_M = 0.5, 0.002, 0.15
_SPECTRUM_SAMPLES = 2**14  # with level rail beside the weld, 33 m in all

_Range = tuple[float, float]
_Words = Annotated[str, Meta(min_length=1, max_length=1000)]


class Term(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A Gaussian: its height, where it is largest, from the weld's centre, and its standard deviation."""

    height_um: float
    place_mm: float
    length_mm: float

    def at(self, x_m: FloatArray) -> FloatArray:
        """Return heights in m."""
        return np.asarray(self.height_um * 1e-6 * np.exp(-0.5 * ((1e3 * x_m - self.place_mm) / self.length_mm) ** 2))


class TermRange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The ranges of a term, and what words it stands for."""

    what: _Words
    height_um: _Range
    place_mm: _Range
    length_mm: _Range


class Prior(msgspec.Struct, frozen=True, dict=True, forbid_unknown_fields=True):
    """The words that describe a weld's geometry, the ranges of its terms, and the wavelengths, m, that it must have."""

    words: _Words
    terms: Annotated[list[TermRange], Meta(min_length=1, max_length=10)]
    wavelengths_m: list[Annotated[float, Meta(gt=0)]] = []

    @cached_property
    def bounds(self) -> list[_Range]:
        """Return the ranges in the order of a search's parameters: height, place and length of each term."""
        return [ends for term in self.terms for ends in (term.height_um, term.place_mm, term.length_mm)]

    @property
    def sha256(self) -> str:
        """Return what tells this prior from another."""
        return hashlib.sha256(msgspec.json.encode(self)).hexdigest()


def load() -> dict[str, Prior]:
    """Return the priors that come with the package, by weld.

    Raises:
        InputError: the file is damaged.
    """
    path = resources.files("weld_force_ros") / "data" / "inference.yaml"
    return parse(path.read_bytes(), "data/inference.yaml")


def parse(data: bytes, source: str) -> dict[str, Prior]:
    """Read priors from the bytes of their YAML file; `source` names it in errors.

    Raises:
        InputError: not YAML, a field unknown or missing, or a range that is none.
    """
    remedy = "write it after the package's data/inference.yaml"
    try:
        priors = _yaml.decode(data, dict[str, Prior])
    except (msgspec.DecodeError, ValueError) as error:
        raise InputError(f"priors {source}: {' '.join(str(error).split())}", remedy) from None
    for name, prior in priors.items():
        for low, high in prior.bounds:
            if not (np.isfinite([low, high]).all() and low < high):
                raise InputError(f"priors {source}, {name}: {low:g} to {high:g} is no range", remedy)
        if any(term.length_mm[0] <= 0 for term in prior.terms):
            raise InputError(f"priors {source}, {name}: a length is not positive", remedy)
    return priors


def terms_of(parameters: Sequence[float] | FloatArray) -> list[Term]:
    """Return the terms of a search's parameters, (3 n_term,)."""
    return [Term(*map(float, three)) for three in np.reshape(parameters, (-1, 3))]


def profile_of(terms: Sequence[Term]) -> Profile:
    """Return a weld's profile under a straightedge of a metre, every 2 mm: the terms' sum, zero at its ends."""
    count = round(2 * _HALF_LENGTH_M / _STEP_M) + 1
    x_m = np.linspace(-_HALF_LENGTH_M, _HALF_LENGTH_M, count)
    to_end = np.clip((_HALF_LENGTH_M - np.abs(x_m)) / _TAPER_M, 0.0, 1.0)
    window = np.sin(0.5 * np.pi * to_end) ** 2
    heights_m = window * np.sum([term.at(x_m) for term in terms], axis=0)
    heights_m[[0, -1]] = 0.0
    return x_m, heights_m


def curvature_share(profile: Profile) -> float:
    """Return the largest upward curvature over the wheel's own; at 1 the wheel would touch at two points."""
    x_m, z_m = profile
    step = float(x_m[1] - x_m[0])
    return float(np.max(np.diff(z_m, 2)) / step**2 * WHEEL_RADIUS_M)


def wavelengths_of(profile: Profile) -> FloatArray:
    """Return the wavelengths, m, of the strong components of a profile: clear peaks of its spectrum, longest first."""
    x_m, z_m = profile
    frequency_per_m = np.fft.rfftfreq(_SPECTRUM_SAMPLES, float(x_m[1] - x_m[0]))[1:]
    amplitude_m = 2 / len(z_m) * np.abs(np.fft.rfft(z_m, _SPECTRUM_SAMPLES))[1:]
    spectrum = Spectrum(frequency_per_m, 1 / frequency_per_m, amplitude_m)  # at 1 m/s
    return np.array([peak.wavelength_m for peak in passage_records.large_peaks(spectrum)])


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def rms_gradient(profile: Profile) -> float:
    """Return the RMS of the gradient, rad."""
    x_m, z_m = profile
    return rms(np.diff(z_m) / np.diff(x_m))
