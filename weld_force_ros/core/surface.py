"""The surface of peak forces over speed and position: many passages, side by side and on every core.

A passage begins with long steps. A step is exact for a force that is linear within it, so that a twelfth of the force's
largest second difference measures what the steps leave out; where that is over `TOLERANCE`, the passage is rolled again
in steps short enough. A passage ends when the weld's echo has faded: when through a window behind the weld the force
kept so close to the smooth rail's that it can no longer exceed what was seen before. Neither depends on the company
that a passage is rolled in.
"""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.core._vector import SPEEDS
from weld_force_ros.core.batch import Batch, approaches
from weld_force_ros.core.rolling import Roller
from weld_force_ros.core.track import Real
from weld_force_ros.core.weld import Trajectory
from weld_force_ros.errors import NumericalError

TOLERANCE = 5e-4  # of the peak force
_ESTIMATE = 1 / 12  # of the second difference: a linear force's mean distance from a parabola, over a step
_MOST_REMEMBERED = 24  # batches, below 1 MB each, dense ones up to 25 MB
_AT_ONCE = 8  # batches whose tables are made before they roll
_BLOCK = 8  # positions that one thread takes at a time

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Surface:
    """Results over speed and position, each (n_speed, n_position)."""

    peak_force_n: Real
    peak_x_m: Real
    min_force_n: Real
    contact_loss_s: Real


class SurfaceRoller:
    """Rolls passages over welds; what depends on the speed alone is remembered from weld to weld."""

    def __init__(self, roller: Roller, threads: int) -> None:
        self._roller = roller
        self._threads = threads
        self._remembered: dict[tuple[int, bytes], Batch] = {}
        self._remembering = threading.Lock()

    def roll(
        self, trajectory: Trajectory, speeds_kmh: Real, positions_m: Real, on_speed: Callable[[], None] | None
    ) -> Surface:
        """See `weld_force_ros.core.passage.Rig.surface`."""
        task = _Task(trajectory, speeds_kmh, positions_m, self._roller)
        told = 0
        with ThreadPoolExecutor(self._threads) as pool:
            while task.wanted.any():
                self._roll_at(int(task.wanted.max()), task, pool)
                done = int(np.count_nonzero(~task.wanted.any(axis=1)))
                while on_speed and told < done:
                    on_speed()
                    told += 1
        if not np.all(np.isfinite(task.results)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        return Surface(*np.moveaxis(task.results[:, :, :4], 2, 0))

    def _roll_at(self, stride: int, task: "_Task", pool: ThreadPoolExecutor) -> None:
        """Roll every passage that wants this stride."""
        asked = task.wanted == stride
        weld = approaches(self._roller, task.trajectory, task.positions_m, stride)

        def batch(rows: Rows) -> Batch:
            return self._batch(stride, task.speeds_kmh[rows])

        def roll(cells: tuple[Rows, Rows]) -> None:
            rows, columns = cells
            found = batch(rows).peaks(weld, columns)
            found[:, :, 1] = (weld.starts[columns] + stride * found[:, :, 1]) * self._roller.grid_m
            task.keep(rows, columns, asked, found, _finer(stride, found))

        for group in _groups(self._companies(stride, task.speeds_kmh, asked)):
            list(pool.map(batch, group))
            list(pool.map(roll, [(rows, columns) for rows in group for columns in _blocks(asked[rows])]))

    def _companies(self, stride: int, speeds_kmh: Real, asked: NDArray[np.bool_]) -> list[Rows]:
        """Rows of speeds that roll together: neighbours, the same whatever is asked, so that tables serve again."""
        order = np.argsort(speeds_kmh)
        able = np.array([row for row in order if self._roller.coarsest_stride(speeds_kmh[row]) >= stride])
        companies = [able[k : k + SPEEDS] for k in range(0, len(able), SPEEDS)]
        return [rows for rows in companies if asked[rows].any()]

    def _batch(self, stride: int, speeds_kmh: Real) -> Batch:
        """A batch, remembered: the next weld is likely to be rolled over at the same speeds."""
        key = (stride, speeds_kmh.tobytes())
        batch = self._remembered.get(key)
        if batch is None:
            batch = Batch(self._roller, speeds_kmh, stride)
            with self._remembering:
                if len(self._remembered) >= _MOST_REMEMBERED:
                    self._remembered.clear()
                self._remembered[key] = batch
        return batch


class _Task:
    """A surface in the making.

    Attributes:
        wanted: (n_speed, n_position), the stride that each passage is still to be rolled in; 0 where it is done.
        results: (n_speed, n_position, 6), as `Batch.peaks`, but places in m.
    """

    def __init__(self, trajectory: Trajectory, speeds_kmh: Real, positions_m: Real, roller: Roller) -> None:
        self.trajectory, self.speeds_kmh, self.positions_m = trajectory, speeds_kmh, positions_m
        strides = [[roller.coarsest_stride(speed)] for speed in speeds_kmh]
        self.wanted = np.repeat(strides, len(positions_m), axis=1)
        self.results = np.empty((*self.wanted.shape, 6))

    def keep(self, rows: Rows, columns: Rows, asked: NDArray[np.bool_], found: Real, finer: NDArray[np.int64]) -> None:
        """Take over what was asked of a company's results."""
        row, column = np.nonzero(asked[np.ix_(rows, columns)])
        self.results[rows[row], columns[column]] = found[row, column]
        self.wanted[rows[row], columns[column]] = finer[row, column]


def _finer(stride: int, results: Real) -> NDArray[np.int64]:
    """The stride that results (..., 6) ask for, as the error goes with its square; 0 where they are good enough."""
    excess = _ESTIMATE * results[..., 4] / (TOLERANCE * results[..., 0])
    good = ~(excess > 1) | (stride == 1)
    halvings = np.ceil(0.5 * np.log2(np.where(good, 1.0, excess))).astype(np.int64)
    return np.where(good, 0, np.maximum(1, stride >> halvings))


def _blocks(asked: NDArray[np.bool_]) -> Iterator[Rows]:
    """Positions that some speed asks for, a thread's share at a time."""
    columns = np.flatnonzero(asked.any(axis=0))
    return (columns[k : k + _BLOCK] for k in range(0, len(columns), _BLOCK))


def _groups(companies: list[Rows]) -> Iterator[list[Rows]]:
    return (companies[k : k + _AT_ONCE] for k in range(0, len(companies), _AT_ONCE))
