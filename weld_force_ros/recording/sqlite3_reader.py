"""One sqlite3 file of rosbag2, read by `rosbags` (extra `foreign`)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from weld_force_ros.errors import BagError
from weld_force_ros.recording.recorded import Recorded, decompressed, is_compressed
from weld_force_ros.recording.recorded_file import CONVERT, RecordedFile
from weld_force_ros.recording.rosbag2_format import MessageDefinition, to_yaml

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

_ENCODINGS = {"MSG": "ros2msg", "IDL": "ros2idl"}


class Sqlite3File(RecordedFile):
    """A `.db3` file, as it is or compressed as a whole; see `RecordedFile`."""

    def stored(self) -> Iterator[Recorded]:
        """Yield every readable message by its time.

        Raises:
            BagError: `rosbags` is not installed, or cannot read the file.
        """
        try:
            from rosbags.rosbag2 import Reader
        except ImportError:
            raise BagError(
                f"{self.path} is an sqlite3 recording, and nothing here reads those",
                f"pip install 'weld_force_ros[foreign]', or {CONVERT}",
            ) from None
        self.indexed, compressed_count = True, 0
        self.lost_bytes = self._unmerged_bytes()
        self.closed = not self.lost_bytes
        try:
            with Reader(self._plain_path) as reader:
                channels = {connection.id: _channel(connection) for connection in reader.connections}
                self.channels = tuple(channels.values())
                for connection, time_ns, data in reader.messages():
                    topic, definition = channels[connection.id]
                    if is_compressed(definition, data):
                        compressed_count += 1
                        try:
                            data = decompressed(data)
                        except ValueError:
                            self.lost_bytes += len(data)
                            continue
                    yield Recorded(topic, definition, bytes(data), time_ns, time_ns)
        except (OSError, BagError):
            raise
        except Exception as error:  # rosbags and SQLite have no common class for what they cannot read
            raise BagError(f"{self.path} cannot be read: {' '.join(str(error).split())}", CONVERT) from error
        self.rewritten = ("sqlite3 is now MCAP", *self._packed)
        if compressed_count:
            self.rewritten += (f"{compressed_count} messages, compressed one by one, are now compressed in chunks",)

    def _unmerged_bytes(self) -> int:
        """Return the size of what a killed recorder wrote beside the file: rosbags does not read it."""
        try:
            return self.path.with_name(f"{self.path.name}-wal").stat().st_size
        except OSError:
            return 0

    def stated_messages(self) -> None:
        """Return None: a database does not state how many messages it was given."""


def _channel(connection: "Connection") -> tuple[str, MessageDefinition]:
    from rosbags.rosbag2.metadata import dump_qos_v9

    ros: Any = connection.ext
    return connection.topic, MessageDefinition(
        name=connection.msgtype,
        text=connection.msgdef.data,
        type_hash=connection.digest,
        offered_qos_profiles=to_yaml(dump_qos_v9(ros.offered_qos_profiles)) if ros.offered_qos_profiles else "",
        schema_encoding=_ENCODINGS.get(connection.msgdef.format.name, ""),
        message_encoding=ros.serialization_format,
    )
