"""One MCAP file, read straight through its records, so that a cut one is read up to the cut."""

import heapq
import os
import struct
import zlib
from collections.abc import Callable, Collection, Generator, Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import msgspec
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Message, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from mcap_ros2.decoder import DecoderFactory

from weld_force_ros.errors import BagError
from weld_force_ros.messages import legible
from weld_force_ros.recording.rosbag2_format import MAX_RECORD_BYTES, ChannelStatistics, MessageDefinition

MAX_REORDERED_BYTES = 2**30
"""Bytes that may be held in memory to bring a file into log order."""

_UNREADABLE = (McapError, struct.error, ValueError)

_HEADER = struct.Struct("<BQ")
_MOST_RECORDS = 500_000  # of a chunk

_FOOTER = struct.Struct("<BQQQI8s")
_FOOTER_OPCODE, _FOOTER_CONTENT_BYTES, _SUMMARY_CRC_BYTES = 2, 20, 12


class Recorded(NamedTuple):
    """One message of a recording; `data` as stored, `content` decoded."""

    topic: str
    definition: MessageDefinition
    data: bytes
    log_time_ns: int
    publish_time_ns: int

    @property
    def content(self) -> Any:
        """Return the message as an object with the fields of its type (from JSON: as parsed).

        Raises:
            BagError: it cannot be decoded; names the topic and the log time.
        """
        try:
            return _decoder(self.definition)(self.data)
        except Exception as error:  # the decoder raises whatever malformed bytes lead it to
            raise self.problem(f"{type(error).__name__} {error}", "leave this topic out or record it again") from error

    @property
    def text(self) -> str:
        """Return the text of a std_msgs/String.

        Raises:
            BagError: it cannot be decoded, or is no such message.
        """
        text = getattr(self.content, "data", None)
        if not isinstance(text, str):
            raise self.problem("not a text", "leave this topic out or record it again")
        return text

    def problem(self, reason: str, remedy: str) -> BagError:
        """Return an error about this message, in one line."""
        return BagError(legible(f"{self.topic} at log time {self.log_time_ns} ns: {reason}"), remedy)


@lru_cache(maxsize=64)
def _decoder(definition: MessageDefinition) -> Callable[[bytes], Any]:
    if definition.message_encoding == "json":
        return msgspec.json.decode
    schema = Schema(id=1, name=definition.name, encoding=definition.schema_encoding, data=definition.text.encode())
    decoder: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(definition.message_encoding, schema)
    if decoder is None:
        raise ValueError(f"no decoder for {definition.message_encoding} after {definition.schema_encoding}")
    return decoder


class _BoundedStream:
    """A stream of known size that returns exactly the bytes requested, or raises EndOfFile; no absurd sizes."""

    def __init__(self, stream: BinaryIO, size: int, path: Path) -> None:
        self._stream, self.size, self._path = stream, size, path
        self.position = 0
        self.intact = 0
        """The position at which the last complete record ends."""
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
        """Yield the complete records up to the end, or to the first that cannot be read."""
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


def _decompress(chunk: Any, path: Path) -> bytes:
    """Return a chunk's content, never more than it announces.

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


class McapFile:
    """One MCAP file, read from front to back as often as wanted; its state is known once it was scanned.

    Attributes:
        path: the file.
        size: in bytes, when it was scanned; a file that grows is read up to there.
        statistics: what it holds.
        closed: whether its end is there.
        indexed: whether it has an index of chunks.
        lost_bytes: how much of it is unreadable.
        lost_messages: how many messages are known to be lost: by its summary, or of those that `expected_messages`
            said it holds. A file that was cut before it was closed cannot tell.
        error: why nothing of it can be read; else None.
    """

    def __init__(self, path: Path, expected_messages: int = 0) -> None:
        self.path = path
        self.size = 0
        self.statistics = ChannelStatistics()
        self.closed = False
        self.indexed = False
        self.lost_bytes = 0
        self.lost_messages = 0
        self.error: BagError | None = None
        self._expected_messages = expected_messages
        self._inode = 0

    @property
    def damage(self) -> str | None:
        """Return what is wrong with the file, in a clause; None if nothing is."""
        if self.error:
            return self.error.reason.replace(str(self.path), self.path.name)
        faults = [
            *(["was not closed"] * (not self.closed)),
            *([f"has {self.lost_bytes} unreadable bytes"] * (self.lost_bytes > 0)),
            *([f"lacks {self.lost_messages} messages"] * (self.lost_messages > 0)),
        ]
        return f"{self.path.name} {' and '.join(faults)}" if faults else None

    @property
    def lossy(self) -> bool:
        """Return whether something that was written cannot be read."""
        return self.lost_bytes > 0 or self.lost_messages > 0 or self.error is not None

    def scan(self) -> None:
        """Read the file through and set the attributes that describe its state."""
        statistics = ChannelStatistics()
        try:
            status = self.path.stat()
            self.size, self._inode = status.st_size, status.st_ino
            for topic, definition, _, log_time_ns, _ in self.stored():
                statistics.add(topic, definition, log_time_ns)
            self.statistics = statistics
            summary = self.summary()
        except FileNotFoundError:
            self.error = BagError(f"{self.path} is missing", "put it back, or go on without it")
        except OSError as error:
            self.error = BagError(f"{self.path}: {error.strerror or error}", "give a file that can be read")
        except BagError as error:
            self.error = error
            self.lost_bytes = self.size
        else:
            self._expected_messages = summary.message_count if summary else self._expected_messages
        self.lost_messages = max(0, self._expected_messages - self.statistics.message_count)

    def stored(self) -> Iterator[Recorded]:
        """Yield every readable message in the order of the file.

        Raises:
            BagError: not an MCAP file, or one that claims absurd sizes.
            OSError: the file cannot be read.
        """
        channels = _Channels()
        indexed = ended = False
        lost_bytes = 0
        with self.path.open("rb") as stream:
            source = _BoundedStream(stream, self._readable_bytes(stream), self.path)
            self._check_magic(source)
            for record in source.records():
                ended |= isinstance(record, DataEnd)
                indexed |= isinstance(record, ChunkIndex)
                if isinstance(record, Chunk):
                    lost_bytes += yield from self._unpack(record, channels)
                elif recorded := channels.take(record):
                    yield recorded
        self.closed, self.indexed = source.complete, indexed
        self.lost_bytes = lost_bytes + channels.lost_bytes + (0 if ended else source.size - source.intact)

    def ordered(self, topics: Collection[str] | None = None) -> Iterator[Recorded]:
        """Yield messages of a scanned file in log order (those of one time in file order), of all or the named topics.

        Raises:
            BagError: too far out of order to be sorted in memory.
        """
        held: list[tuple[int, int, Recorded]] = []
        held_bytes = newest_ns = 0
        for ordinal, recorded in enumerate(self.stored()):
            # The scan found how late a message can come: one older than that by now is not overtaken any more.
            newest_ns = max(newest_ns, recorded.log_time_ns)
            if topics is None or recorded.topic in topics:
                heapq.heappush(held, (recorded.log_time_ns, ordinal, recorded))
                held_bytes += len(recorded.data)
            if held_bytes > MAX_REORDERED_BYTES:
                raise BagError(f"{self.path}: messages too far out of log order", "sort it by log time first")
            while held and held[0][0] <= newest_ns - self.statistics.lateness_ns:
                _, _, oldest = heapq.heappop(held)
                held_bytes -= len(oldest.data)
                yield oldest
        while held:
            yield heapq.heappop(held)[2]

    def summary(self) -> ChannelStatistics | None:
        """Read what the file states at its end that it holds, without the rest; None if it was not closed.

        Raises:
            OSError: the file cannot be read.
        """
        with self.path.open("rb") as stream:
            size = self._readable_bytes(stream)
            if size < _FOOTER.size:
                return None
            stream.seek(size - _FOOTER.size)
            opcode, length, start, _, crc, magic = _FOOTER.unpack(stream.read(_FOOTER.size))
            summary_bytes = size - start
            whole = (opcode, length, magic) == (_FOOTER_OPCODE, _FOOTER_CONTENT_BYTES, MCAP0_MAGIC)
            if not whole or not 0 < start <= size - _FOOTER.size or summary_bytes > MAX_RECORD_BYTES:
                return None
            stream.seek(start)
            content = stream.read(summary_bytes)
        if crc and zlib.crc32(content[:-_SUMMARY_CRC_BYTES]) != crc:
            return None
        return self._parsed_summary(content)

    def _parsed_summary(self, content: bytes) -> ChannelStatistics | None:
        channels, statistics = _Channels(), None
        records = list(_BoundedStream(BytesIO(content), len(content), self.path).records())
        for record in records:
            channels.take(record)
        for record in records:
            if isinstance(record, Statistics):
                statistics = channels.statistics(record)
        self.indexed = any(isinstance(record, ChunkIndex) for record in records)
        return statistics

    def _readable_bytes(self, stream: BinaryIO) -> int:
        """Return its size when scanned, or its present one if it was not scanned or was compressed since."""
        status = os.fstat(stream.fileno())
        return self.size if self._inode == status.st_ino else status.st_size

    def _check_magic(self, source: _BoundedStream) -> None:
        if source.size == 0:
            raise BagError(f"{self.path} is empty", "nothing can be recovered from it")
        if source.size < len(MCAP0_MAGIC) or source.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise BagError(f"{self.path} is not an MCAP file", "give a bag folder or an .mcap file")

    def _unpack(self, chunk: Any, channels: "_Channels") -> Generator[Recorded, None, int]:
        """Yield the messages of a chunk; return how many bytes of it are unreadable."""
        try:
            content = _decompress(chunk, self.path)
        except ValueError:
            return len(chunk.data)
        source = _BoundedStream(BytesIO(content), _plausible_bytes(content), self.path)
        for record in source.records():
            if recorded := channels.take(record):
                yield recorded
        return len(content) - source.intact


def _plausible_bytes(content: bytes) -> int:
    """Return how much of a chunk's content can be records: a few bytes may decompress to millions that are none."""
    position = 0
    for _ in range(_MOST_RECORDS):
        if position + _HEADER.size > len(content):
            break
        opcode, length = _HEADER.unpack_from(content, position)
        if opcode == 0 or length > len(content):
            break
        position += _HEADER.size + length
    return min(position, len(content))


class _Channels:
    """The schemas and channels read so far from a file, by which its messages are understood."""

    def __init__(self) -> None:
        self._schemas: dict[int, Any] = {0: Schema(id=0, name="", encoding="", data=b"")}
        self._channels: dict[int, tuple[str, MessageDefinition]] = {}
        self.lost_bytes = 0

    def take(self, record: Any) -> Recorded | None:
        """Store a schema or a channel; return a message, unless its channel was lost."""
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

    def statistics(self, record: Any) -> ChannelStatistics | None:
        """Return what a file holds by its Statistics record; None if that names channels the file does not describe."""
        counts: dict[tuple[str, MessageDefinition], int] = {}
        for channel, count in record.channel_message_counts.items():
            if channel not in self._channels:
                return None
            if count:
                counts[self._channels[channel]] = counts.get(self._channels[channel], 0) + count
        first_ns = record.message_start_time if counts else None
        return ChannelStatistics(counts, first_ns, record.message_end_time)


def _definition(channel: Any, schema: Any) -> MessageDefinition:
    return MessageDefinition(
        name=schema.name,
        text=schema.data.decode(errors="surrogateescape"),
        type_hash=channel.metadata.get("topic_type_hash", ""),
        offered_qos_profiles=channel.metadata.get("offered_qos_profiles", ""),
        schema_encoding=schema.encoding,
        message_encoding=channel.message_encoding,
    )
