"""The welds marked on a rail and what became of them, in a file that outlives a restart.

A mark is on the disk before it is accepted. It waits until it is ended, as captured or rejected. The file of a captured
weld is written before its mark is ended: killed in between, the mark counts as captured because its file is there.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import UNSET, UnsetType

from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.weld_detection import APART_M

SAME_M = 0.1
TIMEOUT_S = 600.0

_MOST_ENDED = 1000
_MAX_BYTES = 1_000_000

_FileName = Annotated[str, msgspec.Meta(pattern=r"^\w[\w.-]*\.csv$")]


class WeldMark(msgspec.Struct, frozen=True):
    """A weld to be captured.

    Attributes:
        file: name of the measurement file that is to hold it.
        found: the weld was detected in the rail, not marked by an operator.
        captured: the measurement file is written.
    """

    file: _FileName
    chainage_m: float
    weld_id: str
    line_speed_kmh: float | UnsetType = UNSET
    weld_position_m: float | UnsetType = UNSET
    found: bool = False
    captured: bool = False

    def __str__(self) -> str:
        return f"weld {self.weld_id} at {self.chainage_m:.3f} m"


class _State(msgspec.Struct):
    """Content of the file: marks without outcome, and those with one whose rail may still be measured again."""

    waiting: list[WeldMark] = []
    ended: list[WeldMark] = []


class WeldMarks:
    """Marks that wait for their rail, and marks that have ended not long ago.

    Args:
        file: where they are kept, in the folder of the measurement files.
        timeout_s: how long a mark may wait, counted anew after a restart.
        announce: receives a line for the operator.
        clock: seconds, steady.
    """

    def __init__(
        self,
        file: Path,
        timeout_s: float,
        announce: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._file = file
        self._timeout_s = timeout_s
        self._announce = announce
        self._clock = clock
        self._deadline_s: dict[str, float] = {}
        self._is_unsaved = False
        self._state = self._load()

    @property
    def waiting(self) -> list[WeldMark]:
        """Marks without outcome, in the order in which they were accepted."""
        return list(self._state.waiting)

    @property
    def all(self) -> list[WeldMark]:
        """Marks that wait, and those that have ended."""
        return [*self._state.waiting, *self._state.ended]

    def at(self, chainage_m: float) -> WeldMark | None:
        """Return the mark that waits or is captured at a chainage; a weld that was rejected may be marked again."""
        for mark in (*self._state.waiting, *(ended for ended in self._state.ended if ended.captured)):
            if abs(mark.chainage_m - chainage_m) <= (APART_M if mark.found else SAME_M):
                return mark
        return None

    def is_waiting(self, mark: WeldMark) -> bool:
        """Return whether a mark has no outcome yet."""
        return any(waiting.file == mark.file for waiting in self._state.waiting)

    def is_captured(self, mark: WeldMark) -> bool:
        """Return whether a mark has ended as captured."""
        return any(ended.captured and ended.file == mark.file for ended in self._state.ended)

    def is_overdue(self, mark: WeldMark) -> bool:
        """Return whether a mark has waited for as long as it may."""
        return self._clock() >= self._deadline_s[mark.file]

    def accept(self, mark: WeldMark, replaces: WeldMark | None = None) -> None:
        """Keep a mark until it is ended, instead of another one.

        Raises:
            InputError: it cannot be written to the disk; it is not accepted.
        """
        before = self._state
        waiting = [other for other in before.waiting if other is not replaces]
        self._state = _State([*waiting, mark], before.ended)
        try:
            self._save()
        except OSError as error:
            self._state = before
            raise InputError(
                f"the weld at {mark.chainage_m:.3f} m cannot be kept in {self._file.parent}: {error.strerror or error}",
                "free space or make the folder writable, then mark it again",
            ) from None
        self._deadline_s[mark.file] = self._clock() + self._timeout_s
        if replaces is not None:
            self._deadline_s.pop(replaces.file, None)

    def end(self, mark: WeldMark, *, captured: bool) -> None:
        """Record the outcome of a mark."""
        waiting = [other for other in self._state.waiting if other.file != mark.file]
        ended = msgspec.structs.replace(mark, captured=captured)
        self._state = _State(waiting, [*self._state.ended, ended][-_MOST_ENDED:])
        self._deadline_s.pop(mark.file, None)
        self._save_or_announce()

    def forget(self, is_past: Callable[[WeldMark], bool]) -> None:
        """Drop ended marks whose rail would be measured anew."""
        self._state.ended = [mark for mark in self._state.ended if not is_past(mark)]

    def retry_save(self) -> None:
        """Write the file if that failed the last time."""
        if self._is_unsaved:
            self._save_or_announce()

    def _load(self) -> _State:
        try:
            with self._file.open("rb") as stream:
                state = msgspec.json.decode(stream.read(_MAX_BYTES), type=_State)
        except FileNotFoundError:
            return _State()
        except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
            self._announce(f"{self._file}: {error}; mark the welds again whose file did not come")
            return _State()
        # Killed after it had written a measurement file, and before it had recorded so.
        written = [mark for mark in state.waiting if (self._file.parent / mark.file).exists()]
        waiting = [mark for mark in state.waiting if mark not in written]
        for mark in waiting:
            self._deadline_s[mark.file] = self._clock() + self._timeout_s
            self._announce(f"{mark}, marked before the restart, is waited for")
        return _State(waiting, state.ended + [msgspec.structs.replace(mark, captured=True) for mark in written])

    def _save_or_announce(self) -> None:
        # An outdated file does no harm: at worst a mark that has ended is looked at once more.
        try:
            self._save()
        except OSError as error:
            if not self._is_unsaved:
                self._announce(f"{self._file}: {error.strerror or error}; free space or make the folder writable")
            self._is_unsaved = True

    def _save(self) -> None:
        with whole_file(self._file, fsync=True) as stream:
            stream.write(msgspec.json.encode(self._state))
        self._is_unsaved = False
