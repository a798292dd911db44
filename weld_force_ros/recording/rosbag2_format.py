"""rosbag2's form of a recording: the description of its channels and of its files in `metadata.yaml`."""

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import yaml

from weld_force_ros.recording.timeline import Timeline

MAX_RECORD_BYTES = 64 * 2**20
"""The largest record, and the largest chunk once decompressed, that is read; messages up to half of it are written."""


_DAY_NS = 24 * 3600 * 10**9

UNKNOWN_DISTRO = "unknown"


class MessageDefinition(NamedTuple):
    """The type, schema and QoS of a channel's messages.

    Attributes:
        name: the type, `std_msgs/msg/String`.
        text: the `.msg` text, then for each dependency a line of 80 `=`, `MSG: pkg/Type` and its text.
        type_hash: `RIHS01_...`.
        offered_qos_profiles: YAML, a list; see `offered_qos`.
        schema_encoding: how `text` is written.
        message_encoding: how messages are written; a bag has one encoding.
        metadata: what else the channel states, by name.
    """

    name: str
    text: str
    type_hash: str = ""
    offered_qos_profiles: str = ""
    schema_encoding: str = "ros2msg"
    message_encoding: str = "cdr"
    metadata: tuple[tuple[str, str], ...] = ()


class FileForm(NamedTuple):
    """What a recording states beside its messages.

    Attributes:
        profile: of the MCAP file; `ros2` is rosbag2's.
        compression: of its chunks: `zstd`, `lz4` or none.
        ros_distro: the distribution that it was recorded with.
        custom_data: what else its `metadata.yaml` holds, by name.
    """

    profile: str = "ros2"
    compression: str = "zstd"
    ros_distro: str = UNKNOWN_DISTRO
    custom_data: tuple[tuple[str, str], ...] = ()


def to_yaml(content: object) -> str:
    """Return block-style YAML in the order given."""
    text: str = yaml.safe_dump(content, sort_keys=False)
    return text


def offered_qos(*, depth: int | None = None, latched: bool = False) -> str:
    """Return the QoS of a reliable publisher as recordings keep it; without a depth it keeps all."""
    unlimited = ("deadline", "lifespan", "liveliness_lease_duration")
    profile = {
        "history": "keep_all" if depth is None else "keep_last",
        "depth": depth or 0,
        "reliability": "reliable",
        "durability": "transient_local" if latched else "volatile",
        "liveliness": "automatic",
        **{name: {"sec": 9_223_372_036, "nsec": 854_775_807} for name in unlimited},  # infinite, as rmw has it
        "avoid_ros_namespace_conventions": False,
    }
    return to_yaml([profile])


STRING = MessageDefinition(
    name="std_msgs/msg/String",
    text="string data\n",
    type_hash="RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    offered_qos_profiles=offered_qos(latched=True),
)
"""The type that carries contract messages, for tools that record without ROS."""


def string_cdr(text: str) -> bytes:
    """Return a std_msgs/String as little-endian CDR."""
    data = text.encode()
    return struct.pack("<4sI", b"\x00\x01\x00\x00", len(data) + 1) + data + b"\x00"


@dataclass
class ChannelStatistics:
    """The messages of a file by channel, and their times.

    Attributes:
        counts: messages by (topic, definition).
        first_ns: the earliest log time; None without messages.
        last_ns: the latest log time.
        lateness_ns: how far back in time a message lies, at most, behind one stored before it.
        days: the earliest and the latest log time of each day that has messages, by days since the epoch.
    """

    counts: dict[tuple[str, MessageDefinition], int] = field(default_factory=dict)
    first_ns: int | None = None
    last_ns: int = 0
    lateness_ns: int = 0
    days: dict[int, tuple[int, int]] = field(default_factory=dict)

    def add(self, topic: str, definition: MessageDefinition, log_time_ns: int) -> None:
        """Count one message."""
        self.counts[topic, definition] = self.counts.get((topic, definition), 0) + 1
        self.first_ns = log_time_ns if self.first_ns is None else min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)
        self.lateness_ns = max(self.lateness_ns, self.last_ns - log_time_ns)
        self.extend_day(log_time_ns, log_time_ns)

    def extend_day(self, first_ns: int, last_ns: int) -> None:
        """Take account of messages between two log times of one day."""
        day = first_ns // _DAY_NS
        known_first, known_last = self.days.get(day, (first_ns, last_ns))
        self.days[day] = min(known_first, first_ns), max(known_last, last_ns)

    @property
    def timeline(self) -> Timeline:
        """Return the log times without gaps; known of files that were read through."""
        return Timeline(self.days.values())

    @property
    def message_count(self) -> int:
        """Return the number of messages on all channels."""
        return sum(self.counts.values())

    @property
    def start_ns(self) -> int:
        """Return the earliest log time; 0 without messages."""
        return self.first_ns or 0

    @property
    def duration_ns(self) -> int:
        """Return the time from the earliest to the latest log time."""
        return self.last_ns - self.start_ns


def merged(parts: Iterable[ChannelStatistics]) -> ChannelStatistics:
    """Return the statistics of several files together, without `lateness_ns`, which is of single files."""
    whole = ChannelStatistics()
    for statistics in parts:
        for channel, count in statistics.counts.items():
            whole.counts[channel] = whole.counts.get(channel, 0) + count
        if statistics.first_ns is not None:
            whole.first_ns = statistics.first_ns if whole.first_ns is None else min(whole.first_ns, statistics.first_ns)
            whole.last_ns = max(whole.last_ns, statistics.last_ns)
        for first_ns, last_ns in statistics.days.values():
            whole.extend_day(first_ns, last_ns)
    return whole


def information(files: Mapping[str, ChannelStatistics], form: FileForm) -> dict[str, Any]:
    """Return rosbag2's metadata, version 9, of a bag with these files by name."""
    whole = merged(files.values())
    return {
        "version": 9,
        "storage_identifier": "mcap",
        **_extent(whole),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": definition.name,
                    "serialization_format": definition.message_encoding,
                    "offered_qos_profiles": _parsed_qos(definition.offered_qos_profiles),
                    "type_description_hash": definition.type_hash,
                },
                "message_count": count,
            }
            for (topic, definition), count in whole.counts.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": list(files),
        "files": [{"path": name, **_extent(statistics)} for name, statistics in files.items()],
        "custom_data": dict(form.custom_data) or None,
        "ros_distro": form.ros_distro,
    }


def stated_origin(content: Any) -> tuple[str, tuple[tuple[str, str], ...]] | None:
    """Return distribution and custom data that rosbag2's metadata state; None if they are none."""
    if not isinstance(content, dict):
        return None
    distro, custom = content.get("ros_distro"), content.get("custom_data")
    pairs = custom.items() if isinstance(custom, dict) else ()
    return distro if isinstance(distro, str) and distro else UNKNOWN_DISTRO, tuple((str(k), str(v)) for k, v in pairs)


def _extent(statistics: ChannelStatistics) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": statistics.duration_ns},
        "starting_time": {"nanoseconds_since_epoch": statistics.start_ns},
        "message_count": statistics.message_count,
    }


def _parsed_qos(text: str) -> Any:
    try:
        return yaml.safe_load(text) or []
    except yaml.YAMLError:  # of another recorder; the channel keeps it as it is
        return []
