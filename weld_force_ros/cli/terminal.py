"""Write what people read: results to standard output, notes and progress to standard error.

Where standard output holds CSV or JSON (`result_stream`), results for people go to standard error, too.
"""

import csv
import os
import re
import sys
import textwrap
from collections.abc import Iterable
from contextlib import suppress

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from weld_force_ros.cli import result_stream
from weld_force_ros.cli.table_layout import Column, laid_out
from weld_force_ros.studies.result_table import Table


class _Stream(Console):
    """Standard output or error; when its reader has seen enough (`| head`), the work goes on unseen."""

    def on_broken_pipe(self) -> None:
        result_stream.discard(self.file)


_results = _Stream(highlight=False)
notes = _Stream(stderr=True, highlight=False)
"""Where progress and notes are shown."""

_WITH_ITS_UNIT = re.compile(r"(?<=\d) (?=(?:%|km/h|kN|Hz|m|cm|mm|um)(?!\w))")
_WIDTH = 80
_WIDTH_OF_FILES = 120


def width() -> int:
    """Return the columns of the terminal, of any stream that is one; of none, what people read in a file."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isdecimal() and int(stated):
        return int(stated)
    for stream in (sys.__stdout__, sys.__stderr__, sys.__stdin__):
        with suppress(OSError, ValueError, AttributeError):
            if columns := os.get_terminal_size(stream.fileno()).columns:  # type: ignore[union-attr]
                return columns
    return _WIDTH_OF_FILES


def results() -> Console:
    """Return where results for people are shown."""
    return _results if result_stream.form() == "table" else notes


def show(line: Text) -> None:
    """Print one line of results that has a style."""
    results().print(line, soft_wrap=True)


def plain(text: str) -> str:
    """Return text without control characters and changes of direction, which a terminal would obey."""
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)


def say(text: str) -> None:
    """Print plain lines of results, broken between words at the terminal's width; nothing in it is taken for markup."""
    for line in plain(text).split("\n"):
        results().print(Text(_folded(line, width())), soft_wrap=True)


def note(text: str) -> None:
    """Print one plain line about what is being done, not part of the results; only a terminal breaks it."""
    notes.print(Text(plain(text)), soft_wrap=not notes.is_terminal)


def say_wrapped(text: str) -> None:
    """Print sentences of results, in lines that are not too long to be read."""
    say(_folded(plain(text), min(width(), _WIDTH)))


def _folded(line: str, columns: int) -> str:
    """Return a line that is too long in several, no word or quantity of it broken, the later ones indented."""
    if len(line) <= columns:
        return line
    kept = _WITH_ITS_UNIT.sub("\N{NO-BREAK SPACE}", line)
    lines = textwrap.wrap(kept, columns, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def can_draw() -> bool:
    """Return whether results may hold more than ASCII."""
    return results().encoding.startswith("utf")


def progress() -> Progress:
    """Return a progress bar that leaves nothing behind, and shows nothing without a terminal."""
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=notes,
        transient=True,
        disable=not notes.is_terminal,
    )


def table(title: str, columns: Iterable[tuple[str, str]], rows: Iterable[Iterable[str | Text]]) -> None:
    """Print a table; each column is its heading and its alignment.

    Args:
        title: above it; CSV has none.
        columns: heading and `right`, `whole` if cells are not to be wrapped, both or nothing.
        rows: a cell for each column.
    """
    heads = [Column(heading, "right" in how, "whole" in how) for heading, how in columns]
    cells = [[cell if isinstance(cell, Text) else plain(cell) for cell in row] for row in rows]
    if result_stream.form() == "csv":
        sys.stdout.write(result_stream.between_tables())
        lines = csv.writer(sys.stdout, lineterminator="\n")
        lines.writerow([column.heading for column in heads])
        lines.writerows([[cell.plain if isinstance(cell, Text) else cell for cell in row] for row in cells])
        return
    for part in textwrap.wrap(plain(title), width(), break_long_words=False, break_on_hyphens=False):
        show(Text(part, style="bold"))
    for line in laid_out(heads, cells, width(), rule="─" if can_draw() else "-"):
        show(line)


def show_table(found: Table) -> None:
    """Print a study's table, numbers to the right."""
    shown = [(i, column) for i, column in enumerate(found.columns) if column.heading]
    texts = [any(isinstance(row[i], str) for row in found.rows) for i, _ in shown]
    table(
        found.title,
        [(column.heading, "" if text else "right") for (_, column), text in zip(shown, texts, strict=True)],
        [[column.shown(row[i]) for i, column in shown] for row in found.rows],
    )


def percent(share: float) -> str:
    """Return a share in per cent; what is neither none nor all is not shown as such."""
    if 0 < share < 0.01:
        return "<1 %"
    return ">99 %" if 0.99 < share < 1 else f"{100 * share:.0f} %"


def counted(number: int, one: str, several: str = "") -> str:
    """Return a number with its noun: `1 weld`, `2 welds`."""
    return f"{number:,} {one if number == 1 else several or one + 's'}"
