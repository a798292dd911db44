"""Read and write welds as a Parquet table, a row each: the columns of a conditioned `messages.WeldProfile`.

A written table holds all that results depend on. Of others only `x_m` and `z_m` (lists of m) must be there. What is
wrong with a row concerns this row alone.
"""

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
from msgspec import UNSET

from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.messages import WeldProfile, legible

ROW_GROUP = 256
"""Rows that are read together: a batch's, so that nothing is read for nothing."""

_TEXTS = (
    *("weld_id", "source", "rail", "instrument", "profile_sha256", "source_sha256", "running", "chainage_direction"),
    *("format", "kind", "operator", "measured_on"),
)
_NUMBERS = ("chainage_m", "line_speed_kmh", "weld_position_m")
_GEOMETRY = ("x_m", "z_m")
_LISTS = (*_GEOMETRY, "measured_x_m", "measured_z_m")
_UNUSABLE, _REMEDY = "unusable", "remedy"
_CORRECT = "correct this row"

SCHEMA = pa.schema(
    [(name, pa.string()) for name in _TEXTS]
    + [(name, pa.float64()) for name in _NUMBERS]
    + [(name, pa.list_(pa.float64())) for name in _LISTS]
    + [
        (
            "noise",
            pa.struct(
                {
                    "method": pa.string(),
                    "noise_m": pa.float64(),
                    "stated": pa.bool_(),
                    "resolution_m": pa.float64(),
                    "outliers_m": pa.list_(pa.float64()),
                    "form_error": pa.struct(
                        {"deviation_m": pa.float64(), "length_m": pa.float64(), "source": pa.string()}
                    ),
                }
            ),
        )
    ]
    + [
        (
            "support",
            pa.list_(
                pa.struct(
                    {"sleeper": pa.int64(), "share": pa.float64(), "pad_share": pa.float64(), "gap_m": pa.float64()}
                )
            ),
        )
    ]
    + [(_UNUSABLE, pa.string()), (_REMEDY, pa.string())]
)


class RejectedRow(NamedTuple):
    """A weld that cannot be assessed: where it was to come from, why, and what to do."""

    source: str
    reason: str
    remedy: str


ProfileRow = WeldProfile | RejectedRow


def write(path: Path, welds: Iterable[ProfileRow]) -> int:
    """Write a table, whole or not at all; return its number of rows.

    Raises:
        InputError: the place cannot be written.
    """
    with os_errors_as(InputError, path, "name a file in a writable folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as stream:
            return _write(stream, welds)


def _write(stream: BinaryIO, welds: Iterable[ProfileRow]) -> int:
    count, rows = 0, []
    with pq.ParquetWriter(stream, SCHEMA, compression="zstd") as writer:
        for weld in welds:
            rows.append(_row(weld))
            if len(rows) == ROW_GROUP:
                writer.write_table(pa.Table.from_pylist(rows, SCHEMA))
                count += len(rows)
                rows.clear()
        if rows:
            writer.write_table(pa.Table.from_pylist(rows, SCHEMA))
    return count + len(rows)


def _row(weld: ProfileRow) -> dict[str, Any]:
    if isinstance(weld, RejectedRow):
        return {"source": weld.source, _UNUSABLE: weld.reason, _REMEDY: weld.remedy}
    row = {name: value for name in SCHEMA.names[:-2] if (value := getattr(weld, name)) is not UNSET}
    return {name: np.asarray(value) if name in _LISTS else msgspec.to_builtins(value) for name, value in row.items()}


def count_rows(path: Path) -> int:
    """Return the number of rows of a table.

    Raises:
        InputError: it cannot be read, or has no profiles.
    """
    remedy = "give a Parquet file with columns x_m and z_m, lists of m"
    try:
        with pq.ParquetFile(path) as file:
            absent = [name for name in _GEOMETRY if name not in file.schema_arrow.names]
            count: int = file.metadata.num_rows
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: {legible(str(error))}", remedy) from None
    if absent:
        raise InputError(f"{path}: no column {' and '.join(absent)}", remedy)
    return count


def read(path: Path, first: int, count: int) -> Iterator[ProfileRow]:
    """Yield rows `first` to `first + count` of a table; as many rejected ones of a table that became unreadable."""
    given = 0
    try:
        for table in _tables(path, first, count):
            for weld in _welds(path, first + given, table):
                yield weld
                given += 1
    except (OSError, pa.ArrowException) as error:
        reason = f"{path.name}: {legible(str(error))}"
        for row in range(first + given, first + count):
            yield RejectedRow(f"{path.name}, row {row + 1}", reason, "write the table again")


def _tables(path: Path, first: int, count: int) -> Iterator[Any]:
    """Yield the rows as tables; only the row groups they are in are decoded."""
    with pq.ParquetFile(path) as file:
        columns = [name for name in SCHEMA.names if name in file.schema_arrow.names]
        group, skipped = 0, 0
        while skipped + file.metadata.row_group(group).num_rows <= first:
            skipped += file.metadata.row_group(group).num_rows
            group += 1
        groups = list(range(group, file.metadata.num_row_groups))
        behind, rest = first - skipped, count
        for batch in file.iter_batches(ROW_GROUP, row_groups=groups, columns=columns, use_threads=False):
            chosen = pa.Table.from_batches([batch]).slice(behind, rest)
            behind, rest = max(0, behind - len(batch)), rest - len(chosen)
            if len(chosen):
                yield chosen
            if rest == 0:
                return


def _welds(path: Path, first: int, table: Any) -> Iterator[ProfileRow]:
    stated = [name for name in table.column_names if name not in _LISTS]
    rows = table.select(stated).to_pylist() if stated else [{} for _ in range(len(table))]
    for name in set(_LISTS).intersection(table.column_names):
        for row, values in zip(rows, _lists(table.column(name)), strict=True):
            row[name] = values if values or name in _GEOMETRY else None
    for number, row in enumerate(rows, start=first + 1):
        yield _weld(f"{path.name}, row {number}", f"{path.stem}-{number}", row)


def _lists(column: Any) -> list[list[float]]:
    """Return the lists of a column, much faster than value by value."""
    array = column.cast(pa.list_(pa.float64())).combine_chunks()
    flat = array.values.to_numpy(zero_copy_only=False)
    ends = array.offsets.to_numpy()
    return [flat[begin:end].tolist() for begin, end in itertools.pairwise(ends)]


def _weld(where: str, weld_id: str, row: dict[str, Any]) -> ProfileRow:
    unusable, remedy = row.pop(_UNUSABLE, None), row.pop(_REMEDY, None)
    if unusable:
        return RejectedRow(row.get("source") or where, unusable, remedy or _CORRECT)
    content = {"weld_id": weld_id, "source": where[-200:]} | _without_none(row)
    if "noise" in content:
        content["noise"] = _without_none(content["noise"])
    if "support" in content:
        content["support"] = [_without_none(state) for state in content["support"]]
    try:
        weld = msgspec.convert(content, WeldProfile)
    except (msgspec.ValidationError, ValueError) as error:
        return RejectedRow(where, legible(str(error)), _CORRECT)
    problem = weld.problem()
    return RejectedRow(where, problem, _CORRECT) if problem else weld


def _without_none(row: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if value is not None}
