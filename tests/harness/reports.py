"""Welds for the report's tests: assessed on a small grid, and by hand what no small grid gives."""

import dataclasses
from functools import cache

from msgspec import UNSET
from msgspec.structs import replace

from tests.harness.limits import by_value
from weld_force_ros import SOFTWARE
from weld_force_ros.assessment.judge import assess
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.messages import (
    ForceMap,
    GrindingAdvice,
    GrindingSpot,
    PositionOutcome,
    Rejection,
    SimulationSettings,
    profile_sha256,
)
from weld_force_ros.recording.weld_records import Record, RejectedRecord, WeldRecord
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

HOSTILE = '</script><img src=x onerror="window.pwned=1"><script>window.pwned=1</script>\'"&{{7*7}}<!--'


@cache
def _simulator() -> Simulator:
    return Simulator(
        simulation_settings(
            running="with",
            speeds_kmh=[float(v) for v in range(40, 301, 20)],
            positions=6,
            uncertainty=load_uncertainty(4),
        )
    )


def settings() -> SimulationSettings:
    return _simulator().settings


@cache
def weld(
    name: str,
    scale: float = 1.0,
    line_speed_kmh: float | None = None,
    at_m: float | None = None,
    rule_books: str | None = None,
) -> WeldRecord:
    """A shipped profile, scaled, as everything found out about it; judged by value where no rule book is named."""
    profile = read_profile(find(name))
    z = [scale * value for value in profile.z_m]
    profile = replace(
        profile,
        z_m=z,
        profile_sha256=profile_sha256(profile.x_m, z),
        line_speed_kmh=line_speed_kmh or UNSET,
        weld_position_m=UNSET if at_m is None else at_m,
        instrument="trolley 7",
        rail="left",
        chainage_m=12034.5,
    )
    limits = by_value() if rule_books is None else load_limits(rule_books)
    found = assess(profile, _simulator(), limits)
    return WeldRecord(found.verdict, found.force_map, profile, found.history, settings(), limits)


def answered() -> WeldRecord:
    """A weld whose geometry is over a standard's limit and whose forces are undecided."""
    base = weld("weld-4-steep-ramp", line_speed_kmh=160.0, rule_books="force,banenor-531")
    assert base.profile is not None
    return dataclasses.replace(base, profile=replace(base.profile, measured_on="2026-11-20"))


def not_assessed() -> WeldRecord:
    """A weld that no rule book on geometry was chosen for."""
    return weld("cosine-dip-48mm", line_speed_kmh=160.0, rule_books="force")


def undecided() -> WeldRecord:
    """A weld whose decision hangs on where it lies."""
    base = weld("weld-1-dip")
    outcomes = [
        PositionOutcome(position_m=at, decision="grind" if 0.15 < at < 0.35 else "accept")
        for at in settings().positions_m
    ]
    reason = (
        "peak 210 kN at 160 km/h; over the limit: peak_force; accept at 0 to 10 cm, grind at 20 to 30 cm after the "
    )
    return WeldRecord(
        replace(
            base.verdict, weld_id="KM12-undecided", decision="undecided", by_position=outcomes,
            reason=reason + "sleeper: measure the weld's distance from the sleeper before it",
        ),
        base.force_map, base.profile, base.history, base.settings, base.limits,
    )  # fmt: skip


def ground() -> WeldRecord:
    """A weld with advice on grinding."""
    base = weld("weld-4-steep-ramp", 1.5)
    assert base.profile is not None
    assert base.force_map is not None
    x, z = base.profile.x_m, base.profile.z_m
    removal = [max(0.0, 0.5 * height) for height in z]
    peaks = [max(row) for row in _rows(base.force_map)]
    advice = GrindingAdvice(
        weld_id=base.verdict.weld_id, profile_sha256=base.verdict.profile_sha256,
        config_sha256=base.verdict.config_sha256, limits_sha256=base.verdict.limits_sha256, software=SOFTWARE,
        reached=True, reason="least area of 40 searched", x_m=x, z_m=z, removal_m=removal, most_removed_m=max(removal),
        removed_m2=1e-5, band_limit_m=0.03, stone_radius_m=0.15, decision_before="grind", decision_after="accept",
        before=base.verdict.criteria,
        after=[replace(c, passed=True, value=0.8 * c.limit) for c in base.verdict.criteria],
        speeds_kmh=base.force_map.speeds_kmh, peak_before_n=peaks, peak_after_n=[0.8 * p for p in peaks],
        reference_checked=12, reference_within=12, reference_peak_n=180e3, elapsed_s=3.0,
        spots=[GrindingSpot(from_m=-0.4, to_m=-0.1, depth_m=max(removal), deepest_m=-0.3, side="falling chainage")],
        hand_margin_m=0.03e-3, peak_by_hand_n=185e3, chainage_direction="with", gradient_norm_rad=2e-3,
    )  # fmt: skip
    return WeldRecord(
        replace(base.verdict, weld_id="KM12-ground"),
        base.force_map, base.profile, base.history, base.settings, base.limits, advice,
    )  # fmt: skip


def _rows(force_map: ForceMap) -> list[list[float]]:
    width = len(force_map.positions_m)
    return [force_map.peak_force_n[i : i + width] for i in range(0, len(force_map.peak_force_n), width)]


def ancient() -> WeldRecord:
    """A weld of a recording that knows nothing of what contract 1.2 added."""
    base = weld("weld-1-dip")
    assert base.force_map is not None
    verdict = replace(
        base.verdict, weld_id="ancient", curve_class=UNSET, geometry_kind=UNSET,
        permitted_speed_kmh=UNSET, advice_step_kmh=UNSET, avoid=[], restrictions=[], advice=[],
        by_position=[], hollows=[],
        criteria=[
            replace(c, reject_limit=UNSET, margin=UNSET, applies=UNSET, speed_kmh=UNSET, position_m=UNSET, x_m=UNSET,
                    exceeding=UNSET, exceeding_reject=UNSET, driver=UNSET, driver_share=UNSET)
            for c in base.verdict.criteria[:1]
        ],
    )  # fmt: skip
    old = replace(
        base.force_map, curve=UNSET, spread=UNSET, measures=UNSET, p2_force_n=UNSET, force_20hz_n=UNSET,
        model_error=UNSET,
    )  # fmt: skip
    return WeldRecord(verdict, old)


def unusable(source: str = "KM13-R-007.csv") -> RejectedRecord:
    return RejectedRecord(
        Rejection(source=source, reason="sample 12: z is not a finite number", remedy="measure again",
                  raw_text="x,z\n0,1\n1,nan\n")
    )  # fmt: skip


def hostile() -> list[Record]:
    """All text from outside is markup that would run a script if anything took it for markup."""
    base = weld("weld-1-dip")
    assert base.profile is not None
    profile = replace(base.profile, weld_id=HOSTILE, source=HOSTILE, instrument=HOSTILE, rail=HOSTILE)
    criteria = [replace(c, source=HOSTILE, applies=HOSTILE, unit="<img src=x>") for c in base.verdict.criteria]
    criteria.append(replace(criteria[0], name=HOSTILE[:200], unit="<b>"))
    verdict = replace(
        base.verdict, weld_id=HOSTILE, rail=HOSTILE, reason=HOSTILE, software=HOSTILE, advice=[HOSTILE],
        criteria=criteria, unjudged=[HOSTILE],
    )  # fmt: skip
    refused = RejectedRecord(Rejection(source=HOSTILE, reason=HOSTILE, remedy=HOSTILE, raw_text=HOSTILE))
    return [WeldRecord(verdict, base.force_map, profile, base.history, base.settings, base.limits), refused]


def entries() -> list[Record]:
    """One of each kind."""
    return [
        weld("cosine-dip-48mm", line_speed_kmh=160.0, at_m=0.13),
        ground(),
        weld("wheel-flat-0.9mm"),
        undecided(),
        ancient(),
        unusable(),
    ]
