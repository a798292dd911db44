"""One MCAP file, read straight through its records, so that a cut one is read up to the cut."""

import os
import struct
import zlib
from collections.abc import Generator, Iterator
from io import BytesIO
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import msgspec
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, DataEnd, Header, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from weld_force_ros import _yaml
from weld_force_ros.errors import BagError
from weld_force_ros.recording.recorded import Recorded, decompressed, is_compressed
from weld_force_ros.recording.recorded_file import CONVERT, RecordedFile
from weld_force_ros.recording.rosbag2_format import (
    MAX_RECORD_BYTES,
    ChannelStatistics,
    FileForm,
    MessageDefinition,
    stated_origin,
)

ROSBAG2_RECORD = "rosbag2"
"""The name of the metadata record that holds what `metadata.yaml` says."""

_UNREADABLE = (McapError, struct.error, ValueError)

_HEADER = struct.Struct("<BQ")
_MOST_RECORDS = 500_000  # of a chunk

_FOOTER = struct.Struct("<BQQQI8s")
_FOOTER_OPCODE, _FOOTER_CONTENT_BYTES, _SUMMARY_CRC_BYTES = 2, 20, 12


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
                frames = zstandard.ZstdDecompressor().stream_reader(chunk.data, read_across_frames=True)
                content = frames.read(size + 1)
            case "lz4":
                content = _lz4_frames(chunk.data, size + 1)
            case other:
                raise BagError(f"{path}: unknown compression {other!r}", CONVERT)
    except (zstandard.ZstdError, RuntimeError) as error:
        raise ValueError(str(error)) from None
    if len(content) != size or (chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc):
        raise ValueError("the content is not what was written")
    return content


def _lz4_frames(data: bytes, most_bytes: int) -> bytes:
    content = b""
    while data and len(content) < most_bytes:
        frame = lz4.frame.LZ4FrameDecompressor()
        content += frame.decompress(data, max_length=most_bytes - len(content))
        data = frame.unused_data or b""
    return content


class McapFile(RecordedFile):
    """An MCAP file, as it is or compressed as a whole; see `RecordedFile`.

    Attributes:
        has_extras: whether it holds attachments or metadata records.
    """

    has_extras = False

    def stored(self) -> Iterator[Recorded]:
        """Yield every readable message in the order of the file.

        Raises:
            BagError: not an MCAP file, or one that claims absurd sizes.
            OSError: the file cannot be read.
        """
        contents, lost_bytes = _Contents(), 0
        with self._plain_path.open("rb") as stream:
            source = _BoundedStream(stream, self._readable_bytes(stream), self.path)
            self._check_magic(source)
            for record in source.records():
                contents.note(record)
                if isinstance(record, Chunk):
                    lost_bytes += yield from self._unpack(record, contents.channels)
                elif recorded := contents.channels.take(record):
                    yield recorded
        channels = contents.channels
        self.closed, self.indexed = source.complete, contents.indexed
        self.lost_bytes = lost_bytes + channels.lost_bytes + (0 if contents.ended else source.size - source.intact)
        self.channels, self.has_extras = channels.described, contents.has_extras
        self.rewritten = (*self._packed, *channels.rewritten())
        chunked_anew = not contents.form.compression and (self._packed or channels.compressed_count)
        self.form = contents.form._replace(compression="zstd") if chunked_anew else contents.form

    def extras(self) -> Iterator[Attachment | Metadata]:
        """Yield attachments and metadata records, without rosbag2's own, which says what is in the file.

        Raises:
            OSError: the file cannot be read.
        """
        if not self.has_extras:
            return
        with self._plain_path.open("rb") as stream:
            source = _BoundedStream(stream, self._readable_bytes(stream), self.path)
            self._check_magic(source)
            yield from filter(_is_extra, source.records())

    def stated_form(self) -> FileForm:
        """Return what the file states of itself before its first message.

        Raises:
            OSError: the file cannot be read.
        """
        contents = _Contents()
        with self._plain_path.open("rb") as stream:
            source = _BoundedStream(stream, self._readable_bytes(stream), self.path)
            if source.size >= len(MCAP0_MAGIC) and source.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
                for record in takewhile(lambda one: isinstance(one, Header | Metadata), source.records()):
                    contents.note(record)
        return contents.form

    def stated_messages(self) -> int | None:
        """Return how many messages the file states at its end that it holds; None if it was not closed."""
        summary = self.summary()
        return summary.message_count if summary else None

    def summary(self) -> ChannelStatistics | None:
        """Read what the file states at its end that it holds, without the rest; None if it was not closed.

        Raises:
            OSError: the file cannot be read.
        """
        with self._plain_path.open("rb") as stream:
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
        now, scanned = os.fstat(stream.fileno()), self._when_scanned
        return scanned.st_size if scanned and scanned.st_ino == now.st_ino else now.st_size

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


def _is_extra(record: Any) -> bool:
    return isinstance(record, Attachment) or (isinstance(record, Metadata) and record.name != ROSBAG2_RECORD)


class _Contents:
    """What a file holds beside its messages, as far as it was read."""

    def __init__(self) -> None:
        self.channels = _Channels()
        self.form = FileForm()
        self.indexed = self.ended = self.has_extras = False

    def note(self, record: Any) -> None:
        """Take account of a record that stands outside of chunks."""
        self.ended |= isinstance(record, DataEnd)
        self.indexed |= isinstance(record, ChunkIndex)
        self.has_extras |= _is_extra(record)
        if isinstance(record, Header):
            self.form = self.form._replace(profile=record.profile)
        elif isinstance(record, Chunk):
            self.form = self.form._replace(compression=record.compression)
        elif isinstance(record, Metadata) and record.name == ROSBAG2_RECORD:
            try:
                stated = _yaml.decode(record.metadata["serialized_metadata"].encode(), Any)
            except (KeyError, ValueError, msgspec.DecodeError):  # of another recorder
                return
            if origin := stated_origin(stated):
                self.form = self.form._replace(ros_distro=origin[0], custom_data=origin[1])


class _Channels:
    """The schemas and channels read so far from a file, by which its messages are understood."""

    def __init__(self) -> None:
        self._schemas: dict[int, Any] = {0: Schema(id=0, name="", encoding="", data=b"")}
        self._channels: dict[int, tuple[str, MessageDefinition]] = {}
        self._used_schemas = {0}
        self.compressed_count = 0
        self.lost_bytes = 0

    @property
    def described(self) -> tuple[tuple[str, MessageDefinition], ...]:
        """Return topic and definition of each channel, whether or not it has messages."""
        return tuple(self._channels.values())

    def rewritten(self) -> Iterator[str]:
        """Yield what is another when channels and messages are written anew, a clause each."""
        if self.compressed_count:
            yield f"{self.compressed_count} messages, compressed one by one, are now compressed in chunks"
        if doubled := len(self._channels) - len(set(self._channels.values())):
            yield f"{doubled} channels are one with others of the same topic and type"
        if unused := len(self._schemas.keys() - self._used_schemas):
            yield f"{unused} schemas of no channel are left out"

    def take(self, record: Any) -> Recorded | None:
        """Store a schema or a channel; return a message, unless its channel was lost."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel) and record.schema_id in self._schemas:
            self._channels[record.id] = (record.topic, _definition(record, self._schemas[record.schema_id]))
            self._used_schemas.add(record.schema_id)
        elif isinstance(record, Message):
            if record.channel_id in self._channels:
                return self._message(record, *self._channels[record.channel_id])
            self.lost_bytes += len(record.data)
        return None

    def _message(self, record: Any, topic: str, definition: MessageDefinition) -> Recorded | None:
        data = record.data
        if is_compressed(definition, data):
            self.compressed_count += 1
            try:
                data = decompressed(data)
            except ValueError:
                self.lost_bytes += len(data)
                return None
        return Recorded(topic, definition, data, record.log_time, record.publish_time, record.sequence)

    def statistics(self, record: Any) -> ChannelStatistics | None:
        """Return what a file holds by its Statistics record; None if that names channels the file does not describe."""
        counts = dict.fromkeys(self._channels.values(), 0)
        for channel, count in record.channel_message_counts.items():
            if channel not in self._channels:
                return None
            counts[self._channels[channel]] += count
        first_ns = record.message_start_time if any(counts.values()) else None
        return ChannelStatistics(counts, first_ns, record.message_end_time)


def _definition(channel: Any, schema: Any) -> MessageDefinition:
    return MessageDefinition(
        name=schema.name,
        text=schema.data.decode(errors="surrogateescape"),
        type_hash=channel.metadata.get("topic_type_hash", ""),
        offered_qos_profiles=channel.metadata.get("offered_qos_profiles", ""),
        schema_encoding=schema.encoding,
        message_encoding=channel.message_encoding,
        metadata=tuple(
            (k, v) for k, v in channel.metadata.items() if k not in ("topic_type_hash", "offered_qos_profiles")
        ),
    )
