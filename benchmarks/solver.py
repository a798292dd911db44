"""The same passages by general solvers: what speed and accuracy are measured against.

Every solver starts from the same state on smooth rail and rolls until shortly behind the weld, or behind the peak that
the kernel found if that comes later.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks import _solvers, study, timing
from benchmarks.study import Study
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.state_space import first_order_hold
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath

SAMPLE = 28
_SEED = 20180301
_SAMPLED_S = 10e-6
_RUNGE_KUTTA_STEP_S = 5e-6
_BEHIND_PEAK_M = 0.05

Cell = tuple[str, int, int]


class SolvedPassage:
    """One passage over a track of common poles as an initial value problem."""

    def __init__(
        self,
        vehicle_track: VehicleTrackModel,
        wheel_path: WheelPath,
        speed_kmh: float,
        position_m: float,
        until_m: float = -np.inf,
    ) -> None:
        """Take over where a passage of `vehicle_track` begins; `until_m` prolongs it."""
        model = vehicle_track.model
        if not isinstance(model, PoleModel):
            raise TypeError("only tracks of common poles are solved this way")
        start = vehicle_track.start(wheel_path, speed_kmh, position_m)
        speed = speed_kmh / 3.6
        poles, solver = model.poles_rad_s, vehicle_track.solver
        shapes = np.sqrt(model.pair_weight) * model.shapes_at(solver.grid_m * np.arange(solver.grid))
        table = np.stack([shapes.real, shapes.imag], axis=2).reshape(solver.grid, -1)
        pieces = np.ascontiguousarray(-wheel_path.cubics.coefficients)
        to_first = position_m + wheel_path.start_m - start.x_m
        self.state = self._physical(model, start.x_m, start.dt_s, start.rail, start.wheel)
        self.end_s = (max(start.last_m, until_m + _BEHIND_PEAK_M) - start.x_m) / speed
        self._equations = (
            poles.real.copy(), poles.imag.copy(), table, solver.grid_m, pieces, RESAMPLED_STEP_M, start.x_m, to_first,
            speed, solver.physics,
        )  # fmt: skip
        self._slope = np.empty(len(self.state))

    def peak_by_lsoda(self, rtol: float) -> float:
        """Return the peak force by `scipy.integrate.solve_ivp` on the compiled equations."""
        at = np.linspace(0.0, self.end_s, int(self.end_s / _SAMPLED_S) + 2)
        scale = np.abs(self.state) + 1e-9
        solution = solve_ivp(
            self._rate, (0.0, self.end_s), self.state, "LSODA", t_eval=at, rtol=rtol, atol=rtol * scale, max_step=1e-4
        )
        states = np.ascontiguousarray(solution.y.T)
        return float(max(self._force(t, y) for t, y in zip(solution.t, states, strict=True)))

    def peak_by_runge_kutta(self) -> float:
        """Return the peak force by a compiled Runge-Kutta method in steps of 5 µs."""
        steps = int(self.end_s / _RUNGE_KUTTA_STEP_S) + 1
        return float(_solvers.peak_by_runge_kutta(self.state, _RUNGE_KUTTA_STEP_S, steps, *self._equations))

    def _force(self, t: float, y: FloatArray) -> float:
        return float(_solvers.rate(t, y, *self._equations, self._slope))

    def _rate(self, t: float, y: FloatArray) -> FloatArray:
        self._force(t, y)
        return self._slope.copy()

    @staticmethod
    def _physical(model: PoleModel, x_m: float, dt_s: float, rail: FloatArray, wheel: FloatArray) -> FloatArray:
        """Return the states q_k of the equations (times the root of the pair's weight) from the scaled ones."""
        decay, old, new = first_order_hold(model.poles_rad_s, dt_s)
        shape = np.sqrt(model.pair_weight) * model.shapes_at(x_m)[0]
        states = (rail[0::2] + 1j * rail[1::2]) * (decay * new + old) + new * shape * wheel[2]
        return np.concatenate([np.stack([states.real, states.imag], axis=1).ravel(), wheel[:2]])


def speed_against_solver(repetitions: int) -> dict[str, Any]:
    """Time the study by the compiled passages and a sample of it by LSODA (rtol 1e-6), in turn."""
    workload, vehicle_track = study.study(), study.vehicle_track()
    sample = sampled(workload)
    taken = timing.interleaved(
        {
            "kernel": lambda: workload.simulate(vehicle_track),
            "lsoda": lambda: [_solved(vehicle_track, workload, cell).peak_by_lsoda(1e-6) for cell in sample],
        },
        repetitions,
    )
    kernel = [1e6 * t / workload.passages for t in taken["kernel"]]
    lsoda = [1e3 * t / len(sample) for t in taken["lsoda"]]
    ratios = [1e3 * slow / fast for slow, fast in zip(lsoda, kernel, strict=True)]
    return {
        **timing.figure("ratio_to_solve_ivp", ratios),
        "study_passages": workload.passages,
        **timing.figure("study_s", taken["kernel"]),
        **timing.figure("per_passage_us", kernel),
        "solve_ivp_passages": len(sample),
        **timing.figure("solve_ivp_lsoda_rtol_1e-6_ms", lsoda),
    }


def accuracy() -> dict[str, Any]:
    """Compare peak forces, and LSODA's at rtol 1e-6, with rtol 1e-10 on a sample, per cent.

    Every passage of the study is also compared with a compiled Runge-Kutta method, whose own distance from rtol 1e-10
    is given.
    """
    workload, vehicle_track = study.study(), study.vehicle_track()
    peak_maps = {
        name: vehicle_track.peak_map(wheel_path, workload.speeds_kmh, workload.positions_m)
        for name, wheel_path in workload.wheel_paths.items()
    }
    sample = sampled(workload)
    solved = [_solved(vehicle_track, workload, cell, peak_maps) for cell in sample]
    tight = np.array([passage.peak_by_lsoda(1e-10) for passage in solved])
    usual = np.array([passage.peak_by_lsoda(1e-6) for passage in solved])
    bridge = np.array([passage.peak_by_runge_kutta() for passage in solved])
    kernel = np.array([peak_maps[name].peak_force_n[row, column] for name, row, column in sample])
    cells: list[Cell] = [
        (name, row, column)
        for name, peak_map in peak_maps.items()
        for row, column in np.ndindex(peak_map.peak_force_n.shape)
    ]
    with ThreadPoolExecutor() as pool:
        every = np.array(
            list(pool.map(lambda cell: _solved(vehicle_track, workload, cell, peak_maps).peak_by_runge_kutta(), cells))
        )
    found = np.array([peak_maps[name].peak_force_n[row, column] for name, row, column in cells])
    return {
        "peak_error_percent_max": float(_percent(found, every).max()),
        "peak_error_percent_median": float(np.median(_percent(found, every))),
        "peak_error_passages": len(cells),
        "sample_peak_error_percent_max": float(_percent(kernel, tight).max()),
        "sample_solve_ivp_error_percent_max": float(_percent(usual, tight).max()),
        "sample_runge_kutta_error_percent_max": float(_percent(bridge, tight).max()),
        "sample_passages": len(sample),
    }


def sampled(workload: Study) -> list[Cell]:
    """Return passages drawn with a fixed seed, as many over each weld."""
    random = np.random.default_rng(_SEED)
    rows, columns = len(workload.speeds_kmh), len(workload.positions_m)
    return [
        (name, int(random.integers(rows)), int(random.integers(columns)))
        for name in workload.welds
        for _ in range(SAMPLE // len(workload.welds))
    ]


def _solved(
    vehicle_track: VehicleTrackModel, workload: Study, cell: Cell, peak_maps: dict[str, PeakMap] | None = None
) -> SolvedPassage:
    name, row, column = cell
    until = peak_maps[name].peak_x_m[row, column] if peak_maps else -np.inf
    wheel_path = workload.wheel_paths[name]
    return SolvedPassage(vehicle_track, wheel_path, workload.speeds_kmh[row], workload.positions_m[column], until)


def _percent(values: FloatArray, exact: FloatArray) -> NDArray[np.float64]:
    return np.asarray(100 * np.abs(values / exact - 1))
