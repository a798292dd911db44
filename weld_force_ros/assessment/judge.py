"""Compose profile -> force map -> verdict: nodes, command line, replay, campaign and grinding all call it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros import SOFTWARE
from weld_force_ros.assessment.speed_advice import Advice, advise
from weld_force_ros.assessment.verdict import WORST_POSITION, evaluate
from weld_force_ros.errors import InputError
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    SpeedCurve,
    UncertaintyResult,
    Verdict,
    WeldProfile,
    known,
)
from weld_force_ros.simulation.force_map_view import Passages, passages, relevant_range

_AFTER_PEAK_M = 0.1


class Simulates(Protocol):
    """What a verdict needs of a simulator."""

    def force_map(self, profile: WeldProfile) -> ForceMap:
        """Peak forces over speed and position."""

    def force_history(
        self, profile: WeldProfile, speed_kmh: float, position_m: float, *, until_m: float = 0.0
    ) -> ForceHistory:
        """Simulate one passage in the space domain."""


@dataclass(frozen=True)
class Assessment:
    """Everything found out about one weld."""

    force_map: ForceMap
    history: ForceHistory
    verdict: Verdict


def judge(force_map: ForceMap, limits: AssessmentSettings) -> Verdict:
    """The verdict on a force map.

    Raises:
        InputError: no limit holds for a line of that speed.
    """
    rules = WORST_POSITION if isinstance(limits.rules, UnsetType) else limits.rules
    found = evaluate(force_map, limits.limits, rules, limits.gradient_norm)
    if not found.criteria:
        raise InputError(
            f"no limit can be applied to a line of {found.judged_speed_kmh:g} km/h", "state limits for that speed"
        )
    advice = _advised(force_map, limits)
    return Verdict(
        weld_id=force_map.weld_id,
        profile_sha256=force_map.profile_sha256,
        config_sha256=force_map.config_sha256,
        limits_sha256=limits.limits_sha256,
        software=SOFTWARE,
        decision=found.decision,
        reason=found.reason,
        criteria=list(found.criteria),
        peak_force_n=found.peak_force_n,
        static_load_n=force_map.static_load_n,
        worst_speed_kmh=found.worst_speed_kmh,
        worst_position_m=found.worst_position_m,
        worst_x_m=found.worst_x_m,
        judged_speed_kmh=found.judged_speed_kmh,
        chainage_m=force_map.chainage_m,
        rail=force_map.rail,
        unjudged=list(found.unjudged),
        by_position=list(found.by_position),
        geometry_kind=UNSET if isinstance(force_map.measures, UnsetType) else force_map.measures.kind,
        curve_class="hollow" if advice.hollows else "rises",
        maxima_kmh=list(advice.maxima_kmh),
        hollows=list(advice.hollows),
        permitted_speed_kmh=UNSET if advice.permitted_kmh is None else advice.permitted_kmh,
        avoid=list(advice.avoid),
        restrictions=list(advice.restrictions),
        advice=list(advice.words),
        advice_step_kmh=advice.step_kmh,
        samples=len(force_map.spread.support_factor) if isinstance(force_map.spread, UncertaintyResult) else 0,
    )


def _advised(force_map: ForceMap, limits: AssessmentSettings) -> Advice:
    """Advice on speed from the curve, or as fine as the map where it has none."""
    if isinstance(force_map.curve, SpeedCurve):
        speeds = np.array(force_map.curve.speeds_kmh)
        line_kmh = force_map.line_speed_kmh if isinstance(force_map.line_speed_kmh, float) else float(speeds[-1])
        count = max(1, int(np.sum(speeds <= line_kmh * (1 + 1e-9))))
        rolled = passages(force_map.curve, force_map.static_load_n, (len(speeds),), slice(count))
        return advise(speeds[:count], rolled, limits.limits)
    judged = relevant_range(force_map)
    return advise(judged.speeds_kmh, _over_positions(judged.passages), limits.limits)


def _over_positions(at: Passages) -> Passages:
    return Passages(
        at.static_n,
        at.peak_n.max(axis=1),
        at.min_n.min(axis=1),
        at.contact_loss_s.max(axis=1),
        None if at.p2_n is None else at.p2_n.max(axis=1),
        None if at.below_20hz_n is None else at.below_20hz_n.max(axis=1),
    )


def worst_history(profile: WeldProfile, simulator: Simulates, force_map: ForceMap) -> ForceHistory:
    """The passage that decides the verdict on `force_map`."""
    worst = evaluate(force_map, [])
    return simulator.force_history(
        profile, worst.worst_speed_kmh, worst.worst_position_m, until_m=worst.worst_x_m + _AFTER_PEAK_M
    )


def assess(profile: WeldProfile, simulator: Simulates, limits: AssessmentSettings) -> Assessment:
    """From a profile to its verdict."""
    force_map = simulator.force_map(profile)
    return Assessment(force_map, worst_history(profile, simulator, force_map), judge(force_map, limits))


def permitted_kmh(verdict: Verdict) -> float | None:
    """0 if no speed is within limits, None if nothing was said about speed."""
    if verdict.permitted_speed_kmh is not UNSET:
        return known(verdict.permitted_speed_kmh)
    return 0.0 if verdict.advice_step_kmh is not UNSET else None
