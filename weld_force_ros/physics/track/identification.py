"""Find the layers of a track from its measured receptance, as hammer tests give it: pad, sleeper and ballast.

The logarithm of the ratio of receptances is fitted, whose parts are the errors of magnitude and phase: resonances and
what lies between them count alike. Least squares with bounds, from several starts, over logarithms of the parameters.
"""

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track.beam import Rail, Track, receptance
from weld_force_ros.physics.track.support import Spring, Support

Damping = Literal["dashpot", "loss-factor"]

BANDS_HZ = ((0.0, 100.0), (100.0, 300.0), (300.0, 800.0), (800.0, 2000.0), (2000.0, 1e5))
_STARTS_N_PER_M = tuple(product((40e6, 150e6, 500e6, 1500e6), (20e6, 80e6, 300e6)))  # pad and ballast
_KEPT_STARTS = 3
_POINTS_OF_STARTS = 120
# Loss factors that starts have, and the frequencies at which dashpots come to them.
_PAD_LOSS, _PAD_HZ = 0.2, 400.0
_BALLAST_LOSS, _BALLAST_HZ = 0.5, 100.0
_BOUNDS = {
    "pad_n_per_m": (5e6, 1e10),
    "ballast_n_per_m": (1e6, 5e9),
    "pad_ns_per_m": (10.0, 1e7),
    "ballast_ns_per_m": (10.0, 1e8),
    "pad_loss_factor": (1e-3, 3.0),
    "ballast_loss_factor": (1e-3, 3.0),
    "half_sleeper_kg": (5.0, 1000.0),
}
_AT_BOUND = 0.01


@dataclass(frozen=True)
class MeasuredReceptance:
    """A measured receptance.

    Attributes:
        frequency_hz: (n_frequency,), positive and rising.
        at_spans: (n_place,), where on the rail, in spans after a sleeper: 0 over it, 0.5 mid-span.
        m_per_n: (n_place, n_frequency), point receptance as exp(+i w t) has it: it lags the force.
    """

    frequency_hz: FloatArray
    at_spans: FloatArray
    m_per_n: ComplexArray

    def within(self, least_hz: float, most_hz: float) -> "MeasuredReceptance":
        """Return what lies in a band, both ends included."""
        inside = (self.frequency_hz >= least_hz) & (self.frequency_hz <= most_hz)
        return MeasuredReceptance(self.frequency_hz[inside], self.at_spans, self.m_per_n[:, inside])

    def thinned(self, points: int) -> "MeasuredReceptance":
        """Return about so many of its frequencies."""
        every = slice(None, None, max(1, len(self.frequency_hz) // points))
        return MeasuredReceptance(self.frequency_hz[every], self.at_spans, self.m_per_n[:, every])


@dataclass(frozen=True)
class Estimate:
    """A parameter that was found.

    Attributes:
        name: a key of `Identified.values`, which ends in its unit.
        value: in that unit.
        standard_error: relative to it, as the scatter about the fit has it, if errors of frequencies are independent.
        at_bound: whether it ended where the search may not go on: the measurement does not tell it.
    """

    name: str
    value: float
    standard_error: float
    at_bound: bool


@dataclass(frozen=True)
class Identified:
    """A track whose layers were found.

    Attributes:
        track: with the rail and spacing that were given.
        estimates: what was found.
        scatter: RMS of the logarithm of the ratio of receptances, about the RMS of its relative error.
    """

    track: Track
    estimates: tuple[Estimate, ...]
    scatter: float


def identify(
    measured: MeasuredReceptance,
    rail: Rail,
    spacing_m: float,
    *,
    half_sleeper_kg: float,
    find_sleeper: bool = False,
    damping: Damping = "dashpot",
) -> Identified:
    """Find pad and ballast below a rail from its receptance.

    Args:
        measured: over a sleeper, at mid-span, or both.
        rail: as a beam.
        spacing_m: of the sleepers.
        half_sleeper_kg: mass under one rail; where it is found, too, the search begins with it.
        find_sleeper: find that mass, too.
        damping: of both layers.

    Raises:
        NumericalError: fewer numbers than parameters, or no start led to a finite misfit.
    """
    losses = ["pad_loss_factor", "ballast_loss_factor"]
    if damping == "dashpot":
        losses = ["pad_ns_per_m", "ballast_ns_per_m"]
    names = ["pad_n_per_m", "ballast_n_per_m", *losses, *(["half_sleeper_kg"] if find_sleeper else [])]
    if 2 * measured.m_per_n.size <= len(names):
        raise NumericalError(f"{measured.m_per_n.size} values cannot tell {len(names)} parameters", "give more")
    bounds = np.log(np.array([_BOUNDS[name] for name in names])).T

    def track_of(logarithms: FloatArray) -> Track:
        values = {"half_sleeper_kg": half_sleeper_kg, **dict(zip(names, np.exp(logarithms).tolist(), strict=True))}
        return Track("identified", rail, _support(values), spacing_m)

    def search(start: FloatArray, data: MeasuredReceptance) -> OptimizeResult:
        return least_squares(lambda at: _parts(deviation(data, track_of(at))), start, bounds=bounds)

    few = measured.thinned(_POINTS_OF_STARTS)
    starts = [_start(names, *stiffness, half_sleeper_kg) for stiffness in _STARTS_N_PER_M]
    starts.sort(key=lambda start: float(np.sum(np.abs(deviation(few, track_of(start))) ** 2)))
    begun = min((search(start, few) for start in starts[:_KEPT_STARTS]), key=lambda found: float(found.cost))
    found = search(begun.x, measured)
    if not np.isfinite(found.cost):
        raise NumericalError("no track has this receptance", "look at the file's unit and phase")
    return Identified(track_of(found.x), _estimates(names, found, bounds), _scatter(found))


def deviation(measured: MeasuredReceptance, track: Track) -> ComplexArray:
    """Return the logarithm of a track's receptance over the measured one, (n_place, n_frequency)."""
    ours = receptance(track, measured.frequency_hz, track.spacing_m * measured.at_spans)
    return np.asarray(np.log(ours / measured.m_per_n))


def misfit(measured: MeasuredReceptance, track: Track) -> FloatArray:
    """Return the RMS of a track's relative error at each place, (n_place,); NaN without a frequency."""
    if not len(measured.frequency_hz):
        return np.full(len(measured.at_spans), np.nan)
    error = np.expm1(deviation(measured, track))
    return np.asarray(np.sqrt(np.mean(np.abs(error) ** 2, axis=1)))


def _support(values: dict[str, float]) -> Support:
    pad, ballast = (
        Spring(
            values[f"{layer}_n_per_m"],
            values.get(f"{layer}_loss_factor", 0.0),
            values.get(f"{layer}_ns_per_m", 0.0),
        )
        for layer in ("pad", "ballast")
    )
    return Support((pad, ballast), (values["half_sleeper_kg"],))


def _start(names: list[str], pad: float, ballast: float, half_sleeper_kg: float) -> FloatArray:
    values = {
        "pad_n_per_m": pad,
        "ballast_n_per_m": ballast,
        "pad_ns_per_m": _PAD_LOSS * pad / (2 * np.pi * _PAD_HZ),
        "ballast_ns_per_m": _BALLAST_LOSS * ballast / (2 * np.pi * _BALLAST_HZ),
        "pad_loss_factor": _PAD_LOSS,
        "ballast_loss_factor": _BALLAST_LOSS,
        "half_sleeper_kg": half_sleeper_kg,
    }
    return np.log([values[name] for name in names])


def _parts(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real.ravel(), values.imag.ravel()])


def _scatter(found: OptimizeResult) -> float:
    return float(np.sqrt(4 * found.cost / len(found.fun)))  # two real residuals to a complex one


def _estimates(names: list[str], found: OptimizeResult, bounds: FloatArray) -> tuple[Estimate, ...]:
    variance = 2 * found.cost / (len(found.fun) - len(names))
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    near = np.minimum(found.x - bounds[0], bounds[1] - found.x) < _AT_BOUND
    errors = np.sqrt(np.diag(covariance))
    return tuple(
        Estimate(name, float(np.exp(x)), float(error), bool(at_bound))
        for name, x, error, at_bound in zip(names, found.x, errors, near, strict=True)
    )
