"""Criteria that a weld is held against: what is computed of it as numbers that are the worse the larger they are."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from msgspec import UnsetType
from numpy.typing import NDArray

from weld_force_ros.core.geometry import NORM_MRAD
from weld_force_ros.errors import InputError
from weld_force_ros.messages import Limit, NormPoint, ProfileMeasures
from weld_force_ros.physics.arrays import FloatArray


class Rolled(Protocol):
    """A message's columns of passages: a map's, a curve's, or samples'."""

    peak_force_n: list[float]
    min_force_n: list[float]
    contact_loss_s: list[float]
    p2_force_n: list[float] | UnsetType
    force_20hz_n: list[float] | UnsetType


@dataclass(frozen=True)
class Passages:
    """Passages over a weld, arrays of one shape; None where low-passed forces were not computed.

    Attributes:
        static_n: static wheel load.
        peak_n: greatest contact force.
        min_n: least contact force.
        contact_loss_s: time without contact.
        p2_n: greatest force below 120 Hz.
        below_20hz_n: greatest force below 20 Hz.
    """

    static_n: float
    peak_n: FloatArray
    min_n: FloatArray
    contact_loss_s: FloatArray
    p2_n: FloatArray | None
    below_20hz_n: FloatArray | None


def passages(rolled: Rolled, static_n: float, shape: tuple[int, ...], part: Any = ...) -> Passages:
    """The passages of a message.

    Args:
        rolled: columns, row-major.
        static_n: static wheel load.
        shape: of the columns.
        part: index that picks those that count.
    """

    def column(values: list[float]) -> FloatArray:
        return np.asarray(np.array(values).reshape(shape)[part])

    return Passages(
        static_n,
        column(rolled.peak_force_n),
        column(rolled.min_force_n),
        column(rolled.contact_loss_s),
        None if isinstance(rolled.p2_force_n, UnsetType) else column(rolled.p2_force_n),
        None if isinstance(rolled.force_20hz_n, UnsetType) else column(rolled.force_20hz_n),
    )


FORCE_CRITERIA: Mapping[str, Callable[[Passages], FloatArray | None]] = {
    "peak_force": lambda p: p.peak_n,
    "p2_force": lambda p: p.p2_n,
    "force_20hz": lambda p: p.below_20hz_n,
    "dynamic_factor": lambda p: p.peak_n / p.static_n,
    "hertz_pressure_index": lambda p: np.cbrt(p.peak_n / p.static_n),
    "unloading": lambda p: 1 - p.min_n / p.static_n,
    "contact_loss": lambda p: p.contact_loss_s,
}
"""What each says of every passage. The largest Hertz pressure goes with the cube root of the force (Johnson, Contact
Mechanics, 1985, chapter 4), whatever the curvatures: so the index is relative to the pressure at rest."""

AT_THE_PEAK = ("peak_force", "dynamic_factor", "hertz_pressure_index")
"""Those whose place along the rail is that of the greatest force."""

GEOMETRY_CRITERIA = ("quality_index", "straightedge")
"""What the profile says by itself."""

CRITERIA = (*FORCE_CRITERIA, *GEOMETRY_CRITERIA)


def geometry_value(
    name: str, measures: ProfileMeasures | UnsetType, line_kmh: float, norm: Sequence[NormPoint]
) -> float | None:
    """The value of a geometry criterion on a line of a speed; None if the profile was not measured for it.

    Args:
        name: of `GEOMETRY_CRITERIA`.
        measures: of the profile.
        line_kmh: the line's speed.
        norm: largest gradient by line speed; that of `weld_force_ros.core.geometry.NORM_MRAD` if empty.
    """
    if isinstance(measures, UnsetType):
        return None
    if name == "straightedge":
        return measures.straightedge_m
    return measures.gradient_rad / gradient_norm_rad(line_kmh, norm)


def gradient_norm_rad(line_kmh: float, norm: Sequence[NormPoint]) -> float:
    """Largest gradient on a line of a speed: linear between points, constant beyond them."""
    points = [(p.speed_kmh, p.gradient_rad) for p in norm] or [(speed, 1e-3 * mrad) for speed, mrad in NORM_MRAD]
    speeds, gradients = zip(*points, strict=True)
    return float(np.interp(line_kmh, speeds, gradients))


def applies(limit: Limit, line_kmh: float) -> bool:
    """Whether a limit holds on a line of a speed."""
    return bool(in_force(limit, np.array(line_kmh)))


def in_force(limit: Limit, lines_kmh: FloatArray) -> NDArray[np.bool_]:
    """Whether a limit holds on lines of some speeds."""
    above = 0.0 if isinstance(limit.above_kmh, UnsetType) else limit.above_kmh
    upto = np.inf if isinstance(limit.to_kmh, UnsetType) else limit.to_kmh
    return np.asarray((above < lines_kmh) & (lines_kmh <= upto))


def decides(limit: Limit) -> bool:
    """Whether a decision hangs on a limit."""
    return limit.decides is not False


def held_values(
    speeds_kmh: FloatArray, at: Passages, limits: Sequence[Limit]
) -> Iterator[tuple[Limit, NDArray[np.bool_], FloatArray]]:
    """Deciding limits of force, whether each holds on lines of some speeds, and its criterion's values there."""
    for limit in limits:
        values = FORCE_CRITERIA[limit.name](at) if decides(limit) and limit.name in FORCE_CRITERIA else None
        if values is not None:
            yield limit, in_force(limit, speeds_kmh), values


def check(limits: Sequence[Limit]) -> None:
    """Raise an InputError if a limit is for a criterion that does not exist."""
    for limit in limits:
        if limit.name not in CRITERIA:
            raise InputError(f"limit {limit.name!r} names no criterion", f"use {', '.join(CRITERIA)}")
