"""One message of a recording, and its content."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import msgspec
import zstandard
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from weld_force_ros.errors import BagError
from weld_force_ros.messages import legible
from weld_force_ros.recording.message_types import msg_text
from weld_force_ros.recording.rosbag2_format import MAX_RECORD_BYTES, MessageDefinition


class Recorded(NamedTuple):
    """One message of a recording; `data` as it was sent, `content` decoded."""

    topic: str
    definition: MessageDefinition
    data: bytes
    log_time_ns: int
    publish_time_ns: int
    sequence: int = 0

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
    schema = Schema(id=1, name=definition.name, encoding="ros2msg", data=msg_text(definition).encode())
    decoder: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(definition.message_encoding, schema)
    if decoder is None:
        raise ValueError(f"no decoder for {definition.message_encoding} after {definition.schema_encoding}")
    return decoder


def is_compressed(definition: MessageDefinition, data: bytes) -> bool:
    """Return whether a message was compressed by itself (`ros2 bag record --compression-mode message`).

    The first byte tells: that of serialized ROS messages is 0.
    """
    return definition.message_encoding == "cdr" and data.startswith(zstandard.FRAME_HEADER)


def decompressed(data: bytes) -> bytes:
    """Return a message that was compressed by itself.

    Raises:
        ValueError: it is damaged, or larger than a record may be.
    """
    try:
        if zstandard.frame_content_size(data) > MAX_RECORD_BYTES:
            raise ValueError("larger than a record may be")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=MAX_RECORD_BYTES)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None
