"""A wheel that has rolled on smooth rail for ever: the state that every passage begins in, speed by speed.

From rest (static deflection) it is rolled span by span until the force repeats. All passages of a speed share that.
"""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _kernel
from weld_force_ros.physics.passage.state_space import Propagation, StateModel
from weld_force_ros.physics.passage.wheel import Wheel

GRID_M = 0.25e-3
LONGEST_STEP_M = 2e-3
LONGEST_STEP_S = 400e-6
_SETTLED = 1e-5  # of the static load
_MOST_SPANS = 1000


@dataclass(frozen=True)
class SteadyState:
    """A speed in steps of `stride` points of the grid.

    Attributes:
        stride: points of the grid a step.
        dt_s: duration of a step.
        step: how the rail's states move on.
        states: (n_start, n_state + 3) on smooth rail at every point that a passage may begin at: rail states,
            displacement, velocity and force of the wheel.
        smooth_n: (n_grid,), force on smooth rail at every step of the span.
        smooth_wheel: (n_grid, 3), wheel on smooth rail at every step: displacement, velocity, force.
    """

    stride: int
    dt_s: float
    step: Propagation
    states: FloatArray
    smooth_n: FloatArray
    smooth_wheel: FloatArray


class SteadyStateSolver:
    """A wheel on a fitted track with a grid of contact points over the span."""

    def __init__(self, model: StateModel, wheel: Wheel) -> None:
        self.model = model
        self.wheel = wheel
        # A whole number of the longest stride, so that every stride closes the span.
        self.longest_stride = round(LONGEST_STEP_M / GRID_M)
        self.grid = self.longest_stride * max(1, round(model.spacing_m / GRID_M / self.longest_stride))
        self.grid_m = model.spacing_m / self.grid
        self.physics = np.array([wheel.mass_kg, wheel.static_load_n, wheel.hertz_n_per_m15])

    def start(self, first_m: float) -> int:
        """The grid point, one that every stride meets, at or before a place."""
        return self.longest_stride * int(np.floor(first_m / (self.longest_stride * self.grid_m)))

    def steps(self, stride: int, length_m: float) -> int:
        """Steps that cover a length."""
        return int(np.ceil(length_m / (stride * self.grid_m)))

    def coarsest_stride(self, speed_kmh: float) -> int:
        """The longest stride whose step is short enough in time, or 1."""
        stride = self.longest_stride
        while stride > 1 and stride * self.grid_m > LONGEST_STEP_S * speed_kmh / 3.6:
            stride //= 2
        return stride

    def steady_state(self, speed_kmh: float, stride: int) -> SteadyState:
        """The state over smooth rail at a speed.

        Raises:
            NumericalError: the force does not settle.
        """
        step_m = stride * self.grid_m
        dt = step_m / (speed_kmh / 3.6)
        step = self.model.propagation(step_m * np.arange(self.grid // stride), dt)
        rail, wheel = self._at_rest(step)
        states = np.empty((self.grid // stride, len(rail) + 3))
        spans = _kernel.settle_to_periodic(
            rail, wheel, step.decay, step.transitions, step.drives, step.shapes, step.gains, self.physics, dt,
            _SETTLED * self.wheel.static_load_n, _MOST_SPANS, states,
        )  # fmt: skip
        if spans < 0:
            raise NumericalError(f"the force on smooth rail does not settle at {speed_kmh:g} km/h; fit the track anew")
        starts = states[:: self.longest_stride // stride].copy()
        return SteadyState(stride, dt, step, starts, states[:, -1].copy(), states[:, -3:].copy())

    def initial_state(self, steady_state: SteadyState, start: int) -> FloatArray:
        """State at a start, (n_state + 3,)."""
        return np.array(steady_state.states[start // self.longest_stride % len(steady_state.states)])

    def _at_rest(self, step: Propagation) -> tuple[FloatArray, FloatArray]:
        """Static state over the sleeper: rail states, and displacement, velocity and force of the wheel."""
        load = self.wheel.static_load_n
        rail = step.at_rest * load
        deflection = float(step.shapes[0] @ rail + step.gains[0] * load)
        return rail, np.array([deflection + self.wheel.static_indentation_m, 0.0, load])
