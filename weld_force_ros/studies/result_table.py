"""Tables of a study: written as CSV, shown on a terminal."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, os_errors_as

Cell = str | float | bool | None


@dataclass(frozen=True)
class Column:
    """A column: its name in the file, which ends in the unit, and its heading on a terminal; hidden without one."""

    name: str
    heading: str = ""
    decimals: int | None = None

    def shown(self, cell: Cell) -> str:
        """Return a cell as text for a terminal; a missing value is a dash."""
        if cell is None:
            return "-"
        if isinstance(cell, bool):
            return "yes" if cell else "no"
        if isinstance(cell, str):
            return cell
        return f"{cell:g}" if self.decimals is None else f"{cell:.{self.decimals}f}"


@dataclass(frozen=True)
class Table:
    """Rows, each with one cell a column; None where a value is missing."""

    title: str
    columns: tuple[Column, ...]
    rows: Sequence[tuple[Cell, ...]]

    def write_csv(self, path: Path) -> None:
        """Write the table under its columns' names, to eight digits.

        Raises:
            InputError: the place cannot be written.
        """
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow([column.name for column in self.columns])
        writer.writerows([map(_written, row) for row in self.rows])
        with os_errors_as(InputError, path, "name a writable folder"), whole_file(path) as stream:
            stream.write(text.getvalue().encode())


def _written(cell: Cell) -> str:
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return f"{cell:.8g}" if isinstance(cell, float) else str(cell)
