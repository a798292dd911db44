"""Lay a table out for people: a grid as wide as the terminal, or a list where no grid fits."""

import re
import textwrap
from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

from rich.text import Text

Cell = str | Text

_GAP = 2  # between columns
_LONGEST_WORD = 30  # a longer one (a path) is broken where the column ends
_SENTENCE = 40  # a longer text is one, and needs a column in which it can be read
_SENTENCE_WIDTH = 26
_MOST_LINES = 6  # of a row of a grid: what takes more is read better as a list


class Column(NamedTuple):
    """A column of a table: its heading, whether numbers stand in it, and whether its cells are not to be wrapped."""

    heading: str
    right: bool = False
    whole: bool = False


def laid_out(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], width: int, rule: str) -> list[Text]:
    """Return the lines of a table: a grid in which no word is broken, or else a list of its rows.

    Columns in which nothing stands are left out. Names break after hyphens only where the grid would not fit otherwise.

    Args:
        columns: what stands in a row.
        rows: a cell for each column.
        width: of the terminal.
        rule: the character of the line below headings.
    """
    texts = [[column.heading, *(_plain(row[i]) for row in rows)] for i, column in enumerate(columns)]
    told = [i for i, of_column in enumerate(texts) if any(of_column)]
    columns, rows = [columns[i] for i in told], [[row[i] for i in told] for row in rows]
    texts = [texts[i] for i in told]
    for names_break in (False, True):
        widths = _widths(columns, texts, width, names_break)
        if widths is not None and all(len(_row(columns, row, widths)) <= _MOST_LINES for row in rows):
            return _grid(columns, rows, widths, rule)
    return _listed(columns, rows, width)


def _widths(
    columns: Sequence[Column], texts: Sequence[Sequence[str]], width: int, names_break: bool
) -> list[int] | None:
    """Return the width of each column of a grid, or None if they do not fit."""
    least = [_least(column, of_column, names_break) for column, of_column in zip(columns, texts, strict=True)]
    widths = [max(map(len, of_column)) for of_column in texts]
    available = width - _GAP * (len(columns) - 1)
    if sum(least) > available:
        return None
    while sum(widths) > available:
        widest = max(range(len(widths)), key=lambda i: (widths[i] > least[i], widths[i]))
        widths[widest] -= 1
    return widths


def _least(column: Column, texts: Sequence[str], names_break: bool) -> int:
    words = [word for text in texts for word in text.split()]
    if names_break:
        words = [part for word in words for part in re.findall(r"[^-]+-?|-", word)]
    least = max(min(max(map(len, words), default=0), _LONGEST_WORD), *map(len, texts[0].split()), 0)
    longest = max(map(len, texts[1:]), default=0)
    if column.whole:
        return max(least, longest)
    return max(least, _SENTENCE_WIDTH) if longest > _SENTENCE else least


def _plain(cell: Cell) -> str:
    return cell.plain if isinstance(cell, Text) else cell


def _grid(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], widths: Sequence[int], rule: str) -> list[Text]:
    heads: list[list[Cell]] = [[Text(column.heading, style="bold") for column in columns]]
    lines = [line for row in (*heads, *rows) for line in _row(columns, row, widths)]
    below = sum(1 for _ in _row(columns, heads[0], widths))
    lines.insert(below, Text(rule * (sum(widths) + _GAP * (len(widths) - 1))))
    return lines


def _row(columns: Sequence[Column], row: Sequence[Cell], widths: Sequence[int]) -> list[Text]:
    """Return the lines of a row, as many as its longest cell takes."""
    wrapped = [textwrap.wrap(_plain(cell), width) for cell, width in zip(row, widths, strict=True)]
    styles = [cell.style if isinstance(cell, Text) else "" for cell in row]
    lines = []
    for parts in zip_longest(*wrapped, fillvalue=""):
        line = Text()
        for column, part, style, width in zip(columns, parts, styles, widths, strict=True):
            line.append(" " * (width - len(part)) * column.right)
            line.append(part, style)
            line.append(" " * (width - len(part)) * (not column.right) + " " * _GAP)
        line.rstrip()
        lines.append(line)
    return lines


def _listed(columns: Sequence[Column], rows: Sequence[Sequence[Cell]], width: int) -> list[Text]:
    """Return rows one below the other, a line a cell below the first."""
    indent = max((len(column.heading) for column in columns[1:]), default=0) + 4
    lines: list[Text] = []
    for row in rows:
        first = row[0]
        beside = isinstance(first, Text)  # a decision, and what it is on
        name = f"{columns[0].heading} {_plain(first)}" if _plain(first).isdecimal() else _plain(first)
        lines.append(Text.assemble(first, "  ", _plain(row[1])) if beside else Text(name, style="bold"))
        for column, cell in zip(columns[1 + beside :], row[1 + beside :], strict=True):
            style = cell.style if isinstance(cell, Text) else ""
            heading = column.heading
            for part in textwrap.wrap(_plain(cell), max(width - indent, 16)):
                lines.append(Text.assemble(f"  {heading:{indent - 2}}", (part, style)))
                heading = ""
        lines.append(Text())
    return lines[:-1]
