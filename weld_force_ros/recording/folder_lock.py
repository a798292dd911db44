"""Hold a recording's folder for one process, and tell who holds it.

The operating system keeps the lock, so that it ends with its process, however that ends.
"""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from weld_force_ros._files import sync_folder
from weld_force_ros.errors import BagError
from weld_force_ros.recording.bag_errors import refusal_to_overwrite

LONGEST_WAIT_S = 60.0
"""How long a process that is stopping is waited for."""

_STOPPING = "weld-stopping"  # up to 15 characters
_POLL_S = 0.1
_UNTOLD = 10
"""How often in turn a folder may be held without a holder that can be named."""
_PROC = Path("/proc")


class _Holder(NamedTuple):
    """A process that holds a lock; `since` when it was started, `stopping` also while its parent is."""

    pid: int
    since: str
    stopping: bool


@contextmanager
def shown_as_stopping() -> Iterator[None]:
    """Name this process so that who wants its recording waits for it (Linux; `ps` shows it, too)."""
    name = _PROC / "self" / "comm"
    before = ""
    with suppress(OSError):
        before = name.read_text()
        name.write_text(_STOPPING)
    try:
        yield
    finally:
        with suppress(OSError):
            name.write_text(before)


def lock_folder(directory: Path, say: Callable[[str], None]) -> int:
    """Make a folder unless it is there, and return a handle that locks it until the process ends, however it ends.

    Args:
        directory: the folder.
        say: called with who is waited for, if that process is stopping.

    Raises:
        BagError: something else has this name, another process holds it and is not stopping, or this is Windows.
    """
    try:
        import fcntl
    except ImportError:
        raise BagError(f"{directory}: Windows cannot record", "record on Linux; this machine reads it") from None
    if directory.exists() and not directory.is_dir():
        raise refusal_to_overwrite(directory)
    if not directory.exists():
        directory.mkdir(parents=True, exist_ok=True)
        sync_folder(directory.resolve().parent)
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    deadline_s, said, untold = time.monotonic() + LONGEST_WAIT_S, False, 0
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = _holder(directory)
            untold = untold + 1 if holder is None else 0  # it may have let go since
            if untold > _UNTOLD or (holder and not holder.stopping) or time.monotonic() > deadline_s:
                os.close(handle)
                raise _held(directory, holder) from None
            if holder and not said:
                say(f"{directory}: waiting for process {holder.pid}, which is stopping")
                said = True
            time.sleep(_POLL_S)
        else:
            return handle


def _held(directory: Path, holder: _Holder | None) -> BagError:
    if holder is None:
        return BagError(f"{directory} is being recorded to already", "stop that, or choose another name")
    return BagError(
        f"{directory} is being recorded to by process {holder.pid}, running since {holder.since}",
        f"stop it (kill {holder.pid}) and give the same line again, or choose another name",
    )


def _holder(directory: Path) -> _Holder | None:
    """Return which process holds the folder; None where the operating system does not tell."""
    inode = str(directory.stat().st_ino)
    try:
        # number: kind, obligation, access, process, device:device:inode, range; a process that waits has `->` as kind.
        locks = [line.split() for line in (_PROC / "locks").read_text().splitlines()]
        pid = next(int(lock[4]) for lock in locks if lock[1] == "FLOCK" and lock[5].rpartition(":")[2] == inode)
        # Fields from the third on, counted after the name in parentheses, which may hold anything.
        fields = (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
        parent, ticks = int(fields[1]), int(fields[19])
        return _Holder(pid, _time_of(ticks), _is_stopping(pid) or _is_stopping(parent))
    except (OSError, ValueError, IndexError, StopIteration):
        return None


def _is_stopping(pid: int) -> bool:
    try:
        return (_PROC / str(pid) / "comm").read_text().strip() == _STOPPING
    except OSError:  # gone, or a parent outside a container
        return False


def _time_of(ticks: int) -> str:
    boot_s = next(float(line.split()[1]) for line in (_PROC / "stat").read_text().splitlines() if line[:5] == "btime")
    started = datetime.fromtimestamp(boot_s + ticks / os.sysconf("SC_CLK_TCK"), UTC)
    return started.strftime("%Y-%m-%d %H:%M:%S UTC")
