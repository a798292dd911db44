"""Advice on speed against that of every km/h at every position: `python -m benchmarks.speed_advice`.

Each weld is judged by the rule book `force`, and by limits that its own curve crosses. The bounds of
`weld_force_ros.simulation.curve_bounds` were chosen on welds of seeds 101 and 103 to 105, and widened by what those of
2026 showed.
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
from weld_force_ros.simulation.running import directed_runs, directions, stated_running
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

TRACKS = ("bilbao", "bilbao-viscous", "bilbao-causal")
ADVICE = ("curve_class", "maxima_kmh", "hollows", "permitted_speed_kmh", "avoid", "restrictions", "advice", "reason")


@dataclass
class Tally:
    """Of the welds of a track under some limits: passages beyond the map, and seconds of processor time.

    Attributes:
        equal: welds whose advice is that of every km/h at every position.
        asked: passages that a question asked for.
        simulated: passages that were simulated: those, and what filled the registers beside them.
        curve_s: map and curve.
    """

    equal: int = 0
    asked: list[int] = field(default_factory=list)
    simulated: list[int] = field(default_factory=list)
    curve_s: list[float] = field(default_factory=list)


def main() -> None:
    """Print a line a track and set of limits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--welds", type=int, default=50)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--running", choices=("with", "both"), default="with")
    parser.add_argument("--tracks", nargs="+", default=TRACKS)
    arguments = parser.parse_args()
    welds = [profile_of(*weld) for weld in _samples(arguments.welds, arguments.seed)]
    print(f"{len(welds)} welds of seed {arguments.seed}, running {arguments.running}; means of passages beyond the map")
    print("medians of ms of processor time for map and curve; every: every km/h, where it can be the worst")
    print(
        f"{'track':16}{'limits':8}{'equal':>8}{'asked':>7}{'most':>6}{'simulated':>11}{'every':>7}{'all':>6}"
        f"{'curve ms':>10}{'every':>7}{'map':>5}"
    )
    for track in arguments.tracks:
        _print_track(Simulator(simulation_settings(track=track, running=arguments.running)), welds)


def _print_track(simulator: Simulator, welds: list[WeldProfile]) -> None:
    plain, every = Simulator(simulator.settings, curves=False), Tally()
    thorough = Simulator(simulator.settings)  # whose tables take no other's place
    tallies, map_s = {"force": Tally(), "crossed": Tally()}, list[float]()
    for make in (plain.force_map, simulator.force_map, partial(simulator.force_map, asks=asks_of(load_limits()))):
        make(welds[0])  # tables
    for number, weld in enumerate(welds):
        timed(partial(plain.force_map, weld), map_s)
        force_map = counted(simulator, every, partial(simulator.force_map, weld))
        truth = with_every_passage(thorough, weld, force_map)
        for name, tally in tallies.items():
            limits = load_limits() if name == "force" else crossed(truth, number)
            found = counted(simulator, tally, partial(simulator.force_map, weld, asks_of(limits)))
            tally.equal += advice(judge(found, limits)) == advice(judge(truth, limits))
    settings = simulator.settings
    passages = (281 - len(settings.speeds_kmh)) * len(settings.positions_m) * len(directions(settings.running))
    for name, tally in tallies.items():
        medians = [1e3 * float(np.median(each)) for each in (tally.curve_s, every.curve_s, map_s)]
        print(
            f"{settings.track:16}{name:8}{tally.equal:>5}/{len(welds)}{np.mean(tally.asked):7.0f}{max(tally.asked):6d}"
            f"{np.mean(tally.simulated):11.0f}{np.mean(every.simulated):7.0f}{passages:6d}"
            f"{medians[0]:10.0f}{medians[1]:7.0f}{medians[2]:5.0f}",
            flush=True,
        )


def timed(work: Callable[[], ForceMap], seconds: list[float]) -> ForceMap:
    """Return what some work does, and append its processor time."""
    began_s = time.process_time()
    found = work()
    seconds.append(time.process_time() - began_s)
    return found


def _samples(count: int, seed: int) -> list[tuple[str, list[float], list[float]]]:
    return [(weld.weld_id, weld.x_m.tolist(), weld.z_m.tolist()) for weld in population(count, seed)]


def profile_of(weld_id: str, x_m: list[float], z_m: list[float]) -> WeldProfile:
    """Return samples as a profile."""
    sha256 = profile_sha256(x_m, z_m)
    return WeldProfile(weld_id=weld_id, source="synthetic", x_m=x_m, z_m=z_m, profile_sha256=sha256)


def advice(verdict: Verdict) -> dict[str, object]:
    """Return what a verdict says of speeds."""
    return {name: getattr(verdict, name) for name in ADVICE}


def with_every_passage(simulator: Simulator, weld: WeldProfile, force_map: ForceMap) -> ForceMap:
    """Return a weld's force map with a curve of every km/h at every position."""
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


def counted(simulator: Simulator, tally: Tally, work: Callable[[], ForceMap]) -> ForceMap:
    """Return what some work does, and count its passages beyond the map and its time."""
    model = simulator.vehicle_track
    simulate, deciding = VehicleTrackModel.maps_of_few, CurveBounds.deciding
    tally.asked.append(0)
    tally.simulated.append(0)

    def counting(*arguments: object, selected: Selection | None = None, **named: object) -> object:
        tally.simulated[-1] += 0 if selected is None else int(np.count_nonzero(selected))
        return simulate(model, *arguments, selected=selected, **named)  # type: ignore[arg-type]

    def asking(bounds: CurveBounds, *arguments: object) -> Selection:
        selected = deciding(bounds, *arguments)  # type: ignore[arg-type]
        tally.asked[-1] += int(np.count_nonzero(selected))
        return selected

    CurveBounds.deciding = asking  # type: ignore[method-assign,assignment]
    model.maps_of_few = counting  # type: ignore[method-assign,union-attr,assignment]
    try:
        return timed(work, tally.curve_s)
    finally:
        CurveBounds.deciding = deciding  # type: ignore[method-assign]
        del model.maps_of_few


if __name__ == "__main__":
    main()
