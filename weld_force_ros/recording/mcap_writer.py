"""Write MCAP files and `metadata.yaml` in rosbag2's form."""

import errno
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from mcap.records import Attachment, Metadata
from mcap.writer import CompressionType, Writer

from weld_force_ros._files import whole_file
from weld_force_ros.errors import BagError
from weld_force_ros.recording.mcap_reader import ROSBAG2_RECORD, McapFile
from weld_force_ros.recording.recorded import Recorded
from weld_force_ros.recording.rosbag2_format import (
    ChannelStatistics,
    FileForm,
    MessageDefinition,
    information,
    to_yaml,
)

_FORCED_BYTES = 8 * 2**20  # of a whole file, at a time


class AppendFile:
    """A file that grows by whole writes: a write that fails leaves the file as it was before."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._size = 0
        self._gathered: bytearray | None = None

    @contextmanager
    def gathering(self) -> Iterator[bytearray]:
        """Gather all writes in a buffer, which the caller writes as one afterwards."""
        self._gathered = bytearray()
        try:
            yield self._gathered
        finally:
            self._gathered = None

    def write(self, data: bytes) -> int:
        """Append all of it, or raise OSError and append nothing."""
        if self._gathered is not None:
            self._gathered += data
            return len(data)
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
        """Return the number of bytes written or gathered."""
        return self._size + len(self._gathered or b"")

    def flush(self) -> None:
        """Do nothing: every write reaches the file at once."""

    def check_exists(self) -> None:
        """Raise OSError if somebody removed the file: what is written to it would be gone."""
        if os.fstat(self._file.fileno()).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the file was removed while it was written", self._file.name)

    def sync(self) -> None:
        """Force what was written to the disk."""
        os.fdatasync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class McapWriter:
    """Writes an MCAP file and registers channels as they come."""

    def __init__(self, stream: BinaryIO | AppendFile, *, chunked: bool, form: FileForm) -> None:
        self.statistics = ChannelStatistics()
        self._chunked = chunked
        self._schemas: dict[tuple[str, str, str], int] = {}
        self._channels: dict[tuple[str, MessageDefinition], int] = {}
        compression = CompressionType[form.compression.upper() or "NONE"]
        self._writer = Writer(stream, use_chunking=chunked, compression=compression)
        self._writer.start(form.profile)

    def add(
        self,
        topic: str,
        definition: MessageDefinition,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int = 0,
    ) -> None:
        """Write one message."""
        channel = self._channels.get((topic, definition)) or self.register(topic, definition)
        try:
            self._writer.add_message(channel, log_time_ns, data, publish_time_ns, sequence)
        except OSError:
            # The library counted the message before it wrote it.
            counted = self._writer._Writer__statistics
            counted.channel_message_counts[channel] -= 1
            counted.message_count = self.statistics.message_count
            counted.message_start_time, counted.message_end_time = self.statistics.start_ns, self.statistics.last_ns
            raise
        self.statistics.add(topic, definition, log_time_ns)

    def register(self, topic: str, definition: MessageDefinition) -> int:
        """Write the description of a channel, and return its number."""
        described = (definition.name, definition.schema_encoding, definition.text)
        schema = self._schemas.get(described)
        if schema is None:
            text = definition.text.encode(errors="surrogateescape")
            schema = self._writer.register_schema(definition.name, definition.schema_encoding, text)
        metadata = {"offered_qos_profiles": definition.offered_qos_profiles, "topic_type_hash": definition.type_hash}
        present = {key: value for key, value in metadata.items() if value} | dict(definition.metadata)
        channel: int = self._writer.register_channel(topic, definition.message_encoding, schema, present)
        if not self._chunked:
            # A channel counts as registered only once it is in the file, or a full disk would orphan its messages.
            self._writer.flush()
        self._schemas[described], self._channels[topic, definition] = schema, channel
        return channel

    def add_extra(self, record: Attachment | Metadata) -> None:
        """Write an attachment or a metadata record as another file has it."""
        if isinstance(record, Metadata):
            self._writer.add_metadata(record.name, record.metadata)
        else:
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )

    def write_metadata_record(self, content: dict[str, Any]) -> None:
        """Write rosbag2's metadata record."""
        self._writer.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": to_yaml(content)})

    def finish(self) -> None:
        """Write the end of the file: summary, index and footer."""
        self._writer.finish()


def write_mcap(
    path: Path,
    messages: Iterable[Recorded],
    statistics: ChannelStatistics,
    form: FileForm,
    extras: Iterable[Attachment | Metadata] = (),
) -> None:
    """Write messages in log order as one compressed, indexed file in rosbag2's form, and read it before it is named.

    Args:
        path: the file; one that is there is replaced as a whole.
        messages: in log order.
        statistics: what they are.
        form: of the file.
        extras: what the file is to hold beside the messages.

    Raises:
        BagError: what was written does not read back.
        OSError: it cannot be written.
    """
    with whole_file(path, fsync=True) as stream:
        writer = McapWriter(stream, chunked=True, form=form)
        content = information({path.name: statistics}, form)
        writer.write_metadata_record(content)
        for record in extras:
            writer.add_extra(record)
        unforced_bytes = 0
        for recorded in messages:
            writer.add(*recorded)
            unforced_bytes += len(recorded.data)
            if unforced_bytes > _FORCED_BYTES:  # all at the end would keep a recording beside from the disk for long
                stream.flush()
                os.fdatasync(stream.fileno())
                unforced_bytes = 0
        for (topic, definition), count in statistics.counts.items():
            if not count:
                writer.register(topic, definition)
        writer.write_metadata_record(content)
        writer.finish()
        stream.flush()
        again = McapFile(Path(stream.name))
        again.scan()
        if again.damage or again.statistics.counts != statistics.counts:
            raise BagError(f"{path}: did not read back as written", "check the disk and try again")


def write_metadata(directory: Path, files: Mapping[str, ChannelStatistics], form: FileForm) -> None:
    """Write a recording's `metadata.yaml`: its files by name, and what each holds."""
    with whole_file(directory / "metadata.yaml", fsync=True) as stream:
        stream.write(to_yaml({"rosbag2_bagfile_information": information(files, form)}).encode())
