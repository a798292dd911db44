"""Passages of many samples of one weld at few places, each at speeds of its own.

All are in the longest stride. What that leaves out is held to a tolerance in `weld_force_ros.physics.passage.peak_map`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage._sampled_path import sampled_locally
from weld_force_ros.physics.passage._simd import SPEEDS
from weld_force_ros.physics.passage.lane_tables import LaneTables, PlacedSpeeds, SpeedChoice
from weld_force_ros.physics.passage.lowpass import CUTOFFS_HZ
from weld_force_ros.physics.passage.peak_map import WORKING, PeakMap
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver

AT_ONCE = SPEEDS
"""Speeds that a place has."""


@dataclass(frozen=True)
class Places:
    """Places in the span at which all samples pass, in steps of the longest stride.

    Attributes:
        starts: (n_place,), points of the grid where passages begin.
        ends: (n_place,), steps from there until the weld is behind.
        irregularity_m: (n_sample, n_place, n), step by step from the start, positive down.
    """

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    irregularity_m: FloatArray


def sample_peaks(
    tables: LaneTables, places: Places, samples: NDArray[np.intp], speeds: SpeedChoice, *, low_passed: bool
) -> PeakMap:
    """Simulate some samples at every place, at the speeds of that place.

    Args:
        tables: in the longest stride.
        places: where, and over what.
        samples: (n_sample,), which of the places' samples.
        speeds: (n_place, AT_ONCE), indices of the tables' speeds.
        low_passed: also the greatest forces through filters, which takes twice the time.

    Returns:
        Each (n_sample, n_place, AT_ONCE); `peak_x_m` in steps from the start.

    Raises:
        NumericalError: a passage did not stay finite, or the force on smooth rail does not settle.
    """
    count, _, longest = len(samples), *places.irregularity_m.shape[1:]
    at = np.repeat(np.arange(len(speeds)), count)  # samples of a place side by side, as they share its tables
    octets = PlacedSpeeds(
        speeds=speeds[at],
        starts=places.starts[at],
        ends=places.ends[at],
        irregularity_m=places.irregularity_m.reshape(-1, longest),
        rows=np.tile(samples, len(speeds)) * len(speeds) + at,
    )
    found = np.delete(tables.simulate(octets, CUTOFFS_HZ if low_passed else ()), WORKING, axis=2)
    if not np.all(np.isfinite(found)):
        raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
    by_sample = found.reshape(len(speeds), count, AT_ONCE, -1).swapaxes(0, 1)
    peak_n, steps, least_n, loss_s, *low = np.moveaxis(by_sample, 3, 0)
    return PeakMap(peak_n, steps, least_n, loss_s, np.stack(low) if low_passed else None)


class MetPaths(NamedTuple):
    """Wheel paths as they are met in one direction, and the positions at which they are.

    Attributes:
        heights_m: (n_sample, n), of the wheel's centre, zero at both ends.
        start_m: of the first height, from the weld's centre.
        positions_m: (n_place,), the weld's centre after the sleeper.
    """

    heights_m: FloatArray
    start_m: float
    positions_m: FloatArray


def places_over(solver: SteadyStateSolver, step_m: float, directions: Sequence[MetPaths]) -> Places:
    """Return passages over several wheel paths, one direction after the other.

    Args:
        solver: with the grid of the span.
        step_m: between heights.
        directions: with the same samples.
    """
    long_m = solver.longest_stride * solver.grid_m
    begins = [_begins(solver, step_m, met) for met in directions]
    ends = [np.ceil((end_m - from_m) / long_m).astype(np.int64) for _, from_m, end_m in begins]
    samples, count = len(directions[0].heights_m), sum(len(met.positions_m) for met in directions)
    irregularity = np.empty((samples, count, int(np.concatenate(ends).max()) + 1))
    first = 0
    for met, (_, from_m, _) in zip(directions, begins, strict=True):
        sampled_locally(met.heights_m, step_m, from_m - met.start_m, long_m, first, irregularity)
        first += len(from_m)
    return Places(np.concatenate([starts for starts, _, _ in begins]), np.concatenate(ends), irregularity)


def _begins(solver: SteadyStateSolver, step_m: float, met: MetPaths) -> tuple[NDArray[np.int64], FloatArray, float]:
    """Return where passages begin, as points of the grid and from the weld's centre, and where the weld is behind."""
    uneven = np.flatnonzero(met.heights_m.any(axis=0))
    first, last = (max(0, uneven[0] - 1), uneven[-1] + 1) if len(uneven) else (0, 0)
    starts = np.array([solver.start(position + met.start_m + step_m * first) for position in met.positions_m])
    return starts, starts * solver.grid_m - met.positions_m, met.start_m + step_m * last
