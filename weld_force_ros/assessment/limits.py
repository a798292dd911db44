"""Say which limits hold on a line of a speed, what they come to under a static load, and what is within them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import UnsetType
from numpy.typing import NDArray

from weld_force_ros.assessment.criteria import CRITERIA, FORCE_CRITERIA
from weld_force_ros.errors import InputError
from weld_force_ros.messages import Criterion, Limit
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages


class Levels(NamedTuple):
    """What a limit comes to: up to `limit` passes, beyond `reject_limit` rejects."""

    limit: float
    reject_limit: float


def levels(limit: Limit, static_load_n: float) -> Levels:
    """Return what a limit comes to under a static wheel load; infinite where nothing rejects."""
    allowance = 0.0 if isinstance(limit.measurable, UnsetType) else limit.measurable
    factor = static_load_n if limit.form == "times_static" else 1.0
    added = allowance + (static_load_n if limit.form == "plus_static" else 0.0)
    cap = np.inf if isinstance(limit.cap, UnsetType) else limit.cap
    at_most, reject = (min(factor * one + added, cap) for one in (limit.limit, limit.reject_limit))
    return Levels(float(at_most), float("inf") if limit.beyond == "grind" else float(reject))


def applies(limit: Limit, line_kmh: float) -> bool:
    """Return whether a limit holds on a line of a speed."""
    return bool(_in_force(limit, np.array(line_kmh)))


def _in_force(limit: Limit, lines_kmh: FloatArray) -> NDArray[np.bool_]:
    above, start, below, upto = (
        default if isinstance(bound, UnsetType) else bound
        for bound, default in (
            (limit.above_kmh, 0.0), (limit.from_kmh, 0.0), (limit.below_kmh, np.inf), (limit.to_kmh, np.inf),
        )
    )  # fmt: skip
    return np.asarray((above < lines_kmh) & (start <= lines_kmh) & (lines_kmh < below) & (lines_kmh <= upto))


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
        values = FORCE_CRITERIA[limit.name].value(worst) if decides(limit) and limit.name in FORCE_CRITERIA else None
        if values is not None:
            within &= ~_in_force(limit, speeds_kmh) | (values <= levels(limit, worst.static_load_n).limit)
    return within


def check(limits: Sequence[Limit]) -> None:
    """Raise an InputError if a limit is for a criterion that does not exist."""
    for limit in limits:
        if limit.name not in CRITERIA:
            raise InputError(f"limit {limit.name!r} names no criterion", f"use {', '.join(CRITERIA)}")


def ratio(criterion: Criterion) -> float:
    """Return value over limit, infinite beyond a limit of zero."""
    if criterion.limit > 0:
        return criterion.value / criterion.limit
    return 0.0 if criterion.passed else float("inf")


def worst(criteria: Sequence[Criterion]) -> Criterion:
    """Return the criterion nearest to its limit or farthest beyond it, of those that decide if there are any."""
    return max([c for c in criteria if c.decides] or criteria, key=ratio)
