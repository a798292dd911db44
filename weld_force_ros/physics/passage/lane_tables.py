"""Tables of many speeds, any sixteen of which are put side by side for a place: few passages out of many.

`PeakMapSolver` simulates every speed at every place. Here each place has its own sixteen speeds, and the two welds that
share the lanes are two samples of one, so that a register is filled by what is wanted alone. All passages are in the
longest stride: what that leaves out is in the batches of `weld_force_ros.physics.passage.peak_map` held to a tolerance.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _simd_passage
from weld_force_ros.physics.passage._contact import Filters
from weld_force_ros.physics.passage._sampled_path import sampled_locally
from weld_force_ros.physics.passage._simd import SPEEDS
from weld_force_ros.physics.passage.batch import column_count, negligible_n, speed_tables, with_filters_later
from weld_force_ros.physics.passage.lowpass import CUTOFFS_HZ, LowPass, low_pass
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver

SpeedChoice = NDArray[np.intp]
_SHOWN = 4  # of the six results of a passage that are shown, before those of filters


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

    def of(self, samples: NDArray[np.intp]) -> "Places":
        """Return the places of some samples."""
        return Places(self.starts, self.ends, self.irregularity_m[samples])


class LaneTables:
    """The tables of a wheel on a track at many speeds, in one stride; about 40 kB a speed.

    Args:
        solver: of the wheel on the track.
        speeds_kmh: (n_speed,), for which the longest stride serves.
    """

    def __init__(self, solver: SteadyStateSolver, speeds_kmh: FloatArray) -> None:
        self._solver, self._stride = solver, solver.longest_stride
        tables = [speed_tables(solver, self._stride, speed) for speed in speeds_kmh.tolist()]
        steps = [table.steady_state.step for table in tables]
        self._drives = steps[0].drives
        self._decay = np.stack([step.decay for step in steps])
        self._input_scale = np.stack([step.input_scale for step in steps])
        self._gains = np.stack([step.gains for step in steps])
        self._smooth_n = np.stack([table.steady_state.smooth_n for table in tables])
        self._states = np.stack([table.steady_state.states for table in tables])
        self._windows = np.array([table.window for table in tables])
        self._run_outs = np.array([table.run_out for table in tables])
        self._dt_s = np.array([table.steady_state.dt_s for table in tables])
        steady_states = [table.steady_state for table in tables]
        self._filters = {wanted: low_pass(steady_states, solver.wheel.mass_kg, wanted) for wanted in ((), CUTOFFS_HZ)}

    @property
    def size_bytes(self) -> int:
        """Return what the tables take of memory."""
        arrays: list[Any] = [array for filters in self._filters.values() for array in filters]
        return sum(array.nbytes for array in [*arrays, *(v for v in vars(self).values() if hasattr(v, "nbytes"))])

    def peaks(self, places: Places, speeds: SpeedChoice, *, low_passed: bool) -> PeakMap:
        """Simulate every sample at every place, at the speeds of that place.

        Args:
            places: where, and over what.
            speeds: (n_place, SPEEDS), indices of the table's speeds.
            low_passed: also the greatest forces through filters, which takes twice the time.

        Returns:
            Each (n_sample, n_place, SPEEDS); `peak_x_m` in steps from the start.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        filters = self._filters[CUTOFFS_HZ if low_passed else ()]
        samples, count = places.irregularity_m.shape[0], len(speeds)
        results = np.empty(((samples + 1) // 2 * count, 2 * SPEEDS, column_count(filters)))
        _simd_passage.peaks_in_lanes(
            self._pairs(places, speeds),
            self._blocks(speeds),
            _filter_blocks(filters, speeds),
            self._solver.physics,
            negligible_n(self._solver),
            results,
        )
        # (n_pair, n_place, 2, SPEEDS, n_column), with an odd number of samples the last one twice
        found = results.reshape(-1, count, 2, SPEEDS, results.shape[2]).transpose(0, 2, 1, 3, 4)
        found = found.reshape(-1, count, SPEEDS, results.shape[2])[:samples]
        if low_passed:
            found = self._with_later(filters, places, speeds, found)
        shown = np.concatenate([found[..., :_SHOWN], found[..., 6:]], axis=3)
        if not np.all(np.isfinite(shown)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        peak_n, steps, least_n, loss_s, *low = np.moveaxis(shown, 3, 0)
        return PeakMap(peak_n, steps, least_n, loss_s, np.stack(low) if low_passed else None)

    def _pairs(self, places: Places, speeds: SpeedChoice) -> _simd_passage.PlacePairs:
        samples, count, longest = places.irregularity_m.shape
        padded = np.concatenate([places.irregularity_m, places.irregularity_m[-1:]])[: samples + samples % 2]
        irregularity = padded.reshape(-1, 2, count, longest).transpose(0, 2, 1, 3).reshape(-1, 2, longest)
        at = places.starts // self._solver.longest_stride % self._states.shape[1]
        initial = np.repeat(self._states[speeds, at[:, None]].transpose(0, 2, 1)[:, :, None], 2, axis=2)
        repeats = len(irregularity) // count
        return _simd_passage.PlacePairs(
            speed_blocks=np.tile(np.arange(count), repeats),
            initial_states=np.tile(initial.reshape(count, -1, 2 * SPEEDS), (repeats, 1, 1)),
            starts=np.tile(np.repeat(places.starts[:, None] // self._stride, 2, axis=1), (repeats, 1)),
            ends=np.tile(np.repeat(places.ends[:, None], 2, axis=1), (repeats, 1)),
            irregularity_m=np.ascontiguousarray(irregularity),  # one layout for all callers: compiled once
        )

    def _blocks(self, speeds: SpeedChoice) -> _simd_passage.SpeedBlocks:
        return _simd_passage.SpeedBlocks(
            decay=_twice(self._decay, speeds),
            input_scale=_twice(self._input_scale, speeds),
            drives=self._drives,
            gains=_side_by_side(self._gains, speeds),
            smooth_n=_side_by_side(self._smooth_n, speeds),
            windows=_twice(self._windows, speeds),
            run_outs=_twice(self._run_outs, speeds),
            dt_s=_twice(self._dt_s, speeds),
        )

    def _with_later(self, filters: LowPass, places: Places, speeds: SpeedChoice, found: FloatArray) -> FloatArray:
        """Return results (n_sample, n_place, SPEEDS, n_shown) with what filters still show after the passages."""
        starts, parts = places.starts // self._stride, list[FloatArray]()
        for place, chosen in enumerate(speeds):
            own = LowPass(*(array[chosen] for array in filters))
            at = np.full(len(found), starts[place])
            parts.append(with_filters_later(own, at, np.ascontiguousarray(found[:, place].transpose(1, 0, 2))))
        return np.stack(parts, axis=1).transpose(2, 1, 0, 3)


def _filter_blocks(filters: LowPass, speeds: SpeedChoice) -> Filters:
    return Filters(
        _twice(filters.decay, speeds),
        _twice(filters.shapes, speeds),
        _twice(filters.gains, speeds),
        _side_by_side(filters.smooth_n, speeds),
        _twice(filters.floors_n, speeds),
    )


def _side_by_side(table: NDArray[Any], speeds: SpeedChoice) -> NDArray[Any]:
    """Return a table (n_speed, ...) of the chosen speeds, (n_place, ..., SPEEDS)."""
    return np.ascontiguousarray(np.moveaxis(table[speeds], 1, -1))


def _twice(table: NDArray[Any], speeds: SpeedChoice) -> NDArray[Any]:
    """Return a table (n_speed, ...) of the chosen speeds, for either weld of a pair: (n_place, ..., 2 SPEEDS)."""
    return _side_by_side(table, np.concatenate([speeds, speeds], axis=1))


def places_over(
    solver: SteadyStateSolver, paths_m: FloatArray, start_m: float, step_m: float, positions_m: FloatArray
) -> Places:
    """Return passages over several wheel paths, which share their samples' places.

    Args:
        solver: with the grid of the span.
        paths_m: (n_sample, n), heights of the wheel's centre, zero at both ends.
        start_m: of the first height, from the weld's centre.
        step_m: between heights.
        positions_m: (n_place,), the weld's centre after the sleeper.
    """
    uneven = np.flatnonzero(paths_m.any(axis=0))
    first, last = (max(0, uneven[0] - 1), uneven[-1] + 1) if len(uneven) else (0, 0)
    starts = np.array([solver.start(position + start_m + step_m * first) for position in positions_m])
    long_m = solver.longest_stride * solver.grid_m
    from_m = starts * solver.grid_m - positions_m
    ends = np.ceil((start_m + step_m * last - from_m) / long_m).astype(np.int64)
    heights = np.empty((len(paths_m), len(positions_m), int(ends.max()) + 1))
    sampled_locally(paths_m, step_m, from_m - start_m, long_m, heights)
    return Places(starts, ends, -heights)
