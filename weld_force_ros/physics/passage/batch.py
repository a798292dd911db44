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
from weld_force_ros.physics.passage.steady_state import Roller, Rolling
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, Trajectory

ECHO_S = 0.0125
RUN_OUT_S = 0.3
NEGLIGIBLE = 2e-4  # of the static load: an echo that is not waited for
_UNFILTERED = 6  # results of a passage without filters
# Lanes exist in compiled code only.
SIDE_BY_SIDE = not numba.config.DISABLE_JIT

Steps = NDArray[np.int64]
Asked = NDArray[np.bool_]


@dataclass(frozen=True)
class Approaches:
    """Places, each a weld at a position, in steps of a stride.

    Attributes:
        starts: (n_place,), points of the grid, ones that every stride meets, where the passages begin.
        ends: (n_place,), steps from there until the weld is behind.
        irregularity_m: (n_place, n), step by step from the start: the paper's r, positive down.
    """

    starts: Steps
    ends: Steps
    irregularity_m: FloatArray


def approaches(roller: Roller, trajectories: Sequence[Trajectory], positions_m: FloatArray, stride: int) -> Approaches:
    """Where the passages over welds, each at `positions_m` (n_position,), begin and end, and what they roll over."""
    each = [_approach(roller, trajectory, positions_m, stride) for trajectory in trajectories]
    longest = max(one.irregularity_m.shape[1] for one in each)
    heights = np.zeros((len(each), len(positions_m), longest))
    for rows, one in zip(heights, each, strict=True):
        rows[:, : one.irregularity_m.shape[1]] = one.irregularity_m
    return Approaches(
        np.concatenate([one.starts for one in each]),
        np.concatenate([one.ends for one in each]),
        heights.reshape(-1, longest),
    )


def _approach(roller: Roller, trajectory: Trajectory, positions_m: FloatArray, stride: int) -> Approaches:
    first_m, last_m = trajectory.uneven_m
    starts = np.array([roller.start(position + first_m) for position in positions_m])
    step_m = stride * roller.grid_m
    ends = np.ceil((positions_m + last_m - starts * roller.grid_m) / step_m).astype(np.int64)
    heights = np.empty((len(positions_m), int(ends.max()) + 1))
    _kernel.sampled(
        trajectory.spline.c, RESAMPLED_STEP_M, trajectory.start_m, starts * roller.grid_m - positions_m, step_m, heights
    )
    return Approaches(starts, ends, -heights)


class Batch(Protocol):
    """Speeds of one stride."""

    def peaks(
        self, places: Approaches, asked: Asked, pool: Executor, threads: int, cutoffs_hz: tuple[float, ...] = ()
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


def make_batch(roller: Roller, speeds_kmh: FloatArray, stride: int, pool: Executor) -> Batch:
    """Tables for some speeds.

    Raises:
        NumericalError: the force on smooth rail does not settle at a speed.
    """

    def paced(speed_kmh: float) -> _Paced:
        window = roller.steps(stride, ECHO_S * speed_kmh / 3.6)
        run_out = roller.steps(stride, max(roller.model.spacing_m, RUN_OUT_S * speed_kmh / 3.6))
        return _Paced(roller.rolling(speed_kmh, stride), window, run_out)

    speeds = list(pool.map(paced, speeds_kmh.tolist()))
    dense = len(speeds[0].rolling.step.transitions) > 0
    return _SideBySide(roller, speeds) if SIDE_BY_SIDE and not dense else _OneByOne(roller, speeds)


@dataclass(frozen=True)
class _Paced:
    """A speed, with the window in which an echo is listened for and the longest run-out, in steps."""

    rolling: Rolling
    window: int
    run_out: int


class _SideBySide:
    """Companies of `SPEEDS` speeds, their tables interleaved lane by lane; each rolls at two places at a time."""

    def __init__(self, roller: Roller, speeds: list[_Paced]) -> None:
        self._roller, self._stride = roller, speeds[0].rolling.stride
        self._filters = cache(lambda cutoffs_hz: _filters_and_lanes(roller, speeds, cutoffs_hz))
        self._drives = speeds[0].rolling.step.drives
        steps = [speed.rolling.step for speed in speeds]
        self._decay, self._turn = _lanes([step.decay for step in steps]), _lanes([step.turn for step in steps])
        self._dts = _lanes([speed.rolling.dt_s for speed in speeds])
        self._windows = _lanes([speed.window for speed in speeds])
        self._run_outs = _lanes([speed.run_out for speed in speeds])
        self._gains = _companies([step.gains for step in steps])
        self._smooth = _companies([speed.rolling.smooth_n for speed in speeds])
        self._states = _companies([speed.rolling.states for speed in speeds])

    def peaks(
        self, places: Approaches, asked: Asked, pool: Executor, threads: int, cutoffs_hz: tuple[float, ...] = ()
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
        places: Approaches,
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


class _OneByOne:
    """Any states, passage after passage."""

    def __init__(self, roller: Roller, speeds: list[_Paced]) -> None:
        self._roller, self._speeds = roller, speeds
        self._filters = cache(lambda cutoffs_hz: _filters(roller, speeds, cutoffs_hz))

    def peaks(
        self, places: Approaches, asked: Asked, pool: Executor, threads: int, cutoffs_hz: tuple[float, ...] = ()
    ) -> FloatArray:
        """See `Batch`."""
        filters = self._filters(cutoffs_hz)
        found = np.zeros((*asked.shape, _columns(filters)))
        rows = np.flatnonzero(asked.any(axis=1))
        columns = [np.flatnonzero(asked[row]) for row in rows]
        rolled = pool.map(partial(self._roll, places, filters), rows, columns)
        for row, own, results in zip(rows, columns, rolled, strict=True):
            found[row, own] = results
        return _ended(filters, places.starts // self._speeds[0].rolling.stride, found)

    def _roll(self, places: Approaches, filters: LowPass, row: int, columns: NDArray[np.intp]) -> FloatArray:
        speed, starts = self._speeds[row], places.starts[columns]
        rolling, step = speed.rolling, speed.rolling.step
        results = np.empty((len(columns), _columns(filters)))
        _kernel.peaks_at_speed(
            np.stack([self._roller.beginning(rolling, start) for start in starts]), step.decay, step.transitions,
            step.drives, step.shapes, step.gains, starts // rolling.stride, places.ends[columns], speed.window,
            speed.run_out, rolling.smooth_n, _negligible_n(self._roller), places.irregularity_m[columns],
            self._roller.physics, rolling.dt_s, filters.decay[row], filters.shapes[row], filters.gains[row],
            filters.smooth_n[row], filters.floors_n[row], results,
        )  # fmt: skip
        return results


def _negligible_n(roller: Roller) -> float:
    return NEGLIGIBLE * roller.wheel.static_load_n


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


def _filters(roller: Roller, speeds: list[_Paced], cutoffs_hz: tuple[float, ...]) -> LowPass:
    return low_pass([speed.rolling for speed in speeds], roller.wheel.mass_kg, cutoffs_hz)


def _filters_and_lanes(
    roller: Roller, speeds: list[_Paced], cutoffs_hz: tuple[float, ...]
) -> tuple[LowPass, _FilterLanes]:
    filters = _filters(roller, speeds, cutoffs_hz)
    lanes = _FilterLanes(
        _lanes([*filters.decay]),
        _lanes([*filters.shapes]),
        _lanes([*filters.gains]),
        _companies([*filters.smooth_n]),
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


def _companies(arrays: Sequence[ArrayLike]) -> NDArray[Any]:
    """(n_company, ..., SPEEDS): speeds along a last axis; the last one fills what is left."""
    filled = [np.asarray(array) for array in arrays] + [np.asarray(arrays[-1])] * (-len(arrays) % SPEEDS)
    return np.stack([np.stack(filled[k : k + SPEEDS], axis=-1) for k in range(0, len(filled), SPEEDS)])


def _lanes(arrays: Sequence[ArrayLike]) -> NDArray[Any]:
    """(n_company, ..., LANES): each speed twice, once for either place of a pair."""
    companies = _companies(arrays)
    return np.concatenate([companies, companies], axis=-1)
