"""The periodic state of a wheel on smooth rail, in which every passage begins, speed by speed.

From rest (static deflection) the wheel passes period after period of the track until the force repeats. All passages
of a speed share that state.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _scalar_passage
from weld_force_ros.physics.passage.state_space import Propagation, StateModel
from weld_force_ros.physics.passage.wheel import Wheel

GRID_M = 0.25e-3
LONGEST_STEP_M = 2e-3
LONGEST_STEP_S = 400e-6
_SETTLED = 1e-5  # of the static load
_MOST_PERIODS = 1000
_WINDOW_STRIDES = 25  # 50 mm


@dataclass(frozen=True)
class SteadyState:
    """A speed in steps of `stride` points of the grid.

    Attributes:
        stride: points of the grid a step.
        dt_s: duration of a step.
        step: how the rail's states move on.
        states: (n_start, n_state + 3) on smooth rail at every point that a passage may begin at: rail states,
            displacement, velocity and force of the wheel.
        smooth_n: (n_grid,), force on smooth rail at every step of the period.
        smooth_wheel: (n_grid, 3), wheel on smooth rail at every step: displacement, velocity, force.
    """

    stride: int
    dt_s: float
    step: Propagation
    states: FloatArray
    smooth_n: FloatArray
    smooth_wheel: FloatArray


class SteadyStateSolver:
    """Finds the periodic state of a wheel on a fitted track, with a grid of contact points over its period."""

    def __init__(self, model: StateModel, wheel: Wheel) -> None:
        self.model = model
        self.wheel = wheel
        # A whole number of the longest stride, so that every stride closes the span.
        self.longest_stride = round(LONGEST_STEP_M / GRID_M)
        self.span_grid = self.longest_stride * max(1, round(model.spacing_m / GRID_M / self.longest_stride))
        self.grid = self.span_grid * model.spans
        self.grid_m = model.spacing_m / self.span_grid
        # Passages may begin at every longest stride; over a window of spans at fewer places, as each takes a state.
        strides, most = self.grid // self.longest_stride, 1 if model.uniform else _WINDOW_STRIDES
        self.start_every = self.longest_stride * next(k for k in range(most, 0, -1) if strides % k == 0)
        self.physics = np.array([wheel.mass_kg, wheel.static_load_n, wheel.hertz_n_per_m15])
        self._some_step = cache(lambda stride: model.propagation(self._grid_m(stride), LONGEST_STEP_S))

    @property
    def is_dense(self) -> bool:
        """Return whether the rail's states do not come in pairs of their own."""
        return len(self._some_step(self.longest_stride).transitions) > 0

    def drives(self, stride: int) -> FloatArray:
        """Return the drives of states in pairs, which are those of all speeds: (n_grid, n_state)."""
        return np.asarray(self._some_step(stride).drives)

    def start(self, first_m: float) -> int:
        """Return the grid point, one that every stride meets, at or before a place."""
        return self.start_every * int(np.floor(first_m / (self.start_every * self.grid_m)))

    def steps(self, stride: int, length_m: float) -> int:
        """Return the number of steps that cover a length."""
        return int(np.ceil(length_m / (stride * self.grid_m)))

    def coarsest_stride(self, speed_kmh: float) -> int:
        """Return the longest stride whose step is short enough in time, or 1."""
        stride = self.longest_stride
        while stride > 1 and stride * self.grid_m > LONGEST_STEP_S * speed_kmh / 3.6:
            stride //= 2
        return stride

    def steady_state(self, speed_kmh: float, stride: int) -> SteadyState:
        """Return the periodic state on smooth rail at a speed.

        Raises:
            NumericalError: the force does not settle.
        """
        step_m = stride * self.grid_m
        dt = step_m / (speed_kmh / 3.6)
        step = self.model.propagation(self._grid_m(stride), dt)
        load = self.wheel.static_load_n
        # From static deflection over the sleeper.
        rail = step.at_rest * load
        deflection = float(step.shapes[0] @ rail + step.gains[0] * load)
        wheel = np.array([deflection + self.wheel.static_indentation_m, 0.0, load])
        states = np.empty((self.grid // stride, len(rail) + 3))
        spans = _scalar_passage.settle_to_periodic(
            rail, wheel, step, self.physics, dt, _SETTLED * load, _MOST_PERIODS, states
        )
        if spans < 0:
            raise NumericalError(f"the force on smooth rail does not settle at {speed_kmh:g} km/h; fit the track anew")
        starts = states[:: self.start_every // stride].copy()
        return SteadyState(stride, dt, step, starts, states[:, -1].copy(), states[:, -3:].copy())

    def _grid_m(self, stride: int) -> FloatArray:
        """Return the places of all steps of the period, (n_grid,)."""
        return stride * self.grid_m * np.arange(self.grid // stride)

    def initial_state(self, steady_state: SteadyState, start: int) -> FloatArray:
        """Return the state at a start, (n_state + 3,)."""
        return np.array(steady_state.states[start // self.start_every % len(steady_state.states)])
