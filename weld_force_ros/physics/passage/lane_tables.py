"""Tables of a wheel on a track at many speeds of one stride, of which any eight are put side by side for a place.

A speed's tables are made when the first passage asks for that speed, and kept.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _simd_passage
from weld_force_ros.physics.passage._contact import Filters
from weld_force_ros.physics.passage._simd import LANES, PLACES, SPEEDS
from weld_force_ros.physics.passage.kept_rows import KeptRows
from weld_force_ros.physics.passage.lowpass import CUTOFFS_HZ, LowPass, low_pass, result_columns, with_filters
from weld_force_ros.physics.passage.speed_tables import SmoothExtremes, SpeedTables, negligible_n, speed_tables
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver

SpeedChoice = NDArray[np.intp]
_FILTERS: tuple[tuple[float, ...], ...] = ((), CUTOFFS_HZ)


@dataclass(frozen=True)
class PlacedSpeeds:
    """Eight speeds each at a place.

    Attributes:
        speeds: (n, SPEEDS), indices of the tables' speeds.
        starts: (n,), points of the grid where the passages begin.
        ends: (n,), steps from there until the weld is behind.
        irregularity_m: (n_row, n_step), step by step from the start, positive down.
        rows: (n,), of the irregularity.
    """

    speeds: SpeedChoice
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    irregularity_m: FloatArray
    rows: NDArray[np.intp]


class _Rows(NamedTuple):
    """Tables with a row a speed, of what `SpeedTables` and its steady state hold."""

    decay: FloatArray
    input_scale: FloatArray
    gains: FloatArray
    smooth_n: FloatArray
    smooth_wheel: FloatArray
    states: FloatArray
    windows: NDArray[np.int64]
    run_outs: NDArray[np.int64]
    dt_s: FloatArray

    @classmethod
    def of(cls, tables: Sequence[SpeedTables]) -> "_Rows":
        steady_states = [table.steady_state for table in tables]
        return cls(
            decay=np.stack([one.step.decay for one in steady_states]),
            input_scale=np.stack([one.step.input_scale for one in steady_states]),
            gains=np.stack([one.step.gains for one in steady_states]),
            smooth_n=np.stack([one.smooth_n for one in steady_states]),
            smooth_wheel=np.stack([one.smooth_wheel for one in steady_states]),
            states=np.stack([one.states for one in steady_states]),
            windows=np.array([table.window for table in tables]),
            run_outs=np.array([table.run_out for table in tables]),
            dt_s=np.array([one.dt_s for one in steady_states]),
        )


class LaneTables:
    """The tables of a wheel on a track at many speeds, in steps of one stride; about 100 kB a speed in the longest.

    Args:
        solver: of the wheel on the track, whose states come in pairs.
        speeds_kmh: (n_speed,).
        stride: points of the grid a step.
    """

    def __init__(self, solver: SteadyStateSolver, speeds_kmh: FloatArray, stride: int) -> None:
        self.solver, self.stride, self._speeds_kmh = solver, stride, speeds_kmh
        self._rows = KeptRows(len(speeds_kmh), self._make)
        self._filters = {wanted: KeptRows(len(speeds_kmh), partial(self._low_pass, wanted)) for wanted in _FILTERS}
        self._extremes = None if solver.model.uniform else KeptRows(len(speeds_kmh), self._smooth_extremes)

    @property
    def size_bytes(self) -> int:
        """Return what the tables take of memory."""
        filters = sum(kept.size_bytes for kept in self._filters.values())
        return self._rows.size_bytes + filters + (0 if self._extremes is None else self._extremes.size_bytes)

    def make(self, speeds: SpeedChoice, pool: Executor) -> None:
        """Make the tables of some speeds side by side.

        Raises:
            NumericalError: the force on smooth rail does not settle.
        """
        self._rows.of(speeds, pool.map)

    def simulate(self, octets: PlacedSpeeds, cutoffs_hz: tuple[float, ...] = ()) -> FloatArray:
        """Simulate eight speeds at each place: (n, SPEEDS, 6 + n_filter), as `Batch.peaks` returns them.

        Raises:
            NumericalError: the force on smooth rail does not settle.
        """
        count, speeds = len(octets.speeds), octets.speeds
        rows, filters = self._rows.of(speeds), self._filters[cutoffs_hz].of(speeds)
        filled = np.append(np.arange(count), np.full(-count % PLACES, count - 1))
        results = np.empty((len(filled), SPEEDS, result_columns(filters)))
        _simd_passage.peaks_in_lanes(
            _simd_passage.Octets(
                speeds=speeds[filled],
                initial_states=self._initial_states(rows, octets, filled),
                starts=octets.starts[filled] // self.stride,
                ends=octets.ends[filled],
                irregularity_m=octets.irregularity_m,
                rows=octets.rows[filled],
            ),
            self._speed_rows(rows),
            Filters(filters.decay, filters.shapes, filters.gains, filters.smooth_n, filters.floors_n),
            self.solver.physics,
            negligible_n(self.solver),
            results,
        )
        passages, starts = results[:count].reshape(count * SPEEDS, -1), np.repeat(octets.starts, SPEEDS)
        found = with_filters(filters, rows.smooth_wheel, speeds.ravel(), starts // self.stride, passages)
        if self._extremes is not None:
            extremes = self._extremes.of(speeds)
            extremes.add_to(found, self.solver, self.stride, speeds.ravel(), starts)
        return found.reshape(count, SPEEDS, -1)

    def _make(self, speeds: SpeedChoice, run: Callable[..., Iterable[SpeedTables]]) -> _Rows:
        return _Rows.of(list(run(partial(speed_tables, self.solver, self.stride), self._speeds_kmh[speeds].tolist())))

    def _low_pass(self, cutoffs_hz: tuple[float, ...], speeds: SpeedChoice, _: object) -> LowPass:
        rows = self._rows.of(speeds)
        return low_pass(rows.dt_s[speeds], rows.smooth_wheel[speeds], self.solver.wheel.mass_kg, cutoffs_hz)

    def _smooth_extremes(self, speeds: SpeedChoice, _: object) -> SmoothExtremes:
        return SmoothExtremes.of(self.solver, self.stride, self._rows.of(speeds).smooth_n[speeds])

    def _initial_states(self, rows: _Rows, octets: PlacedSpeeds, filled: NDArray[np.intp]) -> FloatArray:
        """Return (n / PLACES, n_state + 3, LANES)."""
        at = octets.starts // self.solver.start_every % rows.states.shape[1]
        states = rows.states[octets.speeds, at[:, None]][filled].reshape(-1, LANES, rows.states.shape[2])
        return np.ascontiguousarray(states.transpose(0, 2, 1))

    def _speed_rows(self, rows: _Rows) -> _simd_passage.SpeedRows:
        return _simd_passage.SpeedRows(
            decay=rows.decay,
            input_scale=rows.input_scale,
            drives=self.solver.drives(self.stride),
            gains=rows.gains,
            smooth_n=rows.smooth_n,
            windows=rows.windows,
            run_outs=rows.run_outs,
            dt_s=rows.dt_s,
            span=self.solver.span_grid // self.stride,
        )
