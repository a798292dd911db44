"""Define the rows of a campaign's results: verdicts of welds and of vehicles over them, forces by speed, rejections.

A weld is known by `weld_number`, its place in the order of the sources. Columns say their units in their names.
"""

from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
from msgspec import UNSET

from weld_force_ros.assessment.criteria import CRITERIA
from weld_force_ros.assessment.limits import ratio, within_limits, worst
from weld_force_ros.messages import AssessmentSettings, ForceMap, Verdict, WeldProfile
from weld_force_ros.simulation.force_map_view import COLUMNS, relevant_range

_KEYS: dict[str, pa.DataType] = {
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
    "running": pa.string(),
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
    "worst_running": pa.string(),
    "judged_speed_kmh": pa.float64(),
    "permitted_speed_kmh": pa.float64(),
    "geometry_kind": pa.string(),
    "curve_class": pa.string(),
}
_ANSWERS = ("geometry", "force")
_OF_MEASURES = {
    "dip_m": pa.float64(),
    "protrusion_m": pa.float64(),
    "gradient_rad": pa.float64(),
    "straightedge_m": pa.float64(),
    "spacing_m": pa.float64(),
}

VERDICTS = pa.schema(
    {
        **_KEYS, "line": pa.string(), "origin": pa.string(), "track": pa.string(),
        **_OF_PROFILE, **_OF_VERDICT, **{f"{name}_answer": pa.string() for name in _ANSWERS},
        "worst_criterion": pa.string(), "worst_ratio": pa.float64(),
        **{f"value_{name}": pa.float64() for name in CRITERIA}, **_OF_MEASURES,
    }
)  # fmt: skip
"""One row a weld, that of the vehicle which decides; or of the others over it. `value_*` is each criterion's value in
SI units, `worst_*` the criterion nearest to its limit, or farthest beyond it, of those that decide."""

SPEEDS = pa.schema(
    {
        **_KEYS,
        "speed_kmh": pa.float64(),
        **{name: pa.float64() for name in COLUMNS},
        "at_position_m": pa.float64(),
        "within_limits": pa.bool_(),
    }
)
"""One row a weld, vehicle and speed: the worst over the relevant positions; `within_limits` on a line of that speed."""

REJECTIONS = pa.schema(
    {"weld_number": pa.int64(), "vehicle": pa.string(), "line": pa.string(), "origin": pa.string(),
     "source": pa.string(), "reason": pa.string(), "remedy": pa.string()}
)  # fmt: skip
"""One row a weld that has no verdict; `vehicle` where it is that one's passages which could not be assessed."""


def verdict_row(profile: WeldProfile, force_map: ForceMap, verdict: Verdict) -> dict[str, Any]:
    """Return the columns of `VERDICTS` that a weld and its verdict determine."""
    row: dict[str, Any] = {name: getattr(profile, name) for name in _OF_PROFILE}
    row |= {name: getattr(verdict, name) for name in _OF_VERDICT}
    answers = {name: getattr(verdict, name) for name in _ANSWERS}
    row |= {f"{name}_answer": answer.decision for name, answer in answers.items() if answer is not UNSET}
    row |= {name: getattr(force_map.measures, name) for name in _OF_MEASURES}
    row |= {f"value_{criterion.name}": criterion.value for criterion in verdict.criteria}
    deciding = worst(verdict.criteria)
    row |= {"track": force_map.track, "worst_criterion": deciding.name, "worst_ratio": ratio(deciding)}
    return {name: value for name, value in row.items() if value is not UNSET}


def speed_columns(force_map: ForceMap, limits: AssessmentSettings) -> dict[str, Any]:
    """Return the columns of `SPEEDS`, (n_speed,) each, but for those that say which weld and vehicle."""
    relevant = relevant_range(force_map, up_to_line=False)
    worst = relevant.worst_over_positions
    return {
        "speed_kmh": relevant.speeds_kmh,
        **worst.columns,
        "at_position_m": relevant.positions_m[relevant.passages.peak_force_n.argmax(axis=1)],
        "within_limits": within_limits(relevant.speeds_kmh, worst, limits.limits),
    }
