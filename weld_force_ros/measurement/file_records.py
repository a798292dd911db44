"""Read the records of a measurement file: its tables of samples as positions and heights in m, and what it states."""

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from typing import NamedTuple

import msgspec

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement import instruments, record, statements
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.numbers import in_metres, is_kilometre_plus, is_missing, number, plain_number, unit_of
from weld_force_ros.measurement.record import Sample
from weld_force_ros.measurement.sample_table import Row, SampleTable, find_tables
from weld_force_ros.measurement.statements import Stated
from weld_force_ros.measurement.text_file import TextFile
from weld_force_ros.messages import MAX_PROFILE_LENGTH_M, MAX_SAMPLES

_WIDEST_SPACING = 1e9  # in any unit


class FileRecord(NamedTuple):
    """A record of a file: the table it is from, its samples in m, and what is stated of it."""

    table: SampleTable
    samples: list[Sample]
    header: dict[str, Stated]


def file_records(file: TextFile, stated: InstrumentFormat | None) -> tuple[list[FileRecord], InstrumentFormat]:
    """Return the records of a file, one a weld, and the format by which it is read.

    Args:
        file: its lines.
        stated: a format to read it by, and what the user states.

    Raises:
        ProfileError: there are no samples in it, or what it states of them cannot be.
    """
    form = stated or InstrumentFormat()
    if form.name == InstrumentFormat().name:
        known = instruments.recognised([line.text for line in file.lines])
        if known is instruments.shipped()["weld-force"] and stated is not None:  # which needs no other layout
            stated = msgspec.structs.replace(
                stated, skip_rows=0, spacing=None, columns={}, separator=None, decimal=None
            )
        form = (known or InstrumentFormat()).with_statements(stated)
    if form.refuse:
        raise ProfileError(form.refuse, "export the heights along the rail")
    return [
        part for table in find_tables(file.lines, form, is_ended=file.is_ended) for part in _records(table, form)
    ], form


def _records(table: SampleTable, form: InstrumentFormat) -> list[FileRecord]:
    """Return the records of a table, each with its samples in m and what is stated of it."""
    header = statements.statements(table.statements, form)
    for key, unit in (("x_unit", table.x_unit), ("z_unit", table.z_unit), ("z_positive", table.z_positive)):
        if unit is None:
            continue
        if key in header and (unit_of(header[key].text) or header[key].text.casefold()) != unit:
            raise ProfileError(
                f"{header[key].where}{key} {header[key].text}, but the heading of the column says {unit}",
                "correct the one that is wrong",
            )
        header.setdefault(key, Stated(unit, ""))
    header = statements.with_format(header, form)
    samples = _samples(table, form, header)
    if (count := header.get("samples")) and count.text.isdecimal() and int(count.text) != len(samples):
        raise ProfileError(
            f"{count.where}{count.text} samples announced, {len(samples)} are there", "the file is not complete"
        )
    records = list[FileRecord]()
    for part in record.divide(samples):
        if abs(part[-1].x - part[0].x) <= MAX_PROFILE_LENGTH_M:
            records.append(FileRecord(table, part, header))
            continue
        length_m = abs(part[-1].x - part[0].x)
        cut = replace(table, notes=[*table.notes, f"cut out of {length_m:.4g} m of rail"])
        records += [FileRecord(cut, weld, header) for weld in record.cut_into_welds(record.ordered(part).samples)]
    return records


def _samples(table: SampleTable, form: InstrumentFormat, header: Mapping[str, Stated]) -> list[Sample]:
    if len(table.rows) > MAX_SAMPLES:
        raise ProfileError(
            f"{len(table.rows)} samples, at most {MAX_SAMPLES}", "give one weld a file, at 0.1 mm or coarser"
        )
    sign = -1 if form.x_direction == "against" else 1
    step = None
    if form.spacing is not None:
        if not 0 < form.spacing <= _WIDEST_SPACING:
            raise ProfileError(f"spacing {form.spacing:g} of the samples", "state it in x_unit, more than 0")
        step = Decimal(str(form.spacing))
    marks, found = tuple(form.missing), []
    x_unit, z_unit = header["x_unit"].text, header["z_unit"].text
    for index, row in enumerate(table.rows):
        try:
            x_m = _position_m(row, table, x_unit) if step is None else in_metres(step * index, x_unit, "x")
            heights_m = [_height_m(row, column, table, z_unit, marks) for column in table.z]
        except ProfileError as error:
            raise ProfileError(f"line {row.line}: {error.reason}", error.remedy) from None
        texts = [plain_number(row.fields[column], decimal_comma=column in table.decimal_comma) for column in table.z]
        found.append(Sample(row.line, sign * x_m, heights_m, texts))
    return found


def _position_m(row: Row, table: SampleTable, unit: str) -> Decimal:
    if table.x is None:
        return Decimal(0)
    text = row.fields[table.x]
    x = number(text, "x", decimal_comma=table.x in table.decimal_comma)
    return in_metres(x, "m" if is_kilometre_plus(text) else unit, "x")


def _height_m(row: Row, column: int, table: SampleTable, unit: str, marks: tuple[str, ...]) -> Decimal | None:
    text = row.fields[column]
    if is_missing(text, marks):
        return None
    return in_metres(number(text, "z", decimal_comma=column in table.decimal_comma), unit, "z")
