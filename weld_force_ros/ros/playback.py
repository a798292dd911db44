"""A recording played onto a live ROS graph: every message as it was stored, in log order, at its time or late.

What is played is decided by `perform`, which knows no ROS; `play` gives it a stage of real publishers.
"""

import math
import re
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import rclpy
import yaml
from ament_index_python import has_resource
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from weld_force_ros.errors import BagError, InputError
from weld_force_ros.recording import Bag, MessageDefinition, Recorded, open_bag
from weld_force_ros.ros import environment
from weld_force_ros.ros.contract_topics import RecordedPublisher
from weld_force_ros.ros.type_definitions import type_hash

CLOCK_TOPIC = "/clock"
CLOCK_PERIOD_S = 1 / 40
MIN_RATE, MAX_RATE = 0.1, 100.0
DISCOVERY_S = 3.0

_ACKNOWLEDGED_S = 5.0
_LOOK_S = 0.01
_LIVE_DEPTH = 100
_LATCHED_DEPTH = 1000
_KEPT_BYTES = 32 * 2**20
"""What the publisher of one topic may hold. Told to keep all, Fast DDS would hold 5000 messages of any size."""
_CLOCK_END_NS = 2**31 * 10**9
_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")

# As rosbag2 writes them since Jazzy, and the numbers that it wrote before.
_RELIABLE = ("reliable", ReliabilityPolicy.RELIABLE.value)
_BEST_EFFORT = ("best_effort", ReliabilityPolicy.BEST_EFFORT.value)
_LATCHED = ("transient_local", DurabilityPolicy.TRANSIENT_LOCAL.value)
_KEEP_LAST = ("keep_last", HistoryPolicy.KEEP_LAST.value)
_MANUAL = ("manual_by_topic", LivelinessPolicy.MANUAL_BY_TOPIC.value)

_Channel = tuple[str, MessageDefinition]


@dataclass(frozen=True)
class PlaybackOptions:
    """What of a recording is played, and how.

    Attributes:
        rate: recorded seconds per second, 0.1 to 100.
        start_offset_s: where to start, after the recording's first message.
        loop: whether to start again at the end, until stopped.
        topics: only these; None for all.
        clock: whether to publish `/clock`.

    Raises:
        InputError: a rate or an offset out of range.
    """

    rate: float = 1.0
    start_offset_s: float = 0.0
    loop: bool = False
    topics: tuple[str, ...] | None = None
    clock: bool = True

    def __post_init__(self) -> None:
        if not MIN_RATE <= self.rate <= MAX_RATE:
            raise InputError(f"rate {self.rate:g} is out of range", f"give {MIN_RATE:g} to {MAX_RATE:g}")
        if not 0 <= self.start_offset_s < math.inf:
            raise InputError(f"start offset {self.start_offset_s:g} s is out of range", "give seconds from 0 on")


@dataclass
class _Size:
    """Of what a channel holds."""

    message_count: int = 0
    largest_bytes: int = 0


class PlaybackPlan:
    """A recording to be played: its extent in time and what is on each channel; reads it through once.

    Attributes:
        start_ns: log time of the first message of all.
        end_ns: log time of the last.

    Raises:
        BagError: nothing in it, or times that ROS cannot express.
        InputError: a topic that is not in it, or a start behind its end.
    """

    def __init__(self, bag: Bag, manner: PlaybackOptions) -> None:
        self._bag = bag
        self.channels: dict[_Channel, _Size] = defaultdict(_Size)
        times: list[int] = []
        for message in bag.messages():
            size = self.channels[message.topic, message.definition]
            size.message_count += 1
            size.largest_bytes = max(size.largest_bytes, len(message.data))
            times = [times[0] if times else message.log_time_ns, message.log_time_ns]
        if not times:
            raise BagError(f"{bag.path} holds no message", "there is nothing to play")
        self.start_ns, self.end_ns = times
        if self.end_ns >= _CLOCK_END_NS:
            raise BagError(f"{bag.path} has log times after the year 2038", "ROS cannot express them; record it again")
        if manner.start_offset_s > self.duration_s:
            raise InputError(
                f"start offset {manner.start_offset_s:g} s lies behind the end of {bag.path}",
                f"give at most {self.duration_s:g} s",
            )
        self.topics = self._chosen(bag, manner.topics)

    @property
    def duration_s(self) -> float:
        """From the first message to the last."""
        return (self.end_ns - self.start_ns) * 1e-9

    def messages(self) -> Iterator[Recorded]:
        """Those of the chosen topics in log order."""
        return self._bag.messages(self.topics)

    def _chosen(self, bag: Bag, wanted: tuple[str, ...] | None) -> set[str]:
        recorded = {topic for topic, _ in self.channels}
        if wanted is None:
            return recorded
        chosen = {"/" + topic.lstrip("/") for topic in wanted}
        if unknown := sorted(chosen - recorded):
            raise InputError(
                f"{self._bag.path} has no topic {unknown[0]}", f"choose from {', '.join(sorted(recorded))}"
            )
        return chosen


class PlaybackClock:
    """How recorded time passes, from `begin` on.

    Args:
        rate: recorded seconds per second.
        now: monotonic seconds.
        sleep: waits so many seconds, or less if playing is stopped.
    """

    def __init__(self, rate: float, now: Callable[[], float], sleep: Callable[[float], object]) -> None:
        self._rate, self._now, self.sleep = rate, now, sleep
        self.begin(0)

    def begin(self, recorded_ns: int) -> None:
        """It is this time in the recording now."""
        self._begun_s, self._origin_ns = self._now(), recorded_ns

    def recorded_ns(self) -> int:
        """The time in the recording."""
        return self._origin_ns + round((self._now() - self._begun_s) * self._rate * 1e9)

    def seconds_until(self, recorded_ns: int) -> float:
        """How long until then; negative if it is over."""
        return (recorded_ns - self._origin_ns) * 1e-9 / self._rate - (self._now() - self._begun_s)


class MessageSink(Protocol):
    """Where a recording is played."""

    def tell(self, recorded_ns: int) -> None:
        """It is this time in the recording."""

    def is_latched(self, message: Recorded) -> bool:
        """Whether those who join late want this message, too."""

    def send(self, message: Recorded) -> None:
        """Play a message."""


def play_messages(
    messages: Iterable[Recorded], start_ns: int, stage: MessageSink, pace: PlaybackClock, stop: threading.Event
) -> None:
    """Play messages once: first, at once, the latched ones before the start, then each at its time or late.

    The time is told before each message, and at least every `CLOCK_PERIOD_S` between; it never goes back.

    Args:
        messages: in log order.
        start_ns: where in the recording to start.
        stage: where they are played.
        pace: of recorded time.
        stop: set to end early.
    """
    stage.tell(start_ns)
    pace.begin(start_ns)
    for message in messages:
        if stop.is_set():
            return
        if message.log_time_ns < start_ns:
            if stage.is_latched(message):
                stage.send(message)
            pace.begin(start_ns)  # however long it took
            continue
        while (left_s := pace.seconds_until(message.log_time_ns)) > 0:
            pace.sleep(min(left_s, CLOCK_PERIOD_S))
            if stop.is_set():
                return
            stage.tell(min(pace.recorded_ns(), message.log_time_ns))
        stage.tell(message.log_time_ns)
        stage.send(message)


def play(
    path: Path,
    manner: PlaybackOptions,
    *,
    stop: threading.Event,
    say: Callable[[str], None] = lambda _: None,
    on_time: Callable[[float, float], None] = lambda at_s, duration_s: None,
    domain_id: int | None = None,
    discovery_s: float = DISCOVERY_S,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] | None = None,
) -> int:
    """Play a recording onto the ROS graph of this machine, or of the discovery range the user chose.

    Every reliable subscriber gets every message: before one that it lacks is pushed out of a publisher's history, it is
    waited for, up to the bound of `topics.RecordedPublisher`.

    Args:
        path: a bag folder or an .mcap file; a cut one is played up to the cut.
        manner: what of it, and how.
        stop: set by another thread or a signal to end cleanly.
        say: told, in one line each, what is not played and why, and what nobody listens to at the start.
        on_time: told the time in the recording and its length, both in seconds.
        domain_id: ROS domain; `ROS_DOMAIN_ID` if absent.
        discovery_s: how long to wait, at most, until each topic has a subscriber.
        now: monotonic seconds.
        sleep: waits so many seconds; default: until `stop` is set.

    Returns:
        How many messages were published.

    Raises:
        BagError: not a readable bag, or nothing in it that can be played.
        InputError: a topic or a start that it does not have; ROS does not start.
    """
    bag = open_bag(path)
    if bag.damage:
        say(f"{path}: {bag.damage}; playing what is there")
    score = PlaybackPlan(bag, manner)
    pace = PlaybackClock(manner.rate, now, sleep or stop.wait)
    start_ns = score.start_ns + round(manner.start_offset_s * 1e9)
    with _node(domain_id) as node:
        stage = RosSink(node, score, manner, say, on_time)
        stage.await_subscribers(discovery_s, stop)
        while not stop.is_set():
            play_messages(score.messages(), start_ns, stage, pace, stop)
            if not manner.loop:
                break
            pace.sleep(CLOCK_PERIOD_S)  # a recording of one moment would otherwise be played without pause
        stage.await_acknowledgement()
    return stage.sent


@contextmanager
def _node(domain_id: int | None) -> Iterator[Node]:
    environment.prepare()
    environment.stay_on_this_machine()
    context = rclpy.Context()
    try:
        rclpy.init(context=context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy has no common class for what it refuses
        raise InputError(f"ROS does not start: {' '.join(str(error).split())}", "check the ROS environment") from None
    try:
        options: dict[str, Any] = {"enable_rosout": False, "start_parameter_services": False}
        node = rclpy.create_node("weld_force_playback", context=context, use_global_arguments=False, **options)
        try:
            yield node
        finally:
            node.destroy_node()
    finally:
        context.try_shutdown()


class RosSink:
    """The stage of real publishers.

    Attributes:
        sent: how many messages were published.
    """

    def __init__(
        self,
        node: Node,
        score: PlaybackPlan,
        manner: PlaybackOptions,
        say: Callable[[str], None],
        on_time: Callable[[float, float], None],
    ) -> None:
        self._node, self._score, self._say, self._on_time = node, score, say, on_time
        self._clock = node.create_publisher(Clock, CLOCK_TOPIC, 10) if manner.clock else None
        self._told_ns: int | None = None
        self._parts: dict[_Channel, RecordedPublisher] = {}
        self._latched: set[str] = set()
        self.sent = 0
        for topic, (message_type, channels) in self._playable().items():
            self._open(topic, message_type, channels)
        if not self._parts:
            raise BagError("nothing in the recording can be played", "source the ROS packages of its message types")

    def tell(self, recorded_ns: int) -> None:
        """Publish the time on `/clock`, once each."""
        if recorded_ns == self._told_ns:
            return
        self._told_ns = recorded_ns
        self._on_time((recorded_ns - self._score.start_ns) * 1e-9, self._score.duration_s)
        if self._clock is not None:
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = divmod(recorded_ns, 10**9)
            self._clock.publish(clock)

    def is_latched(self, message: Recorded) -> bool:
        """Whether its topic is."""
        return message.topic in self._latched

    def send(self, message: Recorded) -> None:
        """Publish the bytes as stored."""
        part = self._parts.get((message.topic, message.definition))
        if part is not None:
            part.publish_recorded(message.data)
            self.sent += 1

    def await_subscribers(self, discovery_s: float, stop: threading.Event) -> None:
        """Wait until each topic has a subscriber, at most so long: there may be none.

        Latched ones, too: a short recording would be over before anybody has joined.
        """
        deadline = time.monotonic() + discovery_s
        while lonely := sorted({topic for (topic, _), part in self._parts.items() if not part.has_subscriber}):
            if time.monotonic() >= deadline:
                self._say(f"nobody subscribes yet to {', '.join(lonely)}; playing all the same")
                return
            if stop.wait(_LOOK_S):
                return

    def await_acknowledgement(self) -> None:
        """Wait until every reliable subscriber has everything, within bounds."""
        deadline = time.monotonic() + _ACKNOWLEDGED_S
        for part in self._parts.values():
            part.wait_until_acknowledged(deadline)

    def _playable(self) -> dict[str, tuple[type, dict[_Channel, _Size]]]:
        """By topic: the type, and the channels of it; says which are not."""
        playable: dict[str, tuple[type, dict[_Channel, _Size]]] = {}
        for (topic, definition), size in self._score.channels.items():
            if topic not in self._score.topics:
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
                self._say(_not_played(topic, size.message_count, str(error)))
        return playable

    def _open(self, topic: str, message_type: type, channels: Mapping[_Channel, _Size]) -> None:
        largest = max(size.largest_bytes for size in channels.values())
        profile = offering((definition.offered_qos_profiles for _, definition in channels), largest)
        try:
            part = RecordedPublisher(self._node, message_type, topic, profile, lambda _: None)
        except InvalidTopicNameException:
            count = sum(size.message_count for size in channels.values())
            self._say(_not_played(topic, count, "ROS has no such topic names"))
            return
        self._parts.update(dict.fromkeys(channels, part))
        if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self._latched.add(topic)


class _UnplayableError(Exception):
    """Why a channel cannot be played."""


def _not_played(topic: str, count: int, reason: str) -> str:
    return f"not played: {topic!r} ({count} messages): {reason}"


def _message_type(definition: MessageDefinition) -> type:
    """The class of a channel's messages.

    Raises:
        _UnplayableError: unknown here, or differently defined.
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


def offering(profiles: Iterable[str], largest_bytes: int) -> QoSProfile:
    """Quality of service that fits whoever the recorded publishers of a topic fitted.

    Args:
        profiles: as channels keep them: YAML, a list.
        largest_bytes: of a message; a publisher never holds more than so many of them as fit 32 MiB.

    Returns:
        The strongest of all that was offered; reliable where that cannot be read.
    """
    offered = [profile for text in profiles for profile in _parsed(text)]
    latched = [profile for profile in offered if profile.get("durability") in _LATCHED]
    weak = bool(offered) and all(profile.get("reliability") in _BEST_EFFORT for profile in offered)
    depth = max(map(_depth, latched), default=_LIVE_DEPTH)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(1, min(depth, _KEPT_BYTES // max(1, largest_bytes))),
        reliability=ReliabilityPolicy.BEST_EFFORT if weak else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        **(_timing(offered[0]) if offered else {}),
    )


def _parsed(text: str) -> list[dict[str, Any]]:
    try:
        profiles = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    return [profile for profile in profiles if isinstance(profile, dict)] if isinstance(profiles, list) else []


def _depth(profile: Mapping[str, Any]) -> int:
    depth = profile.get("depth")
    if profile.get("history") in _KEEP_LAST and isinstance(depth, int) and depth > 0:
        return min(depth, _LATCHED_DEPTH)
    return _LATCHED_DEPTH


def _timing(profile: Mapping[str, Any]) -> dict[str, Any]:
    """What a subscriber may have asked for beside; empty if it cannot be read."""
    try:
        durations = {
            name: Duration(seconds=profile[name]["sec"], nanoseconds=profile[name]["nsec"])
            for name in ("deadline", "lifespan", "liveliness_lease_duration")
        }
    except (KeyError, TypeError, ValueError, OverflowError):
        return {}
    manual = profile.get("liveliness") in _MANUAL
    return {**durations, "liveliness": LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC}
