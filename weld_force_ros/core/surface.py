"""The surface of peak forces over speed and position: many passages, side by side and on every core.

A passage begins with long steps. A step is exact for a force that is linear within it, so that a twelfth of the force's
largest second difference measures what the steps leave out; where that is over `TOLERANCE`, the passage is rolled again
in steps short enough. A passage ends when the weld's echo has faded: when all through a window behind the weld the force kept so close to the
smooth rail's that it can no longer exceed what was seen before. Neither depends on the company that a passage is rolled
in.
"""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from weld_force_ros.core import _kernel
from weld_force_ros.core._vector import LANES, SPEEDS
from weld_force_ros.core.rolling import Roller, Rolling
from weld_force_ros.core.track import Real
from weld_force_ros.core.weld import Trajectory
from weld_force_ros.errors import NumericalError

TOLERANCE = 5e-4  # of the peak force
ECHO_S = 0.025
RUN_OUT_S = 0.3
_ESTIMATE = 1 / 12  # of the second difference: a linear force's mean distance from a parabola, over a step
_MOST_REMEMBERED = 24  # batches, below 1 MB each, dense ones up to 25 MB
_AT_ONCE = 8  # batches whose tables are made before they roll
_BLOCK = 8  # positions that one thread takes at a time
# Lanes exist in compiled code only; without compilation (NUMBA_DISABLE_JIT) passages roll one after the other.
SIDE_BY_SIDE = not numba.config.DISABLE_JIT

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Surface:
    """Results over speed and position, each (n_speed, n_position)."""

    peak_force_n: Real
    peak_x_m: Real
    min_force_n: Real
    contact_loss_s: Real


class _Batch:
    """Up to `SPEEDS` speeds of one stride; tables interleaved lane by lane where they roll side by side."""

    def __init__(self, roller: Roller, speeds_kmh: Real, stride: int) -> None:
        self.stride, self.count = stride, len(speeds_kmh)
        rollings = [roller.rolling(float(speed), stride) for speed in speeds_kmh]
        span = roller.model.spacing_m
        self.windows, self.run_outs = (
            np.array([roller.steps(stride, max(span, duration_s * speed / 3.6)) for speed in speeds_kmh])
            for duration_s in (ECHO_S, RUN_OUT_S)
        )
        self.rollings: list[Rolling] = []
        if SIDE_BY_SIDE and len(rollings[0].step.transitions) == 0:
            self._interleave(rollings)
        else:
            self.rollings = rollings

    def _interleave(self, rollings: list[Rolling]) -> None:
        self.drives = rollings[0].step.drives
        self.decay = _lanes([r.step.decay for r in rollings])
        self.turn = _lanes([r.step.turn for r in rollings])
        self.dts = _lanes([np.array(r.dt_s) for r in rollings])
        self.smooth = _filled([r.smooth_n for r in rollings])
        self.gains = _filled([r.step.gains for r in rollings])
        self.states = _filled([r.states for r in rollings])


def _filled(arrays: list[Real]) -> Real:
    """Speeds along a last axis of `SPEEDS`; the last one fills what is left."""
    return np.stack(arrays + arrays[-1:] * (SPEEDS - len(arrays)), axis=-1)


def _lanes(arrays: list[Real]) -> Real:
    """Each speed twice, once for either position of a pair, along a last axis of `LANES`."""
    return np.tile(_filled(arrays), 2)


@dataclass(frozen=True)
class _Passages:
    """What all passages over one weld share, each (n_position,): where they begin and where the weld ends."""

    trajectory: Trajectory
    positions_m: Real
    starts: NDArray[np.int64]
    lengths_m: Real


class SurfaceRoller:
    """Rolls passages over welds; what depends on the speed alone is remembered from weld to weld."""

    def __init__(self, roller: Roller, threads: int) -> None:
        self._roller = roller
        self._threads = threads
        self._negligible_n = TOLERANCE * roller.wheel.static_load_n
        self._remembered: dict[tuple[int, bytes], _Batch] = {}
        self._remembering = threading.Lock()

    def roll(
        self, trajectory: Trajectory, speeds_kmh: Real, positions_m: Real, on_speed: Callable[[], None] | None
    ) -> Surface:
        """See `weld_force_ros.core.passage.Rig.surface`."""
        passages = self._passages(trajectory, positions_m)
        stride = np.array([self._roller.coarsest_stride(speed) for speed in speeds_kmh])
        wanted = np.repeat(stride[:, None], len(positions_m), axis=1)
        results = np.empty((*wanted.shape, 5))
        told = 0
        with ThreadPoolExecutor(self._threads) as pool:
            while wanted.any():
                self._roll_at(int(wanted.max()), wanted, passages, speeds_kmh, results, pool)
                done = int(np.count_nonzero(~wanted.any(axis=1)))
                for _ in range(done - told if on_speed else 0):
                    on_speed()
                told = done
        if not np.all(np.isfinite(results)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        return Surface(*np.moveaxis(results[:, :, :4], 2, 0))

    def _passages(self, trajectory: Trajectory, positions_m: Real) -> _Passages:
        starts = np.array([self._roller.start(p + trajectory.start_m) for p in positions_m])
        lengths = positions_m + trajectory.end_m - starts * self._roller.grid_m
        return _Passages(trajectory, positions_m, starts, lengths)

    def _roll_at(
        self,
        stride: int,
        wanted: NDArray[np.int64],
        passages: _Passages,
        speeds_kmh: Real,
        results: Real,
        pool: ThreadPoolExecutor,
    ) -> None:
        """Roll what wants this stride; `wanted` becomes 0 where that was enough, else the stride that is needed."""
        asked = wanted == stride
        irregularities = self._irregularities(passages, stride)

        def roll(task: tuple[Rows, Rows]) -> None:
            rows, columns = task
            cells = np.ix_(rows, columns)
            found = self._peaks(self._batch(stride, speeds_kmh[rows]), columns, passages, irregularities)
            found[:, :, 1] = (passages.starts[columns] + stride * found[:, :, 1]) * self._roller.grid_m
            own = asked[cells]
            results[cells] = np.where(own[:, :, None], found, results[cells])
            wanted[cells] = np.where(own, _finer(stride, found), wanted[cells])

        for group in _groups(self._batches(stride, speeds_kmh, asked)):
            list(pool.map(lambda rows: self._batch(stride, speeds_kmh[rows]), group))
            list(pool.map(roll, [(rows, columns) for rows in group for columns in _blocks(asked[rows])]))

    def _irregularities(self, passages: _Passages, stride: int) -> Real:
        """What the kernel rolls over, (n_position, n) a stride apart from each start: the paper's r, positive down."""
        points = self._roller.steps(stride, float(passages.lengths_m.max())) + 1
        along = passages.starts[:, None] + stride * np.arange(points)
        return -passages.trajectory.at(along * self._roller.grid_m - passages.positions_m[:, None])

    def _batches(self, stride: int, speeds_kmh: Real, asked: NDArray[np.bool_]) -> list[Rows]:
        """Rows of speeds that roll together: neighbours, slow ones first as they take the longest."""
        order = np.argsort(speeds_kmh)
        able = np.array([row for row in order if self._roller.coarsest_stride(speeds_kmh[row]) >= stride])
        # The same companies whatever is asked, so that their tables serve again.
        companies = [able[k : k + SPEEDS] for k in range(0, len(able), SPEEDS)]
        return [rows for rows in companies if asked[rows].any()]

    def _batch(self, stride: int, speeds_kmh: Real) -> _Batch:
        """A batch's tables, remembered: the next weld is likely to be rolled over at the same speeds."""
        key = (stride, speeds_kmh.tobytes())
        batch = self._remembered.get(key)
        if batch is None:
            batch = _Batch(self._roller, speeds_kmh, stride)
            with self._remembering:
                if len(self._remembered) >= _MOST_REMEMBERED:
                    self._remembered.clear()
                self._remembered[key] = batch
        return batch

    def _peaks(self, batch: _Batch, columns: Rows, passages: _Passages, irregularities: Real) -> Real:
        """(n_speed, n_position, 5) of a batch at some positions, places in steps from the start."""
        roll = self._one_by_one if batch.rollings else self._side_by_side
        return roll(batch, columns, passages, irregularities)

    def _one_by_one(self, batch: _Batch, columns: Rows, passages: _Passages, irregularities: Real) -> Real:
        starts = passages.starts[columns]
        ends = self._ends(batch, columns, passages)
        results = np.empty((batch.count, len(columns), 5))
        for row, rolling in enumerate(batch.rollings):
            step = rolling.step
            beginnings = np.stack([self._roller.beginning(rolling, start) for start in starts])
            _kernel.peaks_at_speed(
                beginnings, step.decay, step.transitions, step.drives, step.shapes, step.gains,
                starts // batch.stride, ends, ends + batch.run_outs[row], batch.windows[row], rolling.smooth_n,
                self._negligible_n, irregularities[columns], self._roller.physics, rolling.dt_s, results[row],
            )  # fmt: skip
        return results

    def _side_by_side(self, batch: _Batch, columns: Rows, passages: _Passages, irregularities: Real) -> Real:
        paired = np.append(columns, columns[-1:] if len(columns) % 2 else []).astype(np.intp).reshape(-1, 2)
        starts = passages.starts[paired]
        at = (starts // self._roller.longest_stride) % len(batch.states)
        # (n_pair, 2, n_state + 3, SPEEDS), then a lane for each of the two positions and each speed
        beginnings = batch.states[at].transpose(0, 2, 1, 3).reshape(len(paired), -1, LANES)
        ends = np.repeat(self._ends(batch, paired, passages), SPEEDS, axis=1)
        spare = SPEEDS - batch.count
        windows, run_outs = (np.tile(np.pad(steps, (0, spare)), 2) for steps in (batch.windows, batch.run_outs))
        found = np.empty((len(paired), LANES, 5))
        _kernel.peaks_in_lanes(
            beginnings, batch.decay, batch.turn, batch.drives, batch.gains, starts // batch.stride, ends,
            ends + run_outs, windows, batch.smooth, self._negligible_n, irregularities[paired], self._roller.physics,
            batch.dts, found,
        )  # fmt: skip
        by_position = found.reshape(2 * len(paired), SPEEDS, 5)[: len(columns), : batch.count]
        return by_position.transpose(1, 0, 2).copy()

    def _ends(self, batch: _Batch, columns: Rows, passages: _Passages) -> NDArray[np.int64]:
        """Steps until the weld is behind, shape of `columns`."""
        step_m = batch.stride * self._roller.grid_m
        return np.ceil(passages.lengths_m[columns] / step_m).astype(np.int64)


def _finer(stride: int, results: Real) -> NDArray[np.int64]:
    """The stride that the results (..., 5) ask for, as the error goes with its square; 0 where they are good."""
    excess = _ESTIMATE * results[..., 4] / (TOLERANCE * results[..., 0])
    good = ~(excess > 1) | (stride == 1)
    halvings = np.ceil(0.5 * np.log2(np.where(good, 1.0, excess))).astype(np.int64)
    return np.where(good, 0, np.maximum(1, stride >> halvings))


def _blocks(asked: NDArray[np.bool_]) -> Iterator[Rows]:
    """Positions that some speed asks for, a thread's share at a time."""
    columns = np.flatnonzero(asked.any(axis=0))
    return (columns[k : k + _BLOCK] for k in range(0, len(columns), _BLOCK))


def _groups(batches: list[Rows]) -> Iterator[list[Rows]]:
    return (batches[k : k + _AT_ONCE] for k in range(0, len(batches), _AT_ONCE))
