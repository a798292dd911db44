"""Force a recording to the disk within 100 ms of each write, whether or not another write follows."""

import threading
import time

from weld_force_ros.recording.mcap_writer import AppendFile

SYNC_AFTER_S = 0.05
"""The time for which writes are gathered before they are forced to the disk; the disk's own time is added."""


class DiskSync:
    """A thread that forces one file, the one being written, to the disk."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # a file is not closed while it is being forced to the disk
        self._stream: AppendFile | None = None
        self._waiting_since_s: float | None = None
        self._longest_s = 0.0
        self._error: OSError | None = None
        self._dirty = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="disk sync", daemon=True)
        self._thread.start()

    @property
    def longest_unsynced_s(self) -> float:
        """Return the longest time until now from a message being written to being on the disk."""
        since_s = self._waiting_since_s
        return max(self._longest_s, time.monotonic() - since_s if since_s is not None else 0.0)

    def follow(self, stream: AppendFile) -> None:
        """Force this file to the disk from now on."""
        with self._lock:
            self._stream = stream

    def wrote(self) -> None:
        """Take note that the file was written to.

        The thread notes that nothing waits before it forces the file, so that what is written meanwhile waits anew.
        """
        if self._waiting_since_s is None:
            self._waiting_since_s = time.monotonic()
        self._dirty.set()

    def finish(self) -> None:
        """Force the file to the disk now, for the last time.

        Raises:
            OSError: it cannot be forced.
        """
        with self._lock:
            stream, self._stream = self._stream, None
            if stream:
                self._sync(stream)

    def check(self) -> None:
        """Raise the OSError, once, that kept the file from being forced to the disk."""
        error, self._error = self._error, None
        if error:
            raise error

    def close(self) -> None:
        """End the thread."""
        self._closing.set()
        self._dirty.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            self._dirty.wait()
            self._closing.wait(SYNC_AFTER_S)
            self._dirty.clear()
            with self._lock:
                if self._stream and self._waiting_since_s is not None:
                    try:
                        self._sync(self._stream)
                    except OSError as error:
                        self._error = error

    def _sync(self, stream: AppendFile) -> None:
        since_s, self._waiting_since_s = self._waiting_since_s, None
        stream.sync()
        if since_s is not None:
            self._longest_s = max(self._longest_s, time.monotonic() - since_s)
