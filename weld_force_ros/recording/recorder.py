"""Record message by message while a process runs, into a bag that is split, continued and never overwritten."""

import errno
import os
import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from weld_force_ros._files import TEMPORARY, sync_folder
from weld_force_ros.errors import BagError, DiskFullError
from weld_force_ros.recording.bag_errors import as_bag_error, refusal_to_overwrite
from weld_force_ros.recording.compaction import KEPT, Compactor
from weld_force_ros.recording.disk_space import DISK_FULL, DiskSpace
from weld_force_ros.recording.disk_sync import DiskSync
from weld_force_ros.recording.folder_lock import lock_folder
from weld_force_ros.recording.identity import recording_in, with_identity
from weld_force_ros.recording.mcap_reader import McapFile
from weld_force_ros.recording.mcap_writer import AppendFile, McapWriter
from weld_force_ros.recording.metadata_file import MetadataFile
from weld_force_ros.recording.reader import listed_files
from weld_force_ros.recording.rosbag2_format import (
    MAX_RECORD_BYTES,
    ChannelStatistics,
    FileForm,
    MessageDefinition,
    information,
)

SPLIT_BYTES = 256 * 2**20
SPLIT_S = 3600.0
RESERVE_BYTES = 64 * 2**20
"""Bytes left free on the disk, to complete the recording with; it goes on once twice as much is free."""

CLOCK_STEP_NS = 10**9
"""A topic whose log time goes back by more begins a new file."""

CHECK_AGAIN_S = 0.5
"""The interval at which a full disk is checked again."""


class Recorder:
    """Writes a bag, a new one or a new file of one that exists; safe to use from several threads.

    When `write` returns, a killed process loses the message no more; a power cut does not either a tenth of a second
    later (`longest_unsynced_s` says how long it took at most).

    Attributes:
        directory: the bag's folder.
        path: the file that is, or was last, written to.
    """

    def __init__(
        self,
        directory: Path,
        *,
        split_bytes: int = SPLIT_BYTES,
        split_s: float = SPLIT_S,
        reserve_bytes: int = RESERVE_BYTES,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Make the folder, or continue the recording in it, and start a file.

        What a killed process left in the folder is completed in the background. On a full disk the file is started
        with the first message for which there is room.

        Args:
            directory: the bag's folder; one that exists must be a recording of this suite, whatever it was called
                before, and no other process may write to it.
            split_bytes: a file that would grow larger is completed, and another begun.
            split_s: likewise one whose first message was written so long ago.
            reserve_bytes: what is left free on the disk.
            say: called with who is waited for: a process that records here and is stopping.

        Raises:
            BagError: something else has this name, somebody else records to it, or it cannot be written.
            DiskFullError: there is no room for the folder.
        """
        self.directory = directory
        self._split_bytes, self._split_s = split_bytes, split_s
        self._lock = threading.Lock()
        self._closed = False
        self._file: _OpenFile | None = None
        self._stopped = False
        self._check_again_s = 0.0
        with as_bag_error(directory, "choose another place"):
            self._handle = lock_folder(directory, say)
            new = with_identity(FileForm(ros_distro="jazzy")), directory.resolve().name
            self._form, self._name = recording_in(directory) or new
            self._space = DiskSpace(directory, reserve_bytes)
            self._sync = DiskSync()
            self._metadata_file = MetadataFile(directory, self._form)
            self._compactor = Compactor(self._metadata_file, self._space, self._form)
            try:
                self._number = self._take_over()
                self.path = self._next_path()
                self._begin_if_room()
            except BaseException:
                self._release()
                raise

    @property
    def free_bytes(self) -> int:
        """Return how much the disk of the recording has free."""
        return self._space.free_bytes

    @property
    def disk_warning(self) -> str | None:
        """Return a warning if the disk is full or will be soon, as a clause; None while there is room."""
        if self._stopped:
            return f"disk full: {self.free_bytes / 1e6:.0f} MB free, not recording"
        return self._space.nearly_full

    @property
    def longest_unsynced_s(self) -> float:
        """Return the longest time until now from a message being written to being forced to the disk."""
        return self._sync.longest_unsynced_s

    def write(
        self, topic: str, definition: MessageDefinition, cdr: bytes, *, log_time_ns: int, publish_time_ns: int
    ) -> None:
        """Record one message; when this returns, the message is in the file.

        Args:
            topic: full name.
            definition: of the message's type.
            cdr: the serialized message, with its four-byte header.
            log_time_ns: when it was received, since the epoch.
            publish_time_ns: when it was sent, since the epoch.

        Raises:
            DiskFullError: this message was not recorded as there is no room; those before it are kept in a completed
                file. It may be given again: when there is room, the recording goes on in a new file.
            BagError: this message could not be recorded (recording closed, too large, the disk failed); those before
                it are kept, and later ones may be tried.
        """
        if not all(0 <= stamp < 2**63 for stamp in (log_time_ns, publish_time_ns)):
            raise BagError(f"{topic}: time {log_time_ns} or {publish_time_ns} ns", "give nanoseconds since the epoch")
        if len(cdr) > MAX_RECORD_BYTES // 2:
            raise BagError(f"{topic}: message of {len(cdr)} bytes", f"record at most {MAX_RECORD_BYTES // 2}")
        with self._lock:
            if self._closed:
                raise BagError(
                    f"{self.directory}: message on {topic} after the recording was closed", "start a new bag"
                )
            try:
                file = self._file_for(topic, len(cdr), log_time_ns)
                file.add(topic, definition, cdr, log_time_ns, publish_time_ns)
            except OSError as error:
                if error.errno in DISK_FULL:
                    self._stop()
                    raise self._full() from error
                raise BagError(
                    f"{self.path}: {error.strerror or error}",
                    f"check the disk; all before this message on {topic} is kept",
                ) from error
            self._sync.wrote()
            self._space.wrote(len(cdr))

    def close(self) -> None:
        """Complete the file and `metadata.yaml`, and wait until all files are replaced by compressed, indexed ones.

        Files for which there is no room stay as they are: complete, and compressed when the recording is continued.

        Raises:
            BagError: one of these steps failed; the messages are kept.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
        try:
            with as_bag_error(self.directory, KEPT):
                self._complete()
        finally:
            if self._file:
                self._close_file(self._file)
            self._compactor.submit_postponed()
            self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_over(self) -> int:
        """List what is in the folder and complete what was not; return the first file number that is free."""
        numbered = re.compile(rf"{re.escape(self._name)}_(\d+)\.mcap")
        names = {entry.name for entry in self.directory.iterdir()}
        listed = listed_files(self.directory)
        files = sorted((int(found[1]), self.directory / name) for name in names if (found := numbered.fullmatch(name)))
        belonging = re.compile(rf"({numbered.pattern}|metadata\.yaml)(\..+)?")
        if not files and not all(belonging.fullmatch(name) for name in names):
            raise refusal_to_overwrite(self.directory)
        for name in names:
            if name.endswith(TEMPORARY) and belonging.fullmatch(name):
                (self.directory / name).unlink()
        if files:
            self._metadata_file.put(*[(path, self._statistics_of(path)) for _, path in files])
        # Files that were moved away may be brought back: their numbers stay theirs.
        known = (numbered.match(name) for name in names | listed.keys())
        return max((int(found[1]) + 1 for found in known if found), default=0)

    def _statistics_of(self, path: Path) -> ChannelStatistics:
        """Return what a file holds by its own summary; one that was not completed or compressed will be now."""
        file = McapFile(path)
        statistics = file.summary()
        if statistics is None or (statistics.message_count and not file.indexed):
            self._compactor.submit(path)
        return statistics or ChannelStatistics()

    def _next_path(self) -> Path:
        return self.directory / f"{self._name}_{self._number}.mcap"

    def _file_for(self, topic: str, size: int, log_time_ns: int) -> "_OpenFile":
        """Return the file to write a message to, begun if need be.

        Raises:
            DiskFullError: the disk was full a moment ago, or still is.
            OSError: it is full now, or fails.
        """
        self._sync.check()
        file = self._resume() if self._stopped else self._file or self._begin()
        if file.message_count and (
            file.size + size > self._split_bytes
            or time.monotonic() - file.first_s >= self._split_s
            or file.goes_back(topic, log_time_ns)
        ):
            self._complete()
            file = self._begin()
        if not self._space.has_room_for(0):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return file

    def _begin(self) -> "_OpenFile":
        self.path = self._next_path()
        self._file = file = _OpenFile(self.path, self._form)
        self._number += 1
        self._sync.follow(file.stream)
        sync_folder(self.directory)
        self._metadata_file.put((self.path, ChannelStatistics()))
        self._compactor.submit_postponed()
        return file

    def _begin_if_room(self) -> None:
        try:
            if self._space.has_room_for(0):
                self._begin()
            else:
                self._stop()
        except OSError as error:
            if error.errno not in DISK_FULL:
                raise
            self._stop()

    def _complete(self) -> None:
        """Give the file its end and let it be compressed; on a full disk it stays until there is room for the end."""
        file = self._file
        if file is None:
            return
        try:
            file.finish()
        except OSError as error:
            if error.errno not in DISK_FULL:
                self._close_file(file)
            raise
        self._close_file(file)
        self._metadata_file.put((file.path, file.statistics))

    def _close_file(self, file: "_OpenFile") -> None:
        self._file = None
        try:
            self._sync.finish()
        finally:
            file.stream.close()
            self._compactor.submit(file.path)

    def _stop(self) -> None:
        """Complete the file on a full disk, as far as there is room for that; an empty one is taken away again."""
        self._stopped = True
        self._check_again_s = time.monotonic() + CHECK_AGAIN_S
        with suppress(OSError):  # what remains to be done is done when there is room
            if self._file and self._file.message_count:
                self._complete()
            elif self._file:
                file, self._file = self._file, None
                self._sync.finish()
                file.discard()
                self._metadata_file.drop(file.path)

    def _resume(self) -> "_OpenFile":
        if time.monotonic() < self._check_again_s:
            raise self._full()
        self._check_again_s = time.monotonic() + CHECK_AGAIN_S
        if not self._space.has_room_for(self._space.reserve_bytes):
            raise self._full()
        self._complete()
        file = self._begin()
        self._stopped = False
        return file

    def _full(self) -> DiskFullError:
        return DiskFullError(
            f"{self.directory}: disk full, {self.free_bytes / 1e6:.0f} MB free",
            f"free {2 * self._space.reserve_bytes / 1e6:.0f} MB or more, then the recording goes on",
        )

    def _release(self) -> None:
        try:
            self._compactor.close()
        finally:
            self._sync.close()
            os.close(self._handle)


class _OpenFile:
    """A file of a recording that is written to, message by message and without compression."""

    def __init__(self, path: Path, form: FileForm) -> None:
        self.path = path
        self._form = form
        self.first_s = 0.0
        """The monotonic clock's time at which its first message was written."""
        self._newest_ns: dict[str, int] = {}
        self._end = b""
        self.stream = AppendFile(path)
        try:
            self._writer = McapWriter(self.stream, chunked=False, form=form)
            self._writer.write_metadata_record(information({path.name: ChannelStatistics()}, form))
            self.stream.sync()
        except OSError:
            self.discard()
            raise

    @property
    def size(self) -> int:
        """Return the file's size in bytes."""
        return self.stream.tell()

    @property
    def statistics(self) -> ChannelStatistics:
        """Return what the file holds."""
        return self._writer.statistics

    @property
    def message_count(self) -> int:
        """Return the number of messages in the file."""
        return self._writer.statistics.message_count

    def goes_back(self, topic: str, log_time_ns: int) -> bool:
        """Return whether the clock was set back since a topic's newest message.

        Of one topic messages come in order; of another one they may be late for having waited in a queue.
        """
        return log_time_ns < self._newest_ns.get(topic, 0) - CLOCK_STEP_NS

    def add(
        self, topic: str, definition: MessageDefinition, cdr: bytes, log_time_ns: int, publish_time_ns: int
    ) -> None:
        """Write one message."""
        self.stream.check_exists()
        if not self.message_count:
            self.first_s = time.monotonic()
        self._writer.add(topic, definition, cdr, log_time_ns, publish_time_ns)
        self._newest_ns[topic] = max(log_time_ns, self._newest_ns.get(topic, 0))

    def finish(self) -> None:
        """Write the end of the file: all of it or, with an OSError, nothing; then it may be tried again."""
        if not self._end:
            with self.stream.gathering() as end:
                self._writer.write_metadata_record(information({self.path.name: self.statistics}, self._form))
                self._writer.finish()
            self._end = bytes(end)
        self.stream.write(self._end)

    def discard(self) -> None:
        """Close and remove the file."""
        self.stream.close()
        self.path.unlink(missing_ok=True)
