"""Watch a folder: hand each file over once it is completely written, and again when it has changed."""

import os
import stat
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.profile_file import UNFINISHED

try:
    import watchfiles
except ModuleNotFoundError:
    raise InputError(
        "nodes need watchfiles to watch a folder", "install it with `pip install 'weld_force_ros[nodes]'`"
    ) from None

BATCH_FILES = 16
"""How many files are handed over in one call: a simulator need not wait for all that are there."""

_TICK_MS = 20
_FULL_SCAN_S = 5.0  # events of network drives may never come, and a burst of them may overflow
_RETRY_S = 1.0


class _State(NamedTuple):
    size: int
    modified_ns: int
    inode: int


class FolderWatcher:
    """Watches one folder, not those below it, on a thread of its own.

    Args:
        folder: folder to watch; the files already there are handed over first.
        settle_s: how long size and time of change must stay the same before a file whose content is complete is handed
            over.
        unfinished_s: how long they must for any other: a quiet time does not tell that a file is complete.
        is_complete: returns whether the content of a file says that it is all there.
        take: called with the files that are ready, at most `BATCH_FILES` of them, in order of name; raises nothing.
        report_problem: called with a problem of the folder itself, which is tried again.
    """

    def __init__(
        self,
        folder: Path,
        settle_s: float,
        unfinished_s: float,
        is_complete: Callable[[Path], bool],
        take: Callable[[Sequence[Path]], None],
        report_problem: Callable[[str], None],
    ) -> None:
        self._folder = folder
        self._settle_s = settle_s
        self._unfinished_s = unfinished_s
        self._is_complete = is_complete
        self._take = take
        self._report_problem = report_problem
        self._taken: dict[str, _State] = {}
        self._waiting: dict[str, tuple[_State, float]] = {}
        self._incomplete: dict[str, _State] = {}
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def waiting(self) -> int:
        """Return how many files were seen that are not yet handed over."""
        return len(self._waiting)

    @property
    def running(self) -> bool:
        """Return whether files are still handed over."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Begin, or begin again after `close`, with all that is in the folder."""
        self._stop.clear()
        self._taken.clear()
        self._thread = threading.Thread(target=self._run, name="folder watcher", daemon=True)
        self._thread.start()

    def close(self, timeout_s: float) -> None:
        """Hand no further files over, and wait for the call in progress, but at most `timeout_s`."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._watch()
            except (OSError, RuntimeError) as error:
                self._report_problem(f"folder {self._folder}: {error}; trying again")
                self._stop.wait(_RETRY_S)

    def _watch(self) -> None:
        next_full_scan = float("-inf")
        for changes in watchfiles.watch(
            self._folder,
            watch_filter=None,
            recursive=False,
            debounce=2 * _TICK_MS,
            step=_TICK_MS,
            rust_timeout=_TICK_MS,
            yield_on_timeout=True,
            raise_interrupt=False,
            stop_event=self._stop,
        ):
            # Not the whole folder at each change: among thousands of files that takes longer than a simulation.
            self._note(os.path.basename(path) for _, path in changes)
            if time.monotonic() >= next_full_scan:
                self._note(os.listdir(self._folder))
                next_full_scan = time.monotonic() + _FULL_SCAN_S
            self._hand_over()

    def _note(self, names: Iterable[str]) -> None:
        for name in names:
            if not name.startswith(".") and not name.endswith(UNFINISHED):
                self._track(name)

    def _hand_over(self) -> None:
        names = sorted(self._waiting)
        for begin in range(0, len(names), BATCH_FILES):
            if self._stop.is_set():
                return
            ready = [name for name in names[begin : begin + BATCH_FILES] if self._is_ready(name)]
            # Noted before they are read: what is written meanwhile is another state.
            self._taken |= {name: self._waiting[name][0] for name in ready}
            if ready:
                self._take([self._folder / name for name in ready])
            for name in ready:
                self._waiting.pop(name)

    def _is_ready(self, name: str) -> bool:
        quiet_s = self._track(name)
        if quiet_s < self._settle_s:
            return False
        state = self._waiting[name][0]
        # A file that nobody wrote to for long before it was seen was moved or copied here as a whole.
        if max(quiet_s, time.time() - state.modified_ns * 1e-9) >= self._unfinished_s:
            return True
        if self._incomplete.get(name) == state:
            return False
        if self._is_complete(self._folder / name):
            self._incomplete.pop(name, None)
            return True
        self._incomplete[name] = state
        return False

    def _track(self, name: str) -> float:
        """Return for how many seconds a file has been as it is now; -inf if there is nothing to hand over."""
        state, now = self._state(name), time.monotonic()
        if state is None or state == self._taken.get(name):
            self._waiting.pop(name, None)
            return float("-inf")
        if name not in self._waiting or self._waiting[name][0] != state:
            self._waiting[name] = (state, now)
        return now - self._waiting[name][1]

    def _state(self, name: str) -> _State | None:
        """Return size and times of a file; None if there is none, or it is a folder, a pipe or the like."""
        try:
            status = os.stat(self._folder / name)
        except OSError:
            return None
        return _State(status.st_size, status.st_mtime_ns, status.st_ino) if stat.S_ISREG(status.st_mode) else None
