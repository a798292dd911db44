"""A recording written anew in the forms that `ros2 bag record` and other recorders give it."""

from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, ChunkIndex, Footer, MessageIndex, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from weld_force_ros.recording import MessageDefinition, Recorded, open_bag

# As rosidl writes it.
STRING_IDL = """================================================================================
IDL: std_msgs/msg/String
// generated from rosidl_adapter/resource/msg.idl.em
// with input from std_msgs/msg/String.msg

module std_msgs {
  module msg {
    struct String {
      string data;
    };
  };
};
"""

Make = Callable[[list[Recorded], Path], Path]


def remade(source: Path, form: str, folder: Path) -> Path:
    """Write the messages of a recording in one of the forms, and return the bag, a folder or a file."""
    return FORMS[form](list(open_bag(source).messages()), folder)


def _by_rosbags(storage: StoragePlugin, mode: CompressionMode) -> Make:
    def make(messages: list[Recorded], folder: Path) -> Path:
        writer = RosbagsWriter(folder, version=9, storage_plugin=storage)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for topic, definition, data, time_ns, *_ in messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        topic, definition.name, msgdef=definition.text, rihs01=definition.type_hash
                    )
                writer.write(connections[topic], time_ns, data)
        return folder

    return make


def one_file(
    messages: list[Recorded],
    file: Path,
    encoding: str = "ros2msg",
    text: Callable[[MessageDefinition], str] | None = None,
) -> Path:
    file.parent.mkdir()
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2", "libmcap 1.1.0")
        channels = {}
        for topic, definition, data, time_ns, sent_ns, sequence in messages:
            if topic not in channels:
                stated = definition.text if text is None else text(definition)
                schema = writer.register_schema(definition.name, encoding, stated.encode())
                metadata = {"offered_qos_profiles": definition.offered_qos_profiles}
                channels[topic] = writer.register_channel(topic, "cdr", schema, metadata)
            writer.add_message(channels[topic], time_ns, data, sent_ns, sequence)
        writer.finish()
    return file


def _schemas(encoding: str, text: Callable[[MessageDefinition], str]) -> Make:
    def make(messages: list[Recorded], folder: Path) -> Path:
        return one_file(messages, folder / "bag_0.mcap", encoding, text)

    return make


def _frames(name: str, compress: Callable[[bytes], bytes]) -> Make:
    def make(messages: list[Recorded], folder: Path) -> Path:
        file = one_file(messages, folder / "bag_0.mcap")
        file.write_bytes(MCAP0_MAGIC + b"".join(_recompressed(file.read_bytes(), name, compress)) + MCAP0_MAGIC)
        return file

    return make


def _recompressed(content: bytes, name: str, compress: Callable[[bytes], bytes]) -> Iterator[bytes]:
    """The records of a file, each chunk compressed in frames of a third of it; without an index."""
    for record in StreamReader(BytesIO(content), emit_chunks=True).records:
        if isinstance(record, ChunkIndex | MessageIndex | Statistics | SummaryOffset):
            continue
        if isinstance(record, Chunk):
            third = len(record.data) // 3 + 1
            record.data = b"".join(compress(record.data[i : i + third]) for i in range(0, len(record.data), third))
            record.compression = name
        if isinstance(record, Footer):
            record = Footer(0, 0, 0)
        builder = RecordBuilder()
        record.write(builder)
        yield builder.end()


FORMS: dict[str, Make] = {
    "mcap": _by_rosbags(StoragePlugin.MCAP, CompressionMode.NONE),
    "mcap chunks zstd": _by_rosbags(StoragePlugin.MCAP, CompressionMode.STORAGE),
    "mcap message zstd": _by_rosbags(StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "mcap file zstd": _by_rosbags(StoragePlugin.MCAP, CompressionMode.FILE),
    "sqlite3": _by_rosbags(StoragePlugin.SQLITE3, CompressionMode.NONE),
    "sqlite3 message zstd": _by_rosbags(StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "sqlite3 file zstd": _by_rosbags(StoragePlugin.SQLITE3, CompressionMode.FILE),
    "frames zstd": _frames("zstd", zstandard.compress),
    "frames lz4": _frames("lz4", lz4.frame.compress),
    "schemas empty": _schemas("", lambda _: ""),
    "schemas without text": _schemas("ros2msg", lambda _: ""),
    "schemas IDL": _schemas("ros2idl", lambda _: STRING_IDL),
}
"""How to make each form: of messages in log order, into a folder that does not exist yet."""
