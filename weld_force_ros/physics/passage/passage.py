"""Passages of a wheel over a weld on a fitted track, checked: their peaks over speed and position, or one in full."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import Future
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _kernel
from weld_force_ros.physics.passage.batch import ECHO_S
from weld_force_ros.physics.passage.peak_map import TOLERANCE, Surface, SurfaceRoller, executor
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.steady_state import Roller
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import Trajectory

_MOST_REMEMBERED = 64  # speeds, half a megabyte each
_TOGETHER = 8  # welds


@dataclass(frozen=True)
class History:
    """One passage, each (n,): x from the sleeper before the weld, displacements positive up."""

    x_m: FloatArray
    force_n: FloatArray
    wheel_m: FloatArray
    rail_m: FloatArray
    irregularity_m: FloatArray


@dataclass(frozen=True)
class Start:
    """Where and how a passage begins: for another solver to take over.

    Attributes:
        x_m: from the sleeper before the weld.
        last_m: where the passage ends.
        dt_s: the kernel's step, which its rail states depend on.
        rail: (n_state,), as `weld_force_ros.physics.passage.state_space` defines them.
        wheel: displacement, velocity and force, positive down.
    """

    x_m: float
    last_m: float
    dt_s: float
    rail: FloatArray
    wheel: FloatArray


class Rig:
    """A wheel on a fitted track, ready to roll, on `threads` threads: one a core, if not given."""

    def __init__(self, model: StateModel, wheel: Wheel, *, threads: int | None = None) -> None:
        self.model = model
        self.wheel = wheel
        self.roller = Roller(model, wheel)
        self._threads = threads or os.cpu_count() or 1
        # Histories are asked for at many positions of one speed.
        self._in_shortest_steps = lru_cache(_MOST_REMEMBERED)(lambda speed_kmh: self.roller.rolling(speed_kmh, 1))
        self._surfaces = SurfaceRoller(self.roller)

    def surface(
        self,
        trajectory: Trajectory,
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        low_passed: bool = False,
        tolerance: float = TOLERANCE,
        on_speed: Callable[[], None] = lambda: None,
    ) -> Surface:
        """Peak force, its place, least force and contact loss of every passage.

        Args:
            trajectory: the wheel centre's trajectory over the weld.
            speeds_kmh: (n_speed,), positive.
            positions_m: (n_position,), the weld's centre after the sleeper.
            low_passed: also the greatest forces through the filters of `weld_force_ros.physics.passage.lowpass`.
            tolerance: of the peak force, that the steps' length may cost.
            on_speed: called for each speed that is done.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        speeds, positions = checked_speeds(speeds_kmh), checked_axis("position", positions_m)
        return self._surfaces.roll(
            [trajectory], speeds, positions, self._threads, on_speed, low_passed=low_passed, tolerance=tolerance
        )[0]

    def surfaces(
        self,
        trajectories: Iterable[Trajectory],
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        low_passed: bool = False,
        tolerance: float = TOLERANCE,
    ) -> Iterator[Surface]:
        """`surface` of many welds, in their order: some at a time on each thread, and few more are held than that.

        Args:
            trajectories: taken as they are needed.
            speeds_kmh: (n_speed,), positive.
            positions_m: (n_position,), the weld's centre after the sleeper.
            low_passed: as of `surface`.
            tolerance: as of `surface`.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: a passage did not stay finite.
        """
        speeds, positions = checked_speeds(speeds_kmh), checked_axis("position", positions_m)
        roll = partial(self._surfaces.roll, low_passed=low_passed, tolerance=tolerance)
        with executor(self._threads) as pool:
            waiting: deque[Future[list[Surface]]] = deque()
            for some in _some_at_a_time(trajectories, self._threads):
                waiting.append(pool.submit(roll, some, speeds, positions, 1))
                if len(waiting) > self._threads:
                    yield from waiting.popleft().result()
            for rolled in waiting:
                yield from rolled.result()

    def history(self, trajectory: Trajectory, speed_kmh: float, position_m: float, *, until_m: float = 0.0) -> History:
        """One passage in the shortest steps, from a span before the weld to a span after it, or to `until_m` if later.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        speed_kmh, position_m = float(checked_speeds(speed_kmh)[0]), float(checked_axis("position", position_m)[0])
        roller, span = self.roller, self.model.spacing_m
        rolling = self._in_shortest_steps(speed_kmh)
        start = roller.start(position_m + trajectory.start_m - span)
        last_m = max(position_m + trajectory.end_m + span, until_m)
        steps = roller.steps(1, last_m - start * roller.grid_m) + 1
        x = (start + np.arange(steps)) * roller.grid_m
        irregularity = trajectory.at(x - position_m)
        state, step = roller.beginning(rolling, start), rolling.step
        result = np.empty((steps, 3))
        _kernel.history_of_passage(
            state[:-3], state[-3:], step.decay, step.transitions, step.drives, step.shapes, step.gains, start,
            -irregularity, roller.physics, rolling.dt_s, result,
        )  # fmt: skip
        if not np.all(np.isfinite(result)):
            raise NumericalError("the passage did not stay finite; the fit of this track cannot be used at that speed")
        return History(x, result[:, 0], -result[:, 1], -result[:, 2], irregularity)

    def start(self, trajectory: Trajectory, speed_kmh: float, position_m: float) -> Start:
        """The state in which a passage of `surface` begins, in the kernel's own scaling and its shortest step."""
        rolling = self._in_shortest_steps(speed_kmh)
        first_m, end_m = trajectory.uneven_m
        first = self.roller.start(position_m + first_m)
        state = self.roller.beginning(rolling, first)
        last_m = position_m + end_m + 2 * ECHO_S * speed_kmh / 3.6
        return Start(first * self.roller.grid_m, last_m, rolling.dt_s, state[:-3], state[-3:])


def _some_at_a_time(trajectories: Iterable[Trajectory], threads: int) -> Iterator[list[Trajectory]]:
    """Enough to fill each other's lanes; of few welds fewer, so that each thread has some."""
    some = _TOGETHER
    if isinstance(trajectories, Sized):
        some = min(some, max(1, len(trajectories) // (2 * threads)))
    remaining = iter(trajectories)
    while together := list(islice(remaining, some)):
        yield together


def checked_speeds(values: ArrayLike) -> FloatArray:
    """Speeds in km/h as an array, or an InputError."""
    speeds = checked_axis("speed", values)
    if np.any(speeds <= 0):
        raise InputError("a speed is not positive", "give speeds in km/h above 0")
    return speeds


def checked_axis(name: str, values: ArrayLike) -> FloatArray:
    """One or more finite numbers as an array, or an InputError."""
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise InputError(f"a {name} is missing or not finite", f"give at least one {name} as a number")
    return array
