"""Read columns of numbers in measurement files: encoding, lines, delimiters and decimal marks.

Numbers become exact decimals. What is not unambiguous is refused, and messages name the line; the caller adds the file.
"""

import re
from decimal import Decimal
from typing import NamedTuple

from weld_force_ros.errors import ProfileError
from weld_force_ros.messages import MAX_SAMPLES

MAX_FILE_BYTES = 4 * 2**20
_MAX_LINES = MAX_SAMPLES + 10_000

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d{1,3})?", re.ASCII | re.IGNORECASE)
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)


class Line(NamedTuple):
    """A line's number in the file, from 1, and its text without surrounding blanks."""

    number: int
    text: str

    @property
    def is_comment(self) -> bool:
        """True for a header or comment line, false for a row."""
        return self.text.startswith("#")


def decoded(raw: bytes) -> str:
    """Return the text of a file.

    Raises:
        ProfileError: empty, binary, not UTF-8, or larger than `MAX_FILE_BYTES`.
    """
    if len(raw) > MAX_FILE_BYTES:
        raise ProfileError(f"larger than {MAX_FILE_BYTES // 2**20} MB", "give one weld, at most 5 m of rail, a file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ProfileError(f"byte {error.start + 1} is not UTF-8 text", "save the profile as text in UTF-8") from None
    if re.search(r"[\x00-\x08\x0e-\x1f\x7f]", text):
        raise ProfileError("binary, it holds control characters", "save the profile as text in UTF-8")
    if not text.strip():
        raise ProfileError("empty", "give a file with columns x,z")
    return text


def lines_of(text: str, skip_rows: int) -> list[Line]:
    """Return the lines that hold something, after the first `skip_rows`.

    Raises:
        ProfileError: a blank line within the rows, where samples may be missing; a negative `skip_rows`; more lines
            than the samples of a weld and its header can make.
    """
    if skip_rows < 0:
        raise ProfileError(f"skip_rows {skip_rows} is negative", "state how many lines to skip at the top")
    texts = re.split(r"\r\n|\r|\n", text)
    if len(texts) > _MAX_LINES:
        raise ProfileError(f"{len(texts)} lines, at most {_MAX_LINES}", "give one weld a file, at 0.1 mm or coarser")
    split = [Line(n, line.strip()) for n, line in enumerate(texts, start=1)][skip_rows:]
    while split and not split[-1].text:
        split.pop()
    rows_began = False
    for line in split:
        if rows_began and not line.text:
            raise ProfileError(f"line {line.number}: blank line within the samples", "remove it; give one weld a file")
        rows_began = rows_began or not (line.is_comment or not line.text)
    return [line for line in split if line.text]


def read_columns(rows: list[Line], names: list[str]) -> list[tuple[int, list[Decimal]]]:
    """Return the numbers of each row with the row's line number; a first row that holds the names is left out.

    Args:
        rows: the file's lines without comments.
        names: the columns expected: x and z, or z alone.

    Raises:
        ProfileError: another number of columns, another order, something that is not a number, mixed decimal marks.
    """
    if not rows:
        return []
    delimiter = _delimiter(rows[0].text)
    header = [name.strip().lower() for name in rows[0].text.split(delimiter)]
    if sorted(header) == names:
        if header != names:
            raise ProfileError(
                f"line {rows[0].number}: columns {','.join(header)}", "give the columns in the order x,z"
            )
        rows = rows[1:]
    if delimiter != ",":
        _refuse_mixed_decimal_marks(rows)
    return [(row.number, _row_numbers(row, names, delimiter)) for row in rows]


def _delimiter(first_row: str) -> str | None:
    """Return semicolon, tab or comma; None for spaces. Spaces win over commas that can only be decimal marks."""
    for delimiter in (";", "\t"):
        if delimiter in first_row:
            return delimiter
    commas_are_decimal = len(first_row.split()) > 1 and not re.search(r"\s,|,\s", first_row)
    return "," if "," in first_row and not commas_are_decimal else None


def _refuse_mixed_decimal_marks(rows: list[Line]) -> None:
    comma = next((row.number for row in rows if "," in row.text), None)
    point = next((row.number for row in rows if "." in row.text), None)
    if comma and point:
        raise ProfileError(
            f"line {max(comma, point)}: decimal points and decimal commas in one file",
            "use one decimal mark and no thousands separator",
        )


def _row_numbers(row: Line, names: list[str], delimiter: str | None) -> list[Decimal]:
    fields = [field.strip() for field in row.text.split(delimiter)]
    if len(fields) != len(names):
        raise ProfileError(
            f"line {row.number}: {len(fields)} column{'s' * (len(fields) > 1)} instead of {len(names)}",
            _remedy_for_columns(len(fields), len(names)),
        )
    if delimiter != ",":
        fields = [field.replace(",", ".", 1) for field in fields]
    return [number(field, f"line {row.number}: {name}") for name, field in zip(names, fields, strict=True)]


def _remedy_for_columns(found: int, expected: int) -> str:
    if expected == 1:
        return "leave spacing out if the file has x and z; write decimal points if the commas are decimal marks"
    if found == 1:
        return "give rows of x,z, or state the spacing if the file has heights only"
    return "give rows of x,z; with decimal commas, put semicolons between the columns"


def number(text: str, name: str) -> Decimal:
    """Return the finite decimal number that a text holds; `name` says in messages where.

    Raises:
        ProfileError: not a number, or not a finite one.
    """
    if _NUMBER.fullmatch(text):
        return Decimal(text)
    if _NOT_FINITE.fullmatch(text):
        raise ProfileError(f"{name} is {text}, not a finite number", "correct it or measure it again")
    raise ProfileError(
        f"{name} {quoted(text)} is not a number",
        "write numbers such as 1.25; mark lines of text with #, or skip them with skip_rows",
    )


def quoted(text: str) -> str:
    """Return a foreign text for a message: on one line and short."""
    return repr(text if len(text) <= 40 else text[:40] + "…")
