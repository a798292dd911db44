"""Maps of peak force over speed and position: many passages, side by side and on every core.

A passage begins with long steps. A step is exact for a force that is linear within it, so that a twelfth of the force's
largest second difference measures what the steps leave out; where that is over `TOLERANCE`, the passage is simulated
again in steps short enough. A passage ends when the transient has decayed: when through a window behind the weld the
force kept so close to the smooth rail's that it can no longer exceed what was seen before. Neither depends on what is
simulated beside it.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.batch import Batch, Selection, make_batch, passage_starts
from weld_force_ros.physics.passage.lowpass import CUTOFFS_HZ
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.threads import executor

TOLERANCE = 5e-4  # of the peak force
_ESTIMATE = 1 / 12  # of the second difference: a linear force's mean distance from a parabola, over a step
WORKING = (4, 5)
"""Columns of `Batch.peaks` that are no result."""
_MOST_REMEMBERED = 16  # batches: a map's and its curve's; up to 10 MB each, dense ones of short steps up to 200 MB


@dataclass(frozen=True)
class PeakMap:
    """Results over speed and position, each (n_speed, n_position).

    `low_passed_n`, if wanted: (2, n_speed, n_position), greatest force through the filters of
    `weld_force_ros.physics.passage.lowpass.CUTOFFS_HZ`.
    """

    peak_force_n: FloatArray
    peak_x_m: FloatArray
    min_force_n: FloatArray
    contact_loss_s: FloatArray
    low_passed_n: FloatArray | None = None

    @classmethod
    def of(cls, results: FloatArray) -> "PeakMap":
        """Return a map of (n_speed, n_position, n_column): the fields in their order, each filter a column, or none."""
        peak_n, peak_x_m, least_n, loss_s, *low_passed = np.moveaxis(results, 2, 0)
        return cls(peak_n, peak_x_m, least_n, loss_s, np.stack(low_passed) if low_passed else None)


class PeakMapSolver:
    """Simulates passages over welds; what depends on the speed alone is remembered from weld to weld."""

    def __init__(self, solver: SteadyStateSolver) -> None:
        self._solver = solver
        self._remembered: dict[tuple[int, bytes], Batch] = {}
        self._remembering = threading.Lock()
        self._pool = cache(executor)  # starting threads takes longer than a few passages

    def solve(
        self,
        wheel_paths: Sequence[WheelPath],
        speeds_kmh: FloatArray,
        positions_m: FloatArray,
        threads: int,
        on_speed: Callable[[], None] = lambda: None,
        *,
        low_passed: bool = False,
        tolerance: float = TOLERANCE,
        selected: Selection | None = None,
    ) -> list[PeakMap]:
        """Return maps as `VehicleTrackModel.peak_map`, of several welds, which fill each other's lanes.

        Args:
            wheel_paths: over the welds.
            speeds_kmh: (n_speed,).
            positions_m: (n_weld, n_position), or (n_position,) of all.
            threads: that compute.
            on_speed: called for each speed that is done.
            low_passed: also the greatest forces through filters.
            tolerance: of the peak force, that the steps' length may cost.
            selected: (n_speed, n_weld, n_position), what is simulated; the rest is NaN.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        positions = np.broadcast_to(positions_m, (len(wheel_paths), np.shape(positions_m)[-1]))
        shape = (len(speeds_kmh), positions.size)
        order = np.argsort(speeds_kmh)  # neighbours are simulated together, as they take as long
        chosen = np.ones(shape, dtype=bool) if selected is None else selected.reshape(shape)[order]
        speeds, places = np.nonzero(chosen)
        cutoffs_hz = CUTOFFS_HZ if low_passed else ()
        found = self._simulated(
            wheel_paths, speeds_kmh[order], positions, speeds, places, threads, cutoffs_hz, tolerance, on_speed
        )
        if not np.all(np.isfinite(found)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        results = np.full((*shape, found.shape[1]), np.nan)
        results[order[speeds], places] = found
        return [PeakMap.of(part) for part in np.split(results, len(wheel_paths), axis=1)]

    def _simulated(
        self,
        wheel_paths: Sequence[WheelPath],
        speeds_kmh: FloatArray,
        positions_m: FloatArray,
        speeds: NDArray[np.intp],
        places: NDArray[np.intp],
        threads: int,
        cutoffs_hz: tuple[float, ...],
        tolerance: float,
        on_speed: Callable[[], None],
    ) -> FloatArray:
        """Return (n, 4 + n_filter) of passages, each in the longest stride that serves.

        Args:
            wheel_paths: (n_weld,).
            speeds_kmh: (n_speed,), increasing.
            positions_m: (n_weld, n_position).
            speeds: (n,), indices.
            places: (n,), indices of positions, row-major.
            threads: as of `solve`, as the following.
            cutoffs_hz: of filters.
            tolerance: of the peak force.
            on_speed: called for each speed that is done.
        """
        strides = np.array([self._solver.coarsest_stride(speed) for speed in speeds_kmh])[speeds]
        results, pool = np.empty((len(speeds), 6 + len(cutoffs_hz))), self._pool(threads)
        while stride := int(strides.max(initial=0)):
            now = np.flatnonzero(strides == stride)
            begun = passage_starts(self._solver, wheel_paths, positions_m, stride)
            batch = self._batch(stride, speeds_kmh)
            found = batch.peaks(begun, speeds[now], places[now], pool, threads, cutoffs_hz)
            found[:, 1] = (begun.starts[places[now]] + stride * found[:, 1]) * self._solver.grid_m
            results[now] = found
            strides[now] = _finer(stride, found, tolerance)
            for _ in np.setdiff1d(speeds[now], speeds[strides > 0]):
                on_speed()
        return np.delete(results, WORKING, axis=1)

    def _batch(self, stride: int, speeds_kmh: FloatArray) -> Batch:
        """Return a batch, remembered with its tables: the next weld is likely to be simulated at the same speeds."""
        key = (stride, speeds_kmh.tobytes())
        with self._remembering:
            batch = self._remembered.get(key)
            if batch is None:
                if len(self._remembered) >= _MOST_REMEMBERED:
                    self._remembered.clear()
                batch = self._remembered[key] = make_batch(self._solver, speeds_kmh, stride)
        return batch


def _finer(stride: int, results: FloatArray, tolerance: float) -> NDArray[np.int64]:
    """Return the stride that results (..., 6) need, as the error goes with its square; 0 where they are good enough."""
    with np.errstate(invalid="ignore"):  # what did not stay finite is refused in the end
        excess = _ESTIMATE * results[..., 4] / (tolerance * results[..., 0])
    good = ~(excess > 1) | (stride == 1)
    halvings = np.ceil(0.5 * np.log2(np.where(good, 1.0, excess)))
    return np.where(good, 0, np.maximum(1, stride // 2**halvings)).astype(np.int64)
