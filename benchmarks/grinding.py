"""How long advice on grinding takes and what it comes to: `python -m benchmarks.grinding [TRACK ...]`.

The five shipped welds and some of the synthetic population, each held against the shipped limits and, as most are
within those, against a peak force whose dynamic part is a fifth less than theirs.
"""

import sys
from collections.abc import Iterator
from itertools import islice

from msgspec.structs import replace

from weld_force_ros.assessment.grinding import Adviser
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.measurement.shapes import REFERENCE_SHAPES
from weld_force_ros.measurement.synthetic_welds import population
from weld_force_ros.messages import (
    AssessmentSettings,
    GrindingAdvice,
    Limit,
    WeldProfile,
    limits_sha256,
    profile_sha256,
)
from weld_force_ros.simulation.settings import simulation_settings

TRACKS = ("johansson-nielsen", "bilbao-viscous", "bilbao")
SYNTHETIC, SEED, RELIEF = 3, 7, 0.2
HEADING = (
    f"{'weld':32}{'limit kN':>9}{'s':>6}{'mm':>7}{'mm2':>7}{'before':>8}{'after':>7}{'exact':>7}"
    f"{'within':>8}{'steps':>9}  reached"
)


def welds() -> Iterator[WeldProfile]:
    yield from (read_profile(find(name)) for name in islice(REFERENCE_SHAPES, 5))
    for weld in population(SYNTHETIC, SEED):
        x, z = weld.x_m.tolist(), weld.z_m.tolist()
        yield WeldProfile(weld_id=weld.weld_id, source="population", x_m=x, z_m=z, profile_sha256=profile_sha256(x, z))


def with_peak_limit(limits: AssessmentSettings, most_n: float) -> AssessmentSettings:
    own = Limit(name="peak_force", limit=most_n, reject_limit=10 * most_n, unit="N", source="a fifth less than before")
    changed = replace(
        limits, limits=[own, *(x for x in limits.limits if x.name not in ("peak_force", "dynamic_factor"))]
    )
    return replace(changed, limits_sha256=limits_sha256(changed))


def row(advice: GrindingAdvice, limit_n: float, steps: int) -> str:
    exact = f"{advice.reference_peak_n / 1e3:.1f}" if isinstance(advice.reference_peak_n, float) else "-"
    return (
        f"{advice.weld_id:32}{limit_n / 1e3:9.1f}{advice.elapsed_s:6.1f}{advice.most_removed_m * 1e3:7.3f}"
        f"{advice.removed_m2 * 1e6:7.1f}{max(advice.peak_before_n) / 1e3:8.1f}{max(advice.peak_after_n) / 1e3:7.1f}"
        f"{exact:>7}{advice.reference_within:5d}/{advice.reference_checked:<2d}{steps:9d}  {advice.reached}"
    )


def advised(adviser: Adviser, profile: WeldProfile, limit_n: float) -> GrindingAdvice:
    steps = 0

    def step() -> None:
        nonlocal steps
        steps += 1

    advice = adviser.advise(profile, on_step=step)
    print(row(advice, limit_n, steps), flush=True)
    return advice


def main(tracks: list[str]) -> None:
    limits = load_limits()
    for track in tracks:
        settings = simulation_settings(track=track, running="with")
        print(f"\n{track}; steps of the search, passages by the reference within limits\n{HEADING}")
        shipped = Adviser(settings, limits)
        shipped.advise(read_profile(find("weld-5-ramp-protrusion")))  # machine code and tables
        for profile in welds():
            before = advised(shipped, profile, min(200e3, 2 * settings.static_load_n))
            peak_n = max(before.peak_before_n)
            less_n = settings.static_load_n + (1 - RELIEF) * (peak_n - settings.static_load_n)
            advised(Adviser(settings, with_peak_limit(limits, less_n)), profile, less_n)


if __name__ == "__main__":
    main(sys.argv[1:] or list(TRACKS))
