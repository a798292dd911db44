"""Passages of a wheel over a weld: validate, allocate, call the kernel, turn its status into errors.

A passage starts just before the weld in the state of a wheel that has rolled on smooth rail for ever: from rest
(static deflection) it is rolled span by span until the force repeats. All passages of a speed share that approach.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from weld_force_ros.core import _kernel
from weld_force_ros.core._vector import LANES
from weld_force_ros.core.propagation import Propagation, StateModel
from weld_force_ros.core.track import Complex, Real
from weld_force_ros.core.weld import Trajectory
from weld_force_ros.errors import InputError, NumericalError

GRID_M = 0.25e-3
LONGEST_STEP_S = 100e-6
LONGEST_STEP_M = 0.5e-3
RUN_OUT_S = 0.08
_SETTLED = 1e-5  # of the static load
_MOST_SPANS = 1000
_MOST_REMEMBERED = 24  # some 10 MB each
# Lanes exist in compiled code only; without compilation (NUMBA_DISABLE_JIT) passages roll one after the other.
SIDE_BY_SIDE = not numba.config.DISABLE_JIT


@dataclass(frozen=True)
class Wheel:
    """Half a wheelset as a lumped mass under its static load, and its contact: eq. (4) and (5) of the paper."""

    mass_kg: float
    static_load_n: float
    radius_m: float
    hertz_n_per_m15: float

    @property
    def static_indentation_m(self) -> float:
        """Approach of wheel and rail at rest."""
        return float((self.static_load_n / self.hertz_n_per_m15) ** (2 / 3))

    @property
    def contact_stiffness_n_per_m(self) -> float:
        """Slope of the Hertz law at the static load."""
        return float(1.5 * self.hertz_n_per_m15 ** (2 / 3) * self.static_load_n ** (1 / 3))

    def compliance(self, omega: Real) -> Complex:
        """Contact spring and free wheel in series with the track as an irregularity meets them, m/N."""
        return np.asarray(1 / self.contact_stiffness_n_per_m - 1 / (self.mass_kg * omega**2), dtype=np.complex128)


@dataclass(frozen=True)
class Surface:
    """Results over speed and position, each (n_speed, n_position)."""

    peak_force_n: Real
    peak_x_m: Real
    min_force_n: Real
    contact_loss_s: Real


@dataclass(frozen=True)
class History:
    """One passage, each (n,): x from the sleeper before the weld, displacements positive up."""

    x_m: Real
    force_n: Real
    wheel_m: Real
    rail_m: Real
    irregularity_m: Real


@dataclass(frozen=True)
class Start:
    """Where and how a passage begins: for another solver to take over.

    Attributes:
        x_m: from the sleeper before the weld.
        last_m: where the passage ends.
        dt_s: the kernel's step, which its rail states depend on.
        rail: (n_state,), as `weld_force_ros.core.propagation` defines them.
        wheel: displacement, velocity and force, positive down.
    """

    x_m: float
    last_m: float
    dt_s: float
    rail: Real
    wheel: Real


@dataclass(frozen=True)
class _Rolling:
    """What the kernel needs for one speed: a grid of every `stride`-th point, its step, and the state over smooth rail.

    `states` (n_grid, n_state + 3): rail states, displacement, velocity and force of the wheel.
    """

    stride: int
    dt: float
    step: Propagation
    states: Real


class _Batch:
    """Up to `LANES` speeds of one stride, their tables interleaved lane by lane; a lane that is left over repeats one.

    `drives` is None where transitions are dense or nothing is compiled: those roll one speed after the other.
    """

    def __init__(self, rollings: list[_Rolling], speeds: tuple[float, ...]) -> None:
        self.rollings, self.speeds = rollings, speeds
        self._lanes = rollings + [rollings[-1]] * (LANES - len(rollings))
        self.drives: Real | None = None
        if SIDE_BY_SIDE and not len(rollings[0].step.transitions):
            self.decay = self._interleaved([r.step.decay for r in self._lanes])
            self.drives = self._interleaved([r.step.drives for r in self._lanes])
            self.gains = self._interleaved([r.step.gains for r in self._lanes])
            self.dts = np.array([r.dt for r in self._lanes])

    def beginnings(self, starts: NDArray[np.int64]) -> Real:
        """States at grid points, (n_start, n_state + 3, n_lane)."""
        return self._interleaved([r.states[starts % len(r.states)] for r in self._lanes])

    @staticmethod
    def _interleaved(arrays: list[Real]) -> Real:
        return np.ascontiguousarray(np.stack(arrays, axis=-1))


class Rig:
    """A wheel on a fitted track, ready to roll."""

    def __init__(self, model: StateModel, wheel: Wheel) -> None:
        self.model = model
        self.wheel = wheel
        # A whole number of the longest stride, so that every stride closes the span.
        self.longest_stride = round(LONGEST_STEP_M / GRID_M)
        self.grid = self.longest_stride * round(model.spacing_m / GRID_M / self.longest_stride)
        self.grid_m = model.spacing_m / self.grid
        self.physics = np.array([wheel.mass_kg, wheel.static_load_n, wheel.hertz_n_per_m15])
        self._remembered: dict[tuple[float, ...], _Batch] = {}

    def surface(
        self,
        trajectory: Trajectory,
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        on_speed: Callable[[], None] | None = None,
    ) -> Surface:
        """Peak force, its place, least force and contact loss of every passage.

        Args:
            trajectory: the wheel centre's trajectory over the weld.
            speeds_kmh: (n_speed,), positive.
            positions_m: (n_position,), the weld's centre after the sleeper.
            on_speed: called after each speed, from a worker thread.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        speeds, positions = checked_speeds(speeds_kmh), checked_axis("position", positions_m)
        results = np.empty((len(speeds), len(positions), 4))
        starts = np.array([self._start(p + trajectory.start_m) for p in positions])
        irregularities = np.stack(
            [self._irregularity(trajectory, start, p) for start, p in zip(starts, positions, strict=True)]
        )
        batches = self._batches(speeds)

        def roll(task: tuple[NDArray[np.int64], slice]) -> None:
            rows, some = task
            batch = self._batch(tuple(speeds[rows]))
            ends_m = positions[some] + trajectory.end_m
            results[rows, some] = self._peaks(batch, starts[some], ends_m, irregularities[some])
            if on_speed and some.stop is None:
                for _ in rows:
                    on_speed()

        middle = len(positions) // 2
        halves = [slice(0, middle), slice(middle, None)] if middle else [slice(None)]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(lambda rows: self._batch(tuple(speeds[rows])), batches))
            list(pool.map(roll, [(rows, some) for rows in batches for some in halves]))
        if not np.all(np.isfinite(results)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        return Surface(*np.moveaxis(results, 2, 0))

    def history(self, trajectory: Trajectory, speed_kmh: float, position_m: float, *, until_m: float = 0.0) -> History:
        """One passage in the space domain, from a span before the weld to a span after it, or to `until_m` if later.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        speed_kmh, position_m = float(checked_speeds(speed_kmh)[0]), float(checked_axis("position", position_m)[0])
        rolling = self._rolling(speed_kmh)
        span = self.model.spacing_m
        start = self._start(position_m + trajectory.start_m - span)
        steps = self._steps(rolling.stride, start, max(position_m + trajectory.end_m + span, until_m))
        x = (start + rolling.stride * np.arange(steps)) * self.grid_m
        irregularity = trajectory.at(x - position_m)
        rail, wheel = self._state(rolling, start)
        result = np.empty((steps, 3))
        step = rolling.step
        _kernel.history_of_passage(
            rail, wheel, step.decay, step.transitions, step.drives, step.shapes, step.gains, start // rolling.stride,
            -irregularity, self.physics, rolling.dt, result,
        )  # fmt: skip
        if not np.all(np.isfinite(result)):
            raise NumericalError("the passage did not stay finite; the fit of this track cannot be used at that speed")
        return History(x, result[:, 0], -result[:, 1], -result[:, 2], irregularity)

    def start(self, trajectory: Trajectory, speed_kmh: float, position_m: float) -> Start:
        """The state in which a passage of `surface` begins, in the kernel's own scaling."""
        rolling = self._rolling(speed_kmh)
        first = self._start(position_m + trajectory.start_m)
        rail, wheel = self._state(rolling, first)
        last_m = position_m + trajectory.end_m + run_out_m(self.model.spacing_m, speed_kmh)
        return Start(first * self.grid_m, last_m, rolling.dt, rail, wheel)

    def _batches(self, speeds: Real) -> list[NDArray[np.int64]]:
        """Rows of speeds that share a stride, neighbours together, slow ones first as they take the most steps."""
        order = np.argsort(speeds)
        strides = np.array([self._stride(speed) for speed in speeds[order]])
        groups = [order[strides == stride] for stride in np.unique(strides)]
        return [group[k : k + LANES] for group in groups for k in range(0, len(group), LANES)]

    def _batch(self, speeds: tuple[float, ...]) -> _Batch:
        """A batch's tables, remembered: the next weld is likely to be rolled over at the same speeds."""
        batch = self._remembered.get(speeds)
        if batch is None:
            batch = _Batch([self._rolling(speed) for speed in speeds], speeds)
            if len(self._remembered) >= _MOST_REMEMBERED:
                self._remembered.clear()  # another thread may be at it too: nothing is looked up twice
            self._remembered[speeds] = batch
        return batch

    def _peaks(self, batch: _Batch, starts: NDArray[np.int64], ends_m: Real, irregularities: Real) -> Real:
        """(n_speed, n_position, 4) of a batch."""
        stride = batch.rollings[0].stride
        steps = np.array(
            [
                [self._steps(stride, start, end + run_out_m(self.model.spacing_m, speed)) for speed in batch.speeds]
                for start, end in zip(starts, ends_m, strict=True)
            ]
        )
        results = np.empty((len(starts), len(batch.speeds), 4))
        begin = starts // stride
        if batch.drives is None:
            for column, rolling in enumerate(batch.rollings):
                step, own = rolling.step, np.empty((len(starts), 4))
                _kernel.peaks_at_speed(
                    rolling.states, step.decay, step.transitions, step.drives, step.shapes, step.gains, begin,
                    steps[:, column].copy(), irregularities, stride, self.physics, rolling.dt, own,
                )  # fmt: skip
                results[:, column] = own
        else:
            lanes = np.empty((len(starts), LANES, 4))
            spare = LANES - len(batch.speeds)
            _kernel.peaks_in_lanes(
                batch.beginnings(begin), batch.decay, batch.drives, batch.gains, begin,
                np.pad(steps, ((0, 0), (0, spare))), irregularities, stride, self.physics, batch.dts, lanes,
            )  # fmt: skip
            results = lanes[:, : len(batch.speeds)]
        results[:, :, 1] = (starts[:, None] + stride * results[:, :, 1]) * self.grid_m
        return results.transpose(1, 0, 2)

    def _start(self, first_m: float) -> int:
        """The grid point, one that every stride meets, at or before a place."""
        return self.longest_stride * int(np.floor(first_m / (self.longest_stride * self.grid_m)))

    def _steps(self, stride: int, start: int, last_m: float) -> int:
        """Points from a start to a place, both included."""
        return int(np.ceil((last_m - start * self.grid_m) / (stride * self.grid_m))) + 1

    def _irregularity(self, trajectory: Trajectory, start: int, position_m: float) -> Real:
        """What the kernel rolls over, from `start` to the weld's end: the paper's r, positive down."""
        points = int(np.ceil((trajectory.end_m - trajectory.start_m) / self.grid_m)) + self.longest_stride + 1
        return -trajectory.at((start + np.arange(points)) * self.grid_m - position_m)

    def _state(self, rolling: _Rolling, start: int) -> tuple[Real, Real]:
        state = rolling.states[(start // rolling.stride) % len(rolling.states)]
        return state[:-3].copy(), state[-3:].copy()

    def _stride(self, speed_kmh: float) -> int:
        stride = 1
        while 2 * stride <= self.longest_stride and 2 * stride * self.grid_m <= LONGEST_STEP_S * speed_kmh / 3.6:
            stride *= 2
        return stride

    def _rolling(self, speed_kmh: float) -> _Rolling:
        stride = self._stride(speed_kmh)
        dt = stride * self.grid_m / (speed_kmh / 3.6)
        step = self.model.propagation(stride * self.grid_m * np.arange(self.grid // stride), dt)
        rail, wheel = self.at_rest(step)
        states = np.empty((self.grid // stride, len(rail) + 3))
        spans = _kernel.approach(
            rail, wheel, step.decay, step.transitions, step.drives, step.shapes, step.gains, self.physics, dt,
            _SETTLED * self.wheel.static_load_n, _MOST_SPANS, states,
        )  # fmt: skip
        if spans < 0:
            raise NumericalError(f"the force on smooth rail does not settle at {speed_kmh:g} km/h; fit the track anew")
        return _Rolling(stride, dt, step, states)

    def at_rest(self, step: Propagation) -> tuple[Real, Real]:
        """Static state over the sleeper: rail states, and displacement, velocity and force of the wheel."""
        load = self.wheel.static_load_n
        rail = step.at_rest * load
        deflection = float(step.shapes[0] @ rail + step.gains[0] * load)
        return rail, np.array([deflection + self.wheel.static_indentation_m, 0.0, load])


def run_out_m(span_m: float, speed_kmh: float) -> float:
    """Until the weld's echo has passed; at least a span, so that every window holds the smooth rail's own peak."""
    return max(span_m, RUN_OUT_S * speed_kmh / 3.6)


def checked_speeds(values: ArrayLike) -> Real:
    """Speeds in km/h as an array, or an InputError."""
    speeds = checked_axis("speed", values)
    if np.any(speeds <= 0):
        raise InputError("a speed is not positive", "give speeds in km/h above 0")
    return speeds


def checked_axis(name: str, values: ArrayLike) -> Real:
    """One or more finite numbers as an array, or an InputError."""
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise InputError(f"a {name} is missing or not finite", f"give at least one {name} as a number")
    return array
