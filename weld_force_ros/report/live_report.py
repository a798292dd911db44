"""The live report: rows of the newest welds in memory, the part of each in a file."""

import gzip
import threading
from collections import OrderedDict, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import zstandard

from weld_force_ros._files import whole_file
from weld_force_ros._words import english
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Message,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
    identity,
)
from weld_force_ros.recording.weld_records import Record, RejectedRecord, WeldRecord
from weld_force_ros.report.page_header import header
from weld_force_ros.report.table_row import row, row_html
from weld_force_ros.report.weld_section import section

NEWEST = 2_000
"""Number of welds that are kept."""

_MOST_PARTIAL = 256  # a late subscriber gets more verdicts than maps, and in no order
_MOST_SETTINGS = 20

M = TypeVar("M", bound=Message)
T = TypeVar("T")


@dataclass
class _PartialWeld:
    """A weld of which not all messages have arrived; they are kept compressed, as they may be large.

    Attributes:
        number: of its row, which it gets with its verdict.
        verdict: None until it arrives.
        packed: the other messages by type and, of several vehicles' maps and histories, by their settings.
    """

    number: int = 0
    verdict: Verdict | None = None
    packed: dict[tuple[type[Message], str], bytes] = field(default_factory=dict)

    def put(self, message: WeldProfile | ForceMap | ForceHistory) -> None:
        config = "" if isinstance(message, WeldProfile) else message.config_sha256
        self.packed[type(message), config] = zstandard.compress(msgspec.json.encode(message), 1)

    def get(self, kind: type[M], config_sha256: str = "") -> M | None:
        packed = self.packed.get((kind, config_sha256))
        return None if packed is None else msgspec.json.decode(zstandard.decompress(packed), type=kind)


class LiveReport:
    """Rows and details of welds, numbered from 1 in the order of their verdicts; messages may arrive in any order.

    A verdict gets its row at once, with details from the messages that have arrived; later messages are added to the
    details. Memory is bounded: rows take some hundred bytes each, and the oldest incomplete welds are dropped. `add`
    must be called from one thread, everything else from any.

    Args:
        folder: for files of details; nothing else may be in it.
        newest: number of welds that are kept.
    """

    def __init__(self, folder: Path, newest: int = NEWEST) -> None:
        self._folder = folder
        self._rows: deque[bytes] = deque(maxlen=newest)
        self._bases: deque[dict[str, Any] | None] = deque(maxlen=newest)
        self._last = 0
        self._lock = threading.Lock()
        self._partial: OrderedDict[str, _PartialWeld] = OrderedDict()
        self._versions: OrderedDict[str, int] = OrderedDict()
        self._settings: OrderedDict[str, SimulationSettings] = OrderedDict()
        self._limits: OrderedDict[str, AssessmentSettings] = OrderedDict()

    @property
    def count(self) -> int:
        """The number of welds that have arrived."""
        return self._last

    def rows_after(self, number: int) -> bytes:
        """Return the kept rows of welds after one as a JSON list; 0 is before all welds."""
        with self._lock:
            count = min(max(0, self._last - number), len(self._rows))
            rows = list(islice(self._rows, len(self._rows) - count, None))
        return b"[" + b",".join(rows) + b"]"

    def header(self) -> bytes:
        """Return the front's header, of the welds that are kept, as HTML."""
        with self._lock:
            bases = [basis for basis in self._bases if basis]
            limits, settings = list(self._limits.values()), list(self._settings.values())
        return header(bases, limits, english(), settings=settings).encode()

    def detail(self, number: int) -> bytes | None:
        """Return the part of a weld as gzip of HTML; None if it is not kept."""
        try:
            return self._file(number).read_bytes()
        except OSError:
            return None

    def add(self, message: Message) -> None:
        """Add a message to the rows and details.

        Raises:
            OSError: the details cannot be written; the row is kept.
        """
        match message:
            case SimulationSettings():
                with self._lock:
                    _keep(self._settings, message.config_sha256, message, _MOST_SETTINGS)
                self._write_judged_by(message.config_sha256)
            case AssessmentSettings():
                with self._lock:
                    _keep(self._limits, message.limits_sha256, message, _MOST_SETTINGS)
                self._write_judged_by(message.limits_sha256)
            case Rejection():
                self._partial.pop(str(message.profile_id), None)
                with self._new_row(RejectedRecord(message), self._older_outcomes(message)) as number:
                    self._write(number, RejectedRecord(message))
            case WeldProfile() | ForceMap() | ForceHistory() | Verdict():
                self._add_part(message)

    def _add_part(self, message: WeldProfile | ForceMap | ForceHistory | Verdict) -> None:
        measurement = identity(message)
        weld = self._partial.get(measurement) or _PartialWeld()
        _keep(self._partial, measurement, weld, _MOST_PARTIAL)
        if isinstance(message, Verdict):
            with self._new_row(self._record(weld, message), self._older_versions(weld, message)) as number:
                weld.number, weld.verdict = number, message
                is_complete = self._write_weld(weld)
        else:
            weld.put(message)
            is_complete = self._write_weld(weld)
        if is_complete:
            del self._partial[measurement]

    def _older_versions(self, weld: _PartialWeld, verdict: Verdict) -> list[int]:
        """Return the rows of an earlier version of the weld's file, and note that this is the newest."""
        profile = weld.get(WeldProfile)
        if profile is None or not isinstance(profile.file_version_of, str):
            return []
        file = profile.file_version_of
        older = [self._versions.pop(version, 0) for version in (f"{file}\n{verdict.weld_id}", f"{file}\n")]
        _keep(self._versions, f"{file}\n{verdict.weld_id}", self._last + 1, NEWEST)
        return sorted(filter(None, older))

    def _older_outcomes(self, rejection: Rejection) -> list[int]:
        """Return the rows of all that came of a file before it was refused, and note that this is the newest."""
        if not isinstance(rejection.file_version_of, str):
            return []
        of_file = f"{rejection.file_version_of}\n"
        older = [self._versions.pop(version) for version in list(self._versions) if version.startswith(of_file)]
        _keep(self._versions, of_file, self._last + 1, NEWEST)
        return sorted(older)

    def _write_judged_by(self, sha256: str) -> None:
        """Write the details of welds whose verdict arrived before its settings or limits."""
        for weld in self._partial.values():
            if weld.verdict and sha256 in (weld.verdict.config_sha256, weld.verdict.limits_sha256):
                self._write_weld(weld)

    def _write_weld(self, weld: _PartialWeld) -> bool:
        """Write the details of a weld that has its verdict; return whether they are complete."""
        verdict = weld.verdict
        if verdict is None:
            return False
        record = self._record(weld, verdict)
        self._write(weld.number, record)
        parts = (record.profile, record.force_map, record.history, record.settings, record.limits)
        return all(part is not None for part in parts)

    def _record(self, weld: _PartialWeld, verdict: Verdict) -> WeldRecord:
        """Return all that has arrived of a weld."""
        return WeldRecord(
            verdict=verdict,
            force_map=weld.get(ForceMap, verdict.config_sha256),
            profile=weld.get(WeldProfile),
            history=weld.get(ForceHistory, verdict.config_sha256),
            settings=self._settings.get(verdict.config_sha256),
            limits=self._limits.get(verdict.limits_sha256),
        )

    @contextmanager
    def _new_row(self, record: Record, supersedes: Sequence[int]) -> Iterator[int]:
        """Give the number of a new row, to write its details; afterwards add the row, whether they were written or not.

        In this order, as a page that sees a row may ask for its details at once.
        """
        number = self._last + 1
        content = row(number, record) | ({"supersedes": supersedes} if supersedes else {})
        encoded = msgspec.json.encode({**content, "html": row_html(content, english())})
        try:
            yield number
        finally:
            with self._lock:
                self._last = number
                self._rows.append(encoded)
                self._bases.append(content.get("basis"))
                dropped = number - len(self._rows)
            self._file(dropped).unlink(missing_ok=True)

    def _write(self, number: int, record: Record) -> None:
        if number <= self._last - len(self._rows):
            return  # dropped meanwhile
        with whole_file(self._file(number)) as stream:
            stream.write(gzip.compress(section(record, english()).encode(), mtime=0))

    def _file(self, number: int) -> Path:
        return self._folder / f"{number}.gz"


def _keep(kept: OrderedDict[str, T], key: str, value: T, at_most: int) -> None:
    """Put a value last, and drop the first ones if there are too many."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > at_most:
        kept.popitem(last=False)
