"""Advice on speed against that of every km/h at every position: `python -m benchmarks.speed_advice`.

Each weld is judged by the rule book `force`, and by limits that its own curve crosses. The bounds of
`weld_force_ros.simulation.curve_bounds` were chosen on the welds of seed 101.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from msgspec.structs import replace

from weld_force_ros.assessment.judge import asks_of, judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.synthetic_welds import population
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceMap,
    Limit,
    SpeedCurve,
    Verdict,
    WeldProfile,
    limits_sha256,
    profile_sha256,
)
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.simulation.curve_bounds import CurveBounds, Selection
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.running import directed_runs, stated_running
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

TRACKS = ("bilbao", "bilbao-viscous", "bilbao-causal")
ADVICE = ("curve_class", "maxima_kmh", "hollows", "permitted_speed_kmh", "avoid", "restrictions", "advice", "reason")


@dataclass
class Count:
    """Passages beyond the map, of all welds: asked for by a question, and simulated with what fills the registers."""

    asked: list[int] = field(default_factory=list)
    simulated: list[int] = field(default_factory=list)


def main() -> None:
    """Print a line a track and set of limits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--welds", type=int, default=50)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--running", choices=("with", "both"), default="with")
    parser.add_argument("--tracks", nargs="+", default=TRACKS)
    arguments = parser.parse_args()
    welds = [profile_of(*weld) for weld in _samples(arguments.welds, arguments.seed)]
    print(
        f"{arguments.welds} welds of seed {arguments.seed}, running {arguments.running}; passages beyond the map and"
        " ms of processor time, means"
    )
    print(
        f"{'track':16}{'limits':12}{'equal':>8}{'asked':>8}{'most':>6}{'simulated':>11}{'before':>8}{'all':>6}"
        f"{'curve ms':>10}{'before':>8}{'map ms':>8}"
    )
    for track in arguments.tracks:
        simulator = Simulator(simulation_settings(track=track, running=arguments.running))
        for name in ("force", "crossed"):
            print(f"{track:16}{name:12}" + _line(simulator, welds, name), flush=True)


def _line(simulator: Simulator, welds: list[WeldProfile], name: str) -> str:
    plain = Simulator(simulator.settings, curves=False)
    count, before = Count(), Count()
    equal, times = 0, dict[str, list[float]]()
    for number, weld in enumerate(welds):
        force_map = with_every_passage(simulator, weld)
        limits = load_limits() if name == "force" else crossed(force_map, number)
        kinds: dict[str, Callable[[], ForceMap]] = {
            "map": partial(plain.force_map, weld),
            "before": partial(simulator.force_map, weld),
            "curve": partial(simulator.force_map, weld, asks_of(limits)),
        }
        for kind, work in kinds.items():
            work()  # tables
            began_s = time.process_time()
            work()
            times.setdefault(kind, []).append(time.process_time() - began_s)
        counted(simulator, before, kinds["before"])
        found = counted(simulator, count, kinds["curve"])
        equal += advice(judge(found, limits)) == advice(judge(force_map, limits))
    ms = {kind: 1e3 * float(np.mean(values)) for kind, values in times.items()}
    every = (281 - len(simulator.settings.speeds_kmh)) * len(simulator.settings.positions_m)
    return (
        f"{equal:>5}/{len(welds)}{np.mean(count.asked):8.0f}{max(count.asked):6d}{np.mean(count.simulated):11.0f}"
        f"{np.mean(before.simulated):8.0f}{every * len(directed_runs(simulator.settings.running, 0.0)):6d}"
        f"{ms['curve'] - ms['map']:10.0f}{ms['before'] - ms['map']:8.0f}{ms['map']:8.0f}"
    )


def _samples(count: int, seed: int) -> list[tuple[str, list[float], list[float]]]:
    return [(weld.weld_id, weld.x_m.tolist(), weld.z_m.tolist()) for weld in population(count, seed)]


def profile_of(weld_id: str, x_m: list[float], z_m: list[float]) -> WeldProfile:
    """Return samples as a profile."""
    sha256 = profile_sha256(x_m, z_m)
    return WeldProfile(weld_id=weld_id, source="synthetic", x_m=x_m, z_m=z_m, profile_sha256=sha256)


def advice(verdict: Verdict) -> dict[str, object]:
    """Return what a verdict says of speeds."""
    return {name: getattr(verdict, name) for name in ADVICE}


def with_every_passage(simulator: Simulator, weld: WeldProfile) -> ForceMap:
    """Return a weld's force map with a curve of every km/h at every position."""
    force_map = simulator.force_map(weld)
    curve, model = force_map.curve, simulator.tracks.at(weld).vehicle_track
    if not isinstance(curve, SpeedCurve) or not isinstance(model, VehicleTrackModel):
        raise TypeError("the engine makes no curves")
    runs, path = directed_runs(stated_running(weld, simulator.settings), model.opposite_m), simulator.wheel_path(weld)
    positions = np.array(force_map.positions_m)
    found = model.maps_of_few(
        [run.path(path) for run in runs], curve.speeds_kmh, np.stack([run.places(positions) for run in runs]),
        low_passed=True,
    )  # fmt: skip
    worst = Passages.beside([Passages.of_peak_map(one, force_map.static_load_n) for one in found]).worst(axis=1)
    return replace(force_map, curve=replace(curve, **worst.rounded(2, 9)))


def crossed(force_map: ForceMap, number: int) -> AssessmentSettings:
    """Return limits that a weld's curve crosses, here in one and there in another part of it."""
    curve = force_map.curve
    if not isinstance(curve, SpeedCurve):
        raise TypeError("the map has no curve")
    share = (0.3, 0.5, 0.7, 0.9)[number % 4]
    values = {
        "peak_force": np.array(curve.peak_force_n),
        "p2_force": np.array(curve.p2_force_n),
        "unloading": 1 - np.array(curve.min_force_n) / force_map.static_load_n,
    }
    limits = [
        Limit(name=name, limit=float(np.quantile(column, share)) * (1 + 1e-6), reject_limit=1e9, unit="", source="own")
        for name, column in values.items()
    ]
    settings = AssessmentSettings(limits_sha256="0" * 64, limits=limits, rules=load_limits().rules)
    return replace(settings, limits_sha256=limits_sha256(settings))


def counted(simulator: Simulator, count: Count, work: Callable[[], ForceMap]) -> ForceMap:
    """Return what some work does, and count its passages beyond the map."""
    model = simulator.vehicle_track
    simulate, deciding = VehicleTrackModel.maps_of_few, CurveBounds.deciding
    count.asked.append(0)
    count.simulated.append(0)

    def counting(*arguments: object, selected: Selection | None = None, **named: object) -> object:
        count.simulated[-1] += 0 if selected is None else int(np.count_nonzero(selected))
        return simulate(model, *arguments, selected=selected, **named)  # type: ignore[arg-type]

    def asking(bounds: CurveBounds, *arguments: object) -> Selection:
        selected = deciding(bounds, *arguments)  # type: ignore[arg-type]
        count.asked[-1] += int(np.count_nonzero(selected))
        return selected

    CurveBounds.deciding = asking  # type: ignore[method-assign,assignment]
    model.maps_of_few = counting  # type: ignore[method-assign,union-attr,assignment]
    try:
        return work()
    finally:
        CurveBounds.deciding = deciding  # type: ignore[method-assign]
        del model.maps_of_few


if __name__ == "__main__":
    main()
