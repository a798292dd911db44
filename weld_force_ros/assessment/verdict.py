"""Evaluate a force map against limits and rules, to a decision.

Every criterion within its limit: accept. One beyond its reject limit: reject. Else: grind. `undecided` where the input
cannot support that: the position in the span is unknown and the decision depends on it, or nothing is exceeded but
something that could be was not seen, because samples are too far apart or a criterion was not computed.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace
from numpy.typing import NDArray

from weld_force_ros.assessment.criteria import (
    AT_THE_PEAK,
    FORCE_CRITERIA,
    GEOMETRY_CRITERIA,
    geometry_value,
    gradient_norm_rad,
)
from weld_force_ros.assessment.limits import applies, check, decides
from weld_force_ros.assessment.probability import influences, interval
from weld_force_ros.messages import (
    Criterion,
    Decision,
    Limit,
    NormPoint,
    PositionOutcome,
    Rules,
    UncertaintyResult,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages, RelevantMap, index_of_largest

WORST_POSITION = Rules(unknown_position="worst")
"""The rules of recordings that state none."""

_RESOLVED_BY_SAMPLES = 2  # a wave: the sampling theorem
_COARSE_M, _FINE_M = 4.9e-5, 1e-5  # steps of heights: of the first, short waves come out up to 18 % off
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
        gradient_norm: of the quality index, see `weld_force_ros.assessment.criteria.geometry_value`.

    Raises:
        InputError: a limit for a criterion that does not exist.
    """
    check(limits)
    criteria, unjudged = list[Criterion](), list[str]()
    severity = np.zeros(len(relevant.positions_m), dtype=np.int64)
    for limit in limits:
        if not applies(limit, relevant.line_kmh):
            continue
        values = _values(limit.name, relevant, gradient_norm)
        if values is None:
            unjudged += [limit.name] if decides(limit) else []
            continue
        criterion = _criterion(limit, values, relevant)
        spread = relevant.force_map.spread
        if isinstance(spread, UncertaintyResult):
            criterion = _with_probability(criterion, limit, spread, relevant, gradient_norm)
        criteria.append(criterion)
        if decides(limit):
            at_positions = values.max(axis=0)
            beyond = (at_positions > limit.limit) + (at_positions > limit.reject_limit).astype(np.int64)
            severity = np.maximum(severity, beyond)
    row, column = relevant.peak_index
    decision, doubts = _decide(severity, relevant, rules, unjudged)
    return Evaluation(
        decision=decision,
        reason="; ".join([*_findings(relevant, criteria), *doubts]),
        criteria=criteria,
        unjudged=unjudged,
        by_position=[] if isinstance(relevant.force_map.weld_position_m, float) else _outcomes(relevant, severity),
        peak_force_n=float(relevant.passages.peak_force_n[row, column]),
        worst_speed_kmh=float(relevant.speeds_kmh[row]),
        worst_position_m=float(relevant.positions_m[column]),
        worst_x_m=float(relevant.peak_x_m[row, column]),
        judged_speed_kmh=float(relevant.speeds_kmh[-1]),
    )


def _values(name: str, relevant: RelevantMap, gradient_norm: Sequence[NormPoint]) -> FloatArray | None:
    """Return a criterion's values, (n_speed, n_position) or of geometry (1, n_position); None if not computed."""
    if name not in GEOMETRY_CRITERIA:
        return FORCE_CRITERIA[name](relevant.passages)
    value = geometry_value(name, relevant.force_map.measures, relevant.line_kmh, gradient_norm)
    return None if value is None else np.full((1, len(relevant.positions_m)), value)


def _criterion(limit: Limit, values: FloatArray, relevant: RelevantMap) -> Criterion:
    row, column = index_of_largest(values)
    value = float(values[row, column])
    criterion = Criterion(
        name=limit.name,
        value=value,
        limit=limit.limit,
        unit=limit.unit,
        passed=value <= limit.limit,
        source=limit.source,
        verified=limit.verified,
        reject_limit=limit.reject_limit,
        margin=limit.limit - value,
        applies=limit.applies,
        decides=decides(limit),
    )
    if limit.name in GEOMETRY_CRITERIA:
        return criterion
    return replace(
        criterion,
        speed_kmh=float(relevant.speeds_kmh[row]),
        position_m=float(relevant.positions_m[column]),
        x_m=float(relevant.peak_x_m[row, column]) if limit.name in AT_THE_PEAK else UNSET,
    )


def _with_probability(
    criterion: Criterion,
    limit: Limit,
    spread: UncertaintyResult,
    relevant: RelevantMap,
    gradient_norm: Sequence[NormPoint],
) -> Criterion:
    """Return the criterion with the share of samples beyond its limits, and what its value depends on most."""
    values = _sampled(limit.name, spread, relevant, gradient_norm)
    if values is None:
        return criterion
    shares, (low, high) = influences(values, spread), interval(values)
    driver = max(shares, key=shares.__getitem__) if shares else None
    return replace(
        criterion,
        low=low,
        high=high,
        exceeding=float(np.mean(values > limit.limit)),
        exceeding_reject=float(np.mean(values > limit.reject_limit)),
        driver=driver if driver is not None else UNSET,
        driver_share=shares[driver] if driver is not None else UNSET,
    )


def _sampled(
    name: str, spread: UncertaintyResult, relevant: RelevantMap, gradient_norm: Sequence[NormPoint]
) -> FloatArray | None:
    """Return a criterion's value of every sample, (n_sample, n_position), or of geometry (n_sample, 1)."""
    if name == "straightedge":
        return np.array(spread.straightedge_m)[:, None]
    if name == "quality_index":
        return np.array(spread.gradient_rad)[:, None] / gradient_norm_rad(relevant.line_kmh, gradient_norm)
    shape = (len(spread.support_factor), len(spread.positions_m))
    return FORCE_CRITERIA[name](Passages.of_message(spread, relevant.passages.static_load_n, shape))


def _findings(relevant: RelevantMap, criteria: Sequence[Criterion]) -> tuple[str, str]:
    """Describe the highest peak, and which limits are exceeded."""
    row, column = relevant.peak_index
    peak_kn = relevant.passages.peak_force_n[row, column] / 1e3
    speed_kmh, position_cm = relevant.speeds_kmh[row], relevant.positions_m[column] * 100
    failed = [c.name for c in criteria if not c.passed and c.decides]
    informative = [c.name for c in criteria if not c.passed and not c.decides]
    return (
        f"peak {peak_kn:.0f} kN at {speed_kmh:g} km/h, weld {position_cm:.0f} cm after the sleeper",
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
    doubts = [*_unseen(relevant, rules), *(f"{name} was not computed" for name in unjudged)]
    return ("undecided" if worst == "accept" and doubts else worst), doubts


def _unseen(relevant: RelevantMap, rules: Rules) -> list[str]:
    """Describe what samples too far apart, or heights in too large steps, do not show; nothing if all can be seen."""
    measures, worst_speed_kmh = relevant.force_map.measures, float(relevant.speeds_kmh[relevant.peak_index[0]])
    if isinstance(measures, UnsetType) or not rules.resolved_hz:
        return []
    if isinstance(measures.resolution_m, float) and measures.resolution_m >= _COARSE_M:
        return [
            f"heights in steps of {measures.resolution_m * 1e3:.2g} mm do not show what is lower: measure in steps of "
            f"{_FINE_M * 1e3:g} mm"
        ]
    shortest_m = _RESOLVED_BY_SAMPLES * measures.spacing_m
    resolved_hz = worst_speed_kmh / 3.6 / shortest_m
    if resolved_hz >= rules.resolved_hz:
        return []
    needed_mm = 1e3 * worst_speed_kmh / 3.6 / rules.resolved_hz / _RESOLVED_BY_SAMPLES
    return [
        f"samples {measures.spacing_m * 1e3:.3g} mm apart do not show waves below {shortest_m * 1e3:.3g} mm, "
        f"which act above {resolved_hz:.0f} Hz at {worst_speed_kmh:g} km/h: measure every {needed_mm:.2g} mm or closer"
    ]


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
