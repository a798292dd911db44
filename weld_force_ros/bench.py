"""How fast and how exact, measured: the kernel against a general solver on the same equations.

Timings are medians of interleaved repetitions; what counts are their ratios within one run.
"""

import statistics
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from weld_force_ros import fits, profiles, tracks
from weld_force_ros.assess import Simulator, parse_speeds, simulation_settings
from weld_force_ros.core import _kernel
from weld_force_ros.core.passage import Rig, Start
from weld_force_ros.core.poles import PoleModel
from weld_force_ros.core.propagation import first_order_hold
from weld_force_ros.core.weld import RESAMPLED_STEP_M, Trajectory
from weld_force_ros.errors import WeldForceError

STUDY_SPEEDS = "20:255:5"
STUDY_POSITIONS = 15
_SOLVED_WELD = "weld-1-dip"
_SOLVED = [(25.0, 0.0), (60.0, 0.2), (100.0, 0.4), (160.0, 0.08), (250.0, 0.52)]


def run(*, repetitions: int = 3, on_step: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Measure everything; keys name what they hold, with units."""
    simulator = Simulator(simulation_settings(speeds_kmh=parse_speeds(STUDY_SPEEDS), positions=STUDY_POSITIONS))
    definition = tracks.load(simulator.settings.track)
    model = fits.fitted(definition).model()
    profile = profiles.read_profile(profiles.find(_SOLVED_WELD))
    simulator.force_map(profile)  # compiled and warm
    maps, theirs = [], []
    rig, trajectory = Rig(model, definition.wheel), simulator.trajectory(profile)
    for repetition in range(repetitions):
        on_step(f"repetition {repetition + 1} of {repetitions}")
        maps.append(_seconds(lambda: simulator.force_map(profile)))
        theirs.append([_seconds(partial(solved_peak, model, rig, trajectory, *case, rtol=1e-6)) for case in _SOLVED])
    on_step("accuracy")
    peaks = [rig.surface(trajectory, [v], [p]).peak_force_n[0, 0] for v, p in _SOLVED]
    exact = [solved_peak(model, rig, trajectory, v, p, rtol=1e-10) for v, p in _SOLVED]
    on_step("files through the nodes")
    latencies = file_to_verdict_s()
    passages = len(simulator.settings.speeds_kmh) * STUDY_POSITIONS
    map_s = statistics.median(maps)
    solver_s = statistics.median(float(np.mean(times)) for times in theirs)
    return {
        "ratio_to_solve_ivp": solver_s / (map_s / passages),
        "map_passages": passages,
        "map_s": map_s,
        "map_s_spread": [min(maps), max(maps)],
        "per_passage_us": 1e6 * map_s / passages,
        "solve_ivp_lsoda_rtol_1e-6_ms": 1e3 * solver_s,
        "peak_error_against_rtol_1e-10_percent": [
            100 * abs(float(a) / b - 1) for a, b in zip(peaks, exact, strict=True)
        ],
        **latencies,
    }  # fmt: skip


def file_to_verdict_s(files: int = 12) -> dict[str, Any]:
    """Time from a file's appearance to its published verdict, nodes warm, one file at a time; empty without ROS."""
    try:
        from weld_force_ros.ros.demo import keep_to_itself
        from weld_force_ros.ros.run import Suite
    except ImportError:
        return {}
    keep_to_itself()
    source = profiles.find(_SOLVED_WELD).read_text(encoding="utf-8")
    judged = threading.Event()
    waited = []
    with tempfile.TemporaryDirectory() as folder:
        parameters: dict[Any, dict[str, Any]] = {
            "profile": {"folder": folder},
            "simulator": {"speeds": STUDY_SPEEDS},
            "assessment": {"bag": f"{folder}/bag"},
        }
        with Suite(parameters=parameters, on_verdict=lambda _: judged.set()) as suite:
            for number in range(files + 1):
                judged.clear()
                waited.append(_seconds(partial(_measure, Path(folder) / f"weld-{number}.csv", source, judged)))
            suite.drain()
    return {
        "file_to_verdict_s_p50": float(np.percentile(waited[1:], 50)),
        "file_to_verdict_s_p95": float(np.percentile(waited[1:], 95)),
        "file_to_verdict_passages": len(parse_speeds(STUDY_SPEEDS)) * STUDY_POSITIONS,
    }


def _measure(path: Path, text: str, judged: threading.Event) -> None:
    path.write_text(text.replace(_SOLVED_WELD, path.stem), encoding="utf-8")
    if not judged.wait(60.0):
        raise WeldForceError(f"no verdict on {path.name} within 60 s; look at the nodes' log")


def solved_peak(
    model: PoleModel, rig: Rig, trajectory: Trajectory, speed_kmh: float, position_m: float, *, rtol: float
) -> float:
    """Peak force of one passage by LSODA on the compiled equations, from the same starting state."""
    start = rig.start(trajectory, speed_kmh, position_m)
    speed = speed_kmh / 3.6
    grid = trajectory.start_m + RESAMPLED_STEP_M * np.arange(len(trajectory.height_m))
    pieces = np.ascontiguousarray(-CubicSpline(grid, trajectory.height_m).c)
    poles = model.poles_rad_s
    shapes = np.sqrt(model.pair_weight) * model.shapes_at(rig.grid_m * np.arange(rig.grid))
    table = np.ascontiguousarray(np.stack([shapes.real, shapes.imag], axis=2).reshape(rig.grid, -1))
    state = _physical_state(model, start)
    to_first = position_m + trajectory.start_m - start.x_m
    slope = np.empty(len(state))
    arguments = (
        poles.real.copy(), poles.imag.copy(), table, rig.grid_m, pieces, RESAMPLED_STEP_M, start.x_m, to_first,
        speed, rig.physics, slope,
    )  # fmt: skip

    def right_hand_side(t: float, y: np.ndarray) -> np.ndarray:
        _kernel.rate(t, y, *arguments)
        return slope.copy()

    end_s = (start.last_m - start.x_m) / speed
    at = np.linspace(0.0, end_s, int(end_s / 10e-6) + 2)
    scale = np.abs(state) + 1e-9
    solution = solve_ivp(
        right_hand_side, (0.0, end_s), state, "LSODA", t_eval=at, rtol=rtol, atol=rtol * scale, max_step=1e-4
    )
    states = np.ascontiguousarray(solution.y.T)
    return float(max(_kernel.rate(t, y, *arguments) for t, y in zip(solution.t, states, strict=True)))


def _physical_state(model: PoleModel, start: Start) -> np.ndarray:
    """The states q_k of the equations (times the root of the pair's weight), from the kernel's scaled ones."""
    decay, old, new = first_order_hold(model.poles_rad_s, start.dt_s)
    scaled = start.rail[0::2] + 1j * start.rail[1::2]
    shape = np.sqrt(model.pair_weight) * model.shapes_at(start.x_m)[0]
    states = scaled * np.sqrt(decay * new + old) + new * shape * start.wheel[2]
    return np.concatenate([np.stack([states.real, states.imag], axis=1).ravel(), start.wheel[:2]])


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
