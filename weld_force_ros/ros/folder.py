"""A watched folder: each file is handed over once it is completely written, and again when it has changed."""

import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import watchfiles

_TICK_MS = 100
_FULL_LOOK_S = 5.0  # events of network drives may never come
_RETRY_S = 1.0


class _State(NamedTuple):
    size: int
    modified_ns: int
    inode: int


class FolderWatcher:
    """Watches one folder, not those below it, on a thread of its own.

    Args:
        folder: to watch; the files already there are handed over first.
        suffixes: of the files that matter, lower case; hidden files do not.
        settle_s: how long size and time of change must stand still before a file counts as written.
        take: called with each file, in order of name where several are ready; raises nothing.
        complain: called with a problem of the folder itself, which is tried again.
    """

    def __init__(
        self,
        folder: Path,
        suffixes: tuple[str, ...],
        settle_s: float,
        take: Callable[[Path], None],
        complain: Callable[[str], None],
    ) -> None:
        self._folder = folder
        self._suffixes = suffixes
        self._settle_s = settle_s
        self._take = take
        self._complain = complain
        self._taken: dict[Path, _State] = {}
        self._waiting: dict[Path, tuple[_State, float]] = {}
        self._last_full_look = float("-inf")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="folder watcher", daemon=True)

    @property
    def waiting(self) -> int:
        """Files seen that are not yet handed over."""
        return len(self._waiting)

    @property
    def running(self) -> bool:
        """Whether files are still taken."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self, timeout_s: float) -> None:
        """Take no further files; the one in hand is finished, if that takes no longer than `timeout_s`."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._watch()
            except (OSError, RuntimeError) as error:
                self._complain(f"folder {self._folder}: {error}; trying again")
                self._stop.wait(_RETRY_S)

    def _watch(self) -> None:
        self._last_full_look = float("-inf")
        for changes in watchfiles.watch(
            self._folder,
            watch_filter=None,
            recursive=False,
            debounce=2 * _TICK_MS,
            rust_timeout=_TICK_MS,
            yield_on_timeout=True,
            raise_interrupt=False,
            stop_event=self._stop,
        ):
            now = time.monotonic()
            if changes or now - self._last_full_look > _FULL_LOOK_S:
                self._last_full_look = now
                self._look_at(self._files(), now)
            else:
                self._look_at(list(self._waiting), now)

    def _files(self) -> list[Path]:
        return sorted(
            path
            for path in self._folder.iterdir()
            if path.suffix.lower() in self._suffixes and not path.name.startswith(".") and path.is_file()
        )

    def _look_at(self, paths: Iterable[Path], now: float) -> None:
        for path in paths:
            if self._stop.is_set():
                return
            state = _state(path)
            if state is None or state == self._taken.get(path):
                self._waiting.pop(path, None)
            elif path not in self._waiting or self._waiting[path][0] != state:
                self._waiting[path] = (state, now)
            elif now - self._waiting[path][1] >= self._settle_s:
                # Noted before it is read: what is written meanwhile is another state.
                self._taken[path] = state
                self._take(path)
                self._waiting.pop(path, None)


def _state(path: Path) -> _State | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return _State(status.st_size, status.st_mtime_ns, status.st_ino)
