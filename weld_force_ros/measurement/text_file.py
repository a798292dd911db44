"""Turn the bytes of a measurement file into lines of text: archives, spreadsheets, encodings, line ends."""

import io
import re
import zipfile
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from weld_force_ros.errors import ProfileError
from weld_force_ros.messages import MAX_SAMPLES, MIN_PROFILE_SAMPLES

if TYPE_CHECKING:
    from charset_normalizer import CharsetMatches

MAX_FILE_BYTES = 4 * 2**20
_MAX_UNPACKED_BYTES = 64 * 2**20
_MAX_LINES = 2 * MAX_SAMPLES
_LONGEST_LINE = 20_000
_LINE_ENDS = re.compile(r"\r\r\n|\r\n|\r|\n")
_BLANKS = " \u00a0\ufeff\f\v"
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_END_MARKS = "\x00\x1a"  # of CP/M and of logs that lost their power
_USUAL_LETTERS = re.compile(r"[äöüßÄÖÜéèêàçñåæøÆØÅ°]|µ(?=m?\b)")
_AS_LIKELY = 0.007  # of `charset_normalizer`'s measure of chaos
_ENCODINGS = ["cp1252", "cp1250", "cp1251", "cp437", "cp850", "mac_roman", "latin_1"]
_NO_TEXT = (
    (b"\x1f\x8b", "compressed (gzip)", "unpack it"),
    (b"\xd0\xcf\x11\xe0", "an old Excel or Word file", "save it as CSV or .xlsx"),
    (b"\x89HDF", "an HDF5 file", "export the measurement as text"),
    (b"%PDF", "a PDF", "export the measurement as text"),
    (b"<html", "an HTML page", "save it as CSV"),
    (b"<!DOCTYPE", "an HTML page", "save it as CSV"),
    (b"<table", "an HTML page", "save it as CSV"),
)
_BYTE_ORDER_MARKS = (
    (b"\xef\xbb\xbf", "utf-8-sig"),
    (b"\xff\xfe\x00\x00", "utf-32"),
    (b"\x00\x00\xfe\xff", "utf-32"),
    (b"\xff\xfe", "utf-16"),
    (b"\xfe\xff", "utf-16"),
)


class Line(NamedTuple):
    """A line's number in the file, from 1, and its text without surrounding blanks."""

    number: int
    text: str


class TextFile(NamedTuple):
    """The lines of a file, blank ones included, and what was done to read them.

    Attributes:
        is_ended: whether the last line has its line end; a file without one may still be written.
    """

    lines: list[Line]
    notes: list[str]
    is_ended: bool


def text_file(raw: bytes, encoding: str | None = None) -> TextFile:
    """Read the lines of a measurement file.

    A ZIP archive of one file is unpacked, a spreadsheet's first sheet is read as lines with tabs. The encoding is that
    of a byte order mark, else the one given, else UTF-8 or, where the bytes are not UTF-8, what `charset_normalizer`
    finds.

    Args:
        raw: the file.
        encoding: of its text, where the user or the instrument's format states it.

    Raises:
        ProfileError: empty, binary, too large, or not in that encoding.
    """
    _check_size(raw)
    for begin, what, remedy in _NO_TEXT:
        if raw[:64].lstrip().lower().startswith(begin.lower()):
            raise ProfileError(what, remedy)
    notes = list[str]()
    if raw.startswith(b"PK\x03\x04"):
        raw, unpacked = _unpacked(raw)
        notes.append(unpacked)
    text, decoding = _decoded(raw, encoding)
    notes += [decoding] if decoding else []
    ended = text.rstrip(_END_MARKS)
    if len(ended) < len(text):
        notes.append("end marks after the last line left out")
    if _CONTROL.search(ended):
        raise ProfileError("binary, it holds control characters", "export the measurement as text")
    if not ended.strip():
        raise ProfileError("empty", "give a file with columns x,z")
    if ended.count("\n") + ended.count("\r") > 3 * _MAX_LINES:  # at once, not after taking them apart
        raise ProfileError(f"more than {_MAX_LINES} lines", "give one weld a file, at 0.1 mm or coarser")
    texts = _LINE_ENDS.split(ended)
    longest = max(range(len(texts)), key=lambda i: len(texts[i]))
    if len(texts[longest]) > _LONGEST_LINE:
        raise ProfileError(f"line {longest + 1} has {len(texts[longest])} characters", "give one sample a line")
    is_ended = not texts[-1].strip()
    if is_ended:
        texts.pop()
    if len(texts) > _MAX_LINES:
        raise ProfileError(f"{len(texts)} lines, at most {_MAX_LINES}", "give one weld a file, at 0.1 mm or coarser")
    return TextFile([Line(n, text) for n, text in enumerate(_stripped(texts), start=1)], notes, is_ended)


def _stripped(texts: Sequence[str]) -> list[str]:
    """Return lines without blanks at their ends; tabs at their begin stay where they stand for empty cells."""
    texts = [text.rstrip().lstrip(_BLANKS) for text in texts]
    is_indented = all(text.startswith("\t") for text in texts if text)
    return [text.lstrip() if is_indented or text.lstrip().startswith("#") else text for text in texts]


def _check_size(raw: bytes) -> None:
    if len(raw) > MAX_FILE_BYTES:
        raise ProfileError(
            f"larger than {MAX_FILE_BYTES // 2**20} MB", "give the rail about the welds, at 0.1 mm or coarser"
        )


def _unpacked(raw: bytes) -> tuple[bytes, str]:
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
            if "xl/workbook.xml" in names:
                if sum(entry.file_size for entry in archive.infolist()) > _MAX_UNPACKED_BYTES:
                    raise ProfileError("a spreadsheet that is too large", "save the sheet with the samples as CSV")
                text, name = _spreadsheet_text(raw)
                return text.encode(), f"sheet {quoted(name)} of a spreadsheet"
            if len(names) != 1:
                raise ProfileError(f"an archive of {len(names)} files", "unpack it; give each measurement as a file")
            with archive.open(names[0]) as file:
                content = file.read(MAX_FILE_BYTES + 1)
    except ProfileError:
        raise
    except Exception as error:  # of a broken archive the library raises a dozen kinds
        raise ProfileError(f"an archive that cannot be unpacked: {quoted(str(error))}", "unpack it yourself") from None
    _check_size(content)
    return content, "unpacked from a ZIP archive"


def _spreadsheet_text(raw: bytes) -> tuple[str, str]:
    """Return the first sheet that holds a table of numbers, as lines with tabs, and its name."""
    try:
        import openpyxl
    except ImportError:
        raise ProfileError(
            "a spreadsheet", "install `pip install 'weld_force_ros[spreadsheets]'`, or save it as CSV"
        ) from None
    names = list[str]()
    try:
        workbook = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
        for sheet in workbook.worksheets:
            names.append(sheet.title)
            rows, numeric = list[str](), 0
            for row in sheet.iter_rows(max_row=_MAX_LINES + 1, max_col=64, values_only=True):
                cells = ["" if cell is None else str(cell).replace("\t", " ").replace("\n", " ") for cell in row]
                rows.append("\t".join(cells).rstrip("\t"))
                numeric += any(isinstance(cell, int | float) for cell in row)
            if numeric >= MIN_PROFILE_SAMPLES:
                return "\n".join(rows) + "\n", sheet.title
    except Exception as error:  # a foreign library on a foreign file
        raise ProfileError(f"a spreadsheet that cannot be read: {quoted(str(error))}", "save it as CSV") from None
    raise ProfileError(
        f"a spreadsheet without a table of numbers (sheets: {quoted(', '.join(names))})", "save the samples as CSV"
    )


def _decoded(raw: bytes, stated: str | None) -> tuple[str, str | None]:
    marked = next((name for mark, name in _BYTE_ORDER_MARKS if raw.startswith(mark)), None)
    encoding = marked or stated or _utf16_by_zeros(raw) or "utf-8"
    try:
        return raw.decode(encoding), None if encoding.startswith("utf-8") else f"read as {encoding}"
    except (UnicodeDecodeError, LookupError):
        if marked or stated:
            raise ProfileError(f"not {encoding} text", "state its encoding, such as cp1252") from None
    if b"\x00" in raw.rstrip(b"\x00"):
        raise ProfileError("binary, it holds zero bytes", "export the measurement as text")
    from charset_normalizer import from_bytes

    encoding = _likeliest(raw, from_bytes(raw, cp_isolation=_ENCODINGS))
    return raw.decode(encoding, "replace"), f"not UTF-8: read as {encoding}"


def _likeliest(raw: bytes, matches: "CharsetMatches") -> str:
    """Return the encoding in which a file's letters are usual ones; of several, the commonest encoding.

    A few umlauts and signs among numbers are too little text for `charset_normalizer` to tell one from the other.
    """
    if (best := matches.best()) is None:
        return "cp1252"
    likely = {e for match in matches if match.chaos <= best.chaos + _AS_LIKELY for e in match.could_be_from_charset}
    usual = {e: len(_USUAL_LETTERS.findall(raw.decode(e, "replace"))) for e in _ENCODINGS if e in likely}
    return max(usual, key=lambda encoding: usual[encoding], default=best.encoding)


def _utf16_by_zeros(raw: bytes) -> str | None:
    """Recognise UTF-16 without a byte order mark: digits in it have a zero byte each, on one side."""
    sample = raw[:4096]
    zeros = (sample[0::2].count(0), sample[1::2].count(0))
    if max(zeros) < 0.4 * len(sample) / 2 or min(zeros) > 0.05 * len(sample) / 2:
        return None
    return "utf-16-le" if zeros[1] > zeros[0] else "utf-16-be"


def quoted(text: str) -> str:
    """Return a foreign text for a message: on one line and short."""
    return repr(text if len(text) <= 40 else text[:40] + "…")
