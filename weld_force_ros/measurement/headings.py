"""Find the heading of a table of samples and in it the columns: positions, heights, their units."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.column_names import ASIDE, COUNTERS, HEIGHTS, POSITIONS, without_unit, words_of
from weld_force_ros.measurement.instruments import Column, InstrumentFormat
from weld_force_ros.measurement.numbers import is_number, unit_of
from weld_force_ros.measurement.text_file import Line, quoted

COMMENTS = ("#", "%", "!", "~")
Split = Sequence[tuple[Line, list[str]]]
"""Lines with their fields."""


class Heading(NamedTuple):
    """The line with the columns' names."""

    line: int
    names: list[str]


def is_comment(line: Line) -> bool:
    """Return whether a line is marked as a remark."""
    return line.text.startswith(COMMENTS)


def find_heading(split: Split, form: InstrumentFormat) -> Heading | None:
    """Return the line with the columns' names: the last one before the rows that names heights."""
    found = None
    widths = Counter(len(fields) for line, fields in split if not is_comment(line) and all(map(is_number, fields)))
    for line, names in split:
        if is_comment(line) and (":" in line.text or "=" in line.text or (widths and len(names) not in widths)):
            continue
        if sum(map(is_number, names)) >= max(2, len(names) / 2) or (len(names) == 1 and is_number(names[0])):
            if found or not is_comment(line):
                break
            continue
        stated = [c for key in ("x", "z") for c in listed(form.columns.get(key, [])) if isinstance(c, str)]
        is_stated = bool(stated) and all(any(_is_named(name, c) for name in names) for c in stated)
        has_heights = any(words_of(name) & HEIGHTS for name in names)
        if is_stated or (has_heights and (len(names) > 1 or form.spacing is not None)):
            found = Heading(line.number, names)
    return found


def unknown_heading(split: Split, first: int) -> Heading | None:
    """Return the text above the first row that has as many fields, if no heading with known names was found."""
    width = len(split[first][1])
    for line, names in reversed(split[:first]):
        if len(names) == width and all(names) and not any(unit_of(name) or is_number(name) for name in names):
            return None if is_comment(line) and ":" in names[0] else Heading(line.number, names)
    return None


def columns(
    names: list[str], width: int, form: InstrumentFormat, line: int, separator: str | None
) -> tuple[int | None, list[int]]:
    """Return the column of the positions, None where the spacing is stated, and those of the heights.

    Args:
        names: of the columns; empty without a heading.
        width: number of columns.
        form: whose `columns` go first.
        line: of the first row, for messages.
        separator: of the columns.

    Raises:
        ProfileError: they cannot be told apart.
    """
    if "z" in form.columns:
        x = [numbered(c, names, width) for c in listed(form.columns.get("x", []))]
        z = [numbered(c, names, width) for c in listed(form.columns["z"])]
        x = x or [i for i, name in enumerate(names) if words_of(name) & POSITIONS and i not in z]
        if form.spacing is None and len(x) != 1:
            raise ProfileError(
                f"line {line}: no one column is known for x", "state it in `columns` of the format, or `spacing`"
            )
        return (x[0] if form.spacing is None else None), z
    if form.spacing is not None and width == 1:
        return None, [0]
    words = [words_of(name) for name in names]
    heights = [
        i for i, word in enumerate(words) if word & HEIGHTS and not word & ASIDE and not word & POSITIONS - {"s"}
    ]
    places = [i for i, word in enumerate(words) if word & POSITIONS and i not in heights]
    if len(heights) > 1 and (plain := [i for i in heights if words[i] == {"z"}]) and len(plain) == 1:
        heights = plain
    if len(heights) == 1 and (len(places) == 1 or form.spacing is not None):
        return (places[0] if form.spacing is None else None), heights
    if width == 2 and not heights and form.spacing is None:
        return 0, [1]
    found = f"{width} column{'s' * (width > 1)}" + (f" named {', '.join(names)}" if names else " without names")
    if any(word & COUNTERS for word in words) and heights:
        remedy = "x is a counter: state the spacing of the samples"
    elif width == 1:
        remedy = "give rows of x,z, or state the spacing if the file has heights only"
    elif width == 4 and separator == "," and not names:
        found += " (or commas that are decimal marks and separators at once)"
        remedy = "export it with semicolons between the columns, or with decimal points"
    else:
        remedy = "state which are x and z, with --format FILE.yaml and `columns: {x: 1, z: 2}`"
    raise ProfileError(f"line {line}: {found}", remedy)


def numbered(column: Column, names: Sequence[str], width: int) -> int:
    """Return the index of a column that a format states by name, with or without unit, or by number.

    Raises:
        ProfileError: there is none.
    """
    if isinstance(column, int):
        if column > width:
            raise ProfileError(f"no column {column}, the rows have {width}", "correct `columns` of the format")
        return column - 1
    if column in names:
        return list(names).index(column)
    if found := [i for i, name in enumerate(names) if _is_named(name, column)]:
        return found[0]
    raise ProfileError(
        f"no column {quoted(column)}, the heading names {', '.join(names) or 'none'}", "correct `columns` of the format"
    )


def units_row(heading: Heading | None, split: Split, width: int) -> list[str | None] | None:
    """Return the units in a row of their own below the heading, or, without a heading, above the rows."""
    for line, fields in split:
        if fields and is_number(fields[0]):
            continue
        units = [unit_of(part) for part in fields]
        if is_comment(line) and not all(units):
            continue
        below = heading is None or line.number > heading.line
        if below and len(fields) == width and any(units) and not any(map(is_number, fields)):
            return units
    return None


def _is_named(name: str, column: str) -> bool:
    return column == name or column.casefold() == without_unit(name).casefold()


def listed(columns: Column | list[Column]) -> list[Column]:
    """Return one column or several as several."""
    return columns if isinstance(columns, list) else [columns]
