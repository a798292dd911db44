"""Limits and rules -> decision: what a force map means for a weld.

Every criterion within its limit: accept. One beyond its reject limit: reject. Else: grind. `undecided` where the input
cannot support that: the place in the span is unknown and the decision depends on it, or nothing is exceeded but
something that could be was not seen, because samples are too far apart or a criterion was not computed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

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
from weld_force_ros.assessment.probability import influences
from weld_force_ros.messages import (
    Criterion,
    Decision,
    ForceMap,
    Limit,
    NormPoint,
    PositionOutcome,
    Rules,
    UncertaintyResult,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import RelevantMap, passages, relevant_range

WORST_POSITION = Rules(unknown_position="worst")
"""The rules of recordings that state none."""

_RESOLVED_BY_SAMPLES = 2  # a wave: the sampling theorem
_SEVERITY: tuple[Decision, ...] = ("accept", "grind", "reject")


@dataclass(frozen=True)
class Evaluation:
    """What the criteria say of one weld."""

    decision: Decision
    reason: str
    criteria: tuple[Criterion, ...]
    unjudged: tuple[str, ...]
    by_position: tuple[PositionOutcome, ...]
    peak_force_n: float
    worst_speed_kmh: float
    worst_position_m: float
    worst_x_m: float
    judged_speed_kmh: float


@dataclass
class _Evaluated:
    """Criteria in the order of their limits, with what each decides at every position."""

    criteria: list[Criterion] = field(default_factory=list)
    severities: list[NDArray[np.int64]] = field(default_factory=list)
    unjudged: list[str] = field(default_factory=list)


def evaluate(
    force_map: ForceMap,
    limits: Sequence[Limit],
    rules: Rules = WORST_POSITION,
    gradient_norm: Sequence[NormPoint] = (),
) -> Evaluation:
    """Hold a force map against limits.

    Args:
        force_map: of one weld.
        limits: those that are for other line speeds are passed over.
        rules: how they become a decision.
        gradient_norm: of the quality index, see `weld_force_ros.assessment.criteria.geometry_value`.

    Raises:
        InputError: a limit for a criterion that does not exist.
    """
    check(limits)
    judged = relevant_range(force_map)
    weighed = _Evaluated()
    for limit in limits:
        if applies(limit, judged.line_kmh):
            _evaluate_limit(weighed, limit, judged, force_map, gradient_norm)
    row, column = np.unravel_index(np.argmax(judged.passages.peak_n), judged.passages.peak_n.shape)
    peak, speed = float(judged.passages.peak_n[row, column]), float(judged.speeds_kmh[row])
    position = float(judged.positions_m[column])
    by_position = np.max([np.zeros(len(judged.positions_m), dtype=np.int64), *weighed.severities], axis=0)
    decision, doubt = _decide(by_position, judged, force_map, rules, speed, weighed.unjudged)
    failed = [c.name for c in weighed.criteria if not c.passed and c.decides]
    beside = [c.name for c in weighed.criteria if not c.passed and not c.decides]
    worst = f"peak {peak / 1e3:.0f} kN at {speed:g} km/h, weld {position * 100:.0f} cm after the sleeper"
    found = f"over the limit: {', '.join(failed)}" if failed else "all within limits"
    if beside:
        found += f" (not counted: {', '.join(beside)})"
    known = isinstance(force_map.weld_position_m, float)
    outcomes = (
        PositionOutcome(position_m=float(at), decision=_SEVERITY[severity])
        for at, severity in zip(judged.positions_m, by_position, strict=True)
    )
    return Evaluation(
        decision=decision,
        reason="; ".join([worst, found, *doubt]),
        criteria=tuple(weighed.criteria),
        unjudged=tuple(weighed.unjudged),
        by_position=() if known else tuple(outcomes),
        peak_force_n=peak,
        worst_speed_kmh=speed,
        worst_position_m=position,
        worst_x_m=float(judged.peak_x_m[row, column]),
        judged_speed_kmh=float(judged.speeds_kmh[-1]),
    )


def _evaluate_limit(
    weighed: _Evaluated, limit: Limit, judged: RelevantMap, force_map: ForceMap, gradient_norm: Sequence[NormPoint]
) -> None:
    """Hold what can happen against one limit."""
    if limit.name in GEOMETRY_CRITERIA:
        value = geometry_value(limit.name, force_map.measures, judged.line_kmh, gradient_norm)
        values = None if value is None else np.full((1, len(judged.positions_m)), value)
    else:
        values = FORCE_CRITERIA[limit.name](judged.passages)
    if values is None:
        if decides(limit):
            weighed.unjudged.append(limit.name)
        return
    criterion = _criterion(limit, values, judged)
    if isinstance(force_map.spread, UncertaintyResult):
        criterion = _with_probability(criterion, limit, force_map.spread, judged, gradient_norm)
    weighed.criteria.append(criterion)
    if not decides(limit):
        return
    at_positions = values.max(axis=0)
    weighed.severities.append((at_positions > limit.limit) + (at_positions > limit.reject_limit).astype(np.int64))


def _criterion(limit: Limit, values: FloatArray, judged: RelevantMap) -> Criterion:
    row, column = np.unravel_index(np.argmax(values), values.shape)
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
        speed_kmh=float(judged.speeds_kmh[row]),
        position_m=float(judged.positions_m[column]),
        x_m=float(judged.peak_x_m[row, column]) if limit.name in AT_THE_PEAK else UNSET,
    )


def _with_probability(
    criterion: Criterion,
    limit: Limit,
    spread: UncertaintyResult,
    judged: RelevantMap,
    gradient_norm: Sequence[NormPoint],
) -> Criterion:
    """The criterion with the share of samples beyond its limits, and what the value varies with."""
    values = _sampled(limit.name, spread, judged, gradient_norm)
    if values is None:
        return criterion
    shares = influences(values, spread)
    driver = max(shares, key=shares.__getitem__) if shares else None
    return replace(
        criterion,
        exceeding=float(np.mean(values > limit.limit)),
        exceeding_reject=float(np.mean(values > limit.reject_limit)),
        driver=driver if driver is not None else UNSET,
        driver_share=shares[driver] if driver is not None else UNSET,
    )


def _sampled(
    name: str, spread: UncertaintyResult, judged: RelevantMap, gradient_norm: Sequence[NormPoint]
) -> FloatArray | None:
    """A criterion's value of every sample, (n_sample, n_position), or (n_sample, 1) of what the geometry says."""
    if name == "straightedge":
        return np.array(spread.straightedge_m)[:, None]
    if name == "quality_index":
        return np.array(spread.gradient_rad)[:, None] / gradient_norm_rad(judged.line_kmh, gradient_norm)
    shape = (len(spread.support_factor), len(spread.positions_m))
    return FORCE_CRITERIA[name](passages(spread, judged.passages.static_n, shape))


def _decide(
    by_position: NDArray[np.int64],
    judged: RelevantMap,
    force_map: ForceMap,
    rules: Rules,
    worst_speed_kmh: float,
    unjudged: Sequence[str],
) -> tuple[Decision, list[str]]:
    """The decision, and what stands in the way of one: what is missing and what to do about it."""
    worst = _SEVERITY[by_position.max()]
    unknown = isinstance(force_map.weld_position_m, UnsetType)
    if unknown and rules.unknown_position == "undecided" and by_position.min() != by_position.max():
        where = _by_stretches(judged.positions_m, by_position)
        return "undecided", [f"{where}: measure the weld's distance from the sleeper before it"]
    doubts = [*_unseen(force_map, rules, worst_speed_kmh), *(f"{name} was not computed" for name in unjudged)]
    return ("undecided" if worst == "accept" and doubts else worst), doubts


def _unseen(force_map: ForceMap, rules: Rules, worst_speed_kmh: float) -> list[str]:
    """What samples too far apart do not show, in words; nothing if they are near enough, or their distance unknown."""
    if isinstance(force_map.measures, UnsetType) or not rules.resolved_hz:
        return []
    shortest_m = _RESOLVED_BY_SAMPLES * force_map.measures.spacing_m
    resolved_hz = worst_speed_kmh / 3.6 / shortest_m
    if resolved_hz >= rules.resolved_hz:
        return []
    needed_mm = 1e3 * worst_speed_kmh / 3.6 / rules.resolved_hz / _RESOLVED_BY_SAMPLES
    return [
        f"samples {force_map.measures.spacing_m * 1e3:.3g} mm apart do not show waves below {shortest_m * 1e3:.3g} mm, "
        f"which act above {resolved_hz:.0f} Hz at {worst_speed_kmh:g} km/h: measure every {needed_mm:.2g} mm or closer"
    ]


def _by_stretches(positions_m: FloatArray, by_position: NDArray[np.int64]) -> str:
    """`accept at 12 to 40 cm after the sleeper, grind at 0 to 8 and 44 to 56 cm`."""
    parts = []
    for severity in np.unique(by_position):
        inside = np.concatenate([[False], by_position == severity, [False]])
        edges = np.flatnonzero(np.diff(inside)).reshape(-1, 2)
        stretches = [_stretch(positions_m[first], positions_m[last - 1]) for first, last in edges]
        parts.append(f"{_SEVERITY[severity]} at {' and '.join(stretches)} cm")
    return f"{', '.join(parts)} after the sleeper"


def _stretch(first_m: float, last_m: float) -> str:
    return f"{first_m * 100:.0f}" if first_m == last_m else f"{first_m * 100:.0f} to {last_m * 100:.0f}"
