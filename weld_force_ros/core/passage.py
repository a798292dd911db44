"""Passages of a wheel over a weld: validate, allocate, call the kernel, turn its status into errors.

A passage starts just before the weld in the state of a wheel that has rolled on smooth rail for ever: from rest
(static deflection) it is rolled span by span until the force repeats. All passages of a speed share that approach.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.core import _kernel
from weld_force_ros.core.poles import PoleModel
from weld_force_ros.core.track import Complex, Real
from weld_force_ros.core.weld import Trajectory
from weld_force_ros.errors import InputError, NumericalError

GRID_M = 0.25e-3
LONGEST_STEP_S = 50e-6
LONGEST_STEP_M = 0.5e-3
RUN_OUT_S = 0.08
_SETTLED = 1e-5  # of the static load
_MOST_SPANS = 1000


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
        state: (2 n + 2,): rail states (re, im), displacement and velocity of the wheel, positive down.
    """

    x_m: float
    last_m: float
    state: Real


@dataclass(frozen=True)
class _Rolling:
    """What the kernel needs for one speed."""

    stride: int
    dt: float
    coefficients: Real  # (6, n): decay (re, im), weight of the old force (re, im), of the new force (re, im)
    gains: Real  # (n_grid,): rail displacement per new force, within the step
    states: Real  # (n_grid // stride, 2 n + 3): the periodic state over smooth rail


class Rig:
    """A wheel on a fitted track, ready to roll."""

    def __init__(self, model: PoleModel, wheel: Wheel) -> None:
        self.model = model
        self.wheel = wheel
        # A whole number of the longest stride, so that every stride closes the span.
        strides = round(LONGEST_STEP_M / GRID_M)
        self.grid = strides * round(model.spacing_m / GRID_M / strides)
        self.grid_m = model.spacing_m / self.grid
        residues = model.residues_at(self.grid_m * np.arange(self.grid)) * model.pair_weight
        self.shapes = np.empty((self.grid, 2 * len(model.poles_rad_s)))
        self.shapes[:, 0::2] = residues.real
        self.shapes[:, 1::2] = -residues.imag
        self.physics = np.array([wheel.mass_kg, wheel.static_load_n, wheel.hertz_n_per_m15])

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
        speeds, positions = _speeds(speeds_kmh), _axis("position", positions_m)
        results = np.empty((len(speeds), len(positions), 4))

        def run(row: int) -> None:
            rolling = self._rolling(speeds[row])
            results[row] = self._peaks(rolling, trajectory, speeds[row], positions)
            if on_speed:
                on_speed()

        # Slow passages take the most steps: they go first, so that the threads end together.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(run, np.argsort(speeds)))
        if not np.all(np.isfinite(results)):
            raise NumericalError("a passage did not stay finite; the fit of this track cannot be used at that speed")
        return Surface(*np.moveaxis(results, 2, 0))

    def history(self, trajectory: Trajectory, speed_kmh: float, position_m: float, *, until_m: float = 0.0) -> History:
        """One passage in the space domain, from a span before the weld to a span after it, or to `until_m` if later.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        speed_kmh, position_m = float(_speeds(speed_kmh)[0]), float(_axis("position", position_m)[0])
        rolling = self._rolling(speed_kmh)
        span = self.model.spacing_m
        first_m = position_m + trajectory.start_m - span
        start, steps = self._window(rolling, first_m, max(position_m + trajectory.end_m + span, until_m))
        x = (start + rolling.stride * np.arange(steps)) * self.grid_m
        irregularity = trajectory.at(x - position_m)
        rail, wheel = self._state(rolling, start)
        result = np.empty((steps, 3))
        _kernel.history_of_passage(
            rail, wheel, self.shapes, rolling.gains, rolling.coefficients, start, rolling.stride, -irregularity,
            self.physics, rolling.dt, result,
        )  # fmt: skip
        if not np.all(np.isfinite(result)):
            raise NumericalError("the passage did not stay finite; the fit of this track cannot be used at that speed")
        return History(x, result[:, 0], -result[:, 1], -result[:, 2], irregularity)

    def start(self, trajectory: Trajectory, speed_kmh: float, position_m: float) -> Start:
        """The state in which a passage of `surface` begins."""
        rolling = self._rolling(speed_kmh)
        last_m = position_m + trajectory.end_m + self._run_out_m(speed_kmh)
        first, _ = self._window(rolling, position_m + trajectory.start_m, last_m)
        rail, wheel = self._state(rolling, first)
        return Start(first * self.grid_m, last_m, np.concatenate([rail, wheel[:2]]))

    def _run_out_m(self, speed_kmh: float) -> float:
        """Until the weld's echo has passed; at least a span, so that every window holds the smooth rail's own peak."""
        return max(self.model.spacing_m, RUN_OUT_S * speed_kmh / 3.6)

    def _peaks(self, rolling: _Rolling, trajectory: Trajectory, speed_kmh: float, positions: Real) -> Real:
        run_out_m = self._run_out_m(speed_kmh)
        windows = [self._window(rolling, p + trajectory.start_m, p + trajectory.end_m + run_out_m) for p in positions]
        starts = np.array([start for start, _ in windows])
        lengths = np.array([steps for _, steps in windows])
        index = starts[:, None] + rolling.stride * np.arange(lengths.max())[None, :]
        # The paper's r is positive down: this is where the sign turns.
        irregularities = -trajectory.at(index * self.grid_m - positions[:, None])
        results = np.empty((len(positions), 4))
        _kernel.peaks_at_speed(
            rolling.states, self.shapes, rolling.gains, rolling.coefficients, starts, lengths, rolling.stride,
            irregularities, self.physics, rolling.dt, results,
        )  # fmt: skip
        results[:, 1] = (starts + rolling.stride * results[:, 1]) * self.grid_m
        return results

    def _window(self, rolling: _Rolling, first_m: float, last_m: float) -> tuple[int, int]:
        """First grid point and number of points of a stretch of track, rounded outwards to whole steps."""
        step_m = rolling.stride * self.grid_m
        first = int(np.floor(first_m / step_m))
        return first * rolling.stride, int(np.ceil(last_m / step_m)) - first + 1

    def _state(self, rolling: _Rolling, start: int) -> tuple[Real, Real]:
        state = rolling.states[(start // rolling.stride) % len(rolling.states)]
        return state[:-3].copy(), state[-3:].copy()

    def _rolling(self, speed_kmh: float) -> _Rolling:
        speed = speed_kmh / 3.6
        stride = 1
        while 2 * stride * self.grid_m <= min(LONGEST_STEP_S * speed, LONGEST_STEP_M * (1 + 1e-9)):
            stride *= 2
        dt = stride * self.grid_m / speed
        coefficients = _first_order_hold(self.model.poles_rad_s, dt)
        new = np.empty(self.shapes.shape[1])
        new[0::2], new[1::2] = coefficients[4], coefficients[5]
        gains = self.shapes @ new
        rail, wheel = self.at_rest()
        states = np.empty((self.grid // stride, self.shapes.shape[1] + 3))
        spans = _kernel.approach(
            rail, wheel, self.shapes, gains, coefficients, stride, self.physics, dt,
            _SETTLED * self.wheel.static_load_n, _MOST_SPANS, states,
        )  # fmt: skip
        if spans < 0:
            raise NumericalError(f"the force on smooth rail does not settle at {speed_kmh:g} km/h; fit the track anew")
        return _Rolling(stride, dt, coefficients, gains, states)

    def at_rest(self) -> tuple[Real, Real]:
        """Static state over the sleeper: rail states, and displacement, velocity and force of the wheel."""
        rest = -self.wheel.static_load_n / self.model.poles_rad_s
        rail = np.empty(self.shapes.shape[1])
        rail[0::2], rail[1::2] = rest.real, rest.imag
        deflection = float(self.shapes[0] @ rail)
        return rail, np.array([deflection + self.wheel.static_indentation_m, 0.0, self.wheel.static_load_n])


def _speeds(values: ArrayLike) -> Real:
    speeds = _axis("speed", values)
    if np.any(speeds <= 0):
        raise InputError("a speed is not positive", "give speeds in km/h above 0")
    return speeds


def _axis(name: str, values: ArrayLike) -> Real:
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise InputError(f"a {name} is missing or not finite", f"give at least one {name} as a number")
    return array


def _first_order_hold(poles: Complex, dt: float) -> Real:
    """Exact step of q' = p q + f for f linear within dt: q1 = decay q0 + old f0 + new f1; (6, n) real and imaginary."""
    z = poles * dt
    decay = np.exp(z)
    # phi1 = (e^z - 1) / z and phi2 = (e^z - 1 - z) / z^2, by their series where the difference would cancel
    small = np.abs(z) < 0.05
    safe = np.where(small, 1.0, z)
    phi1 = np.where(small, 1 + z / 2 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6)))), np.expm1(safe) / safe)
    phi2 = np.where(
        small,
        0.5 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6 * (1 + z / 7))))),
        (np.expm1(safe) - safe) / safe**2,
    )
    old, new = dt * (phi1 - phi2), dt * phi2
    return np.stack([decay.real, decay.imag, old.real, old.imag, new.real, new.imag])
