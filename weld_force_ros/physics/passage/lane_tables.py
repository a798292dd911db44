"""Tables of many speeds, any eight of which are put side by side for a place: few passages out of many.

`PeakMapSolver` simulates every speed at every place. Here each place has its own eight speeds, and what shares the
lanes are four samples of one weld, so that a register is filled by what is wanted alone. All passages are in the
longest stride: what that leaves out is in the batches of `weld_force_ros.physics.passage.peak_map` held to a tolerance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _simd_passage
from weld_force_ros.physics.passage._contact import Filters
from weld_force_ros.physics.passage._sampled_path import sampled_locally
from weld_force_ros.physics.passage._simd import LANES, QUARTER, SPEEDS
from weld_force_ros.physics.passage.batch import (
    SmoothExtremes,
    column_count,
    negligible_n,
    speed_tables,
    with_filters_later,
)
from weld_force_ros.physics.passage.lowpass import CUTOFFS_HZ, LowPass, low_pass
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver

AT_ONCE = QUARTER
"""Speeds that a place has."""

SpeedChoice = NDArray[np.intp]
_SAMPLES = LANES // AT_ONCE  # that share the lanes
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
        self._extremes = SmoothExtremes.of(solver, self._smooth_n, self._stride)
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

    def peaks(self, places: Places, samples: NDArray[np.intp], speeds: SpeedChoice, *, low_passed: bool) -> PeakMap:
        """Simulate some samples at every place, at the speeds of that place.

        Args:
            places: where, and over what.
            samples: (n_sample,), which of the places' samples.
            speeds: (n_place, AT_ONCE), indices of the table's speeds.
            low_passed: also the greatest forces through filters, which takes twice the time.

        Returns:
            Each (n_sample, n_place, AT_ONCE); `peak_x_m` in steps from the start.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        filters = self._filters[CUTOFFS_HZ if low_passed else ()]
        count = len(speeds)
        results = np.empty((-(-len(samples) // _SAMPLES) * count, LANES, column_count(filters)))
        _simd_passage.peaks_in_lanes(
            self._lanes(places, samples, speeds),
            self._blocks(speeds),
            _filter_blocks(filters, speeds),
            self._solver.physics,
            negligible_n(self._solver),
            results,
        )
        # The last sample fills what lanes are left.
        in_lanes = results.reshape(-1, count, _SAMPLES, AT_ONCE, results.shape[2]).transpose(0, 2, 1, 3, 4)
        found: FloatArray = in_lanes.reshape(-1, count, AT_ONCE, results.shape[2])[: len(samples)]
        if low_passed:
            found = self._with_later(filters, places, speeds, found)
        if self._extremes is not None:
            for place, (start, chosen) in enumerate(zip(places.starts, speeds, strict=True)):
                of_place, starts = found[:, place].transpose(1, 0, 2), np.full(len(found), start)
                self._extremes.added(self._solver, self._stride, starts, of_place, chosen)
        shown = np.concatenate([found[..., :_SHOWN], found[..., 6:]], axis=3)
        if not np.all(np.isfinite(shown)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        peak_n, steps, least_n, loss_s, *low = np.moveaxis(shown, 3, 0)
        return PeakMap(peak_n, steps, least_n, loss_s, np.stack(low) if low_passed else None)

    def _lanes(self, places: Places, samples: NDArray[np.intp], speeds: SpeedChoice) -> _simd_passage.PlacePairs:
        _, count, longest = places.irregularity_m.shape
        repeats = -(-len(samples) // _SAMPLES)
        own = samples[np.minimum(np.arange(repeats * _SAMPLES), len(samples) - 1)].reshape(repeats, 1, _SAMPLES)
        at = places.starts // self._solver.start_every % self._states.shape[1]
        initial = np.tile(self._states[speeds, at[:, None]].transpose(0, 2, 1), _SAMPLES)
        return _simd_passage.PlacePairs(
            speed_blocks=np.tile(np.arange(count), repeats),
            initial_states=np.tile(initial, (repeats, 1, 1)),
            starts=np.tile(np.repeat(places.starts[:, None] // self._stride, 2, axis=1), (repeats, 1)),
            ends=np.tile(np.repeat(places.ends[:, None], 2, axis=1), (repeats, 1)),
            irregularity_m=places.irregularity_m.reshape(-1, longest),
            rows=(own * count + np.arange(count)[:, None]).reshape(-1, _SAMPLES),
        )

    def _blocks(self, speeds: SpeedChoice) -> _simd_passage.SpeedBlocks:
        return _simd_passage.SpeedBlocks(
            decay=_in_lanes(self._decay, speeds),
            input_scale=_in_lanes(self._input_scale, speeds),
            drives=self._drives,
            gains=_in_half_the_lanes(self._gains, speeds),
            smooth_n=_in_half_the_lanes(self._smooth_n, speeds),
            windows=_in_lanes(self._windows, speeds),
            run_outs=_in_lanes(self._run_outs, speeds),
            dt_s=_in_lanes(self._dt_s, speeds),
            span=self._solver.span_grid // self._stride,
        )

    def _with_later(self, filters: LowPass, places: Places, speeds: SpeedChoice, found: FloatArray) -> FloatArray:
        """Return results (n_sample, n_place, AT_ONCE, n_shown) with what filters still show after the passages."""
        starts, parts = places.starts // self._stride, list[FloatArray]()
        for place, chosen in enumerate(speeds):
            at = np.full(len(found), starts[place])
            of_place = np.ascontiguousarray(found[:, place].transpose(1, 0, 2))
            parts.append(with_filters_later(filters, chosen, at, of_place))
        return np.stack(parts, axis=1).transpose(2, 1, 0, 3)


def _filter_blocks(filters: LowPass, speeds: SpeedChoice) -> Filters:
    return Filters(
        _in_lanes(filters.decay, speeds),
        _in_lanes(filters.shapes, speeds),
        _in_lanes(filters.gains, speeds),
        _in_half_the_lanes(filters.smooth_n, speeds),
        _in_lanes(filters.floors_n, speeds),
    )


def _in_half_the_lanes(table: NDArray[Any], speeds: SpeedChoice) -> NDArray[Any]:
    """Return a table (n_speed, ...) of the chosen speeds, for half of the samples: (n_place, ..., SPEEDS)."""
    return _side_by_side(table, np.tile(speeds, SPEEDS // AT_ONCE))


def _in_lanes(table: NDArray[Any], speeds: SpeedChoice) -> NDArray[Any]:
    """Return a table (n_speed, ...) of the chosen speeds, for all samples: (n_place, ..., LANES)."""
    return _side_by_side(table, np.tile(speeds, _SAMPLES))


def _side_by_side(table: NDArray[Any], speeds: SpeedChoice) -> NDArray[Any]:
    return np.ascontiguousarray(np.moveaxis(table[speeds], 1, -1))


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
