"""Writing recordings: message by message while a process runs, and whole ones from what was read."""

import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from mcap.writer import Writer

from weld_force_ros.bag.form import MAX_RECORD_BYTES, MessageDefinition, Tally, information, to_yaml
from weld_force_ros.bag.reading import Bag, open_bag
from weld_force_ros.errors import BagError

SYNC_INTERVAL_S = 1.0
"""How often, at most, a recording is forced to the disk: what a power cut may take beyond a killed process."""


class _WholeWrites:
    """A file that grows by whole writes: one that fails leaves the file as it was before."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._size = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            self._file.truncate(self._size)
            self._file.seek(self._size)
            raise
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def sync(self) -> None:
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


class McapWriter:
    """An MCAP file that registers channels as they come."""

    def __init__(self, stream: BinaryIO | _WholeWrites, *, chunked: bool, profile: str = "ros2") -> None:
        self.tally = Tally()
        self._chunked = chunked
        self._schemas: dict[tuple[str, str, str], int] = {}
        self._channels: dict[tuple[str, MessageDefinition], int] = {}
        self._writer = Writer(stream, use_chunking=chunked)
        self._writer.start(profile)

    def add(
        self, topic: str, definition: MessageDefinition, data: bytes, log_time_ns: int, publish_time_ns: int
    ) -> None:
        """Write one message."""
        channel = self._channels.get((topic, definition)) or self._register(topic, definition)
        self._writer.add_message(channel, log_time_ns, data, publish_time_ns)
        self.tally.add(topic, definition, log_time_ns)

    def _register(self, topic: str, definition: MessageDefinition) -> int:
        described = (definition.name, definition.schema_encoding, definition.text)
        schema = self._schemas.get(described)
        if schema is None:
            text = definition.text.encode(errors="surrogateescape")
            schema = self._writer.register_schema(definition.name, definition.schema_encoding, text)
        metadata = {"offered_qos_profiles": definition.offered_qos_profiles, "topic_type_hash": definition.type_hash}
        said = {key: value for key, value in metadata.items() if value}
        channel: int = self._writer.register_channel(topic, definition.message_encoding, schema, said)
        if not self._chunked:
            # A channel counts as registered only once it is in the file, or a full disk would orphan its messages.
            self._writer.flush()
        self._schemas[described], self._channels[topic, definition] = schema, channel
        return channel

    def note(self, content: dict[str, Any]) -> None:
        """Write rosbag2's metadata record."""
        self._writer.add_metadata("rosbag2", {"serialized_metadata": to_yaml(content)})

    def finish(self) -> None:
        """Write what ends a file."""
        self._writer.finish()


class Recorder:
    """Writes one new bag; safe to use from several threads.

    A killed process loses nothing that `write` returned from, a power cut at most what came since the file was last
    forced to the disk (`SYNC_INTERVAL_S`, looked at with each write).

    Attributes:
        directory: the bag's folder.
        path: the MCAP file in it.
    """

    def __init__(self, directory: Path) -> None:
        """Make the folder and start the file.

        Args:
            directory: the bag's folder; must not exist.

        Raises:
            BagError: it exists already, or cannot be written.
        """
        self.directory = directory
        self.path = directory / f"{directory.resolve().name}_0.mcap"
        self._lock = threading.Lock()
        self._closed = False
        self._synced = -SYNC_INTERVAL_S
        with disk(directory):
            refuse_existing(directory)
            directory.mkdir(parents=True)
            self._stream = _WholeWrites(self.path)
            self._writer = McapWriter(self._stream, chunked=False)
            self._writer.note(self._so_far())
            self._sync()
            _sync_folder(directory)
            _sync_folder(directory.resolve().parent)

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
            BagError: this message could not be recorded (disk full, recording closed, too large); those before it
                are kept, and later ones may be tried.
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
            with disk(self.path, f"free space; all before this message on {topic} is kept"):
                self._writer.add(topic, definition, cdr, log_time_ns, publish_time_ns)
                if time.monotonic() - self._synced >= SYNC_INTERVAL_S:
                    self._sync()

    def close(self) -> None:
        """Complete the file and `metadata.yaml`, then exchange the file for a compressed and indexed one.

        Raises:
            BagError: one of these steps failed; the messages are kept.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
        with disk(self.directory, "its messages are kept: free space, then run `weld-force bag recover` on it"):
            try:
                self._writer.note(self._so_far())
                self._writer.finish()
                self._stream.sync()
            finally:
                self._stream.close()
            _write_metadata(self.directory, self._so_far())
            _write_whole(self.directory, self.path.name, open_bag(self.path))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _so_far(self) -> dict[str, Any]:
        return information(self.path.name, self._writer.tally)

    def _sync(self) -> None:
        self._synced = time.monotonic()
        self._stream.sync()


def _write_whole(directory: Path, file_name: str, bag: Bag) -> None:
    """Write all messages of a bag in log order as one compressed, indexed file in rosbag2's form."""
    with new_file(directory / file_name) as stream:
        writer = McapWriter(stream, chunked=True)
        content = information(file_name, bag.tally)
        writer.note(content)
        for recorded in bag.messages():
            writer.add(*recorded)
        writer.note(content)
        writer.finish()


def _write_metadata(directory: Path, content: dict[str, Any]) -> None:
    with new_file(directory / "metadata.yaml") as stream:
        stream.write(to_yaml({"rosbag2_bagfile_information": content}).encode())


@dataclass(frozen=True)
class RecoveryReport:
    """What was recovered; `damage` is None if nothing was wrong with the source."""

    target: str
    message_count: int
    lost_bytes: int
    damage: str | None

    @property
    def lossy(self) -> bool:
        """Whether something written is not in the target."""
        return self.lost_bytes > 0


def recover(source: Path, target: Path) -> RecoveryReport:
    """Write all that is readable of a recording to a new bag, and read that again before it gets its name.

    Args:
        source: a bag folder or an .mcap file.
        target: folder of the new bag; must not exist.

    Raises:
        BagError: nothing is readable, the target exists or cannot be written, or does not read back the same.
    """
    bag = open_bag(source)
    refuse_existing(target)
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    file_name = f"{target.resolve().name}_0.mcap"
    with disk(target):
        part.mkdir(parents=True)
        try:
            _write_whole(part, file_name, bag)
            _write_metadata(part, information(file_name, bag.tally))
            again = open_bag(part)
            if again.damage or again.tally.counts != bag.tally.counts:
                raise BagError(f"{target}: did not read back as written", "check the disk and try again")
            part.rename(target)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        _sync_folder(target.parent)
    return RecoveryReport(str(target), bag.tally.message_count, bag.lost_bytes, bag.damage)


@contextmanager
def disk(path: Path, remedy: str = "choose another place or free space") -> Iterator[None]:
    """Turn what the operating system refuses into a BagError about `path`."""
    try:
        yield
    except OSError as error:
        raise BagError(f"{path}: {error.strerror or error}", remedy) from error


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Write beside, force to the disk, and only then name: who looks finds the old file or all of the new one."""
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def refuse_existing(path: Path) -> None:
    """Raise a BagError if something is there: recordings are never overwritten."""
    if path.exists():
        raise BagError(f"{path} exists and is not overwritten", "choose another name or remove it")


def _sync_folder(directory: Path) -> None:
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
