"""What the dashboard shows: a row of each of the newest welds in memory, its details in a file."""

import threading
from collections import OrderedDict, deque
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TypeVar

import msgspec
import zstandard

from weld_force_ros._files import whole_file
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
from weld_force_ros.report.table_row import row
from weld_force_ros.report.weld_detail import detail

NEWEST = 2_000
"""So many rows are kept, and the details of so many welds."""

_BESIDE_THE_VERDICT = 3  # profile, map, history
_MOST_IN_THE_MAKING = 256  # whoever joins late gets more verdicts than maps, and in no order
_MOST_SETTINGS = 20

M = TypeVar("M", bound=Message)
T = TypeVar("T")


@dataclass
class _PartialWeld:
    """A measurement of which not everything has come; messages are kept compressed, as they may be large.

    Attributes:
        shown: the number and the verdict, once that has come.
        packed: the other parts.
    """

    shown: tuple[int, Verdict] | None = None
    packed: dict[type[Message], bytes] = field(default_factory=dict)

    def put(self, message: Message) -> None:
        self.packed[type(message)] = zstandard.compress(msgspec.json.encode(message), 1)

    def get(self, kind: type[M]) -> M | None:
        packed = self.packed.get(kind)
        return None if packed is None else msgspec.json.decode(zstandard.decompress(packed), type=kind)


class LiveReport:
    """Welds numbered from 1 on, as their verdicts come; messages may come in any order.

    A verdict gets its row at once, and details of what has come by then; what comes later is added to these. Memory
    stays: rows are some hundred bytes each, and what is incomplete for long is given up. `take` is for one thread, the
    others for any.

    Args:
        folder: for files of details; of its own.
        newest: how many welds are kept.
    """

    def __init__(self, folder: Path, newest: int = NEWEST) -> None:
        self._folder = folder
        self._rows: deque[bytes] = deque(maxlen=newest)
        self._last = 0
        self._lock = threading.Lock()
        self._making: OrderedDict[str, _PartialWeld] = OrderedDict()
        self._settings: OrderedDict[str, SimulationSettings] = OrderedDict()
        self._limits: OrderedDict[str, AssessmentSettings] = OrderedDict()

    @property
    def count(self) -> int:
        """How many welds have come."""
        return self._last

    def rows_after(self, number: int) -> bytes:
        """JSON: a list of the rows kept of welds that came after one, which 0 is before all."""
        with self._lock:
            count = min(max(0, self._last - number), len(self._rows))
            rows = list(islice(self._rows, len(self._rows) - count, None))
        return b"[" + b",".join(rows) + b"]"

    def detail(self, number: int) -> bytes | None:
        """The details of a weld as `report_page.detail` makes them; None if it is not kept."""
        try:
            return self._file(number).read_bytes()
        except OSError:
            return None

    def take(self, message: Message) -> None:
        """Show what a message says.

        Raises:
            OSError: details cannot be written; the row is there.
        """
        match message:
            case SimulationSettings():
                _keep(self._settings, message.config_sha256, message, _MOST_SETTINGS)
                self._write_made_by(message.config_sha256)
            case AssessmentSettings():
                _keep(self._limits, message.limits_sha256, message, _MOST_SETTINGS)
                self._write_made_by(message.limits_sha256)
            case Rejection():
                self._making.pop(str(message.profile_id), None)
                self._write(self._add(RejectedRecord(message)), RejectedRecord(message))
            case WeldProfile() | ForceMap() | ForceHistory() | Verdict():
                self._take_part(message)

    def _take_part(self, message: WeldProfile | ForceMap | ForceHistory | Verdict) -> None:
        measurement = identity(message)
        making = self._making.get(measurement) or _PartialWeld()
        if isinstance(message, Verdict):
            making.shown = self._add(WeldRecord(message)), message
        else:
            making.put(message)
        _keep(self._making, measurement, making, _MOST_IN_THE_MAKING)
        if self._write_shown(making):
            del self._making[measurement]

    def _write_made_by(self, sha256: str) -> None:
        """Settings have come that verdicts before them were made with."""
        for making in self._making.values():
            if making.shown and sha256 in (making.shown[1].config_sha256, making.shown[1].limits_sha256):
                self._write_shown(making)

    def _write_shown(self, making: _PartialWeld) -> bool:
        """Write the details of a weld that has its row; whether all is in them."""
        if making.shown is None:
            return False
        number, verdict = making.shown
        weld = WeldRecord(
            verdict=verdict,
            force_map=making.get(ForceMap),
            profile=making.get(WeldProfile),
            history=making.get(ForceHistory),
            settings=self._settings.get(verdict.config_sha256),
            limits=self._limits.get(verdict.limits_sha256),
        )
        self._write(number, weld)
        return len(making.packed) == _BESIDE_THE_VERDICT and weld.settings is not None and weld.limits is not None

    def _add(self, entry: Record) -> int:
        encoded = msgspec.json.encode(row(self._last + 1, entry))
        with self._lock:
            self._last += 1
            self._rows.append(encoded)
            dropped = self._last - len(self._rows)
        self._file(dropped).unlink(missing_ok=True)
        return self._last

    def _write(self, number: int, entry: Record) -> None:
        if number <= self._last - len(self._rows):
            return  # dropped meanwhile
        with whole_file(self._file(number)) as stream:
            stream.write(detail(entry))

    def _file(self, number: int) -> Path:
        return self._folder / f"{number}.gz"


def _keep(kept: OrderedDict[str, T], key: str, value: T, at_most: int) -> None:
    """Put a value last, and let go of the first if there are too many."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > at_most:
        kept.popitem(last=False)
