"""Publish and receive the contract messages of one node: stamped, numbered, validated, counted."""

import secrets
import threading
import time
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import NamedTuple, Self, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from msgspec import UNSET, UnsetType
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_policy_name_from_kind
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import String

from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.messages import (
    MAX_MESSAGE_BYTES,
    MAX_TEXT,
    TOPICS,
    Header,
    Message,
    Rejection,
    Stamp,
    WeldMarker,
    WeldProfile,
    decode,
    describe,
    encodable,
    encode,
    read_header,
    text_identity,
)
from weld_force_ros.ros import diagnostics, qos
from weld_force_ros.ros.diagnostics import NodeDiagnostics
from weld_force_ros.ros.foreign_publishers import TolerantSubscription
from weld_force_ros.ros.sequence_tracker import SequenceTracker
from weld_force_ros.ros.serialized_messages import RecordedPublisher, SerializedMessage, subscribe_raw

M = TypeVar("M", bound=Message)
_FROM_ANYBODY: tuple[type[Message], ...] = (WeldProfile, WeldMarker)
_MAX_NAME = 200
_CLOSE_S = 5.0
_CDR_OVERHEAD_BYTES = 64
_LIVE_NS = 5 * 10**9  # a publisher waits for a slow subscriber for less


class Incoming(NamedTuple):
    """A contract message that has arrived, not yet validated.

    Attributes:
        kind: its type.
        serialized: the message as it arrived.
        text: its JSON.
        header: its publisher and sequence number; None if not even they can be read.
        repeated: whether it had arrived before.
        replayed: whether it is played from a recording: it was sent long after it was stamped.
    """

    kind: type[Message]
    serialized: SerializedMessage
    text: str
    header: Header | None
    repeated: bool
    replayed: bool = False

    @property
    def publisher(self) -> str:
        """Return who sent it; empty if unknown."""
        return self.header.publisher if self.header is not None else ""

    @property
    def description(self) -> str:
        """Return what to call the message in a Rejection."""
        return describe(self.kind, self.header)


class ContractTopics:
    """The contract topics of one node.

    Args:
        node: the node.
        publishes: types of the messages it may publish.
        record: called with each message before it is published.
        group: callback group of the subscriptions; default: the node's own.

    Attributes:
        instance: name of this process's node, by which messages say who published them.
        diagnostics: counts and problems of the node.
    """

    def __init__(
        self,
        node: Node,
        publishes: Iterable[type[Message]],
        record: Callable[[SerializedMessage], None] = lambda _: None,
        group: CallbackGroup | None = None,
    ) -> None:
        self._node = node
        self._record = record
        self._group = group
        self._lock = threading.Lock()
        self._publishers: dict[type[Message], RecordedPublisher] = {}
        self._other_publishers: list[RecordedPublisher] = []
        self._subscriptions: list[Subscription] = []
        self._tolerant_subscriptions: list[TolerantSubscription] = []
        for kind in publishes:
            self._publishers[kind] = RecordedPublisher(
                node, String, TOPICS[kind].name, qos.publisher_qos(TOPICS[kind]), self._record
            )
        self._sequence = dict.fromkeys(self._publishers, 0)
        self._gaps = SequenceTracker()
        self.instance = f"{node.get_fully_qualified_name()}#{secrets.token_hex(4)}"
        self.diagnostics = NodeDiagnostics(node.get_fully_qualified_name(), self.instance)
        self.diagnostics.gaps = lambda: self._gaps.missed

    def add_publisher(
        self,
        message_type: type,
        topic: str,
        profile: QoSProfile,
        record: Callable[[SerializedMessage], None] | None = None,
    ) -> RecordedPublisher:
        """Add a publisher of a topic that is not in the contract; `record` replaces the node's own."""
        self._other_publishers.append(
            RecordedPublisher(self._node, message_type, topic, profile, record or self._record)
        )
        return self._other_publishers[-1]

    def publish_diagnostics(self) -> None:
        """Publish the node's state once a second; it is recorded when it arrives, as it must not wait for a disk."""
        publisher = self.add_publisher(DiagnosticArray, diagnostics.TOPIC, qos.DIAGNOSTICS, lambda _: None)
        self.diagnostics.publish_periodically(self._node, publisher.publish)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Withdraw all topics, once every subscriber has what was published, or after a while."""
        self.wait_until_acknowledged(_CLOSE_S)
        self.diagnostics.stop(self._node)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for tolerant in self._tolerant_subscriptions:
            tolerant.destroy()
        for publisher in (*self._publishers.values(), *self._other_publishers):
            publisher.destroy()

    def publish(self, message: Message) -> None:
        """Fill in publisher, sequence and stamp, and publish.

        Raises:
            MessageError: the message breaks the contract; nothing was published and no number used up.
        """
        kind = type(message)
        with self._lock:
            now = self._node.get_clock().now().to_msg()
            message.stamp = Stamp(sec=now.sec, nanosec=now.nanosec)
            message.publisher, message.sequence = self.instance, self._sequence[kind]
            self._publishers[kind].publish(String(data=encode(message).decode()))
            self._sequence[kind] += 1
        self.diagnostics.count_published(TOPICS[kind].name)

    def publish_recorded(self, kind: type[Message], cdr: bytes) -> None:
        """Publish a serialised message as it was recorded, with its own stamp and number."""
        with self._lock:
            self._publishers[kind].publish_recorded(cdr)

    def report_problem(self, problem: object) -> None:
        """Log a problem of the node itself, and keep it for /diagnostics."""
        self.diagnostics.report_problem(str(problem))
        self._node.get_logger().error(str(problem))

    def reject(self, source: str, error: Exception, raw_text: str = "", **identities: str | UnsetType) -> Rejection:
        """Publish a Rejection, made by `rejection` of the same arguments, and return it."""
        rejection = self.rejection(source, error, raw_text, **identities)
        self.publish(rejection)
        return rejection

    def rejection(
        self,
        source: str,
        error: Exception,
        raw_text: str = "",
        *,
        source_sha256: str | UnsetType = UNSET,
        profile_sha256: str | UnsetType = UNSET,
        profile_id: str | UnsetType = UNSET,
    ) -> Rejection:
        """Make and log, but do not publish, the Rejection of an input that could not be used.

        Args:
            source: the file or message it came from.
            error: why.
            raw_text: the text it came as; cut to what a message may hold.
            source_sha256: identity of the file, if known.
            profile_sha256: identity of the profile, if known.
            profile_id: identity of the measurement; default: one made of source and text.
        """
        if isinstance(error, InputError):
            reason, remedy = error.reason, error.remedy
        else:
            reason = str(error) or type(error).__name__
            remedy = "check the profile; if it is in order, report this as a fault"
        rejection = Rejection(
            source=encodable(source)[:_MAX_NAME] or "unknown",
            reason=encodable(reason).removeprefix(f"{source}: ")[:MAX_TEXT],
            remedy=encodable(remedy)[:MAX_TEXT],
            raw_text=encodable(raw_text[:MAX_TEXT]),
            raw_truncated=len(raw_text) > MAX_TEXT,
            source_sha256=source_sha256,
            profile_sha256=profile_sha256,
            profile_id=profile_id if isinstance(profile_id, str) else text_identity(source, raw_text),
        )
        self.diagnostics.report_problem(f"{rejection.source}: {rejection.reason}")
        self._node.get_logger().warning(f"{rejection.source} rejected: {rejection.reason}; {rejection.remedy}")
        return rejection

    def subscribe(
        self, kind: type[Message], take: Callable[[SerializedMessage], None], group: CallbackGroup | None = None
    ) -> None:
        """Subscribe to a contract topic; what `take` gets is to be handed to `receive`, on any one thread.

        What people publish themselves is taken with any quality of service; of the nodes' own topics, a publisher that
        does not match is a problem.
        """
        topic, profile, group = TOPICS[kind], qos.subscription_qos(TOPICS[kind]), group or self._group
        if kind in _FROM_ANYBODY:
            self._tolerant_subscriptions.append(
                TolerantSubscription(self._node, String, topic.name, profile, take, group)
            )
            return

        def report_mismatch(event: QoSRequestedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self.report_problem(
                f"a publisher of {topic.name} is not heard: its {policy} is not that of the suite; "
                f"publish with reliable{' and transient local' if topic.latched else ''}"
            )

        events = SubscriptionEventCallbacks(incompatible_qos=report_mismatch, use_default_callbacks=False)
        self._subscriptions.append(subscribe_raw(self._node, String, topic.name, profile, take, group, events))

    def subscribe_other(
        self,
        message_type: type,
        topic: str,
        profile: QoSProfile,
        take: Callable[[SerializedMessage], None],
        group: CallbackGroup | None = None,
    ) -> None:
        """Subscribe to a topic that is not in the contract."""
        self._subscriptions.append(subscribe_raw(self._node, message_type, topic, profile, take, group or self._group))

    def receive(self, kind: type[Message], serialized: SerializedMessage) -> Incoming:
        """Count a message of a contract topic and read its header, without validating its content."""
        text = _text(serialized)
        header = read_header(text)
        repeated = header is not None and self._gaps.note(TOPICS[kind].name, header)
        self.diagnostics.count_received(TOPICS[kind].name)
        return Incoming(kind, serialized, text, header, repeated, self._is_replayed(header, serialized))

    def _is_replayed(self, header: Header | None, serialized: SerializedMessage) -> bool:
        """Return whether a message was sent long after it was stamped, by the clock of its sender.

        Simulated time says nothing of when a message is sent, and messages of others may have no stamp.
        """
        stamped_ns = header.stamped_ns if header is not None else 0
        simulated = bool(self._node.get_parameter("use_sim_time").value)
        return stamped_ns > 0 and not simulated and serialized.sent_ns - stamped_ns > _LIVE_NS

    def resume(self, kind: type[Message], text: str) -> None:
        """Account for a message that an earlier process of this node recorded."""
        header = read_header(text)
        if header is not None and header.publisher:
            self._gaps.resume(TOPICS[kind].name, header)

    def decode_or_reject(
        self, kind: type[M], incoming: Incoming, on_reject: Callable[[Rejection], None] = lambda _: None
    ) -> M | None:
        """Return the message if it keeps the contract; else publish its Rejection, call `on_reject`, return None."""
        try:
            return decode(kind, incoming.text)
        except MessageError as error:
            on_reject(self.reject(incoming.description, error, incoming.text))
            return None

    def decode_recorded(self, kind: type[M], cdr: bytes) -> M | None:
        """Return a serialised message that was recorded; None if it breaks the contract."""
        try:
            return decode(kind, deserialize_message(cdr, String).data)
        except MessageError:
            return None

    def decode_or_report(self, kind: type[M], incoming: Incoming) -> M | None:
        """Return the message if it keeps the contract; else report a problem, without a Rejection, and return None."""
        try:
            return decode(kind, incoming.text)
        except MessageError as error:
            self.report_problem(f"{incoming.description}: {error.reason}")
            return None

    def sent(self, kind: type[Message]) -> int:
        """Return how many messages of a kind were published."""
        return self._sequence.get(kind, 0)

    def taken_from(self, publisher: str, kind: type[Message]) -> int:
        """Return how many messages of a kind were received of those that `publisher` sent."""
        return self._gaps.next_expected(TOPICS[kind].name, publisher)

    def wait_until_acknowledged(self, timeout_s: float) -> None:
        """Wait until every subscriber has what was published, but at most `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        for publisher in self._publishers.values():
            publisher.wait_until_acknowledged(deadline)


def _text(serialized: SerializedMessage) -> str:
    if len(serialized.cdr) > MAX_MESSAGE_BYTES + _CDR_OVERHEAD_BYTES:
        return f"a message of {len(serialized.cdr)} bytes, which was not read"
    try:
        return deserialize_message(serialized.cdr, String).data
    except Exception:  # not CDR: what arrived is kept for the Rejection
        return serialized.cdr.decode("utf-8", "replace")
