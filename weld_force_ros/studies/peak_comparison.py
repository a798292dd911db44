"""Peak forces of two models over the same passages, and statistics of their differences; no model runs here."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from weld_force_ros.studies.result_table import Cell, Column, Table


class ComparedPassage(NamedTuple):
    """One passage by an engine and by the reference; `peak_n` is NaN where the engine did not stay finite."""

    track: str
    engine: str
    shape: str
    speed_kmh: float
    position_m: float
    reference_n: float
    peak_n: float

    @property
    def difference_percent(self) -> float:
        """Return the difference in per cent of the reference's peak force."""
        return 100.0 * (self.peak_n / self.reference_n - 1.0)


class PeakDifference(NamedTuple):
    """Statistics of the differences of some passages; NaN if no passage stayed finite."""

    passages: int
    not_finite: int
    rms_percent: float
    worst: ComparedPassage

    @property
    def max_percent(self) -> float:
        """Return the largest difference, without its sign."""
        return abs(self.worst.difference_percent)


def peak_difference(passages: Sequence[ComparedPassage]) -> PeakDifference:
    """Return root mean square and worst of the differences in peak force, over at least one passage."""
    finite = [p for p in passages if math.isfinite(p.peak_n)]
    if not finite:
        return PeakDifference(len(passages), len(passages), math.nan, passages[0])
    mean_square = math.fsum(p.difference_percent**2 for p in finite) / len(finite)
    worst = max(finite, key=lambda p: abs(p.difference_percent))
    return PeakDifference(len(passages), len(passages) - len(finite), math.sqrt(mean_square), worst)


def grouped_differences(passages: Iterable[ComparedPassage], *names: str) -> dict[tuple[Cell, ...], PeakDifference]:
    """Return the differences of passages that agree in the fields `names`, in the order of first appearance."""
    groups: dict[tuple[Cell, ...], list[ComparedPassage]] = {}
    for passage in passages:
        groups.setdefault(tuple(getattr(passage, name) for name in names), []).append(passage)
    return {key: peak_difference(group) for key, group in groups.items()}


_COLUMNS = {
    "track": Column("track", "track"),
    "engine": Column("engine", "engine"),
    "shape": Column("shape", "shape"),
    "speed_kmh": Column("speed_kmh", "km/h"),
    "position_m": Column("position_m", "m after sleeper", 2),
}


def difference_table(title: str, passages: Iterable[ComparedPassage], *names: str) -> Table:
    """Return the differences grouped by the fields `names`, each with its worst passage."""
    columns = (
        *(_COLUMNS[name] for name in names),
        Column("passages"),
        Column("passages_not_finite", "failed"),
        Column("rms_percent", "RMS %", 2),
        Column("max_percent", "max %", 2),
        Column("worst_difference_percent"),
        Column("worst_shape"),
        Column("worst_speed_kmh", "at km/h"),
        Column("worst_position_m", "at m", 2),
    )
    rows: list[tuple[Cell, ...]] = []
    for key, e in grouped_differences(passages, *names).items():
        w = e.worst
        rows.append(
            (*key, e.passages, e.not_finite, e.rms_percent, e.max_percent,
             w.difference_percent, w.shape, w.speed_kmh, w.position_m)
        )  # fmt: skip
    return Table(title, columns, rows)


def passage_table(passages: Iterable[ComparedPassage]) -> Table:
    """Return every passage on a row."""
    columns = (
        *(_COLUMNS[name] for name in ("track", "engine", "shape", "speed_kmh", "position_m")),
        Column("reference_peak_force_n", "reference N", 0),
        Column("peak_force_n", "peak N", 0),
        Column("peak_force_difference_percent", "difference %", 2),
    )
    return Table("Peak forces", columns, [(*p, p.difference_percent) for p in passages])
