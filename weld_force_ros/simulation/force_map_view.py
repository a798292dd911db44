"""View the part of a force map that is relevant: up to the line's speed, at the weld's position in the span."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, fields
from dataclasses import replace as changed
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace
from numpy.typing import NDArray

from weld_force_ros.messages import Direction, ForceMap, OppositeDirection, SpeedCurve
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap


class PassageColumns(Protocol):
    """The columns in which a message holds passages: a map's, a curve's, or samples'."""

    peak_force_n: list[float]
    min_force_n: list[float]
    contact_loss_s: list[float]
    p2_force_n: list[float] | UnsetType
    force_20hz_n: list[float] | UnsetType


@dataclass(frozen=True)
class Passages:
    """Results of passages over a weld, arrays of one shape under the names of the messages' columns.

    Attributes:
        static_load_n: static wheel load.
        peak_force_n: maximum contact force.
        min_force_n: minimum contact force.
        contact_loss_s: time without contact.
        p2_force_n: maximum force below 120 Hz; None if it was not computed.
        force_20hz_n: maximum force below 20 Hz; None if it was not computed.
    """

    static_load_n: float
    peak_force_n: FloatArray
    min_force_n: FloatArray
    contact_loss_s: FloatArray
    p2_force_n: FloatArray | None
    force_20hz_n: FloatArray | None

    @classmethod
    def of_message(
        cls, message: PassageColumns, static_load_n: float, shape: tuple[int, ...], part: Any = ...
    ) -> "Passages":
        """Read the passages of a message.

        Args:
            message: its columns are row-major.
            static_load_n: static wheel load.
            shape: of the columns.
            part: index of the passages to take.
        """
        columns: dict[str, Any] = {name: getattr(message, name) for name in COLUMNS}
        for name, column in columns.items():
            computed = not isinstance(column, UnsetType)
            columns[name] = np.asarray(np.array(column).reshape(shape)[part]) if computed else None
        return cls(static_load_n, **columns)

    @classmethod
    def of_peak_map(cls, peak_map: PeakMap, static_load_n: float) -> "Passages":
        """Take the passages of a peak map, (n_speed, n_position)."""
        low_passed = (None, None) if peak_map.low_passed_n is None else peak_map.low_passed_n
        return cls(static_load_n, peak_map.peak_force_n, peak_map.min_force_n, peak_map.contact_loss_s, *low_passed)

    @classmethod
    def concatenated(cls, parts: Sequence["Passages"]) -> "Passages":
        """Join passages along their first axis."""
        first = parts[0]
        return first._with({name: np.concatenate([part.columns[name] for part in parts]) for name in first.columns})

    @classmethod
    def stacked(cls, parts: Sequence["Passages"]) -> "Passages":
        """Join passages along a new first axis."""
        first = parts[0]
        return first._with({name: np.stack([part.columns[name] for part in parts]) for name in first.columns})

    @classmethod
    def beside(cls, parts: Sequence["Passages"]) -> "Passages":
        """Join passages along their last axis."""
        first = parts[0]
        names = first.columns
        return first._with({name: np.concatenate([part.columns[name] for part in parts], axis=-1) for name in names})

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """The arrays that were computed, by name."""
        return {name: getattr(self, name) for name in COLUMNS if getattr(self, name) is not None}

    def at(self, part: Any) -> "Passages":
        """Return the passages at an index."""
        return self._with({name: values[part] for name, values in self.columns.items()})

    def reshaped(self, shape: tuple[int, ...]) -> "Passages":
        """Return the passages in another shape."""
        return self._with({name: values.reshape(shape) for name, values in self.columns.items()})

    def worse_than(self, other: "Passages") -> Mapping[str, NDArray[np.bool_]]:
        """Return of each column where it is worse than another's."""
        return {
            name: np.asarray(values < other.columns[name] if name == "min_force_n" else values > other.columns[name])
            for name, values in self.columns.items()
            if name in other.columns
        }

    def only(self, selected: NDArray[np.bool_]) -> "Passages":
        """Return the passages with what cannot be the worst of any in place of those that are not selected."""
        never = {"min_force_n": np.inf}
        return self._with(
            {name: np.where(selected, values, never.get(name, -np.inf)) for name, values in self.columns.items()}
        )

    def worst(self, axis: int) -> "Passages":
        """Return the worst over an axis: the minimum of the minimum force, the maximum of everything else."""
        return self._with(
            {
                name: np.asarray(values.min(axis=axis) if name == "min_force_n" else values.max(axis=axis))
                for name, values in self.columns.items()
            }
        )

    def accumulated(self) -> "Passages":
        """Return the worst so far along the first axis."""
        return self._with(
            {
                name: (np.minimum if name == "min_force_n" else np.maximum).accumulate(values)
                for name, values in self.columns.items()
            }
        )

    def rounded(self, force_decimals: int, time_decimals: int) -> dict[str, Any]:
        """Return the columns as messages hold them: row-major lists of rounded numbers."""
        return {
            name: rounded(values, time_decimals if name == "contact_loss_s" else force_decimals)
            for name, values in self.columns.items()
        }

    def _with(self, columns: Mapping[str, FloatArray]) -> "Passages":
        every: dict[str, Any] = {**dict.fromkeys(COLUMNS), **columns}
        return Passages(self.static_load_n, **every)


COLUMNS = tuple(field.name for field in fields(Passages) if field.name != "static_load_n")
"""Names of the columns, in messages as in `Passages`."""


@dataclass(frozen=True)
class RelevantMap:
    """The part of a force map that can happen: up to the line's speed, at the weld's position where that is known.

    Of a map of both directions, each cell of a column is from the one in which it is worse.

    Attributes:
        force_map: the whole.
        speeds_kmh: (n_speed,).
        positions_m: (n_position,).
        passages: of shape (n_speed, n_position).
        peak_x_m: (n_speed, n_position).
        line_kmh: the line's speed, or the highest that was computed.
        by_direction: the passages of each direction that was simulated.
        against: of each column, where it is from passages against rising x.
    """

    force_map: ForceMap
    speeds_kmh: FloatArray
    positions_m: FloatArray
    passages: Passages
    peak_x_m: FloatArray
    line_kmh: float
    by_direction: Mapping[Direction, Passages]
    against: Mapping[str, NDArray[np.bool_]]

    def direction(self, column: str, row: int, position: int) -> Direction | UnsetType:
        """Return the direction of the passage that a column's cell is from; unset if the map does not say it."""
        if isinstance(self.force_map.running, UnsetType):
            return UNSET
        return "against" if self.against[column][row, position] else "with"

    @cached_property
    def worst_over_positions(self) -> Passages:
        """The worst over positions at each speed, (n_speed,)."""
        return self.passages.worst(axis=1)

    @cached_property
    def peak_index(self) -> tuple[int, int]:
        """Row and column of the passage with the highest peak."""
        return index_of_largest(self.passages.peak_force_n)

    def worst_by_speed(self) -> tuple[FloatArray, Passages]:
        """Return speeds (n,) up to the line's and the worst over positions at each: from the curve, if there is one."""
        speeds, worst = force_curve(self)
        count = count_up_to(speeds, self.force_map.line_speed_kmh)
        return speeds[:count], worst.at(slice(count))

    def answering(self, limits_sha256: str) -> "RelevantMap":
        """Return it as verdicts by some limits see it.

        If the curve's speeds were chosen for other limits, what was estimated between them does not answer these: only
        what was simulated stays.
        """
        curve = self.force_map.curve
        if isinstance(curve, UnsetType) or curve.limits_sha256 in (UNSET, limits_sha256):
            return self
        return changed(self, force_map=replace(self.force_map, curve=simulated_part(curve)))


def whole_map(force_map: ForceMap) -> RelevantMap:
    """Return all of a force map, whatever the line's speed and the weld's position."""
    return relevant_range(replace(force_map, line_speed_kmh=UNSET, weld_position_m=UNSET))


def relevant_range(force_map: ForceMap, *, up_to_line: bool = True) -> RelevantMap:
    """Return the part of a force map that can happen; with the speeds above the line's if not `up_to_line`."""
    speeds, positions = np.array(force_map.speeds_kmh), np.array(force_map.positions_m)
    line_kmh = float(speeds[-1]) if isinstance(force_map.line_speed_kmh, UnsetType) else force_map.line_speed_kmh
    rows = np.arange(count_up_to(speeds, line_kmh) if up_to_line else len(speeds))
    columns = relevant_positions(positions, force_map.weld_position_m, force_map.span_m)
    passages, peak_x_m, by_direction, against = _worse(force_map, np.ix_(rows, columns))
    return RelevantMap(force_map, speeds[rows], positions[columns], passages, peak_x_m, line_kmh, by_direction, against)


def worse_passages(force_map: ForceMap) -> Passages:
    """Return all passages of a map, (n_speed, n_position), each column's cell in the direction in which it is worse."""
    return _worse(force_map, ...)[0]


def _worse(
    force_map: ForceMap, part: Any
) -> tuple[Passages, FloatArray, Mapping[Direction, Passages], Mapping[str, NDArray[np.bool_]]]:
    """Return of part of a map the worse passages, places of their peaks, either direction's, and which are against."""
    shape, load_n = (len(force_map.speeds_kmh), len(force_map.positions_m)), force_map.static_load_n
    own: Direction = "against" if force_map.running == "against" else "with"
    passages = Passages.of_message(force_map, load_n, shape, part)
    peak_x_m = np.array(force_map.peak_x_m).reshape(shape)[part]
    other = force_map.against
    if not isinstance(other, OppositeDirection):
        against = {name: np.full(values.shape, own == "against") for name, values in passages.columns.items()}
        return passages, peak_x_m, {own: passages}, against
    opposite = Passages.of_message(other, load_n, shape, part)
    against = dict(opposite.worse_than(passages))
    x_m = np.where(against["peak_force_n"], np.array(other.peak_x_m).reshape(shape)[part], peak_x_m)
    return Passages.stacked([passages, opposite]).worst(axis=0), x_m, {own: passages, "against": opposite}, against


def relevant_positions(positions_m: FloatArray, at_m: float | UnsetType, span_m: float) -> NDArray[np.intp]:
    """Return the indices of the positions that count.

    All where the weld's position is unknown; the one at `at_m`, if it was computed; else those computed on either side
    of it, round the span.

    Args:
        positions_m: (n_position,), metres after the sleeper.
        at_m: the weld's position, unset if unknown.
        span_m: sleeper spacing.
    """
    if isinstance(at_m, UnsetType):
        return np.arange(len(positions_m))
    ahead = np.mod(positions_m - at_m, span_m)
    behind = np.mod(at_m - positions_m, span_m)
    exact = np.flatnonzero(np.minimum(ahead, behind) < 1e-6)
    return exact[:1] if len(exact) else np.unique([np.argmin(ahead), np.argmin(behind)])


def force_curve(relevant: RelevantMap) -> tuple[FloatArray, Passages]:
    """Return speeds (n,) and the worst over positions at each.

    From the map's curve, which goes on to the highest speed computed; where it has none, from its relevant part.
    """
    curve = relevant.force_map.curve
    if not isinstance(curve, SpeedCurve):
        return relevant.speeds_kmh, relevant.worst_over_positions
    speeds = np.array(curve.speeds_kmh)
    return speeds, Passages.of_message(curve, relevant.force_map.static_load_n, speeds.shape)


def simulated_part(curve: SpeedCurve) -> SpeedCurve:
    """Return a curve without what was estimated between its simulated speeds."""
    if isinstance(curve.estimated, UnsetType):
        return curve
    known = {speed for speed, estimated in zip(curve.speeds_kmh, curve.estimated, strict=True) if not estimated}
    return replace(at_speeds(curve, known), estimated=UNSET, limits_sha256=UNSET)


def at_speeds(curve: SpeedCurve, speeds_kmh: Container[float]) -> SpeedCurve:
    """Return a curve at some of its speeds."""
    kept = [number for number, speed in enumerate(curve.speeds_kmh) if speed in speeds_kmh]
    columns = {name: getattr(curve, name) for name in curve.__struct_fields__}
    return replace(
        curve, **{name: [values[i] for i in kept] for name, values in columns.items() if isinstance(values, list)}
    )


def index_of_largest(values: FloatArray) -> tuple[int, int]:
    """Return row and column of the largest of values (n_row, n_column)."""
    row, column = np.unravel_index(np.argmax(values), values.shape)
    return int(row), int(column)


def rounded(values: FloatArray, decimals: int) -> list[float]:
    """Return rounded values as a message's row-major list."""
    listed: list[float] = np.round(values, decimals).ravel().tolist()
    return listed


def count_up_to(speeds_kmh: FloatArray, line_kmh: float | UnsetType) -> int:
    """Return how many of increasing speeds count on a line: all, if its speed is not known."""
    if isinstance(line_kmh, UnsetType):
        return len(speeds_kmh)
    # A grid that starts above the line's speed is judged at its lowest.
    return max(1, int(np.sum(speeds_kmh <= line_kmh * (1 + 1e-9))))
