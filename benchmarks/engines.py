"""Time per passage of each engine in the study, and what a second thread brings."""

from functools import partial
from typing import Any

from benchmarks import study, timing

_REFERENCE_SPEED_KMH = 100.0
_TIMES = 4


def engines(repetitions: int) -> dict[str, Any]:
    """Time the whole study by common poles and RFP, one weld at one speed by the reference."""
    fast, rational, reference = (study.study(engine) for engine in ("common-poles", "rfp", "reference"))
    weld = reference.wheel_paths[study.WELDS[1]]
    taken = timing.interleaved(
        {
            "common_poles": fast.simulate,
            "rfp": rational.simulate,
            "reference": lambda: reference.simulator.vehicle_track.peak_map(
                weld, [_REFERENCE_SPEED_KMH], reference.positions_m
            ),
        },
        repetitions,
    )
    passages = {"common_poles": fast.passages, "rfp": rational.passages, "reference": study.POSITIONS}
    found: dict[str, Any] = {}
    for name, values in taken.items():
        found |= timing.figure(f"{name}_per_passage_us", [1e6 * t / passages[name] for t in values])
    return found


def threads(repetitions: int) -> dict[str, Any]:
    """Time the study four times over, in one stream, on one thread and on two, in turn."""
    workload = study.study()
    vehicle_tracks = {count: study.vehicle_track(count) for count in (1, 2)}
    taken = timing.interleaved(
        {
            f"{_TIMES}_studies_{count}_thread_s": partial(workload.simulate, vehicle_track, _TIMES)
            for count, vehicle_track in vehicle_tracks.items()
        },
        repetitions,
    )
    one, two = taken.values()
    found: dict[str, Any] = {}
    for name, values in taken.items():
        found |= timing.figure(name, values)
    return {**found, **timing.figure("two_threads_over_one", [a / b for a, b in zip(one, two, strict=True)])}
