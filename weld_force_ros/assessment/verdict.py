"""Evaluate a force map against limits and rules, to a decision.

Every criterion within its limit: accept. One beyond its reject limit: reject. Else: grind. `undecided` where the input
cannot support that: the position in the span is unknown and the decision depends on it, or nothing is exceeded but
something that could be was not seen, because samples are too far apart or a criterion was not computed.
"""

from collections.abc import Sequence
from dataclasses import replace as replace_fields
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace
from numpy.typing import NDArray

from weld_force_ros.assessment.coverage import uncomputed, unseen
from weld_force_ros.assessment.criteria import (
    FORCE_CRITERIA,
    GEOMETRY_CRITERIA,
    geometry_values,
)
from weld_force_ros.assessment.decision import Judged, answer, measure_next, model_deviation, overall, widened
from weld_force_ros.assessment.limits import Levels, applies, check, decides, levels, within_limits
from weld_force_ros.assessment.probability import influences, interval
from weld_force_ros.assessment.speed_advice import in_prose_kmh
from weld_force_ros.messages import (
    Answer,
    Criterion,
    Decision,
    Direction,
    Limit,
    NormPoint,
    PositionOutcome,
    Rules,
    UncertaintyResult,
    known,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages, RelevantMap, index_of_largest
from weld_force_ros.simulation.running import direction_in_words

WORST_POSITION = Rules(unknown_position="worst")
"""The rules of recordings that state none."""

_STATE_LINE_SPEED = "state the line's speed: `--line-speed`, or `# line_speed_kmh:` in the file"
_SEVERITY: tuple[Decision, ...] = ("accept", "grind", "reject")


class Evaluation(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of the criteria for one weld: fields of `weld_force_ros.messages.Verdict`."""

    decision: Decision
    reason: str
    criteria: list[Criterion]
    unjudged: list[str]
    by_position: list[PositionOutcome]
    peak_force_n: float
    worst_speed_kmh: float
    worst_position_m: float
    worst_x_m: float
    judged_speed_kmh: float
    worst_running: Direction | UnsetType
    geometry: Answer | UnsetType = UNSET
    force: Answer | UnsetType = UNSET
    measure_next: str | UnsetType = UNSET
    accepted_risk: float | UnsetType = UNSET


def evaluate(
    relevant: RelevantMap,
    limits: Sequence[Limit],
    rules: Rules = WORST_POSITION,
    gradient_norm: Sequence[NormPoint] = (),
) -> Evaluation:
    """Evaluate the relevant part of a force map against limits.

    Args:
        relevant: of one weld's map.
        limits: those that are for other line speeds are passed over.
        rules: how they become a decision.
        gradient_norm: of the quality index, see `weld_force_ros.assessment.criteria.geometry_values`.

    Raises:
        InputError: a limit for a criterion that does not exist.
    """
    check(limits)
    judged, unjudged = list[Judged](), list[Limit]()
    severity = np.zeros(len(relevant.positions_m), dtype=np.int64)
    for limit in limits:
        if not applies(limit, relevant.line_kmh):
            continue
        values = _values(limit, relevant, gradient_norm)
        if values is None:
            unjudged += [limit] if decides(limit) else []
            continue
        one = _judged(limit, values, relevant, rules, gradient_norm)
        judged.append(one)
        if decides(limit):
            at_positions = values.max(axis=0)
            beyond = (at_positions > one.levels.limit) + (at_positions > one.levels.reject_limit).astype(np.int64)
            severity = np.maximum(severity, beyond)
    row, column = relevant.peak_index
    found = _two_answers(judged, unjudged, relevant, limits, rules) if rules.accepted_risk else None
    decision, doubts = found.outcome if found else _decide(severity, relevant, rules, [one.name for one in unjudged])
    criteria = [one.criterion for one in judged]
    return Evaluation(
        decision=decision,
        reason="; ".join([*_findings(relevant, criteria), *doubts]),
        criteria=criteria,
        unjudged=[limit.name for limit in unjudged],
        by_position=[] if isinstance(relevant.force_map.weld_position_m, float) else _outcomes(relevant, severity),
        peak_force_n=float(relevant.passages.peak_force_n[row, column]),
        worst_speed_kmh=float(relevant.speeds_kmh[row]),
        worst_position_m=float(relevant.positions_m[column]),
        worst_x_m=float(relevant.peak_x_m[row, column]),
        judged_speed_kmh=float(relevant.speeds_kmh[-1]),
        geometry=found.geometry if found else UNSET,
        force=found.force if found else UNSET,
        measure_next=found.measure_next or UNSET if found else UNSET,
        accepted_risk=rules.accepted_risk,
        worst_running=relevant.direction("peak_force_n", row, column),
    )


def _values(limit: Limit, relevant: RelevantMap, gradient_norm: Sequence[NormPoint]) -> FloatArray | None:
    """Return a criterion's values, (n_speed, n_position) or of geometry (1, n_position); None if not computed."""
    if limit.name not in GEOMETRY_CRITERIA:
        return FORCE_CRITERIA[limit.name].value(relevant.passages)
    value = geometry_values(limit, relevant.force_map.measures, relevant.line_kmh, gradient_norm)
    return None if value is None else np.full((1, len(relevant.positions_m)), value)


def _judged(
    limit: Limit, values: FloatArray, relevant: RelevantMap, rules: Rules, gradient_norm: Sequence[NormPoint]
) -> Judged:
    """Hold a criterion's values against its limit; with samples, also the probability that it is exceeded."""
    applied = levels(limit, relevant.passages.static_load_n)
    criterion = _criterion(limit, applied, values, relevant)
    spread = relevant.force_map.spread
    sampled = _sampled(limit, spread, relevant, gradient_norm) if isinstance(spread, UncertaintyResult) else None
    if not rules.accepted_risk:
        no_deviation = np.zeros_like(values)
        if sampled is not None and isinstance(spread, UncertaintyResult):
            shares = (np.mean(sampled > applied.limit), np.mean(sampled > applied.reject_limit))
            criterion = _with_probability(criterion, sampled, spread, *map(float, shares))
        return Judged(limit, criterion, applied, values, no_deviation)
    uncertain = values.max(axis=0, keepdims=True) if sampled is None else widened(sampled)
    rows = [] if isinstance(rules.model_uncertainty, UnsetType) else rules.model_uncertainty
    one = Judged(limit, criterion, applied, uncertain, model_deviation(limit.name, uncertain, relevant, rows))
    exceeding, rejecting = float(one.exceeds().mean()), float(one.rejects().mean())
    if sampled is not None and isinstance(spread, UncertaintyResult):
        return replace_fields(one, criterion=_with_probability(criterion, sampled, spread, exceeding, rejecting))
    return replace_fields(one, criterion=replace(criterion, exceeding=exceeding, exceeding_reject=rejecting))


def _criterion(limit: Limit, applied: Levels, values: FloatArray, relevant: RelevantMap) -> Criterion:
    row, column = index_of_largest(values)
    value = float(values[row, column])
    criterion = Criterion(
        name=limit.name,
        value=value,
        limit=applied.limit,
        unit=limit.unit,
        passed=value <= applied.limit,
        source=limit.source,
        verified=limit.verified,
        reject_limit=applied.reject_limit if np.isfinite(applied.reject_limit) else UNSET,
        margin=applied.limit - value,
        applies=limit.applies,
        decides=decides(limit),
        base_m=limit.base_m,
        rule_book=limit.rule_book,
        source_kind=limit.source_kind,
    )
    if limit.name in GEOMETRY_CRITERIA:
        return criterion
    of_passages = FORCE_CRITERIA[limit.name]
    return replace(
        criterion,
        speed_kmh=float(relevant.speeds_kmh[row]),
        position_m=float(relevant.positions_m[column]),
        x_m=float(relevant.peak_x_m[row, column]) if of_passages.at_the_peak else UNSET,
        running=relevant.direction(of_passages.column, row, column),
    )


def _with_probability(
    criterion: Criterion, sampled: FloatArray, spread: UncertaintyResult, exceeding: float, rejecting: float
) -> Criterion:
    """Return the criterion with the probability of its limits being exceeded, and what its value depends on most."""
    shares, (low, high) = influences(sampled, spread), interval(sampled)
    driver = max(shares, key=shares.__getitem__) if shares else None
    return replace(
        criterion,
        low=low,
        high=high,
        exceeding=exceeding,
        exceeding_reject=rejecting,
        driver=driver if driver is not None else UNSET,
        driver_share=shares[driver] if driver is not None else UNSET,
    )


def _sampled(
    limit: Limit, spread: UncertaintyResult, relevant: RelevantMap, gradient_norm: Sequence[NormPoint]
) -> FloatArray | None:
    """Return a criterion's value of every sample, (n_sample, n_position), or of geometry (n_sample, 1)."""
    if limit.name in GEOMETRY_CRITERIA:
        found = geometry_values(limit, spread, relevant.line_kmh, gradient_norm)
        return None if found is None else found[:, None]
    shape = (len(spread.support_factor), len(spread.positions_m))
    return FORCE_CRITERIA[limit.name].value(Passages.of_message(spread, relevant.passages.static_load_n, shape))


class _TwoAnswers(NamedTuple):
    """The two answers, the decision they make, and what would decide an undecided one."""

    geometry: Answer
    force: Answer
    measure_next: str | None

    @property
    def outcome(self) -> tuple[Decision, list[str]]:
        """Decision, and each answer in a clause."""
        answers = (("geometry", self.geometry), ("force", self.force))
        return overall(self.geometry, self.force), [
            f"{name} ({' and '.join(one.rule_books) or 'by standard'}): {one.decision}: {one.reason}"
            for name, one in answers
        ]


def _two_answers(
    judged: Sequence[Judged], unjudged: Sequence[Limit], relevant: RelevantMap, limits: Sequence[Limit], rules: Rules
) -> _TwoAnswers:
    """Return both answers at the accepted risk, and what would decide an undecided weld."""
    risk = known(rules.accepted_risk)
    assert risk is not None, "the caller has asked"  # noqa: S101
    certain = isinstance(relevant.force_map.weld_position_m, float) or rules.unknown_position == "worst"
    unmeasured = {
        is_geometry: [_unmeasured(one, relevant) for one in unjudged if (one.name in GEOMETRY_CRITERIA) is is_geometry]
        for is_geometry in (True, False)
    }
    doubts = {
        True: [*unmeasured[True], *unseen(relevant, rules)],
        False: [*unmeasured[False], *uncomputed(relevant, limits), *unseen(relevant, rules)],
    }
    geometry, force = (
        answer(judged, doubts[is_geometry], risk, is_geometry=is_geometry, certain_places=certain)
        for is_geometry in (True, False)
    )
    slower = _without_line_speed(force, limits, relevant)
    if slower is not force:
        return _TwoAnswers(geometry, slower, _STATE_LINE_SPEED)
    undecided = {is_geometry for is_geometry, one in ((True, geometry), (False, force)) if one.decision == "undecided"}
    for is_geometry in undecided:
        if doubts[is_geometry]:
            return _TwoAnswers(geometry, force, doubts[is_geometry][0])
    open_ones = [one for one in judged if one.of_geometry in undecided]
    return _TwoAnswers(geometry, force, measure_next(open_ones, relevant.force_map.spread, position_known=certain))


def _unmeasured(limit: Limit, relevant: RelevantMap) -> str:
    if isinstance(limit.base_m, float) and not isinstance(relevant.force_map.measures, UnsetType):
        return f"the record is too short for {limit.name} on {limit.base_m:g} m: measure {limit.base_m:g} m or more"
    return f"{limit.name} was not computed"


def _without_line_speed(force: Answer, limits: Sequence[Limit], relevant: RelevantMap) -> Answer:
    """Return the answer on forces that would be another on a slower line as undecided: up to where they hold."""
    if isinstance(relevant.force_map.line_speed_kmh, float) or force.decision not in ("grind", "reject"):
        return force
    speeds, worst = relevant.worst_by_speed()
    within = within_limits(speeds, worst.accumulated(), limits)
    if not within[0]:
        return force
    highest_kmh = in_prose_kmh(float(speeds[int(np.argmin(within)) - 1]), float(speeds[0]))
    holds = f"forces are within limits up to {highest_kmh:g} km/h"
    doubt = f"the line's speed is not stated: {holds}"
    return replace(force, decision="undecided", reason=f"{doubt}; {force.reason}", doubts=[doubt, *force.doubts])


def _findings(relevant: RelevantMap, criteria: Sequence[Criterion]) -> tuple[str, str]:
    """Describe the highest peak, and which limits are exceeded."""
    row, column = relevant.peak_index
    peak_kn = relevant.passages.peak_force_n[row, column] / 1e3
    speed_kmh, position_cm = relevant.speeds_kmh[row], relevant.positions_m[column] * 100
    running = relevant.direction("peak_force_n", row, column)
    words = f", running {direction_in_words(running)}" if relevant.force_map.running == "both" else ""
    failed = [c.name for c in criteria if not c.passed and c.decides]
    informative = [c.name for c in criteria if not c.passed and not c.decides]
    return (
        f"peak {peak_kn:.0f} kN at {speed_kmh:g} km/h, weld {position_cm:.0f} cm after the sleeper{words}",
        (f"over the limit: {', '.join(failed)}" if failed else "all within limits")
        + (f" (informative only: {', '.join(informative)})" if informative else ""),
    )


def _outcomes(relevant: RelevantMap, severity: NDArray[np.int64]) -> list[PositionOutcome]:
    return [
        PositionOutcome(position_m=float(at), decision=_SEVERITY[level])
        for at, level in zip(relevant.positions_m, severity, strict=True)
    ]


def _decide(
    severity: NDArray[np.int64], relevant: RelevantMap, rules: Rules, unjudged: Sequence[str]
) -> tuple[Decision, list[str]]:
    """Return the decision, and what stands in the way of one: what is missing and what to do about it."""
    worst = _SEVERITY[severity.max()]
    unknown = isinstance(relevant.force_map.weld_position_m, UnsetType)
    if unknown and rules.unknown_position == "undecided" and severity.min() != severity.max():
        where = _by_stretches(relevant.positions_m, severity)
        return "undecided", [f"{where}: measure the weld's distance from the sleeper before it"]
    doubts = [*unseen(relevant, rules), *(f"{name} was not computed" for name in unjudged)]
    return ("undecided" if worst == "accept" and doubts else worst), doubts


def _by_stretches(positions_m: FloatArray, by_position: NDArray[np.int64]) -> str:
    """Describe decisions as `accept at 12 to 40 cm after the sleeper, grind at 0 to 8 and 44 to 56 cm`."""
    parts = []
    for severity in np.unique(by_position):
        inside = np.concatenate([[False], by_position == severity, [False]])
        edges = np.flatnonzero(np.diff(inside)).reshape(-1, 2)
        stretches = [_stretch(positions_m[first], positions_m[last - 1]) for first, last in edges]
        parts.append(f"{_SEVERITY[severity]} at {' and '.join(stretches)} cm")
    return f"{', '.join(parts)} after the sleeper"


def _stretch(first_m: float, last_m: float) -> str:
    return f"{first_m * 100:.0f}" if first_m == last_m else f"{first_m * 100:.0f} to {last_m * 100:.0f}"
