"""View the part of a force map that counts: up to the line's speed, at the weld's place."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from msgspec import UnsetType
from numpy.typing import NDArray

from weld_force_ros.messages import ForceMap
from weld_force_ros.physics.arrays import FloatArray


class PassageColumns(Protocol):
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


def passages(rolled: PassageColumns, static_n: float, shape: tuple[int, ...], part: Any = ...) -> Passages:
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


@dataclass(frozen=True)
class RelevantMap:
    """The part of a force map that can happen: up to the line's speed, at the weld's position if that is known.

    Attributes:
        speeds_kmh: (n_speed,).
        positions_m: (n_position,).
        passages: of shape (n_speed, n_position).
        peak_x_m: (n_speed, n_position).
        line_kmh: the line's speed, or the highest that was computed.
    """

    speeds_kmh: FloatArray
    positions_m: FloatArray
    passages: Passages
    peak_x_m: FloatArray
    line_kmh: float


def relevant_range(force_map: ForceMap) -> RelevantMap:
    """The part of a force map that can happen."""
    speeds, positions = np.array(force_map.speeds_kmh), np.array(force_map.positions_m)
    rows, line_kmh = np.arange(len(speeds)), float(speeds[-1])
    if not isinstance(force_map.line_speed_kmh, UnsetType):
        line_kmh = force_map.line_speed_kmh
        # A grid that starts above the line's speed is judged at its lowest.
        rows = rows[: max(1, int(np.sum(speeds <= line_kmh * (1 + 1e-9))))]
    columns = relevant_positions(positions, force_map.weld_position_m, force_map.span_m)
    shape, part = (len(speeds), len(positions)), np.ix_(rows, columns)
    return RelevantMap(
        speeds[rows],
        positions[columns],
        passages(force_map, force_map.static_load_n, shape, part),
        np.array(force_map.peak_x_m).reshape(shape)[part],
        line_kmh,
    )


def relevant_positions(positions_m: FloatArray, at_m: float | UnsetType, span_m: float) -> NDArray[np.intp]:
    """Which positions count: all, or the computed ones on either side of `at_m`, round the span.

    One if it was computed itself.
    """
    if isinstance(at_m, UnsetType):
        return np.arange(len(positions_m))
    ahead = np.mod(positions_m - at_m, span_m)
    behind = np.mod(at_m - positions_m, span_m)
    exact = np.flatnonzero(np.minimum(ahead, behind) < 1e-6)
    return exact[:1] if len(exact) else np.unique([np.argmin(ahead), np.argmin(behind)])
