"""Publish recorded messages and their time on a ROS graph."""

import re
import threading
import time
from collections.abc import Callable, Mapping
from importlib import import_module

from ament_index_python import has_resource
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rosgraph_msgs.msg import Clock

from weld_force_ros.errors import BagError
from weld_force_ros.recording import MessageDefinition, Recorded
from weld_force_ros.ros.playback_plan import Channel, ChannelSize, PlaybackOptions, PlaybackPlan
from weld_force_ros.ros.playback_qos import playback_qos
from weld_force_ros.ros.serialized_messages import RecordedPublisher
from weld_force_ros.ros.type_definitions import type_hash

CLOCK_TOPIC = "/clock"

_ACKNOWLEDGED_S = 5.0
_POLL_S = 0.01
_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


class RosSink:
    """A publisher for each channel of a recording that can be played, and one for the clock.

    Args:
        node: the node that publishes.
        plan: the recording.
        options: which of it to play.
        report: called with one line for each channel that cannot be played, and for topics without a subscriber.
        on_time: called with the time in the recording and its length, both in s.

    Attributes:
        sent: how many messages were published.

    Raises:
        BagError: no channel can be played.
    """

    def __init__(
        self,
        node: Node,
        plan: PlaybackPlan,
        options: PlaybackOptions,
        report: Callable[[str], None],
        on_time: Callable[[float, float], None],
    ) -> None:
        self._node, self._plan, self._report, self._on_time = node, plan, report, on_time
        self._clock = node.create_publisher(Clock, CLOCK_TOPIC, 10) if options.clock else None
        self._published_ns: int | None = None
        self._publishers: dict[Channel, RecordedPublisher] = {}
        self._latched: set[str] = set()
        self._live_reported = False
        self.sent = 0
        for topic, (message_type, channels) in self._playable().items():
            self._add_publisher(topic, message_type, channels)
        if not self._publishers:
            raise BagError("nothing in the recording can be played", "source the ROS packages of its message types")

    def set_time(self, recorded_ns: int) -> None:
        """Publish the time on `/clock`, but none twice."""
        if recorded_ns == self._published_ns:
            return
        self._published_ns = recorded_ns
        self._on_time(self._plan.timeline.elapsed_ns(recorded_ns) * 1e-9, self._plan.duration_s)
        if self._clock is not None:
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = divmod(recorded_ns, 10**9)
            self._clock.publish(clock)

    def is_latched(self, message: Recorded) -> bool:
        """Return whether the topic of a message is latched."""
        return message.topic in self._latched

    def send(self, message: Recorded) -> None:
        """Publish the bytes as they are stored."""
        publisher = self._publishers.get((message.topic, message.definition))
        if publisher is not None:
            publisher.publish_recorded(message.data)
            self.sent += 1

    def await_subscribers(self, discovery_s: float, stop: threading.Event) -> None:
        """Wait until each topic has a subscriber, but at most `discovery_s`: there may be none.

        That includes latched topics: a short recording would be over before anybody has joined.
        """
        deadline = time.monotonic() + discovery_s
        while without := sorted({t for (t, _), publisher in self._publishers.items() if not publisher.has_subscriber}):
            if time.monotonic() >= deadline:
                self._report(f"nobody subscribes yet to {', '.join(without)}; playing all the same")
                return
            if stop.wait(_POLL_S):
                return

    def report_live_publishers(self) -> None:
        """Report, once, the topics of the recording that nodes of this graph publish, too: who subscribes gets both."""
        both = sorted({topic for topic, _ in self._publishers if self._node.count_publishers(topic) > 1})
        if both and not self._live_reported:
            self._live_reported = True
            self._report(
                f"live nodes publish {', '.join(both)}, too: subscribers get both; `--topics weld_profile` plays "
                "measurements alone"
            )

    def await_acknowledgement(self) -> None:
        """Wait until every reliable subscriber has everything, but at most 5 s."""
        deadline = time.monotonic() + _ACKNOWLEDGED_S
        for publisher in self._publishers.values():
            publisher.wait_until_acknowledged(deadline)

    def _playable(self) -> dict[str, tuple[type, dict[Channel, ChannelSize]]]:
        """Return type and channels of each topic that can be played, and report which channels cannot."""
        playable: dict[str, tuple[type, dict[Channel, ChannelSize]]] = {}
        for (topic, definition), size in self._plan.channels.items():
            if topic not in self._plan.topics:
                continue
            try:
                if topic == CLOCK_TOPIC and self._clock is not None:
                    raise _UnplayableError("it is made anew")
                message_type = _message_type(definition)
                first_type, channels = playable.setdefault(topic, (message_type, {}))
                if message_type is not first_type:
                    raise _UnplayableError(f"{definition.name} is not the first type on this topic")
                channels[topic, definition] = size
            except _UnplayableError as error:
                self._report(_not_played(topic, size.message_count, str(error)))
        return playable

    def _add_publisher(self, topic: str, message_type: type, channels: Mapping[Channel, ChannelSize]) -> None:
        largest = max(size.largest_bytes for size in channels.values())
        profile = playback_qos((definition.offered_qos_profiles for _, definition in channels), largest)
        try:
            publisher = RecordedPublisher(self._node, message_type, topic, profile, lambda _: None)
        except InvalidTopicNameException:
            count = sum(size.message_count for size in channels.values())
            self._report(_not_played(topic, count, "ROS has no such topic names"))
            return
        self._publishers.update(dict.fromkeys(channels, publisher))
        if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self._latched.add(topic)


class _UnplayableError(Exception):
    """A channel cannot be played."""


def _not_played(topic: str, count: int, reason: str) -> str:
    return f"not played: {topic!r} ({count} messages): {reason}"


def _message_type(definition: MessageDefinition) -> type:
    """Return the class of a channel's messages.

    Raises:
        _UnplayableError: the type is unknown here, or defined otherwise than in the recording.
    """
    if definition.message_encoding != "cdr":
        raise _UnplayableError(f"{definition.message_encoding!r} is no encoding of ROS messages")
    match = _TYPE_NAME.fullmatch(definition.name)
    # The index first: a name in a file must not have just any module imported.
    if not match or not has_resource("rosidl_interfaces", match[1]):
        raise _UnplayableError(f"type {definition.name!r} is unknown here")
    try:
        found: type = getattr(import_module(f"{match[1]}.msg"), match[2])
        known_hash = type_hash(f"{match[1]}/{match[2]}")
    except (ImportError, AttributeError, LookupError, OSError):
        raise _UnplayableError(f"type {definition.name!r} is unknown here") from None
    if definition.type_hash not in ("", known_hash):
        raise _UnplayableError(f"{definition.name} is defined otherwise here than where it was recorded")
    return found
