"""Fits on disk, looked up by the content that they depend on.

First among the shipped ones, then in the user's cache folder; else a fit is made and kept there.
"""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import platformdirs
from threadpoolctl import threadpool_limits

from weld_force_ros import __version__
from weld_force_ros.core.causality import acausal
from weld_force_ros.core.poles import BAND_HZ, REPORT_BANDS, PoleModel, default_fit, relative_error
from weld_force_ros.errors import InputError
from weld_force_ros.tracks import TrackDefinition

# Part of every fit's key: raise it when the fit of the same track would come out differently.
FIT_VERSION = 2

FittedEngine = Literal["common-poles", "rfp"]

_DATA = resources.files("weld_force_ros.data")


class Fit(msgspec.Struct, kw_only=True, tag_field="engine"):
    """A fit on disk: what it was made from, how well it came out, and what no fit could do better.

    `*_by_band` follow `bands_hz` (pairs of ends): RMS of |fit - exact| / |exact + contact and wheel|, and the same for
    the exact receptance cut at the impulse, mid-span.
    """

    key: str
    track: str
    software: str
    order: int
    spacing_m: float
    error: float
    bands_hz: list[float]
    error_by_band: list[float]
    acausal_energy_share: float
    acausal_floor_by_band: list[float]

    @property
    def engine(self) -> str:
        """The engine that uses it."""
        return str(self.__struct_config__.tag)


class PolesFit(Fit, kw_only=True, tag="common-poles"):
    """Common poles; `residues_*` are row-major (section, pole)."""

    section_m: list[float]
    poles_re_rad_s: list[float]
    poles_im_rad_s: list[float]
    residues_re: list[float]
    residues_im: list[float]

    def model(self) -> PoleModel:
        """The fitted track."""
        shape = (len(self.section_m), len(self.poles_re_rad_s))
        return PoleModel(
            poles_rad_s=np.array(self.poles_re_rad_s) + 1j * np.array(self.poles_im_rad_s),
            residues=(np.array(self.residues_re) + 1j * np.array(self.residues_im)).reshape(shape),
            section_m=np.array(self.section_m),
            spacing_m=self.spacing_m,
        )


def key_of(definition: TrackDefinition, engine: FittedEngine = "common-poles") -> str:
    """Identity of a fit: the numbers it depends on, not the text they came in."""
    content = [FIT_VERSION, engine, asdict(definition.track) | {"name": ""}, asdict(definition.wheel)]
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def fitted(
    definition: TrackDefinition,
    engine: FittedEngine = "common-poles",
    *,
    on_fit: Callable[[str], None] | None = None,
) -> PolesFit:
    """The fit of a track: shipped, cached, or made now and cached.

    Args:
        definition: the track and its own wheel, by which errors are weighed.
        engine: which kind of fit.
        on_fit: told, in words, if the fit has to be made, which takes some seconds.
    """
    key = key_of(definition, engine)
    shipped_file = _DATA / "fits" / f"{definition.track.name}.{engine}.json"
    cached_file = platformdirs.user_cache_path("weld_force_ros") / "fits" / f"{key}.json"
    for file in (shipped_file, cached_file):
        if (found := _read(file, key)) is not None:
            return found
    if on_fit:
        on_fit(f"fitting track {definition.track.name}, once")
    fit = make(definition, engine)
    with contextlib.suppress(OSError):  # a read-only home costs time at the next start, nothing else
        write(fit, cached_file)
    return fit


def make(definition: TrackDefinition, engine: FittedEngine = "common-poles") -> PolesFit:
    """Fit a track now."""
    if engine != "common-poles":
        raise InputError(f"engine {engine!r} has no fit", "use common-poles")
    # Many small factorisations: a second BLAS thread makes them many times slower where another program computes.
    with threadpool_limits(limits=1, user_api="blas"):
        model = default_fit(definition.track, definition.wheel.compliance)
    return PolesFit(
        **_account(definition, engine, model),
        section_m=model.section_m.tolist(),
        poles_re_rad_s=model.poles_rad_s.real.tolist(),
        poles_im_rad_s=model.poles_rad_s.imag.tolist(),
        residues_re=model.residues.real.ravel().tolist(),
        residues_im=model.residues.imag.ravel().tolist(),
    )


def _account(definition: TrackDefinition, engine: FittedEngine, model: PoleModel) -> dict[str, Any]:
    """What every fit says of itself."""
    track, compliance = definition.track, definition.wheel.compliance
    before = acausal(track, track.spacing_m / 2)
    return {
        "key": key_of(definition, engine),
        "track": track.name,
        "software": f"weld_force_ros {__version__}",
        "order": model.order,
        "spacing_m": model.spacing_m,
        "error": relative_error(model, track, compliance, BAND_HZ),
        "bands_hz": [end for band in REPORT_BANDS for end in band],
        "error_by_band": [relative_error(model, track, compliance, band) for band in REPORT_BANDS],
        "acausal_energy_share": before.energy_share,
        "acausal_floor_by_band": [before.floor(compliance, band) for band in REPORT_BANDS],
    }


def write(fit: PolesFit, path: Path) -> None:
    """Write a fit so that another process sees either the whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(fit), indent=0) + b"\n")
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _read(file: resources.abc.Traversable, key: str) -> PolesFit | None:
    """A fit file of that key, or None: a damaged cache entry is as good as none."""
    try:
        fit = msgspec.json.decode(file.read_bytes(), type=PolesFit)
        fit.model()
    except (OSError, ValueError):
        return None
    return fit if fit.key == key else None
