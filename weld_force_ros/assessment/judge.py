"""Compose profile -> force map -> verdict: nodes, command line, replay, campaign and grinding all call it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from msgspec import UNSET, UnsetType
from msgspec.structs import asdict

from weld_force_ros import SOFTWARE
from weld_force_ros.assessment.decision import force_share
from weld_force_ros.assessment.limits import worst
from weld_force_ros.assessment.speed_advice import advise
from weld_force_ros.assessment.speed_questions import SpeedQuestions
from weld_force_ros.assessment.verdict import WORST_POSITION, Evaluation, evaluate
from weld_force_ros.errors import InputError
from weld_force_ros.messages import (
    AssessmentSettings,
    Criterion,
    Decision,
    Direction,
    ForceHistory,
    ForceMap,
    UncertaintyResult,
    Verdict,
    WeldProfile,
    known,
)
from weld_force_ros.simulation.curve_refinement import Asks
from weld_force_ros.simulation.force_map_view import RelevantMap, relevant_range

_AFTER_PEAK_M = 0.1


class Simulates(Protocol):
    """The part of a simulator that a verdict needs."""

    def force_map(self, profile: WeldProfile, asks: Asks | None = None) -> ForceMap:
        """Compute the forces at every speed and position, and a curve that answers what is asked."""

    def force_history(
        self,
        profile: WeldProfile,
        speed_kmh: float,
        position_m: float,
        *,
        until_m: float,
        running: Direction | UnsetType,
    ) -> ForceHistory:
        """Compute one passage in the space domain."""


@dataclass(frozen=True)
class Assessment:
    """A weld's force map, its verdict, and the history of the passage that decided the verdict."""

    force_map: ForceMap
    history: ForceHistory
    verdict: Verdict


def assess(profile: WeldProfile, simulator: Simulates, limits: AssessmentSettings) -> Assessment:
    """Simulate a weld and judge it.

    Raises:
        NumericalError: a passage did not stay finite.
        InputError: no limit holds for a line of that speed.
    """
    return assess_vehicles(profile, [simulator], limits)


def assess_vehicles(profile: WeldProfile, simulators: Sequence[Simulates], limits: AssessmentSettings) -> Assessment:
    """Simulate a weld under each of several vehicles and judge it by the one that decides.

    Raises:
        NumericalError: a passage did not stay finite.
        InputError: no limit holds for a line of that speed.
    """
    force_maps = simulate_vehicles(profile, simulators, limits)
    verdict = judge_vehicles(force_maps, limits)
    deciding = [m.config_sha256 for m in force_maps].index(verdict.config_sha256)
    relevant = relevant_range(force_maps[deciding])
    history = _history(profile, simulators[deciding], relevant, verdict.criteria)
    return Assessment(force_maps[deciding], history, verdict)


def simulate_vehicles(
    profile: WeldProfile, simulators: Sequence[Simulates], limits: AssessmentSettings | None = None
) -> list[ForceMap]:
    """Compute a weld's force map under each of several vehicles; the maps say that they are judged together.

    Args:
        profile: the weld.
        simulators: of each vehicle.
        limits: by which it will be judged; if they are not known, curves are simulated at every km/h.

    Raises:
        NumericalError: a passage did not stay finite.
        InputError: the weld's position lies beyond the sleeper span.
    """
    asks = None if limits is None else asks_of(limits)
    force_maps = [simulator.force_map(profile, asks) for simulator in simulators]
    for force_map in force_maps if len(force_maps) > 1 else ():
        force_map.judged_together = [one.config_sha256 for one in force_maps]
    return force_maps


def asks_of(limits: AssessmentSettings) -> Asks:
    """Return what advice on speed by some limits asks of force-speed curves."""
    return lambda force_map: SpeedQuestions(limits.limits, limits.limits_sha256, told_apart(force_map, limits))


def judge_vehicles(force_maps: Sequence[ForceMap], limits: AssessmentSettings) -> Verdict:
    """Return the verdict on the force maps of several vehicles over a weld: that of the vehicle which decides.

    Raises:
        InputError: no limit holds for a line of that speed.
    """
    return max((judge(force_map, limits) for force_map in force_maps), key=gravity)


_GRAVITY: tuple[Decision, ...] = ("accept", "undecided", "grind", "reject")


def gravity(verdict: Verdict) -> tuple[int, float, float]:
    """Return by what the verdicts of several vehicles over a weld are ordered: the greatest is that of the weld.

    That is the one whose decision is the gravest; of equal ones, that with the highest probability of exceeding a force
    limit, then with the highest peak relative to its static load.
    """
    force = known(verdict.force)
    exceeding = known(force.exceeding) if force is not None else None
    return _GRAVITY.index(verdict.decision), exceeding or 0.0, verdict.peak_force_n / verdict.static_load_n


def judge(force_map: ForceMap, limits: AssessmentSettings) -> Verdict:
    """Return the verdict on a force map.

    Raises:
        InputError: no limit holds for a line of that speed.
    """
    return judge_relevant(relevant_range(force_map), limits)


def judge_relevant(relevant: RelevantMap, limits: AssessmentSettings) -> Verdict:
    """Return the verdict on a force map whose relevant part is known already.

    Raises:
        InputError: no limit holds for a line of that speed.
    """
    relevant = relevant.answering(limits.limits_sha256)
    force_map, evaluation = relevant.force_map, _evaluate(relevant, limits)
    if not evaluation.criteria:
        raise InputError(
            f"no limit can be applied to a line of {evaluation.judged_speed_kmh:g} km/h", "state limits for that speed"
        )
    return Verdict(
        weld_id=force_map.weld_id,
        profile_sha256=force_map.profile_sha256,
        config_sha256=force_map.config_sha256,
        limits_sha256=limits.limits_sha256,
        software=SOFTWARE,
        static_load_n=force_map.static_load_n,
        chainage_m=force_map.chainage_m,
        rail=force_map.rail,
        vehicle=force_map.vehicle,
        geometry_kind=UNSET if isinstance(force_map.measures, UnsetType) else force_map.measures.kind,
        samples=len(force_map.spread.support_factor) if isinstance(force_map.spread, UncertaintyResult) else 0,
        **asdict(evaluation),
        **asdict(advise(*relevant.worst_by_speed(), limits.limits, told_apart(force_map, limits))),
    )


def deciding_history(
    profile: WeldProfile, simulator: Simulates, force_map: ForceMap, limits: AssessmentSettings | None = None
) -> ForceHistory:
    """Compute the history of the passage that decides the verdict on a force map.

    That is the passage of the force criterion nearest to its limit or farthest beyond it; the one with the highest peak
    where the geometry decides, or no limits are known.

    Raises:
        NumericalError: the passage did not stay finite.
    """
    relevant = relevant_range(force_map)
    return _history(profile, simulator, relevant, _evaluate(relevant, limits).criteria if limits else [])


def told_apart(force_map: ForceMap, limits: AssessmentSettings) -> float | None:
    """Return the share of forces' dynamic part below which differences are fit error and model uncertainty.

    None where rules accept no risk, as in earlier versions: every difference is then told.
    """
    rules = limits.rules
    if isinstance(rules, UnsetType) or isinstance(rules.accepted_risk, UnsetType):
        return None
    return force_share(force_map, known(rules.model_uncertainty) or [])


def permitted_kmh(verdict: Verdict) -> float | None:
    """Return the highest computed speed with all forces within limits.

    0 if no speed is within limits, None if nothing was said about speed.
    """
    if verdict.permitted_speed_kmh is not UNSET:
        return known(verdict.permitted_speed_kmh)
    return 0.0 if verdict.advice_step_kmh is not UNSET else None


def _evaluate(relevant: RelevantMap, limits: AssessmentSettings) -> Evaluation:
    rules = WORST_POSITION if isinstance(limits.rules, UnsetType) else limits.rules
    return evaluate(relevant, limits.limits, rules, limits.gradient_norm)


def _history(
    profile: WeldProfile, simulator: Simulates, relevant: RelevantMap, criteria: Sequence[Criterion]
) -> ForceHistory:
    row, column = relevant.peak_index
    running = relevant.direction("peak_force_n", row, column)
    if criteria:
        deciding = worst(criteria)
        if isinstance(deciding.speed_kmh, float) and isinstance(deciding.position_m, float):
            row = int((relevant.speeds_kmh == deciding.speed_kmh).argmax())
            column = int((relevant.positions_m == deciding.position_m).argmax())
            running = deciding.running
    after_peak_m = -_AFTER_PEAK_M if running == "against" else _AFTER_PEAK_M
    return simulator.force_history(
        profile,
        float(relevant.speeds_kmh[row]),
        float(relevant.positions_m[column]),
        until_m=float(relevant.peak_x_m[row, column]) + after_peak_m,
        running=running,
    )
