"""Contract messages as tables for other programs: CSV or Parquet, a file for each table."""

import csv
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from msgspec import UNSET, UnsetType

from weld_force_ros._files import whole_folder
from weld_force_ros.errors import BagError, InputError
from weld_force_ros.messages import (
    ForceMap,
    Message,
    OppositeDirection,
    Rejection,
    Verdict,
    WeldProfile,
    identity,
    known,
)
from weld_force_ros.recording.bag_errors import as_bag_error, refuse_existing
from weld_force_ros.recording.contract_messages import recorded_messages
from weld_force_ros.recording.json_export import ExportReport, check_found
from weld_force_ros.recording.reader import open_bag

FORMATS = ("csv", "parquet")

ROWS_AT_ONCE = 100_000
"""The number of rows of a table, about, that are held before they are written; a message's rows stay together."""

Cell = str | int | float | bool | None
Rows = Iterable[tuple[Cell, ...]]


class Table(NamedTuple):
    """A table of one kind of message; every row begins with the columns of `KEY`.

    Attributes:
        name: of its file.
        kind: the messages it is made of.
        columns: beyond those that all have (`KEY`): name with unit, and type.
        rows: a message's rows, of these columns.
    """

    name: str
    kind: type[Message]
    columns: dict[str, type]
    rows: Callable[[Any], Rows]


KEY: dict[str, type] = {"log_time_ns": int, "topic": str, "profile_id": str}
"""The columns that all tables share. `profile_id` joins them; a rejection of a file without a profile has none."""


def _fields(**columns: type) -> tuple[dict[str, type], Callable[[Message], Rows]]:
    """Return columns named as a message's fields, and what makes a message its one row."""

    def rows(message: Message) -> Rows:
        values = (getattr(message, name) for name in columns)
        yield tuple(None if value is UNSET else value for value in values)

    return columns, rows


def _criteria(verdict: Verdict) -> Rows:
    for criterion in verdict.criteria:
        values = (getattr(criterion, name) for name in _CRITERION)
        yield verdict.weld_id, *(None if value is UNSET else value for value in values)


def _restrictions(verdict: Verdict) -> Rows:
    for r in verdict.restrictions:
        yield verdict.weld_id, r.speed_kmh, r.peak_force_n, r.change, r.within_limits


def _passages(found: ForceMap) -> Rows:
    places = [(speed, position) for speed in found.speeds_kmh for position in found.positions_m]
    own = None if found.running is UNSET else "against" if found.running == "against" else "with"
    both: list[tuple[str | None, ForceMap | OppositeDirection | UnsetType]] = [(own, found), ("against", found.against)]
    for direction, of in both:
        if isinstance(of, UnsetType):
            continue
        cells = zip(of.peak_force_n, of.peak_x_m, of.min_force_n, of.contact_loss_s, strict=True)
        for place, cell in zip(places, cells, strict=True):
            yield found.weld_id, found.config_sha256, *place, *cell, direction, known(found.vehicle)


def _profile(profile: WeldProfile) -> Rows:
    (row,) = _PROFILE_FIELDS[1](profile)
    yield *row, len(profile.x_m), "; ".join(profile.conditioning)


def _samples(profile: WeldProfile) -> Rows:
    for x_m, z_m in zip(profile.x_m, profile.z_m, strict=True):
        yield profile.weld_id, x_m, z_m


_PROFILE_FIELDS = _fields(
    weld_id=str,
    source=str,
    profile_sha256=str,
    source_sha256=str,
    rail=str,
    instrument=str,
    chainage_m=float,
    line_speed_kmh=float,
    weld_position_m=float,
    running=str,
)

_CRITERION: dict[str, type] = {
    "name": str, "value": float, "limit": float, "unit": str, "passed": bool, "source": str, "verified": bool,
    "reject_limit": float, "margin": float, "decides": bool, "speed_kmh": float, "position_m": float, "x_m": float,
    "exceeding": float, "exceeding_reject": float, "driver": str, "driver_share": float, "running": str,
}  # fmt: skip

TABLES = (
    Table(
        "verdicts",
        Verdict,
        *_fields(
            weld_id=str,
            decision=str,
            reason=str,
            peak_force_n=float,
            static_load_n=float,
            worst_speed_kmh=float,
            worst_position_m=float,
            worst_x_m=float,
            judged_speed_kmh=float,
            permitted_speed_kmh=float,
            geometry_kind=str,
            curve_class=str,
            chainage_m=float,
            rail=str,
            profile_sha256=str,
            config_sha256=str,
            limits_sha256=str,
            software=str,
            worst_running=str,
            vehicle=str,
        ),
    ),
    Table(
        "criteria",
        Verdict,
        {"weld_id": str, **_CRITERION},
        _criteria,
    ),
    Table(
        "restrictions",
        Verdict,
        {"weld_id": str, "speed_kmh": float, "peak_force_n": float, "change": float, "within_limits": bool},
        _restrictions,
    ),
    Table(
        "force_maps",
        ForceMap,
        {
            "weld_id": str, "config_sha256": str, "speed_kmh": float, "position_m": float, "peak_force_n": float,
            "peak_x_m": float, "min_force_n": float, "contact_loss_s": float, "running": str, "vehicle": str,
        },
        _passages,
    ),
    Table("profiles", WeldProfile, {**_PROFILE_FIELDS[0], "sample_count": int, "conditioning": str}, _profile),
    Table("profile_samples", WeldProfile, {"weld_id": str, "x_m": float, "z_m": float}, _samples),
    Table(
        "rejections",
        Rejection,
        *_fields(
            source=str,
            reason=str,
            remedy=str,
            raw_text=str,
            raw_truncated=bool,
            source_sha256=str,
            profile_sha256=str,
        ),
    ),
)  # fmt: skip


class _TableFile(Protocol):
    """A file of one format that rows are added to."""

    def add(self, rows: Collection[tuple[Cell, ...]]) -> None: ...

    def close(self) -> None: ...


class _Csv:
    def __init__(self, path: Path, columns: dict[str, type]) -> None:
        self._file = path.open("x", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file)
        self._writer.writerow(columns)

    def add(self, rows: Collection[tuple[Cell, ...]]) -> None:
        self._writer.writerows(tuple(_written(cell) for cell in row) for row in rows)

    def close(self) -> None:
        self._file.close()


def _written(cell: Cell) -> Cell:
    return str(cell).lower() if isinstance(cell, bool) else cell


class _Parquet:
    def __init__(self, path: Path, columns: dict[str, type]) -> None:
        import pyarrow  # type: ignore[import-untyped]
        import pyarrow.parquet  # type: ignore[import-untyped]

        kinds = {str: pyarrow.string(), int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_()}
        self._schema = pyarrow.schema([(name, kinds[kind]) for name, kind in columns.items()])
        self._table_of = pyarrow.Table.from_arrays
        self._array = pyarrow.array
        self._writer = pyarrow.parquet.ParquetWriter(path, self._schema, compression="zstd")

    def add(self, rows: Collection[tuple[Cell, ...]]) -> None:
        columns = zip(*rows, strict=True)
        arrays = [self._array(cells, column.type) for cells, column in zip(columns, self._schema, strict=True)]
        self._writer.write_table(self._table_of(arrays, schema=self._schema))

    def close(self) -> None:
        self._writer.close()


_TABLE_FILES: dict[str, Callable[[Path, dict[str, type]], _TableFile]] = {"csv": _Csv, "parquet": _Parquet}


class _TableWriter:
    """Writes one table, to a file of each format."""

    def __init__(self, table: Table, folder: Path, formats: Iterable[str], stack: ExitStack) -> None:
        self._table = table
        self._rows: list[tuple[Cell, ...]] = []
        self._files = []
        for name in formats:
            file = _TABLE_FILES[name](folder / f"{table.name}.{name}", {**KEY, **table.columns})
            stack.callback(file.close)
            self._files.append(file)

    def add(self, message: Message, key: tuple[Cell, ...]) -> None:
        if isinstance(message, self._table.kind):
            self._rows.extend((*key, *row) for row in self._table.rows(message))
            if len(self._rows) >= ROWS_AT_ONCE:
                self.flush()

    def flush(self) -> None:
        if self._rows:
            for file in self._files:
                file.add(self._rows)
            self._rows.clear()


def export_tables(
    source: Path,
    target: Path,
    formats: Collection[str] = ("csv",),
    *,
    on_invalid: Callable[[BagError], None] | None = None,
) -> ExportReport:
    """Write verdicts, criteria, force maps, profiles and rejections as tables to a new folder.

    Args:
        source: a bag folder or one of its files.
        target: the new folder; must not exist.
        formats: one or more of `FORMATS`.
        on_invalid: called with the error of each message that breaks the contract.

    Raises:
        BagError: the source is unreadable or holds no contract message, or the target exists or cannot be written.
        InputError: a format is unknown, or what writes it is not installed.
    """
    _check(formats)
    bag = open_bag(source)
    message_count = invalid_count = 0
    refuse_existing(target)
    with as_bag_error(target), whole_folder(target) as folder, ExitStack() as stack:
        writers = [_TableWriter(table, folder, dict.fromkeys(formats), stack) for table in TABLES]
        kinds = tuple(table.kind for table in TABLES)
        for recorded, message in recorded_messages(bag):
            if isinstance(message, BagError):
                invalid_count += 1
                if on_invalid:
                    on_invalid(message)
            elif isinstance(message, kinds):
                message_count += 1
                key = (recorded.log_time_ns, recorded.topic, _profile_id(message))
                for writer in writers:
                    writer.add(message, key)
        for writer in writers:
            writer.flush()
        check_found(source, message_count)
    return ExportReport(message_count, invalid_count)


def _profile_id(message: Message) -> str | None:
    match message:
        case Verdict() | ForceMap() | WeldProfile():
            return identity(message)
        case Rejection(profile_id=str(profile_id)):
            return profile_id
    return None


def _check(formats: Collection[str]) -> None:
    for name in formats:
        if name not in FORMATS:
            raise InputError(f"format {name!r} is unknown", f"use {' or '.join(FORMATS)}")
    if "parquet" in formats:
        try:
            import pyarrow.parquet  # noqa: F401
        except ImportError:
            raise InputError(
                "Parquet tables need pyarrow", "install it with `pip install 'weld_force_ros[tables]'`, or export csv"
            ) from None
