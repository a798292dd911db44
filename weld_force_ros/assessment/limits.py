"""Read limits and rules, and say which of them hold on a line of a speed."""

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from weld_force_ros import _yaml
from weld_force_ros.assessment.criteria import CRITERIA, FORCE_CRITERIA
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.messages import (
    AssessmentSettings,
    Criterion,
    Limit,
    NormPoint,
    Rules,
    encode,
    legible,
    limits_sha256,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages


def applies(limit: Limit, line_kmh: float) -> bool:
    """Return whether a limit holds on a line of a speed."""
    return bool(_in_force(limit, np.array(line_kmh)))


def _in_force(limit: Limit, lines_kmh: FloatArray) -> NDArray[np.bool_]:
    above = 0.0 if isinstance(limit.above_kmh, UnsetType) else limit.above_kmh
    upto = np.inf if isinstance(limit.to_kmh, UnsetType) else limit.to_kmh
    return np.asarray((above < lines_kmh) & (lines_kmh <= upto))


def decides(limit: Limit) -> bool:
    """Return whether the decision depends on a limit; it is informative only otherwise."""
    return limit.decides is not False


def within_limits(speeds_kmh: FloatArray, worst: Passages, limits: Sequence[Limit]) -> NDArray[np.bool_]:
    """Return whether each speed is within the force limits, of those that decide, for a line of that speed.

    Args:
        speeds_kmh: (n,).
        worst: (n,), the worst over positions at each speed.
        limits: those for geometry criteria, which do not depend on speed, are left out.
    """
    within = np.ones(len(speeds_kmh), dtype=np.bool_)
    for limit in limits:
        values = FORCE_CRITERIA[limit.name](worst) if decides(limit) and limit.name in FORCE_CRITERIA else None
        if values is not None:
            within &= ~_in_force(limit, speeds_kmh) | (values <= limit.limit)
    return within


def check(limits: Sequence[Limit]) -> None:
    """Raise an InputError if a limit is for a criterion that does not exist."""
    for limit in limits:
        if limit.name not in CRITERIA:
            raise InputError(f"limit {limit.name!r} names no criterion", f"use {', '.join(CRITERIA)}")


class _LimitsFile(msgspec.Struct, forbid_unknown_fields=True):
    limits: list[dict[str, Any]]
    rules: Rules | UnsetType = UNSET
    gradient_norm: list[NormPoint] = []


def load_limits(path: Path | None = None) -> AssessmentSettings:
    """Read limits and rules from a YAML file of the form of `data/limits/default.yaml`, which is the default.

    A bare list of limits will do: the worst position then counts, and any sampling is good enough.

    Raises:
        InputError: not readable, not of that form, or a limit for a criterion that does not exist.
    """
    source = str(path or "data/limits/default.yaml")
    remedy = "write it after data/limits/default.yaml"
    file = path or resources.files("weld_force_ros.data") / "limits" / "default.yaml"
    try:
        content = _yaml.decode(_yaml.read(file), object)
        stated = msgspec.convert(content if isinstance(content, dict) else {"limits": content}, _LimitsFile)
        limits = [_limit(row) for row in stated.limits]
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise InputError(f"limits {source}: {legible(str(error))}", remedy) from None
    try:
        check(limits)
    except InputError as error:
        raise InputError(f"limits {source}: {error.reason}", error.remedy) from None
    settings = AssessmentSettings(
        limits_sha256="0" * 64, limits=limits, rules=stated.rules, gradient_norm=stated.gradient_norm
    )
    settings.limits_sha256 = limits_sha256(settings)
    try:
        encode(settings)
    except MessageError as error:
        raise InputError(f"limits {source}: {error.reason}", remedy) from None
    return settings


def _limit(row: dict[str, Any]) -> Limit:
    """Read a limit strictly: messages may hold fields of later versions, files no misspelt ones."""
    unknown = row.keys() - set(Limit.__struct_fields__)
    if unknown:
        raise ValueError(f"limit {row.get('name', '')}: {', '.join(sorted(unknown))} is unknown")
    return msgspec.convert(row, Limit)


def ratio(criterion: Criterion) -> float:
    """Return value over limit, infinite beyond a limit of zero."""
    if criterion.limit > 0:
        return criterion.value / criterion.limit
    return 0.0 if criterion.passed else float("inf")


def worst(criteria: Sequence[Criterion]) -> Criterion:
    """Return the criterion nearest to its limit or farthest beyond it, of those that decide if there are any."""
    return max([c for c in criteria if c.decides] or criteria, key=ratio)
