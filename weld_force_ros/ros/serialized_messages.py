"""Publish and receive serialised ROS messages of any type, as they are recorded."""

import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription

from weld_force_ros.ros.qos import serves_any

_NO_TIME = Duration()
_SLOW_SUBSCRIBER_S = 2.0


class SerializedMessage(NamedTuple):
    """A serialised message of any topic, as it is recorded; times are nanoseconds since the epoch.

    `number` is the middleware's count of its publisher's messages, `tolerated` whether it came by a subscription that
    asks for less than its topic's own.
    """

    topic: str
    message_type: type
    qos: QoSProfile
    cdr: bytes
    received_ns: int
    sent_ns: int
    number: int = 0
    tolerated: bool = False


class RecordedPublisher:
    """A ROS publisher that hands each message to a recorder before it publishes it."""

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        profile: QoSProfile,
        record: Callable[[SerializedMessage], None],
    ) -> None:
        self._node = node
        # Each event that is waited for takes the executor longer, also such as never come.
        events = PublisherEventCallbacks(use_default_callbacks=not serves_any(profile))
        self._publisher = node.create_publisher(message_type, topic, profile, event_callbacks=events)
        self._describe = (recorded_name(node, topic), message_type, profile)
        self._record = record
        self._depth = profile.depth if profile.history == HistoryPolicy.KEEP_LAST else 0
        self._unacknowledged = 0

    def publish(self, message: Any) -> None:
        """Record, then publish, a ROS message."""
        cdr = serialize_message(message)
        now_ns = time.time_ns()
        self._record(SerializedMessage(*self._describe, cdr, now_ns, now_ns))
        self.publish_recorded(cdr)

    def publish_recorded(self, cdr: bytes) -> None:
        """Publish a serialised message that is recorded already."""
        if self._depth and self._unacknowledged >= self._depth - 1:
            # Otherwise a message that a subscriber has not got yet would be pushed out. A subscriber that is stuck for
            # longer loses messages and sees a gap: it cannot hold up everybody else.
            self.wait_until_acknowledged(time.monotonic() + _SLOW_SUBSCRIBER_S)
            self._unacknowledged = 0
        self._publisher.publish(cdr)
        self._unacknowledged += 1

    @property
    def has_subscriber(self) -> bool:
        """Return whether a subscriber is matched; the node knows of it a moment before."""
        return bool(self._publisher.get_subscription_count())

    def wait_until_acknowledged(self, deadline: float) -> None:
        """Wait until every subscriber has what was published, or until `deadline` (monotonic seconds)."""
        # rclpy's own waiting holds the interpreter lock.
        pause = threading.Event()
        while not self._publisher.wait_for_all_acked(_NO_TIME) and time.monotonic() < deadline:
            pause.wait(0.005)

    def destroy(self) -> None:
        """Withdraw the topic."""
        self._node.destroy_publisher(self._publisher)


def subscribe_raw(
    node: Node,
    message_type: type,
    topic: str,
    profile: QoSProfile,
    take: Callable[[SerializedMessage], None],
    group: CallbackGroup | None = None,
    events: SubscriptionEventCallbacks | None = None,
) -> Subscription:
    """Subscribe to a topic of any type; `take` gets each message in the executor's thread and must be quick."""
    name = recorded_name(node, topic)

    def callback(cdr: bytes, info: dict[str, int]) -> None:
        take(
            SerializedMessage(
                name,
                message_type,
                profile,
                cdr,
                info["received_timestamp"],
                info["source_timestamp"],
                info["publication_sequence_number"],
            )
        )

    return node.create_subscription(
        message_type, topic, callback, profile, raw=True, callback_group=group, event_callbacks=events
    )


def recorded_name(node: Node, topic: str) -> str:
    """Return a topic's name in the node's namespace, whatever it is remapped to: by it a recording is read."""
    return node.resolve_topic_name(topic, only_expand=True)
