"""What maximum force says over speed: at one position of a weld, and over all positions in a span.

Over welds with a dip the maximum force rises to a relative maximum, falls, and rises again; over others it rises almost
linearly (paper, sections 3 and 4). A hollow is "the combinations of speeds and positions [...] for which the maximum
force diminishes as speed increases" (section 7): here all that lies below what was reached at a lower speed. A kink,
the paper's "sharp angle" (section 6.1), is a speed at which another peak of the history becomes the largest.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # loads its slow parts, such as integrate, where they are first used
from numpy.typing import ArrayLike, NDArray

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.peaks import vertex
from weld_force_ros.physics.arrays import FloatArray

NEGLIGIBLE = 0.005  # of the largest less the smallest force
_LEVEL = 1e-9  # of the force: a curve that varies less is constant


@dataclass(frozen=True)
class Extremum:
    """A local maximum or minimum of a force-speed curve.

    Attributes:
        prominence_n: by how much a maximum, where it was computed, stands above the higher of the lowest places between
            it and what is higher to either side; of a minimum, upside down.
    """

    speed_kmh: float
    force_n: float
    prominence_n: float


@dataclass(frozen=True)
class Hollow:
    """Speeds at which force is below what a lower speed reached.

    Attributes:
        from_kmh: where the curve begins to fall.
        lowest_kmh: where it lies deepest below the force at `from_kmh`.
        to_kmh: where that force is reached again, or the last speed.
        depth_n: greatest fall.
    """

    from_kmh: float
    lowest_kmh: float
    to_kmh: float
    depth_n: float


@dataclass(frozen=True)
class CurveFeatures:
    """Shape of a force-speed curve.

    Attributes:
        maxima: local maxima inside the range of speeds.
        minima: local minima inside the range of speeds.
        hollows: in the order of speed; they do not overlap.
        monotonic: whether force never falls by more than is negligible.
        linearity: R^2 of the least-squares line; 1 of a constant.
        rise_n_per_kmh: slope of that line.
    """

    maxima: list[Extremum]
    minima: list[Extremum]
    hollows: list[Hollow]
    monotonic: bool
    linearity: float
    rise_n_per_kmh: float


@dataclass(frozen=True)
class SurfaceFeatures:
    """Shape of a surface of maximum force over speed and position.

    Attributes:
        hollow: (n_speed, n_position), whether a lower speed reached more force at that position.
        hollow_share: share of the span at which there is a hollow, each position standing for its surroundings.
        best_by_mean_m: position of the least mean force over speed.
        best_by_maximum_m: position of the least maximum force over speed.
        worst_by_mean_m: position of the greatest mean force over speed.
        worst_by_maximum_m: position of the greatest maximum force over speed.
        sensitivity: (n_speed,), largest less smallest force over position, relative to the mean over position.
    """

    hollow: NDArray[np.bool_]
    hollow_share: float
    best_by_mean_m: float
    best_by_maximum_m: float
    worst_by_mean_m: float
    worst_by_maximum_m: float
    sensitivity: FloatArray


def curve_features(
    speeds_kmh: ArrayLike, peak_n: ArrayLike, *, prominence: float = NEGLIGIBLE, tolerance: float = NEGLIGIBLE
) -> CurveFeatures:
    """Return extrema, local minima and linearity of a force-speed curve.

    Args:
        speeds_kmh: (n,), increasing, at least three.
        peak_n: (n,), maximum force.
        prominence: of an extremum, relative to the largest less the smallest force; extrema are refined by a parabola.
        tolerance: fall that does not count, relative to the same.

    Raises:
        InputError: not of that form.
    """
    speeds, force = _checked(speeds_kmh, peak_n)
    extent = float(np.ptp(force))
    if extent <= _LEVEL * float(np.abs(force).max()):  # rounding has no extrema
        return CurveFeatures(maxima=[], minima=[], hollows=[], monotonic=True, linearity=1.0, rise_n_per_kmh=0.0)
    scatter, abscissa = force - np.mean(force), speeds - np.mean(speeds)
    slope = (abscissa @ scatter) / (abscissa @ abscissa)
    residual = scatter - slope * abscissa
    hollows = [_hollow(speeds, force, run) for run in _falls(force, tolerance * extent)]
    return CurveFeatures(
        maxima=_maxima(speeds, force, prominence * extent),
        minima=[replace(e, force_n=-e.force_n) for e in _maxima(speeds, -force, prominence * extent)],
        hollows=hollows,
        monotonic=not hollows,
        linearity=float(1 - residual @ residual / (scatter @ scatter)),
        rise_n_per_kmh=float(slope),
    )


def kinks(speeds_kmh: ArrayLike, peak_n: ArrayLike, peak_x_m: ArrayLike, *, step_m: float = 5e-3) -> list[float]:
    """Return the speeds in km/h at which another peak of the history becomes the largest.

    The place of the maximum jumps there, and the curve turns upward; the speed is where the lines through two speeds on
    either side cross.

    Args:
        speeds_kmh: (n,), increasing, at least three.
        peak_n: (n,), maximum force.
        peak_x_m: (n,), its place relative to the weld.
        step_m: a jump exceeds this by either side's course: a peak may move with speed.

    Raises:
        InputError: not of that form.
    """
    speeds, force = _checked(speeds_kmh, peak_n)
    place = _checked(speeds, peak_x_m)[1]
    drift = np.diff(place) / np.diff(speeds)
    # Departure of each step from the course before and after it; beyond the ends a peak rests.
    before = np.abs(drift - np.concatenate([[0.0], drift[:-1]])) * np.diff(speeds)
    after = np.abs(drift - np.concatenate([drift[1:], [0.0]])) * np.diff(speeds)
    ends = np.flatnonzero(np.minimum(before, after) > step_m) + 1
    starts, stops = np.concatenate([[0], ends]), np.concatenate([ends, [len(speeds)]])
    branches = [slice(a, b) for a, b in zip(starts.tolist(), stops.tolist(), strict=True)]
    crossings = [_crossing(speeds[old], force[old], speeds[new], force[new]) for old, new in pairwise(branches)]
    return [at_kmh for at_kmh in crossings if at_kmh is not None]


def surface_features(
    speeds_kmh: ArrayLike,
    positions_m: ArrayLike,
    peak_n: ArrayLike,
    span_m: float,
    *,
    between_kmh: tuple[float, float] = (0.0, np.inf),
    tolerance: float = NEGLIGIBLE,
) -> SurfaceFeatures:
    """Return local minima, best and worst positions, and how much the position matters.

    Args:
        speeds_kmh: (n_speed,), increasing, at least three.
        positions_m: (n_position,), increasing, of the weld after the sleeper, within one span.
        peak_n: (n_speed, n_position), maximum force.
        span_m: sleeper spacing.
        between_kmh: speeds over which positions are compared; means are by the trapezoidal rule.
        tolerance: see `curve_features`.

    Raises:
        InputError: not of that form, or no speed in the range.
    """
    force = np.asarray(peak_n, dtype=np.float64)
    positions = np.asarray(positions_m, dtype=np.float64)
    speeds = _checked(speeds_kmh, force[:, 0])[0]
    if force.shape != (len(speeds), len(positions)) or np.ptp(positions) >= span_m or np.any(np.diff(positions) <= 0):
        raise InputError(
            f"forces of shape {force.shape} for {len(speeds)} speeds and {len(positions)} positions in {span_m:g} m",
            "give one force for each speed and position, positions increasing within one span",
        )
    compared = (speeds >= between_kmh[0]) & (speeds <= between_kmh[1])
    if not compared.any():
        raise InputError(f"no speed from {between_kmh[0]:g} to {between_kmh[1]:g} km/h", "compute speeds in that range")
    hollow = np.zeros(force.shape, dtype=bool)
    for column, at_position in enumerate(force.T):
        for run in _falls(at_position, tolerance * float(np.ptp(at_position))):
            hollow[run, column] = True
    mean = _mean_over(speeds[compared], force[compared])
    maximum = force[compared].max(axis=0)
    return SurfaceFeatures(
        hollow=hollow,
        hollow_share=float(_surroundings(positions, span_m) @ hollow.any(axis=0) / span_m),
        best_by_mean_m=float(positions[np.argmin(mean)]),
        best_by_maximum_m=float(positions[np.argmin(maximum)]),
        worst_by_mean_m=float(positions[np.argmax(mean)]),
        worst_by_maximum_m=float(positions[np.argmax(maximum)]),
        sensitivity=np.ptp(force, axis=1) / force.mean(axis=1),
    )


def _checked(speeds_kmh: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    speeds, array = np.asarray(speeds_kmh, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if speeds.ndim != 1 or len(speeds) < 3 or speeds.shape != array.shape or np.any(np.diff(speeds) <= 0):
        raise InputError(
            f"speeds of shape {speeds.shape} for values of shape {array.shape} make no curve",
            "give three or more increasing speeds and one value for each",
        )
    return speeds, array


def _maxima(speeds: FloatArray, force: FloatArray, prominence_n: float) -> list[Extremum]:
    if prominence_n == 0:  # a constant has no extremum, though that would find one
        return []
    heights = ((index, _prominence(force, index)) for index in _tops(force))
    return [Extremum(*vertex(speeds, force, index), height) for index, height in heights if height >= prominence_n]


def _tops(values: FloatArray) -> list[int]:
    """Return the indices of local maxima, the middle of each level one, as `scipy.signal.find_peaks` does.

    Loading `scipy.signal` takes longer than all advice on a weld.
    """
    first = np.flatnonzero(np.diff(values, prepend=np.nan))  # of each run of equal values
    last = np.append(first[1:], len(values)) - 1
    rises = np.diff(values[first]) > 0
    inside = np.flatnonzero(rises[:-1] & ~rises[1:]) + 1
    return [int(middle) for middle in (first[inside] + last[inside]) // 2]


def _prominence(values: FloatArray, top: int) -> float:
    """Return by how much a maximum stands above the higher of the lowest values between it and what is higher."""
    return min(_descent(values[top::-1]), _descent(values[top:]))


def _descent(values: FloatArray) -> float:
    """Return by how much values fall below the first before they rise above it."""
    higher = np.flatnonzero(values > values[0])
    return float(values[0] - values[: higher[0] if len(higher) else None].min())


def _falls(force: FloatArray, negligible_n: float) -> list[slice]:
    """Return the runs of samples below an earlier one, by more than is negligible at their deepest."""
    below = np.maximum.accumulate(force) - force
    edges = np.flatnonzero(np.diff(np.concatenate([[False], below > 0, [False]])))
    return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist() if below[a:b].max() > negligible_n]


def _hollow(speeds: FloatArray, force: FloatArray, run: slice) -> Hollow:
    from_kmh, summit_n = vertex(speeds, force, run.start - 1)
    lowest_kmh, lowest_n = vertex(speeds, force, run.start + int(np.argmin(force[run])))
    to_kmh = float(speeds[-1])
    if run.stop < len(speeds):
        back = slice(run.stop - 1, run.stop + 1)
        to_kmh = float(np.interp(summit_n, force[back], speeds[back]))
    return Hollow(from_kmh, lowest_kmh, to_kmh, summit_n - lowest_n)


def _crossing(old_kmh: FloatArray, old_n: FloatArray, new_kmh: FloatArray, new_n: FloatArray) -> float | None:
    """Return where the line that ends one branch meets the next one's, between the two; None if they cannot.

    The larger of two forces turns upward where they cross. A branch of one speed has no line: half way, then.
    """
    last, first = float(old_kmh[-1]), float(new_kmh[0])
    if len(old_kmh) == 1 or len(new_kmh) == 1:
        return (last + first) / 2
    old_rise = float((old_n[-1] - old_n[-2]) / (old_kmh[-1] - old_kmh[-2]))
    new_rise = float((new_n[1] - new_n[0]) / (new_kmh[1] - new_kmh[0]))
    if new_rise <= old_rise:
        return None
    lead = float(old_n[-1] - new_n[0]) + new_rise * (first - last)
    return float(np.clip(last + lead / (new_rise - old_rise), last, first))


def _mean_over(speeds: FloatArray, force: FloatArray) -> FloatArray:
    if len(speeds) == 1:
        return np.asarray(force[0])
    return np.asarray(scipy.integrate.trapezoid(force, speeds, axis=0) / (speeds[-1] - speeds[0]))


def _surroundings(positions: FloatArray, span_m: float) -> FloatArray:
    """Return the length of span nearest to each position, round the span."""
    gaps = np.diff(np.concatenate([positions, [positions[0] + span_m]]))
    return np.asarray((gaps + np.roll(gaps, 1)) / 2)
