"""Passages of a wheel over a weld on a fitted track, checked: their peaks over speed and position, or one in full."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from concurrent.futures import Future
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage import _scalar_passage
from weld_force_ros.physics.passage.batch import Selection
from weld_force_ros.physics.passage.peak_map import TOLERANCE, PeakMap, PeakMapSolver
from weld_force_ros.physics.passage.speed_tables import TRANSIENT_WINDOW_S
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.threads import executor, thread_count

_MOST_REMEMBERED = 64  # speeds, half a megabyte each
_WELDS_AT_ONCE = 8


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
    """The start of a passage, for another solver to take over.

    Attributes:
        x_m: from the sleeper before the weld.
        last_m: where the passage ends.
        dt_s: the compiled passage's step, which its rail states depend on.
        rail: (n_state,), as `weld_force_ros.physics.passage.state_space` defines them.
        wheel: displacement, velocity and force, positive down.
    """

    x_m: float
    last_m: float
    dt_s: float
    rail: FloatArray
    wheel: FloatArray


class VehicleTrackModel:
    """A wheel on a fitted track, simulated on `threads` threads: one a core, if not given."""

    def __init__(self, model: StateModel, wheel: Wheel, *, threads: int | None = None) -> None:
        self.model = model
        self.wheel = wheel
        self.solver = SteadyStateSolver(model, wheel)
        self._threads = thread_count(threads)
        # Histories are asked for at many positions of one speed.
        self._steady_state = lru_cache(_MOST_REMEMBERED)(self.solver.steady_state)
        self._peak_maps = PeakMapSolver(self.solver)

    @property
    def opposite_m(self) -> float:
        """Return what a place x is met at against rising x, plus x: the span, where all supports are alike."""
        return self.model.opposite_m

    def peak_map(
        self,
        wheel_path: WheelPath,
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        low_passed: bool = False,
        tolerance: float = TOLERANCE,
        on_speed: Callable[[], None] = lambda: None,
        selected: Selection | None = None,
    ) -> PeakMap:
        """Return peak force, its place, least force and contact loss of every passage.

        Args:
            wheel_path: the wheel centre's trajectory over the weld.
            speeds_kmh: (n_speed,), positive.
            positions_m: (n_position,), the weld's centre after the sleeper.
            low_passed: also the greatest forces through the filters of `weld_force_ros.physics.passage.lowpass`.
            tolerance: of the peak force, that the steps' length may cost.
            on_speed: called for each speed that is done.
            selected: (n_speed, n_position), what is simulated; the rest is NaN. Everything, if not given.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        return self.maps_of_few(
            [wheel_path],
            speeds_kmh,
            checked_axis("position", positions_m)[None],
            low_passed=low_passed,
            tolerance=tolerance,
            on_speed=on_speed,
            selected=None if selected is None else selected[:, None],
        )[0]

    def maps_of_few(
        self,
        wheel_paths: Sequence[WheelPath],
        speeds_kmh: ArrayLike,
        positions_m: FloatArray,
        *,
        low_passed: bool = False,
        tolerance: float = TOLERANCE,
        on_speed: Callable[[], None] = lambda: None,
        selected: Selection | None = None,
    ) -> list[PeakMap]:
        """Return the maps of a few paths at positions of their own, (n_path, n_position), all threads on each speed.

        `selected` is (n_speed, n_path, n_position); else see `peak_map`.
        """
        return self._peak_maps.solve(
            wheel_paths, checked_speeds(speeds_kmh), checked_positions(positions_m), self._threads, on_speed,
            low_passed=low_passed, tolerance=tolerance, selected=selected,
        )  # fmt: skip

    def peak_maps(
        self,
        wheel_paths: Iterable[WheelPath],
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        low_passed: bool = False,
        tolerance: float = TOLERANCE,
    ) -> Iterator[PeakMap]:
        """Yield the peak maps of many welds, in their order; welds are taken as they are needed.

        Args:
            wheel_paths: taken as they are needed.
            speeds_kmh: (n_speed,), positive.
            positions_m: (n_position,), the weld's centre after the sleeper; or (n_path, n_position), of each.
            low_passed: as of `peak_map`.
            tolerance: as of `peak_map`.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: a passage did not stay finite.
        """
        speeds, positions = checked_speeds(speeds_kmh), checked_positions(positions_m)
        solve = partial(self._peak_maps.solve, low_passed=low_passed, tolerance=tolerance)
        with executor(self._threads) as pool:
            waiting: deque[Future[list[PeakMap]]] = deque()
            taken = 0
            for some in _some_at_a_time(wheel_paths, self._threads):
                own = positions if positions.ndim == 1 else positions[taken : taken + len(some)]
                taken += len(some)
                waiting.append(pool.submit(solve, some, speeds, own, 1))
                if len(waiting) > self._threads:
                    yield from waiting.popleft().result()
            for some_maps in waiting:
                yield from some_maps.result()

    def history(
        self, wheel_path: WheelPath, speed_kmh: float, position_m: float, *, until_m: float = 0.0, stride: int = 1
    ) -> History:
        """Return one passage, from a span before the weld to a span after, or `until_m`.

        `stride` is how many points of the solver's grid a step has, at most its `coarsest_stride` of the speed.

        Raises:
            InputError: a speed that is not positive, or anything that is not finite.
            NumericalError: the passage did not stay finite.
        """
        speed_kmh, position_m = float(checked_speeds(speed_kmh)[0]), float(checked_axis("position", position_m)[0])
        solver, span = self.solver, self.model.spacing_m
        steady_state = self._steady_state(speed_kmh, stride)
        start = solver.start(position_m + wheel_path.start_m - span)
        last_m = max(position_m + wheel_path.end_m + span, until_m)
        steps = solver.steps(stride, last_m - start * solver.grid_m) + 1
        x = (start + stride * np.arange(steps)) * solver.grid_m
        irregularity = wheel_path.at(x - position_m)
        state, step = solver.initial_state(steady_state, start), steady_state.step
        result = np.empty((steps, 3))
        _scalar_passage.history_of_passage(
            state[:-3], state[-3:], step, start // stride, -irregularity, solver.physics, steady_state.dt_s, result
        )
        if not np.all(np.isfinite(result)):
            raise NumericalError("the passage did not stay finite; the fit of this track cannot be used at that speed")
        return History(x, result[:, 0], -result[:, 1], -result[:, 2], irregularity)

    def start(self, wheel_path: WheelPath, speed_kmh: float, position_m: float) -> Start:
        """Return the state in which a passage of `peak_map` begins, in the shortest step and its scaling of states."""
        steady_state = self._steady_state(speed_kmh, 1)
        first_m, end_m = wheel_path.nonzero_extent_m
        first = self.solver.start(position_m + first_m)
        state = self.solver.initial_state(steady_state, first)
        last_m = position_m + end_m + 2 * TRANSIENT_WINDOW_S * speed_kmh / 3.6
        return Start(first * self.solver.grid_m, last_m, steady_state.dt_s, state[:-3], state[-3:])


def _some_at_a_time(wheel_paths: Iterable[WheelPath], threads: int) -> Iterator[list[WheelPath]]:
    """Yield enough to fill each other's lanes; of few welds fewer, so that each thread has some."""
    some = _WELDS_AT_ONCE
    if isinstance(wheel_paths, Sized):
        some = min(some, max(1, len(wheel_paths) // (2 * threads)))
    remaining = iter(wheel_paths)
    while part := list(islice(remaining, some)):
        yield part


def checked_speeds(values: ArrayLike) -> FloatArray:
    """Return speeds in km/h as an array, or raise an InputError."""
    speeds = checked_axis("speed", values)
    if np.any(speeds <= 0):
        raise InputError("a speed is not positive", "give speeds in km/h above 0")
    return speeds


def checked_positions(positions_m: ArrayLike) -> FloatArray:
    """Return positions (n_position,), or (n_path, n_position) of each path, as an array, or raise an InputError."""
    positions = np.asarray(positions_m, dtype=np.float64)
    checked = checked_axis("position", positions.ravel())
    return checked.reshape(positions.shape) if positions.ndim == 2 else checked


def checked_axis(name: str, values: ArrayLike) -> FloatArray:
    """Return one or more finite numbers as an array, or raise an InputError."""
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise InputError(f"a {name} is missing or not finite", f"give at least one {name} as a number")
    return array
