"""Criteria and limits -> decision: what a force map means for a weld."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from msgspec import UnsetType

from weld_force_ros.contract import Criterion, ForceMap, Limit
from weld_force_ros.core.track import Real
from weld_force_ros.errors import InputError


@dataclass(frozen=True)
class Finding:
    """What the criteria say of one weld."""

    decision: Literal["accept", "grind", "reject"]
    reason: str
    criteria: tuple[Criterion, ...]
    peak_force_n: float
    worst_speed_kmh: float
    worst_position_m: float
    worst_x_m: float
    judged_speed_kmh: float


@dataclass(frozen=True)
class _Judged:
    """The part of a force map that can happen: up to the line's speed, at the weld's position if that is known."""

    speeds_kmh: Real
    positions_m: Real
    peak_force_n: Real
    peak_x_m: Real
    contact_loss_s: Real


# Each criterion's value from the passages that can happen; all are read the same way: larger is worse.
MEASURES = {
    "peak_force": lambda judged, static_n: float(judged.peak_force_n.max()),
    "dynamic_factor": lambda judged, static_n: float(judged.peak_force_n.max() / static_n),
    "contact_loss": lambda judged, static_n: float(judged.contact_loss_s.max()),
}


def find(force_map: ForceMap, limits: list[Limit]) -> Finding:
    """Hold a force map against limits.

    Accepted if every criterion is within its limit, rejected if one is beyond its reject limit, else to be ground.

    Raises:
        InputError: a limit for a criterion that does not exist.
    """
    judged = _judged(force_map)
    criteria = []
    for limit in limits:
        if limit.name not in MEASURES:
            raise InputError(f"limit {limit.name!r} names no criterion", f"use {', '.join(MEASURES)}")
        value = MEASURES[limit.name](judged, force_map.static_load_n)
        criteria.append(
            Criterion(
                name=limit.name,
                value=value,
                limit=limit.limit,
                unit=limit.unit,
                passed=value <= limit.limit,
                source=limit.source,
                verified=limit.verified,
            )
        )
    failed = [c.name for c in criteria if not c.passed]
    beyond = any(c.value > limit.reject_limit for c, limit in zip(criteria, limits, strict=True))
    row, column = np.unravel_index(np.argmax(judged.peak_force_n), judged.peak_force_n.shape)
    peak, speed = float(judged.peak_force_n[row, column]), float(judged.speeds_kmh[row])
    position = float(judged.positions_m[column])
    worst = f"peak {peak / 1e3:.0f} kN at {speed:g} km/h, weld {position * 100:.0f} cm after the sleeper"
    return Finding(
        decision="reject" if beyond else "grind" if failed else "accept",
        reason=f"{worst}; over the limit: {', '.join(failed)}" if failed else f"{worst}; all within limits",
        criteria=tuple(criteria),
        peak_force_n=peak,
        worst_speed_kmh=speed,
        worst_position_m=position,
        worst_x_m=float(judged.peak_x_m[row, column]),
        judged_speed_kmh=float(judged.speeds_kmh[-1]),
    )


def _judged(force_map: ForceMap) -> _Judged:
    speeds, positions = np.array(force_map.speeds_kmh), np.array(force_map.positions_m)
    rows = np.arange(len(speeds))
    if not isinstance(force_map.line_speed_kmh, UnsetType):
        # A grid that starts above the line's speed is judged at its lowest.
        rows = rows[: max(1, int(np.sum(speeds <= force_map.line_speed_kmh * (1 + 1e-9))))]
    columns = np.arange(len(positions))
    if not isinstance(force_map.weld_position_m, UnsetType):
        columns = _neighbours(positions, force_map.weld_position_m, force_map.span_m)

    def part(values: list[float]) -> Real:
        return np.array(values).reshape(len(speeds), len(positions))[np.ix_(rows, columns)]

    return _Judged(
        speeds[rows],
        positions[columns],
        part(force_map.peak_force_n),
        part(force_map.peak_x_m),
        part(force_map.contact_loss_s),
    )


def _neighbours(positions_m: Real, at_m: float, span_m: float) -> np.ndarray:
    """The computed positions on either side of `at_m`, round the span; one if it was computed itself."""
    ahead = np.mod(positions_m - at_m, span_m)
    behind = np.mod(at_m - positions_m, span_m)
    exact = np.flatnonzero(np.minimum(ahead, behind) < 1e-6)
    return exact[:1] if len(exact) else np.unique([np.argmin(ahead), np.argmin(behind)])
