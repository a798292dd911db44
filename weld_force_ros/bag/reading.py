"""Reading recordings: straight through the records, so that a cut file is read up to the cut."""

import heapq
import struct
import zlib
from collections.abc import Callable, Collection, Generator, Iterator
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import msgspec
import yaml
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from mcap_ros2.decoder import DecoderFactory

from weld_force_ros.bag.form import MAX_RECORD_BYTES, MessageDefinition, Tally
from weld_force_ros.errors import BagError

MAX_REORDERED_BYTES = 2**30
"""How much may have to be held in memory to bring a recording into log order."""

_UNREADABLE = (McapError, struct.error, ValueError)


class Recorded(NamedTuple):
    """One message of a recording; `data` as stored, `content` decoded."""

    topic: str
    definition: MessageDefinition
    data: bytes
    log_time_ns: int
    publish_time_ns: int

    @property
    def content(self) -> Any:
        """The message as an object with the fields of its type (from JSON: as parsed).

        Raises:
            BagError: it cannot be decoded; names the topic and the log time.
        """
        try:
            return _decoder(self.definition)(self.data)
        except Exception as error:  # the decoder raises whatever malformed bytes lead it to
            raise self.problem(f"{type(error).__name__} {error}", "leave this topic out or record it again") from error

    def problem(self, reason: str, remedy: str) -> BagError:
        """An error about this message, in one line."""
        return BagError(f"{self.topic} at log time {self.log_time_ns} ns: {' '.join(reason.split())}", remedy)


@lru_cache(maxsize=64)
def _decoder(definition: MessageDefinition) -> Callable[[bytes], Any]:
    if definition.message_encoding == "json":
        return msgspec.json.decode
    schema = Schema(id=1, name=definition.name, encoding=definition.schema_encoding, data=definition.text.encode())
    decoder: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(definition.message_encoding, schema)
    if decoder is None:
        raise ValueError(f"no decoder for {definition.message_encoding} after {definition.schema_encoding}")
    return decoder


class _Source:
    """A stream of known size that gives just what is asked for, or says that it ends; never more than a record."""

    def __init__(self, stream: BinaryIO, size: int, path: Path) -> None:
        self._stream, self.size, self._path = stream, size, path
        self.position = 0
        self.intact = 0
        """Where the last complete record ends."""
        self.complete = False

    def read(self, count: int) -> bytes:
        if count < 0:
            raise ValueError("negative length")
        if count > self.size - self.position:
            raise EndOfFile
        if count > MAX_RECORD_BYTES:
            raise _oversized(self._path, count)
        data = self._stream.read(count)
        if len(data) < count:
            raise EndOfFile
        self.position += count
        return data

    def records(self) -> Iterator[Any]:
        """The complete records up to the end, or to the first that cannot be read."""
        try:
            reader = StreamReader(self, skip_magic=True, emit_chunks=True, record_size_limit=None)
            for record in reader.records:
                self.intact = self.position
                yield record
            self.intact, self.complete = self.position, True
        except _UNREADABLE:
            return


def _oversized(path: Path, count: int) -> BagError:
    return BagError(
        f"{path}: claims a record of {count} bytes", f"use a file with at most {MAX_RECORD_BYTES} in a record"
    )


def _inflate(chunk: Any, path: Path) -> bytes:
    """A chunk's content, never more than it announces.

    Raises:
        BagError: it announces too much, or is compressed in a way that is unknown here.
        ValueError: it is damaged.
    """
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise _oversized(path, size)
    try:
        match chunk.compression:
            case "":
                content: bytes = chunk.data
            case "zstd":
                content = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
            case "lz4":
                content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            case other:
                raise BagError(f"{path}: unknown compression {other!r}", "rewrite it with zstd, lz4 or none")
    except (zstandard.ZstdError, RuntimeError) as error:
        raise ValueError(str(error)) from None
    if len(content) != size or (chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc):
        raise ValueError("the content is not what was written")
    return content


class _McapFile:
    """One MCAP file, read from front to back as often as wanted; its state is known after the first time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = path.stat().st_size
        self.closed = False
        self.indexed = False
        self.lost_bytes = 0

    @property
    def damage(self) -> str | None:
        faults = [
            *(["was not closed"] * (not self.closed)),
            *([f"has {self.lost_bytes} unreadable bytes"] * (self.lost_bytes > 0)),
        ]
        return f"{self.path.name} {' and '.join(faults)}" if faults else None

    def messages(self) -> Iterator[Recorded]:
        """Every readable message in the order of the file.

        Raises:
            BagError: not an MCAP file, or one that claims absurd sizes.
        """
        channels = _Channels()
        indexed = ended = False
        lost_bytes = 0
        with self.path.open("rb") as stream:
            source = _Source(stream, self.size, self.path)
            self._check_magic(source)
            for record in source.records():
                ended |= isinstance(record, DataEnd)
                indexed |= isinstance(record, ChunkIndex)
                if isinstance(record, Chunk):
                    lost_bytes += yield from self._unpack(record, channels)
                elif recorded := channels.take(record):
                    yield recorded
        self.closed, self.indexed = source.complete, indexed
        self.lost_bytes = lost_bytes + channels.lost_bytes + (0 if ended else self.size - source.intact)

    def _check_magic(self, source: _Source) -> None:
        if self.size == 0:
            raise BagError(f"{self.path} is empty", "nothing can be recovered from it")
        if self.size < len(MCAP0_MAGIC) or source.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise BagError(f"{self.path} is not an MCAP file", "give a bag folder or an .mcap file")

    def _unpack(self, chunk: Any, channels: "_Channels") -> Generator[Recorded, None, int]:
        """The messages of a chunk; returns how many bytes of it are unreadable."""
        try:
            content = _inflate(chunk, self.path)
        except ValueError:
            return len(chunk.data)
        source = _Source(BytesIO(content), len(content), self.path)
        for record in source.records():
            if recorded := channels.take(record):
                yield recorded
        return len(content) - source.intact


class _Channels:
    """The channels met so far in a file, to tell messages by."""

    def __init__(self) -> None:
        self._schemas: dict[int, Any] = {0: Schema(id=0, name="", encoding="", data=b"")}
        self._channels: dict[int, tuple[str, MessageDefinition]] = {}
        self.lost_bytes = 0

    def take(self, record: Any) -> Recorded | None:
        """Note a schema or a channel; give a message, unless its channel was lost."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel) and record.schema_id in self._schemas:
            self._channels[record.id] = (record.topic, _definition(record, self._schemas[record.schema_id]))
        elif isinstance(record, Message):
            if record.channel_id in self._channels:
                topic, definition = self._channels[record.channel_id]
                return Recorded(topic, definition, record.data, record.log_time, record.publish_time)
            self.lost_bytes += len(record.data)
        return None


def _definition(channel: Any, schema: Any) -> MessageDefinition:
    return MessageDefinition(
        name=schema.name,
        text=schema.data.decode(errors="surrogateescape"),
        type_hash=channel.metadata.get("topic_type_hash", ""),
        offered_qos_profiles=channel.metadata.get("offered_qos_profiles", ""),
        schema_encoding=schema.encoding,
        message_encoding=channel.message_encoding,
    )


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a recording."""

    topic: str
    type_name: str
    message_count: int


@dataclass(frozen=True)
class Summary:
    """What a recording holds and what state it is in; `damage` is None for one that was closed and is whole."""

    path: str
    files: tuple[str, ...]
    size_bytes: int
    message_count: int
    start_ns: int
    duration_s: float
    topics: tuple[TopicSummary, ...]
    closed: bool
    indexed: bool
    lost_bytes: int
    damage: str | None


class Bag:
    """A recording, scanned once when opened: what is damaged is known before the first message is used.

    Attributes:
        path: what was opened.
    """

    def __init__(self, path: Path) -> None:
        """See `open_bag`."""
        self.path = path
        self.tally = Tally()
        try:
            self._files = [_McapFile(file) for file in _mcap_files(path)]
            for topic, definition, _, log_time_ns, _ in self._stored():
                self.tally.add(topic, definition, log_time_ns)
        except OSError as error:
            remedy = "give a bag folder or an .mcap file that can be read"
            raise BagError(f"{error.filename or path}: {error.strerror or error}", remedy) from error
        if self.truncated and not self.tally.message_count:
            raise BagError(f"{path} holds no readable message and was not closed", "nothing can be recovered from it")

    @property
    def truncated(self) -> bool:
        """Whether a file was never closed, or its end is missing."""
        return not all(file.closed for file in self._files)

    @property
    def lost_bytes(self) -> int:
        """How much of the message data is unreadable."""
        return sum(file.lost_bytes for file in self._files)

    @property
    def damage(self) -> str | None:
        """What is wrong with the files, in a clause; None if nothing is."""
        return "; ".join(file.damage for file in self._files if file.damage) or None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Recorded]:
        """Messages in log order (those of one time in file order), of all topics or of those named.

        Raises:
            BagError: too far out of order to be sorted in memory.
        """
        held: list[tuple[int, int, Recorded]] = []
        held_bytes = newest_ns = 0
        for ordinal, recorded in enumerate(self._stored()):
            # The scan found how late a message can come: one older than that by now is not overtaken any more.
            newest_ns = max(newest_ns, recorded.log_time_ns)
            if topics is None or recorded.topic in topics:
                heapq.heappush(held, (recorded.log_time_ns, ordinal, recorded))
                held_bytes += len(recorded.data)
            if held_bytes > MAX_REORDERED_BYTES:
                raise BagError(f"{self.path}: messages too far out of log order", "sort it by log time first")
            while held and held[0][0] <= newest_ns - self.tally.lateness_ns:
                _, _, oldest = heapq.heappop(held)
                held_bytes -= len(oldest.data)
                yield oldest
        while held:
            yield heapq.heappop(held)[2]

    def summary(self) -> Summary:
        """What the recording holds and what state it is in."""
        return Summary(
            path=str(self.path),
            files=tuple(file.path.name for file in self._files),
            size_bytes=sum(file.size for file in self._files),
            message_count=self.tally.message_count,
            start_ns=self.tally.start_ns,
            duration_s=self.tally.duration_ns * 1e-9,
            topics=tuple(
                TopicSummary(topic, definition.name, n) for (topic, definition), n in self.tally.counts.items()
            ),
            closed=not self.truncated,
            indexed=all(file.indexed for file in self._files),
            lost_bytes=self.lost_bytes,
            damage=self.damage,
        )

    def _stored(self) -> Iterator[Recorded]:
        for file in self._files:
            yield from file.messages()


def open_bag(path: Path) -> Bag:
    """Open a bag folder or an .mcap file, intact or cut; reads it through once.

    Raises:
        BagError: no such path, no recording in it, a file missing, not MCAP, empty, sizes that are absurd, or cut
            before its first message.
    """
    return Bag(path)


def summary(path: Path) -> Summary:
    """What a recording holds and what state it is in; errors as `open_bag`."""
    return open_bag(path).summary()


def _mcap_files(path: Path) -> list[Path]:
    if not path.is_dir():
        if not path.exists():
            raise BagError(f"{path} does not exist", "give a bag folder or an .mcap file")
        return [path]
    # Shorter names first: bag_10.mcap comes after bag_9.mcap.
    files = _listed_files(path) or sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    if not files:
        raise BagError(f"{path} holds no .mcap file", "give a bag folder or an .mcap file")
    for file in files:
        if not file.is_file():
            raise BagError(f"{file} is missing", "put it back, or give the .mcap files that are left one by one")
    return files


def _listed_files(directory: Path) -> list[Path]:
    """The files that metadata.yaml names; none if it is missing or broken, as it may be after a crash."""
    try:
        text = (directory / "metadata.yaml").read_text()
        names = yaml.safe_load(text)["rosbag2_bagfile_information"]["relative_file_paths"]
        return [directory / Path(name).name for name in names]
    except (FileNotFoundError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
        return []
