"""The rows of a campaign's results: verdicts, forces by speed, rejections.

A weld is known by `weld_number`, its place in the order of the sources, and each vehicle over it has rows of its own.
Columns say their units in their names.
"""

from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
from msgspec import UNSET

from weld_force_ros.assessment.criteria import CRITERIA
from weld_force_ros.assessment.limits import held_values
from weld_force_ros.messages import AssessmentSettings, Criterion, ForceMap, Verdict, WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages, passages, relevant_positions

_WHO: dict[str, pa.DataType] = {
    "weld_number": pa.int64(),
    "vehicle": pa.string(),
}
_OF_PROFILE = {
    "weld_id": pa.string(),
    "source": pa.string(),
    "rail": pa.string(),
    "chainage_m": pa.float64(),
    "line_speed_kmh": pa.float64(),
    "weld_position_m": pa.float64(),
    "profile_sha256": pa.string(),
}
_OF_VERDICT = {
    "config_sha256": pa.string(),
    "limits_sha256": pa.string(),
    "decision": pa.string(),
    "reason": pa.string(),
    "peak_force_n": pa.float64(),
    "static_load_n": pa.float64(),
    "worst_speed_kmh": pa.float64(),
    "worst_position_m": pa.float64(),
    "worst_x_m": pa.float64(),
    "judged_speed_kmh": pa.float64(),
    "permitted_speed_kmh": pa.float64(),
    "geometry_kind": pa.string(),
    "curve_class": pa.string(),
}
_OF_MEASURES = {
    "dip_m": pa.float64(),
    "protrusion_m": pa.float64(),
    "gradient_rad": pa.float64(),
    "straightedge_m": pa.float64(),
    "spacing_m": pa.float64(),
}

VERDICTS = pa.schema(
    {
        **_WHO, "line": pa.string(), "origin": pa.string(), "track": pa.string(),
        **_OF_PROFILE, **_OF_VERDICT, "worst_criterion": pa.string(), "worst_ratio": pa.float64(),
        **{f"value_{name}": pa.float64() for name in CRITERIA}, **_OF_MEASURES,
    }
)  # fmt: skip
"""One row a weld and vehicle; `value_*` is each criterion's value in SI units, `worst_*` the criterion nearest to its
limit, or farthest beyond it, of those that decide."""

_FORCES = ("peak_force_n", "min_force_n", "contact_loss_s", "p2_force_n", "force_20hz_n")
SPEEDS = pa.schema(
    {
        **_WHO,
        "speed_kmh": pa.float64(),
        **{name: pa.float64() for name in _FORCES},
        "at_position_m": pa.float64(),
        "within_limits": pa.bool_(),
    }
)
"""One row a weld, vehicle and speed: the worst over the positions that count; `within_limits`: of a line of it."""

REJECTIONS = pa.schema(
    {"weld_number": pa.int64(), "vehicle": pa.string(), "line": pa.string(), "origin": pa.string(),
     "source": pa.string(), "reason": pa.string(), "remedy": pa.string()}
)  # fmt: skip
"""One row a weld that could not be assessed; `vehicle` where it is one vehicle's passages that could not."""


def verdict_row(profile: WeldProfile, force_map: ForceMap, verdict: Verdict) -> dict[str, Any]:
    """The columns of `VERDICTS` that these say."""
    row: dict[str, Any] = {name: getattr(profile, name) for name in _OF_PROFILE}
    row |= {name: getattr(verdict, name) for name in _OF_VERDICT}
    row |= {name: getattr(force_map.measures, name) for name in _OF_MEASURES}
    row |= {f"value_{criterion.name}": criterion.value for criterion in verdict.criteria}
    worst = max([c for c in verdict.criteria if c.decides] or verdict.criteria, key=_ratio)
    row |= {"track": force_map.track, "worst_criterion": worst.name, "worst_ratio": _ratio(worst)}
    return {name: value for name, value in row.items() if value is not UNSET}


def _ratio(criterion: Criterion) -> float:
    """Value over limit; beyond a limit of zero it is infinite."""
    if criterion.limit > 0:
        return criterion.value / criterion.limit
    return 0.0 if criterion.passed else float("inf")


def speed_columns(force_map: ForceMap, limits: AssessmentSettings) -> dict[str, Any]:
    """The columns of `SPEEDS` but for those that say which weld and vehicle, (n_speed,) each."""
    speeds, positions = np.array(force_map.speeds_kmh), np.array(force_map.positions_m)
    columns = relevant_positions(positions, force_map.weld_position_m, force_map.span_m)
    counted = passages(force_map, force_map.static_load_n, (len(speeds), len(positions)), np.s_[:, columns])
    if counted.p2_n is None or counted.below_20hz_n is None:
        raise ValueError("low-passed forces were not asked for")
    worst = Passages(
        counted.static_n,
        counted.peak_n.max(axis=1),
        counted.min_n.min(axis=1),
        counted.contact_loss_s.max(axis=1),
        counted.p2_n.max(axis=1),
        counted.below_20hz_n.max(axis=1),
    )
    forces = (worst.peak_n, worst.min_n, worst.contact_loss_s, worst.p2_n, worst.below_20hz_n)
    return {
        "speed_kmh": speeds,
        **dict(zip(_FORCES, forces, strict=True)),
        "at_position_m": positions[columns][counted.peak_n.argmax(axis=1)],
        "within_limits": _within(speeds, worst, limits),
    }


def _within(speeds_kmh: FloatArray, worst: Passages, limits: AssessmentSettings) -> Any:
    within = np.ones(len(speeds_kmh), dtype=np.bool_)
    for limit, held, values in held_values(speeds_kmh, worst, limits.limits):
        within &= ~held | (values <= limit.limit)
    return within
