"""Passages over welds at several speeds, in steps of one stride.

Where states come in pairs of common poles, eight speeds at each of four places advance side by side in vector
registers; dense transitions, and code that is not compiled, take one passage after the other.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache, partial
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _scalar_passage
from weld_force_ros.physics.passage._contact import Filters
from weld_force_ros.physics.passage._simd import PLACES, SPEEDS
from weld_force_ros.physics.passage.lane_tables import LaneTables, PlacedSpeeds, SpeedChoice
from weld_force_ros.physics.passage.lowpass import UNFILTERED, LowPass, low_pass, result_columns, with_filters
from weld_force_ros.physics.passage.speed_tables import SmoothExtremes, negligible_n, speed_tables
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath

# Lanes exist in compiled code only.
USE_SIMD = not numba.config.DISABLE_JIT

StepCounts = NDArray[np.int64]
Selection = NDArray[np.bool_]


@dataclass(frozen=True)
class PassageStarts:
    """Places, each a weld at a position, in steps of a stride.

    Attributes:
        starts: (n_place,), points of the grid, ones that every stride meets, where the passages begin.
        ends: (n_place,), steps from there until the weld is behind.
        irregularity_m: (n_place, n), step by step from the start: the paper's r, positive down.
    """

    starts: StepCounts
    ends: StepCounts
    irregularity_m: FloatArray


def passage_starts(
    solver: SteadyStateSolver, wheel_paths: Sequence[WheelPath], positions_m: FloatArray, stride: int
) -> PassageStarts:
    """Return where passages over welds at `positions_m` (n_weld, n_position) begin and end, and the irregularity."""
    of_each = [_starts_over(solver, *weld, stride) for weld in zip(wheel_paths, positions_m, strict=True)]
    longest = max(own.irregularity_m.shape[1] for own in of_each)
    irregularity = np.zeros((*positions_m.shape, longest))
    for rows, own in zip(irregularity, of_each, strict=True):
        rows[:, : own.irregularity_m.shape[1]] = own.irregularity_m
    return PassageStarts(
        np.concatenate([own.starts for own in of_each]),
        np.concatenate([own.ends for own in of_each]),
        irregularity.reshape(-1, longest),
    )


def _starts_over(
    solver: SteadyStateSolver, wheel_path: WheelPath, positions_m: FloatArray, stride: int
) -> PassageStarts:
    first_m, last_m = wheel_path.nonzero_extent_m
    starts = np.array([solver.start(position + first_m) for position in positions_m])
    step_m = stride * solver.grid_m
    ends = np.ceil((positions_m + last_m - starts * solver.grid_m) / step_m).astype(np.int64)
    heights = np.empty((len(positions_m), int(ends.max()) + 1))
    first_samples_m = starts * solver.grid_m - positions_m
    cubics = wheel_path.cubics.coefficients
    _scalar_passage.sampled(cubics, RESAMPLED_STEP_M, wheel_path.start_m, first_samples_m, step_m, heights)
    return PassageStarts(starts, ends, -heights)


class Batch(Protocol):
    """Speeds of one stride."""

    def peaks(
        self,
        places: PassageStarts,
        speeds: SpeedChoice,
        at: NDArray[np.intp],
        pool: Executor,
        threads: int,
        cutoffs_hz: tuple[float, ...] = (),
    ) -> FloatArray:
        """Simulate some passages.

        Args:
            places: the welds at their positions.
            speeds: (n,), indices.
            at: (n,), indices of places.
            pool: where to compute.
            threads: in how many parts.
            cutoffs_hz: (n_filter,), of the low-pass filters.

        Returns:
            (n, 6 + n_filter): peak force, its place in steps from the start, least force, time without contact, largest
            second difference of the force, number of steps; greatest low-passed forces. The peak is NaN where a passage
            did not stay finite.

        Raises:
            NumericalError: the force on smooth rail does not settle at a speed.
        """


def make_batch(solver: SteadyStateSolver, speeds_kmh: FloatArray, stride: int) -> Batch:
    """Return a batch for some speeds, increasing, whose tables are made as they are needed."""
    made = SimdBatch if USE_SIMD and not solver.is_dense else ScalarBatch
    return made(solver, speeds_kmh, stride)


class SimdBatch:
    """Passages side by side: eight of a place's speeds at a time, at four places."""

    def __init__(self, solver: SteadyStateSolver, speeds_kmh: FloatArray, stride: int) -> None:
        self._tables = LaneTables(solver, speeds_kmh, stride)

    def peaks(
        self,
        places: PassageStarts,
        speeds: SpeedChoice,
        at: NDArray[np.intp],
        pool: Executor,
        threads: int,
        cutoffs_hz: tuple[float, ...] = (),
    ) -> FloatArray:
        """See `Batch`."""
        self._tables.make(speeds, pool)
        octets = _octets(speeds, at)
        groups = np.arange(len(octets)) // PLACES
        shares = [octets[groups % threads == part] for part in range(min(threads, groups[-1] + 1))]
        simulate = partial(self._simulate, places, speeds, at, cutoffs_hz)
        found = np.empty((len(speeds), UNFILTERED + len(cutoffs_hz)))
        for own, results in zip(shares, pool.map(simulate, shares), strict=True):
            found[own] = results
        return found

    def _simulate(
        self,
        places: PassageStarts,
        speeds: SpeedChoice,
        at: NDArray[np.intp],
        cutoffs_hz: tuple[float, ...],
        octets: NDArray[np.intp],
    ) -> FloatArray:
        """Return results (n_octet, SPEEDS, 6 + n_filter)."""
        own = at[octets[:, 0]]
        placed = PlacedSpeeds(speeds[octets], places.starts[own], places.ends[own], places.irregularity_m, own)
        return self._tables.simulate(placed, cutoffs_hz)


def _octets(speeds: SpeedChoice, at: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return passages, eight of each place at a time, (n_octet, SPEEDS); a place's last one fills what is left.

    Ordered by speed, as fast ones take longer: the octets that are simulated together are of similar speeds.
    """
    order = np.lexsort((speeds, at))
    of_place = np.flatnonzero(np.append(True, np.diff(at[order]) > 0))
    counts = np.diff(np.append(of_place, len(order)))
    octets_each = -(-counts // SPEEDS)
    within = np.arange(octets_each.sum()) - np.repeat(np.cumsum(octets_each) - octets_each, octets_each)
    lanes = np.minimum(SPEEDS * within[:, None] + np.arange(SPEEDS), np.repeat(counts, octets_each)[:, None] - 1)
    octets = order[np.repeat(of_place, octets_each)[:, None] + lanes]
    return np.asarray(octets[np.lexsort(speeds[octets].T)])


class ScalarBatch:
    """States of any kind, passage after passage."""

    def __init__(self, solver: SteadyStateSolver, speeds_kmh: FloatArray, stride: int) -> None:
        self._solver, self._stride, self._speeds_kmh = solver, stride, speeds_kmh
        self._tables = cache(lambda speed: speed_tables(solver, stride, float(speeds_kmh[speed])))
        self._filters = cache(self._low_pass)

    def peaks(
        self,
        places: PassageStarts,
        speeds: SpeedChoice,
        at: NDArray[np.intp],
        pool: Executor,
        threads: int,
        cutoffs_hz: tuple[float, ...] = (),
    ) -> FloatArray:
        """See `Batch`."""
        found = np.empty((len(speeds), UNFILTERED + len(cutoffs_hz)))
        own = [np.flatnonzero(speeds == speed) for speed in np.unique(speeds)]
        simulate = partial(self._simulate, places, cutoffs_hz)
        simulated = pool.map(simulate, [int(speeds[some[0]]) for some in own], [at[some] for some in own])
        for some, results in zip(own, simulated, strict=True):
            found[some] = results
        return found

    def _low_pass(self, speed: int, cutoffs_hz: tuple[float, ...]) -> LowPass:
        steady_state = self._tables(speed).steady_state
        smooth_wheel = steady_state.smooth_wheel[None]
        return low_pass(np.array([steady_state.dt_s]), smooth_wheel, self._solver.wheel.mass_kg, cutoffs_hz)

    def _simulate(
        self, places: PassageStarts, cutoffs_hz: tuple[float, ...], speed: int, at: NDArray[np.intp]
    ) -> FloatArray:
        """Return results (n, 6 + n_filter) of passages of one speed."""
        tables, filters, starts = self._tables(speed), self._filters(speed, cutoffs_hz), places.starts[at]
        steady_state, alone = tables.steady_state, np.zeros(len(at), dtype=np.intp)
        results = np.empty((len(at), result_columns(filters)))
        passages = _scalar_passage.Passages(
            initial_states=np.stack([self._solver.initial_state(steady_state, start) for start in starts]),
            starts=starts // self._stride,
            ends=places.ends[at],
            irregularity_m=places.irregularity_m[at],
        )
        smooth = _scalar_passage.SmoothRail(
            steady_state.smooth_n,
            negligible_n(self._solver),
            self._solver.span_grid // self._stride,
            tables.window,
            tables.run_out,
        )
        own_filters = Filters(
            filters.decay[0], filters.shapes[0], filters.gains[0], filters.smooth_n[0], filters.floors_n[0]
        )
        _scalar_passage.peaks_at_speed(
            passages, steady_state.step, smooth, own_filters, self._solver.physics, steady_state.dt_s, results
        )
        found = with_filters(filters, steady_state.smooth_wheel[None], alone, starts // self._stride, results)
        if not self._solver.model.uniform:
            extremes = SmoothExtremes.of(self._solver, self._stride, steady_state.smooth_n[None])
            extremes.add_to(found, self._solver, self._stride, alone, starts)
        return found
