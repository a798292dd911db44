"""Speeds that are simulated together: their tables, made once, and passages over welds at all of them.

Where states come in pairs of common poles, sixteen speeds at two places advance side by side in vector registers;
dense transitions, and code that is not compiled, take one passage after the other.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple, Protocol

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _scalar_passage, _simd_passage
from weld_force_ros.physics.passage._contact import Filters
from weld_force_ros.physics.passage._simd import LANES, SPEEDS
from weld_force_ros.physics.passage.lowpass import ORDER, LowPass, greatest, low_pass
from weld_force_ros.physics.passage.steady_state import SteadyState, SteadyStateSolver
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath

TRANSIENT_WINDOW_S = 0.0125
RUN_OUT_S = 0.3
NEGLIGIBLE = 2e-4  # of the static load: a transient that is not waited for
_NEGLIGIBLE_IN_WINDOW = 1e-3  # where smooth rail near a support that differs is the peak
_UNFILTERED = 6  # results of a passage without filters
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
        selected: Selection,
        pool: Executor,
        threads: int,
        cutoffs_hz: tuple[float, ...] = (),
    ) -> FloatArray:
        """Simulate the selected passages.

        Args:
            places: the welds at their positions.
            selected: (n_speed, n_place).
            pool: where to compute.
            threads: in how many parts.
            cutoffs_hz: (n_filter,), of the low-pass filters.

        Returns:
            (n_speed, n_place, 6 + n_filter), valid where selected: peak force, its place in steps from the start,
            least force, time without contact, largest second difference of the force, number of steps; greatest
            low-passed forces. The peak is NaN where a passage did not stay finite.
        """


def make_batch(solver: SteadyStateSolver, speeds_kmh: FloatArray, stride: int, pool: Executor) -> Batch:
    """Compute the tables of some speeds.

    Raises:
        NumericalError: the force on smooth rail does not settle at a speed.
    """
    speeds = list(pool.map(partial(speed_tables, solver, stride), speeds_kmh.tolist()))
    dense = len(speeds[0].steady_state.step.transitions) > 0
    return SimdBatch(solver, speeds) if USE_SIMD and not dense else ScalarBatch(solver, speeds)


def speed_tables(solver: SteadyStateSolver, stride: int, speed_kmh: float) -> "SpeedTables":
    """Compute the tables of a speed.

    Raises:
        NumericalError: the force on smooth rail does not settle.
    """
    window = solver.steps(stride, TRANSIENT_WINDOW_S * speed_kmh / 3.6)
    run_out = solver.steps(stride, max(solver.model.spacing_m, RUN_OUT_S * speed_kmh / 3.6))
    return SpeedTables(solver.steady_state(speed_kmh, stride), window, run_out)


@dataclass(frozen=True)
class SpeedTables:
    """A speed, with the window through which a transient has to have decayed and the longest run-out, in steps."""

    steady_state: SteadyState
    window: int
    run_out: int


class SimdBatch:
    """Blocks of `SPEEDS` speeds, their tables interleaved lane by lane; each is simulated at two places at a time."""

    def __init__(self, solver: SteadyStateSolver, speeds: list[SpeedTables]) -> None:
        self._solver, self._stride = solver, speeds[0].steady_state.stride
        self._filters = cache(lambda cutoffs_hz: _block_filters(solver, speeds, cutoffs_hz))
        steps = [speed.steady_state.step for speed in speeds]
        self._blocks = _simd_passage.SpeedBlocks(
            decay=_lanes([step.decay for step in steps]),
            input_scale=_lanes([step.input_scale for step in steps]),
            drives=steps[0].drives,
            gains=_speed_blocks([step.gains for step in steps]),
            smooth_n=_speed_blocks([speed.steady_state.smooth_n for speed in speeds]),
            windows=_lanes([speed.window for speed in speeds]),
            run_outs=_lanes([speed.run_out for speed in speeds]),
            dt_s=_lanes([speed.steady_state.dt_s for speed in speeds]),
            span=solver.span_grid // self._stride,
        )
        self._states = _speed_blocks([speed.steady_state.states for speed in speeds])
        smooth_n = np.stack([speed.steady_state.smooth_n for speed in speeds])
        self._extremes = SmoothExtremes.of(solver, smooth_n, self._stride)

    def peaks(
        self,
        places: PassageStarts,
        selected: Selection,
        pool: Executor,
        threads: int,
        cutoffs_hz: tuple[float, ...] = (),
    ) -> FloatArray:
        """See `Batch`."""
        filters, block_filters = self._filters(cutoffs_hz)
        speed_blocks, place_pairs = self._paired(selected)
        columns = column_count(filters)
        simulate = partial(self._simulate, places, block_filters, columns)
        shares = [np.arange(part, len(place_pairs), threads) for part in range(min(threads, len(place_pairs)))]
        found = np.zeros((len(self._states), selected.shape[1], SPEEDS, columns))
        own = [(speed_blocks[share], place_pairs[share]) for share in shares]
        for (blocks, pairs), results in zip(own, pool.map(simulate, *zip(*own, strict=True)), strict=True):
            found[blocks[:, None], pairs] = results
        by_speed = found.transpose(0, 2, 1, 3).reshape(-1, selected.shape[1], found.shape[3])[: len(selected)]
        shown = _with_filters_later(filters, places.starts // self._stride, by_speed, selected)
        if self._extremes is None:
            return shown
        return self._extremes.added(self._solver, self._stride, places.starts, shown)

    def _paired(self, selected: Selection) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return speed blocks (n_pair,) and pairs of places (n_pair, 2) at which any of their passages is selected."""
        padded = np.pad(selected, ((0, len(self._states) * SPEEDS - len(selected)), (0, 0)))
        any_speed = np.asarray(padded.reshape(-1, SPEEDS, selected.shape[1]).any(axis=1))
        places = [np.flatnonzero(any_speed[block]) for block in range(len(self._states))]
        pairs = [np.pad(at, (0, len(at) % 2), mode="edge").reshape(-1, 2) for at in places]
        return np.repeat(np.arange(len(pairs)), [len(own) for own in pairs]), np.concatenate(pairs)

    def _simulate(
        self,
        places: PassageStarts,
        filters: Filters,
        columns: int,
        speed_blocks: NDArray[np.intp],
        place_pairs: NDArray[np.intp],
    ) -> FloatArray:
        """Return results (n_pair, 2, SPEEDS, n_column)."""
        starts = places.starts[place_pairs]
        at = starts // self._solver.start_every % self._states.shape[1]
        # (n_pair, 2, n_state + 3, SPEEDS), then a lane for each of the two places and each speed
        states = self._states[speed_blocks[:, None], at]
        results = np.empty((len(place_pairs), LANES, columns))
        pairs = _simd_passage.PlacePairs(
            speed_blocks=speed_blocks,
            initial_states=states.transpose(0, 2, 1, 3).reshape(len(place_pairs), -1, LANES),
            starts=starts // self._stride,
            ends=places.ends[place_pairs],
            irregularity_m=places.irregularity_m,
            rows=np.repeat(place_pairs, 2, axis=1),
        )
        _simd_passage.peaks_in_lanes(
            pairs, self._blocks, filters, self._solver.physics, negligible_n(self._solver), results
        )
        return results.reshape(len(place_pairs), 2, SPEEDS, -1)


class ScalarBatch:
    """States of any kind, passage after passage."""

    def __init__(self, solver: SteadyStateSolver, speeds: list[SpeedTables]) -> None:
        self._solver, self._speeds = solver, speeds
        smooth_n = np.stack([speed.steady_state.smooth_n for speed in speeds])
        self._extremes = SmoothExtremes.of(solver, smooth_n, speeds[0].steady_state.stride)
        self._filters = cache(
            lambda cutoffs_hz: low_pass([speed.steady_state for speed in speeds], solver.wheel.mass_kg, cutoffs_hz)
        )

    def peaks(
        self,
        places: PassageStarts,
        selected: Selection,
        pool: Executor,
        threads: int,
        cutoffs_hz: tuple[float, ...] = (),
    ) -> FloatArray:
        """See `Batch`."""
        filters = self._filters(cutoffs_hz)
        found = np.zeros((*selected.shape, column_count(filters)))
        rows = np.flatnonzero(selected.any(axis=1))
        columns = [np.flatnonzero(selected[row]) for row in rows]
        simulated = pool.map(partial(self._simulate, places, filters), rows, columns)
        for row, own, results in zip(rows, columns, simulated, strict=True):
            found[row, own] = results
        stride = self._speeds[0].steady_state.stride
        shown = _with_filters_later(filters, places.starts // stride, found, selected)
        return shown if self._extremes is None else self._extremes.added(self._solver, stride, places.starts, shown)

    def _simulate(self, places: PassageStarts, filters: LowPass, row: int, columns: NDArray[np.intp]) -> FloatArray:
        speed, starts = self._speeds[row], places.starts[columns]
        steady_state = speed.steady_state
        results = np.empty((len(columns), column_count(filters)))
        passages = _scalar_passage.Passages(
            initial_states=np.stack([self._solver.initial_state(steady_state, start) for start in starts]),
            starts=starts // steady_state.stride,
            ends=places.ends[columns],
            irregularity_m=places.irregularity_m[columns],
        )
        smooth = _scalar_passage.SmoothRail(
            steady_state.smooth_n,
            negligible_n(self._solver),
            self._solver.span_grid // steady_state.stride,
            speed.window,
            speed.run_out,
        )
        own_filters = Filters(
            filters.decay[row], filters.shapes[row], filters.gains[row], filters.smooth_n[row], filters.floors_n[row]
        )
        _scalar_passage.peaks_at_speed(
            passages, steady_state.step, smooth, own_filters, self._solver.physics, steady_state.dt_s, results
        )
        return results


def negligible_n(solver: SteadyStateSolver) -> float:
    """Return the transient that is not waited for."""
    share = NEGLIGIBLE if solver.model.uniform else _NEGLIGIBLE_IN_WINDOW
    return share * solver.wheel.static_load_n


def column_count(filters: LowPass) -> int:
    """Return the number of the compiled passages' results: `Batch.peaks`'s, filter states and wheel at the end."""
    count = filters.gains.shape[1]
    return _UNFILTERED + (count * (1 + ORDER) + 3 if count else 0)


def _block_filters(
    solver: SteadyStateSolver, speeds: list[SpeedTables], cutoffs_hz: tuple[float, ...]
) -> tuple[LowPass, Filters]:
    filters = low_pass([speed.steady_state for speed in speeds], solver.wheel.mass_kg, cutoffs_hz)
    return filters, Filters(
        _lanes([*filters.decay]),
        _lanes([*filters.shapes]),
        _lanes([*filters.gains]),
        _speed_blocks([*filters.smooth_n]),
        _lanes([*filters.floors_n]),
    )


def with_filters_later(filters: LowPass, speeds: NDArray[np.intp], starts: StepCounts, found: FloatArray) -> FloatArray:
    """Return `Batch.peaks`'s results from the compiled passages' (n_speed, n_place, n_column), of some speeds."""
    shown = _UNFILTERED + filters.gains.shape[1]
    results = found[:, :, :shown]
    if shown > _UNFILTERED:
        ends = (starts + found[:, :, 5].astype(np.int64)) % filters.smooth_n.shape[2]
        results[:, :, _UNFILTERED:] = greatest(filters, speeds, results[:, :, _UNFILTERED:], ends, found[:, :, shown:])
    return results


def _with_filters_later(filters: LowPass, starts: StepCounts, found: FloatArray, selected: Selection) -> FloatArray:
    """Do as `with_filters_later` at the speeds and places (n_speed, n_place) of which any passage is selected."""
    speeds, places = np.flatnonzero(selected.any(axis=1)), np.flatnonzero(selected.any(axis=0))
    part = with_filters_later(filters, speeds, starts[places], found[np.ix_(speeds, places)])
    results = found[:, :, : part.shape[2]]
    results[np.ix_(speeds, places)] = part
    return results


class SmoothExtremes(NamedTuple):
    """Extremes of the force on smooth rail about the weld, met with rising x and against, each (n_speed, 2).

    Where all supports are alike they come in every span, and a passage has seen them. Where a few differ, the rail near
    them is part of what is asked for, whether or not the passage over the weld itself came to it.

    Attributes:
        highest_n: greatest force.
        highest_at: its place, in steps from sleeper 0 of the track.
        lowest_n: least force.
    """

    highest_n: FloatArray
    highest_at: FloatArray
    lowest_n: FloatArray

    @classmethod
    def of(cls, solver: SteadyStateSolver, smooth_n: FloatArray, stride: int) -> "SmoothExtremes | None":
        """Return those of forces (n_speed, n_grid); None where all supports are alike."""
        if solver.model.uniform:
            return None
        half = smooth_n.shape[1] // 4  # of a window; the period is two
        origins = [0, _image(solver) // stride]
        near = np.stack([smooth_n[:, (origin + np.arange(-half, half)) % smooth_n.shape[1]] for origin in origins])
        at = near.argmax(axis=2) - half + np.array(origins)[:, None]
        return cls(near.max(axis=2).T, at.T.astype(np.float64), near.min(axis=2).T)

    def added(
        self, solver: SteadyStateSolver, stride: int, starts: StepCounts, found: FloatArray, speeds: Any = np.s_[:]
    ) -> FloatArray:
        """Return results (n_speed, n_place, n) of passages that begin at `starts`, with these where they are beyond."""
        image = _image(solver)
        against = np.abs(starts - image) < np.abs(starts)
        highest, at, lowest = (values[speeds][:, against.astype(np.intp)] for values in self)
        found[..., 1] = np.where(highest > found[..., 0], at - starts / stride, found[..., 1])
        found[..., 0] = np.maximum(found[..., 0], highest)
        found[..., 2] = np.minimum(found[..., 2], lowest)
        return found


def _image(solver: SteadyStateSolver) -> int:
    """Return the grid point of sleeper 0 of the mirror image."""
    return round((solver.model.opposite_m - solver.model.spacing_m) / solver.grid_m)


def _speed_blocks(arrays: Sequence[ArrayLike]) -> NDArray[Any]:
    """Stack speeds along a last axis, (n_block, ..., SPEEDS); the last one fills what is left."""
    filled = [np.asarray(array) for array in arrays] + [np.asarray(arrays[-1])] * (-len(arrays) % SPEEDS)
    return np.stack([np.stack(filled[k : k + SPEEDS], axis=-1) for k in range(0, len(filled), SPEEDS)])


def _lanes(arrays: Sequence[ArrayLike]) -> NDArray[Any]:
    """Stack speeds along a last axis, (n_block, ..., LANES), each twice, once for either place of a pair."""
    blocks = _speed_blocks(arrays)
    return np.concatenate([blocks, blocks], axis=-1)
