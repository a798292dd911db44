"""Find the tables of samples in a measurement file: header block, heading, rows, footer, one weld after another.

The rows are the lines whose fields are numbers; what stands before them is the header, what stands after them the
footer. Columns are taken by the names in the heading, by number where the format states it, or, of two, as x and z.
"""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.column_names import HEIGHTS_DOWN, HEIGHTS_UP, NO_HEIGHTS, WELDS, unit_in, words_of
from weld_force_ros.measurement.headings import (
    COMMENTS,
    Heading,
    Split,
    columns,
    find_heading,
    is_comment,
    listed,
    numbered,
    units_row,
    unknown_heading,
)
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.numbers import is_missing, is_number, unit_of
from weld_force_ros.measurement.text_file import Line, quoted

_SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "space": None, "pipe": "|"}
_REMARK = re.compile(r"(?<=\d)\s+[#!]\s.*$")  # behind a row
_GLUED = re.compile(r"(?<=\d)(?=[+-]\d)")


class Row(NamedTuple):
    """A row of samples: its line in the file and its fields."""

    line: int
    fields: list[str]


class Statement(NamedTuple):
    """A key with its value in a header block, and where it stands."""

    line: int
    key: str
    value: str
    is_comment: bool


@dataclass
class SampleTable:
    """The rows of one weld.

    Attributes:
        statements: keys and values of the lines before the rows.
        rows: the rows, fields by column.
        x: column of the positions; None where there are none.
        z: columns of the heights; several are several passes.
        x_unit, z_unit: as the heading states them.
        z_positive: `up` or `down`, where the heading names heights or gaps.
        weld: name of the weld as a column states it.
        decimal_comma: columns in which commas are decimal marks.
        notes: what was done to find the rows.
        footer: lines after the rows.
    """

    statements: list[Statement]
    rows: list[Row]
    x: int | None = None
    z: list[int] = field(default_factory=list)
    x_unit: str | None = None
    z_unit: str | None = None
    z_positive: str | None = None
    weld: str | None = None
    decimal_comma: frozenset[int] = frozenset()
    notes: list[str] = field(default_factory=list)
    footer: int = 0


def find_tables(lines: Sequence[Line], form: InstrumentFormat, *, is_ended: bool = True) -> list[SampleTable]:
    """Return the tables of a file, one a weld, in their order.

    Args:
        lines: of the file.
        form: of the instrument.
        is_ended: whether the last line has its line end; if not, it may be cut off.

    Raises:
        ProfileError: no rows, columns that cannot be told apart, a line within the rows that is no row.
    """
    lines = [_without_quotes(line) for line in lines[form.skip_rows :]]
    separator, lines = _separator(lines, form)
    if separator is None:
        lines = [Line(line.number, _GLUED.sub(" ", line.text)) if _is_glued(line.text) else line for line in lines]
    lines = [_without_remark(line) for line in lines]
    split = [(line, _fields(_without_mark(line), separator)) for line in lines]
    heading = find_heading(split, form)
    if heading is not None and separator is not None:
        split = [(line, _padded(line, fields, separator, len(heading.names))) for line, fields in split]
    used = [c for key in ("x", "z") for c in listed(form.columns.get(key, []))]
    rows_at = [
        i for i, (line, fields) in enumerate(split) if not is_comment(line) and _is_row(fields, heading, form, used)
    ]
    rows_at = _of_one_build(rows_at, split)
    if not rows_at:
        raise ProfileError("no samples", "give rows of x,z after the header")
    heading = heading or unknown_heading(split, rows_at[0])
    cut_off = not is_ended and rows_at[-1] == len(split) - 1 and _is_cut_off(rows_at, split)
    if cut_off:
        rows_at.pop()
    _refuse_between(rows_at, split, heading)
    tables = []
    begin = 0
    for block in _blocks(rows_at, split, heading):
        head = [part for part in split[begin : block[0]] if part[0].text and not _is_heading(part, heading)]
        begin = block[-1] + 1
        end = begin if block[-1] != rows_at[-1] else len(split)
        head += [part for part in split[block[0] : end] if is_comment(part[0])]
        rows = [Row(split[i][0].number, split[i][1]) for i in block]
        tables.append(_table(_statements(head, separator), rows, heading, split, form, separator))
    if cut_off:
        tables[-1].notes.append(f"line {lines[-1].number}, the last, is cut off: left out")
    tables[-1].footer = (
        0 if cut_off else sum(1 for line, _ in split[rows_at[-1] + 1 :] if line.text and not is_comment(line))
    )
    if tables[-1].footer:
        plural = "s" * (tables[-1].footer > 1)
        tables[-1].notes.append(f"{tables[-1].footer} line{plural} after the samples left out")
    for table in tables[1:]:  # what stands at the top of the file holds for all
        own = {statement.key for statement in table.statements}
        table.statements = [s for s in tables[0].statements if s.key not in own] + table.statements
    return [part for table in tables for part in _by_weld(table, heading, form)]


def _padded(line: Line, fields: list[str], separator: str, width: int) -> list[str]:
    """Return the fields of a row with the empty ones at its end, as many as the heading has."""
    if len(fields) >= width or is_comment(line) or line.text.count(separator) < width - 1 or not any(fields):
        return fields
    return fields + [""] * (width - len(fields))


def _is_heading(part: tuple[Line, list[str]], heading: Heading | None) -> bool:
    return heading is not None and part[0].number == heading.line


def _without_mark(line: Line) -> str:
    return line.text.lstrip("".join(COMMENTS)).strip() if is_comment(line) else line.text


def _is_cut_off(rows_at: Sequence[int], split: Split) -> bool:
    """Return whether the last row has fewer fields or decimals than all others."""
    rows = [split[i][1] for i in rows_at]
    if len(rows) < 3:
        return False
    if len(rows[-1]) != len(rows[-2]):
        return len(rows[-1]) < len(rows[-2])
    digits = {_decimals(row[-1]) for row in rows[:-1] if row[-1]}
    return len(digits) == 1 and _decimals(rows[-1][-1]) < min(digits)


def _decimals(text: str) -> int:
    return len(re.split("[.,]", text)[-1]) if re.search("[.,]", text) else 0


def _without_quotes(line: Line) -> Line:
    """Return a comment that a spreadsheet has put in quotes or padded with separators as it was."""
    if "#" not in line.text or not line.text.lstrip('"').startswith("#"):
        return line
    return Line(line.number, line.text.strip('"').rstrip(";,\t "))


def _without_remark(line: Line) -> Line:
    """Return a row without the remark behind it."""
    if ("#" not in line.text and "!" not in line.text) or is_comment(line):
        return line
    return Line(line.number, _REMARK.sub("", line.text))


def _separator(lines: list[Line], form: InstrumentFormat) -> tuple[str | None, list[Line]]:
    """Return what separates columns (None: blanks) and the lines without one that only states it."""
    stated = re.fullmatch(r'"?sep=(.)"?', lines[0].text) if lines else None
    if stated:
        return stated[1], lines[1:]
    if form.separator is not None:
        return _SEPARATORS[form.separator], lines
    texts = [line.text for line in lines if any(map(str.isdigit, line.text)) and not is_comment(line)]
    for separator in (";", "\t", "|"):
        if sum(separator in text for text in texts) > len(texts) / 2:
            return separator, lines
    decimal = [len(text.split()) > 1 and all(map(is_number, text.split())) for text in texts if "," in text]
    commas_separate = decimal and sum(decimal) <= len(decimal) / 2 and not _is_one_column(texts, form)
    return ("," if commas_separate and len(decimal) > len(texts) / 2 else None), lines


def _is_one_column(texts: Sequence[str], form: InstrumentFormat) -> bool:
    """Return whether single commas are decimal marks: what stands before them does not go along the rail."""
    if any(text.count(",") > 1 or "." in text for text in texts):
        return False
    before = [text.partition(",")[0] for text in texts]
    return form.spacing is not None or len(set(before)) < len(before) / 2


def _is_glued(text: str) -> bool:
    return len(text.split()) == 1 and bool(re.fullmatch(r"[+-]?\d+\.\d+[+-]\d+\.\d+", text))


def _fields(text: str, separator: str | None) -> list[str]:
    if separator is None:
        fields = text.split()
    elif '"' in text:
        fields = next(csv.reader([text], delimiter=separator), [])
    else:
        fields = text.split(separator)
    fields = [part.strip() for part in fields]
    while len(fields) > 1 and not fields[-1]:
        fields.pop()
    if separator == "|" and fields and not fields[0]:
        fields = fields[1:]
    return fields


def _is_row(fields: Sequence[str], heading: Heading | None, form: InstrumentFormat, used: Sequence[int | str]) -> bool:
    """Return whether fields are a row of samples: numbers, with marks of missing values, and one number at least."""
    if used and all(isinstance(c, int) and c <= len(fields) for c in used):
        fields, heading = [fields[c - 1] for c in used if isinstance(c, int)], None
    if fields and all(map(is_number, fields)):  # nearly every line
        return True
    numbers = [is_number(part) for part in fields]
    missing = [is_missing(part, tuple(form.missing)) for part in fields]
    if not any(numbers):
        return False
    if all(n or m for n, m in zip(numbers, missing, strict=True)):
        return True
    return heading is not None and len(fields) == len(heading.names) and sum(numbers) >= 2


def _of_one_build(rows_at: list[int], split: Split) -> list[int]:
    """Return the rows with as many fields as most, without single numbers of the header; others stay, to be refused."""
    if not rows_at:
        return []
    usual = Counter(len(split[i][1]) for i in rows_at).most_common(1)[0][0]
    inside = [i for i in rows_at if len(split[i][1]) == usual]
    first, last = inside[0], inside[-1]
    return [i for i in rows_at if first <= i <= last]


def _refuse_between(rows_at: Sequence[int], split: Split, heading: Heading | None) -> None:
    """Refuse a row with another number of fields; a last one that is empty is a missing value."""
    usual = Counter(len(split[i][1]) for i in rows_at).most_common(1)[0][0]
    for i in rows_at:
        line, fields = split[i]
        if len(fields) != usual:
            missing_last = len(fields) == usual - 1 and heading is not None and len(heading.names) == usual
            if not missing_last:
                plural = "s" * (len(fields) != 1)
                raise ProfileError(
                    f"line {line.number}: {len(fields)} column{plural} instead of {usual}", "correct this line"
                )
            fields.append("")


def _blocks(rows_at: Sequence[int], split: Split, heading: Heading | None) -> list[list[int]]:
    """Divide rows into welds: where a header stands between them; where x begins again is found with the numbers."""
    blocks = [[rows_at[0]]]
    for before, after in itertools.pairwise(rows_at):
        between = [part for part in split[before + 1 : after] if part[0].text]
        if between and not all(_continues(part, heading) for part in between):
            stranger = next((part[0] for part in between if not _continues(part, heading)), None)
            if stranger is not None and not _begins_a_weld(between):
                raise ProfileError(
                    f"line {stranger.number}: {quoted(stranger.text)} is not a row of numbers",
                    "correct it, or mark it with # if it is a remark",
                )
            blocks.append([])
        blocks[-1].append(after)
    return blocks


def _continues(part: tuple[Line, list[str]], heading: Heading | None) -> bool:
    """Return whether a line between rows says nothing: a remark, the heading once more, separators alone."""
    line, fields = part
    repeated = heading is not None and fields == heading.names
    units = bool(fields) and all(unit_of(name) for name in fields)
    return is_comment(line) or repeated or units or not any(fields)


def _begins_a_weld(between: Split) -> bool:
    return any(words_of(fields[0]) & WELDS for _, fields in between if fields)


def _statements(head: Iterable[tuple[Line, list[str]]], separator: str | None) -> list[Statement]:
    found = []
    for line, _ in head:
        comment = is_comment(line)
        text = line.text.lstrip("".join(COMMENTS)).strip()
        parts = re.split(r"\s*[:=]\s*", text, maxsplit=1)
        if len(parts) == 1 and separator is not None and not comment:
            parts = [part.strip() for part in text.split(separator)][:2]
        if len(parts) == 1 and not comment:
            parts = re.split(r"\s+", text, maxsplit=1)
        key, value = parts[0].strip(' "'), parts[-1].strip(' ";,\t') if len(parts) > 1 else ""
        # `# unit: mm unit: um` describes columns; our own keys may stand in a weld's name.
        in_columns = comment and "_" not in key and re.search(rf"(?<!\w){re.escape(key)}\s*:", value)
        if len(parts) > 1 and key and value and not in_columns:
            found.append(Statement(line.number, key, value, comment))
    return found


def _table(
    statements: list[Statement],
    rows: list[Row],
    heading: Heading | None,
    split: Split,
    form: InstrumentFormat,
    separator: str | None,
) -> SampleTable:
    width = len(rows[0].fields)
    names = heading.names if heading is not None else []
    table = SampleTable(statements, rows)
    if heading is not None and len(names) != width:
        raise ProfileError(
            f"line {rows[0].line}: {width} columns, but the heading names {len(names)}", "correct the heading"
        )
    for name in names:
        for word in words_of(name) & NO_HEIGHTS.keys():
            raise ProfileError(
                f"line {heading.line if heading else 1}: column {quoted(name)} holds {NO_HEIGHTS[word]}",
                "export the heights along the rail",
            )
    table.x, table.z = columns(names, width, form, rows[0].line, separator)
    units = units_row(heading, split, width)
    for name, column in (("x_unit", table.x), ("z_unit", table.z[0])):
        if column is not None and names:
            setattr(table, name, unit_in(names[column]) or (units[column] if units else None))
        elif column is not None and units:
            setattr(table, name, units[column])
    if names:
        words = words_of(names[table.z[0]])
        table.z_positive = "up" if words & HEIGHTS_UP else "down" if words & HEIGHTS_DOWN else None
        others = [name for i, name in enumerate(names) if i != table.x and i not in table.z]
        if others:
            table.notes.append(f"columns not used: {', '.join(others)}")
    _refuse_changing_unit(table, names)
    used = [*table.z] if table.x is None else [table.x, *table.z]
    table.decimal_comma = frozenset(i for i in used if _has_decimal_comma(rows, i, form))
    return table


def _refuse_changing_unit(table: SampleTable, names: Sequence[str]) -> None:
    """Refuse heights whose unit stands in a column of its own and changes from row to row; take it if it does not."""
    for column in range(len(table.rows[0].fields)):
        if unit_of(table.rows[0].fields[column]) is None:
            continue
        cells = [unit_of(row.fields[column]) for row in table.rows]
        if not all(cells):
            continue
        changed = next((row.line for row, unit in zip(table.rows, cells, strict=True) if unit != cells[0]), None)
        if changed is not None:
            name = f" {quoted(names[column])}" if names else ""
            raise ProfileError(f"line {changed}: the unit in column{name} changes", "export all heights in one unit")
        table.z_unit = table.z_unit or cells[0]


def _has_decimal_comma(rows: Sequence[Row], column: int, form: InstrumentFormat) -> bool:
    if form.decimal is not None:
        return form.decimal == "comma"
    # In 1,234.5 and 1.234,5 the last one is the decimal mark.
    commas = [row.line for row in rows if "," in row.fields[column] and "." not in row.fields[column]]
    points = [row.line for row in rows if "." in row.fields[column] and "," not in row.fields[column]]
    if commas and points:
        raise ProfileError(
            f"line {max(commas[0], points[0])}: decimal points and decimal commas in one column",
            "use one decimal mark and no thousands separator",
        )
    return bool(commas)


def _by_weld(table: SampleTable, heading: Heading | None, form: InstrumentFormat) -> list[SampleTable]:
    """Divide a table by the column that names the weld, if it has one."""
    names = heading.names if heading is not None else []
    if "weld" in form.columns:
        column = numbered(listed(form.columns["weld"])[0], names, len(table.rows[0].fields))
    else:
        named = [i for i, name in enumerate(names) if words_of(name) & WELDS and i != table.x and i not in table.z]
        if len(named) != 1:
            return [table]
        column = named[0]
    groups: dict[str, list[Row]] = {}
    for row in table.rows:
        groups.setdefault(row.fields[column], []).append(row)
    return [replace(table, rows=rows, weld=weld, notes=[*table.notes]) for weld, rows in groups.items()]
