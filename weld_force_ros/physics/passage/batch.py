"""Speeds that roll together: their tables, made once, and passages over welds at all of them.

Where states come in pairs of common poles, sixteen speeds at two places advance side by side in vector registers;
dense transitions, and code that is not compiled, roll one passage after the other.
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
from weld_force_ros.physics.passage import _kernel
from weld_force_ros.physics.passage._simd import LANES, SPEEDS
from weld_force_ros.physics.passage.lowpass import ORDER, LowPass, greatest, low_pass
from weld_force_ros.physics.passage.steady_state import SteadyState, SteadyStateSolver
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath

ECHO_S = 0.0125
RUN_OUT_S = 0.3
NEGLIGIBLE = 2e-4  # of the static load: an echo that is not waited for
_UNFILTERED = 6  # results of a passage without filters
# Lanes exist in compiled code only.
SIDE_BY_SIDE = not numba.config.DISABLE_JIT

Steps = NDArray[np.int64]
Asked = NDArray[np.bool_]


@dataclass(frozen=True)
class PassageStarts:
    """Places, each a weld at a position, in steps of a stride.

    Attributes:
        starts: (n_place,), points of the grid, ones that every stride meets, where the passages begin.
        ends: (n_place,), steps from there until the weld is behind.
        irregularity_m: (n_place, n), step by step from the start: the paper's r, positive down.
    """

    starts: Steps
    ends: Steps
    irregularity_m: FloatArray


def passage_starts(
    solver: SteadyStateSolver, wheel_paths: Sequence[WheelPath], positions_m: FloatArray, stride: int
) -> PassageStarts:
    """Where the passages over welds, each at `positions_m` (n_position,), begin and end, and what they roll over."""
    each = [_approach(solver, wheel_path, positions_m, stride) for wheel_path in wheel_paths]
    longest = max(one.irregularity_m.shape[1] for one in each)
    heights = np.zeros((len(each), len(positions_m), longest))
    for rows, one in zip(heights, each, strict=True):
        rows[:, : one.irregularity_m.shape[1]] = one.irregularity_m
    return PassageStarts(
        np.concatenate([one.starts for one in each]),
        np.concatenate([one.ends for one in each]),
        heights.reshape(-1, longest),
    )


def _approach(solver: SteadyStateSolver, wheel_path: WheelPath, positions_m: FloatArray, stride: int) -> PassageStarts:
    first_m, last_m = wheel_path.nonzero_extent_m
    starts = np.array([solver.start(position + first_m) for position in positions_m])
    step_m = stride * solver.grid_m
    ends = np.ceil((positions_m + last_m - starts * solver.grid_m) / step_m).astype(np.int64)
    heights = np.empty((len(positions_m), int(ends.max()) + 1))
    _kernel.sampled(
        wheel_path.spline.c, RESAMPLED_STEP_M, wheel_path.start_m, starts * solver.grid_m - positions_m, step_m, heights
    )
    return PassageStarts(starts, ends, -heights)


class Batch(Protocol):
    """Speeds of one stride."""

    def peaks(
        self, places: PassageStarts, asked: Asked, pool: Executor, threads: int, cutoffs_hz: tuple[float, ...] = ()
    ) -> FloatArray:
        """Passages that are asked for.

        Args:
            places: what is rolled over.
            asked: (n_speed, n_place).
            pool: where to compute.
            threads: in how many parts.
            cutoffs_hz: (n_filter,), of the low-pass filters.

        Returns:
            (n_speed, n_place, 6 + n_filter), valid where asked for: peak force, its place in steps from the start,
            least force, time without contact, largest second difference of the force, steps rolled; greatest
            low-passed forces. The peak is NaN where a passage did not stay finite.
        """


def make_batch(solver: SteadyStateSolver, speeds_kmh: FloatArray, stride: int, pool: Executor) -> Batch:
    """Tables for some speeds.

    Raises:
        NumericalError: the force on smooth rail does not settle at a speed.
    """

    def paced(speed_kmh: float) -> _SpeedTables:
        window = solver.steps(stride, ECHO_S * speed_kmh / 3.6)
        run_out = solver.steps(stride, max(solver.model.spacing_m, RUN_OUT_S * speed_kmh / 3.6))
        return _SpeedTables(solver.steady_state(speed_kmh, stride), window, run_out)

    speeds = list(pool.map(paced, speeds_kmh.tolist()))
    dense = len(speeds[0].steady_state.step.transitions) > 0
    return SimdBatch(solver, speeds) if SIDE_BY_SIDE and not dense else ScalarBatch(solver, speeds)


@dataclass(frozen=True)
class _SpeedTables:
    """A speed, with the window in which an echo is listened for and the longest run-out, in steps."""

    steady_state: SteadyState
    window: int
    run_out: int


class SimdBatch:
    """Companies of `SPEEDS` speeds, their tables interleaved lane by lane; each rolls at two places at a time."""

    def __init__(self, solver: SteadyStateSolver, speeds: list[_SpeedTables]) -> None:
        self._roller, self._stride = solver, speeds[0].steady_state.stride
        self._filters = cache(lambda cutoffs_hz: _filters_and_lanes(solver, speeds, cutoffs_hz))
        self._drives = speeds[0].steady_state.step.drives
        steps = [speed.steady_state.step for speed in speeds]
        self._decay, self._turn = _lanes([step.decay for step in steps]), _lanes([step.turn for step in steps])
        self._dts = _lanes([speed.steady_state.dt_s for speed in speeds])
        self._windows = _lanes([speed.window for speed in speeds])
        self._run_outs = _lanes([speed.run_out for speed in speeds])
        self._gains = _speed_blocks([step.gains for step in steps])
        self._smooth = _speed_blocks([speed.steady_state.smooth_n for speed in speeds])
        self._states = _speed_blocks([speed.steady_state.states for speed in speeds])

    def peaks(
        self, places: PassageStarts, asked: Asked, pool: Executor, threads: int, cutoffs_hz: tuple[float, ...] = ()
    ) -> FloatArray:
        """See `Batch`."""
        filters, lanes = self._filters(cutoffs_hz)
        companies, pairs = self._paired(asked)
        roll = partial(self._roll, places, lanes, _columns(filters), companies, pairs)
        shares = [np.arange(part, len(pairs), threads) for part in range(min(threads, len(pairs)))]
        found = np.zeros((len(self._states), asked.shape[1], SPEEDS, _columns(filters)))
        for share, results in zip(shares, pool.map(roll, shares), strict=True):
            found[companies[share, None], pairs[share]] = results
        by_speed = found.transpose(0, 2, 1, 3).reshape(-1, asked.shape[1], found.shape[3])[: len(asked)]
        return _ended(filters, places.starts // self._stride, by_speed)

    def _paired(self, asked: Asked) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Companies (n_item,) and the pairs of places (n_item, 2) at which any of their passages is asked for."""
        padded = np.pad(asked, ((0, len(self._states) * SPEEDS - len(asked)), (0, 0)))
        wanted = np.asarray(padded.reshape(-1, SPEEDS, asked.shape[1]).any(axis=1))
        asked_at = [np.flatnonzero(wanted[company]) for company in range(len(self._states))]
        pairs = [np.pad(at, (0, len(at) % 2), mode="edge").reshape(-1, 2) for at in asked_at]
        return np.repeat(np.arange(len(pairs)), [len(own) for own in pairs]), np.concatenate(pairs)

    def _roll(
        self,
        places: PassageStarts,
        lanes: "_FilterLanes",
        columns: int,
        companies: NDArray[np.intp],
        pairs: NDArray[np.intp],
        share: NDArray[np.intp],
    ) -> FloatArray:
        """(n_share, 2, SPEEDS, n_column)."""
        companies, pairs = companies[share], pairs[share]
        starts = places.starts[pairs]
        at = starts // self._roller.longest_stride % self._states.shape[1]
        # (n_share, 2, n_state + 3, SPEEDS), then a lane for each of the two places and each speed
        states = self._states[companies[:, None], at]
        results = np.empty((len(share), LANES, columns))
        _kernel.peaks_in_lanes(
            companies, states.transpose(0, 2, 1, 3).reshape(len(share), -1, LANES), self._decay, self._turn,
            self._drives, self._gains, starts // self._stride, places.ends[pairs], self._windows, self._run_outs,
            self._smooth, _negligible_n(self._roller), places.irregularity_m[pairs], self._roller.physics, self._dts,
            *lanes, results,
        )  # fmt: skip
        return results.reshape(len(share), 2, SPEEDS, -1)


class ScalarBatch:
    """Any states, passage after passage."""

    def __init__(self, solver: SteadyStateSolver, speeds: list[_SpeedTables]) -> None:
        self._roller, self._speeds = solver, speeds
        self._filters = cache(lambda cutoffs_hz: _filters(solver, speeds, cutoffs_hz))

    def peaks(
        self, places: PassageStarts, asked: Asked, pool: Executor, threads: int, cutoffs_hz: tuple[float, ...] = ()
    ) -> FloatArray:
        """See `Batch`."""
        filters = self._filters(cutoffs_hz)
        found = np.zeros((*asked.shape, _columns(filters)))
        rows = np.flatnonzero(asked.any(axis=1))
        columns = [np.flatnonzero(asked[row]) for row in rows]
        rolled = pool.map(partial(self._roll, places, filters), rows, columns)
        for row, own, results in zip(rows, columns, rolled, strict=True):
            found[row, own] = results
        return _ended(filters, places.starts // self._speeds[0].steady_state.stride, found)

    def _roll(self, places: PassageStarts, filters: LowPass, row: int, columns: NDArray[np.intp]) -> FloatArray:
        speed, starts = self._speeds[row], places.starts[columns]
        steady_state, step = speed.steady_state, speed.steady_state.step
        results = np.empty((len(columns), _columns(filters)))
        _kernel.peaks_at_speed(
            np.stack([self._roller.initial_state(steady_state, start) for start in starts]),
            step.decay, step.transitions, step.drives, step.shapes, step.gains,
            starts // steady_state.stride, places.ends[columns], speed.window, speed.run_out,
            steady_state.smooth_n, _negligible_n(self._roller), places.irregularity_m[columns],
            self._roller.physics, steady_state.dt_s, filters.decay[row], filters.shapes[row], filters.gains[row],
            filters.smooth_n[row], filters.floors_n[row], results,
        )  # fmt: skip
        return results


def _negligible_n(solver: SteadyStateSolver) -> float:
    return NEGLIGIBLE * solver.wheel.static_load_n


class _FilterLanes(NamedTuple):
    """Filters as `peaks_in_lanes` takes them."""

    decay: FloatArray
    shapes: FloatArray
    gains: FloatArray
    smooth_n: FloatArray
    floors_n: FloatArray


def _columns(filters: LowPass) -> int:
    """Of the kernel's results: those of `Batch.peaks`; with filters, their states and the wheel at the end as well."""
    count = filters.gains.shape[1]
    return _UNFILTERED + (count * (1 + ORDER) + 3 if count else 0)


def _filters(solver: SteadyStateSolver, speeds: list[_SpeedTables], cutoffs_hz: tuple[float, ...]) -> LowPass:
    return low_pass([speed.steady_state for speed in speeds], solver.wheel.mass_kg, cutoffs_hz)


def _filters_and_lanes(
    solver: SteadyStateSolver, speeds: list[_SpeedTables], cutoffs_hz: tuple[float, ...]
) -> tuple[LowPass, _FilterLanes]:
    filters = _filters(solver, speeds, cutoffs_hz)
    lanes = _FilterLanes(
        _lanes([*filters.decay]),
        _lanes([*filters.shapes]),
        _lanes([*filters.gains]),
        _speed_blocks([*filters.smooth_n]),
        _lanes([*filters.floors_n]),
    )
    return filters, lanes


def _ended(filters: LowPass, starts: Steps, found: FloatArray) -> FloatArray:
    """Results as of `Batch.peaks` from those of the kernel, (n_speed, n_place, n_column)."""
    shown = _UNFILTERED + filters.gains.shape[1]
    if shown > _UNFILTERED:
        ends = (starts + found[:, :, 5].astype(np.int64)) % filters.smooth_n.shape[2]
        found[:, :, _UNFILTERED:shown] = greatest(filters, found[:, :, _UNFILTERED:shown], ends, found[:, :, shown:])
    return found[:, :, :shown]


def _speed_blocks(arrays: Sequence[ArrayLike]) -> NDArray[Any]:
    """(n_company, ..., SPEEDS): speeds along a last axis; the last one fills what is left."""
    filled = [np.asarray(array) for array in arrays] + [np.asarray(arrays[-1])] * (-len(arrays) % SPEEDS)
    return np.stack([np.stack(filled[k : k + SPEEDS], axis=-1) for k in range(0, len(filled), SPEEDS)])


def _lanes(arrays: Sequence[ArrayLike]) -> NDArray[Any]:
    """(n_company, ..., LANES): each speed twice, once for either place of a pair."""
    companies = _speed_blocks(arrays)
    return np.concatenate([companies, companies], axis=-1)
