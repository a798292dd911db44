"""Contract messages in and out of one node: stamped, numbered, validated, counted."""

import secrets
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from msgspec import UNSET, UnsetType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from weld_force_ros import contract
from weld_force_ros.contract import MAX_TEXT, TOPICS, Message, Rejection, Stamp
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.ros import health, qos
from weld_force_ros.ros.accounts import GapCounter, Header, header_of
from weld_force_ros.ros.health import Health

M = TypeVar("M", bound=Message)
_MAX_NAME = 200
_NO_TIME = Duration()


class Sample(NamedTuple):
    """A serialised message of any topic, as it is recorded. Times are nanoseconds since the epoch."""

    topic: str
    message_type: type
    qos: QoSProfile
    cdr: bytes
    received_ns: int
    sent_ns: int


class Incoming(NamedTuple):
    """A contract message that has arrived, not yet validated; `header` is None if not even that can be read."""

    kind: type[Message]
    sample: Sample
    text: str
    header: Header | None

    @property
    def publisher(self) -> str:
        """Who sent it, empty if unknown."""
        return self.header.publisher if self.header is not None else ""

    @property
    def description(self) -> str:
        """What to call the message in a Rejection."""
        topic = TOPICS[self.kind].name
        if self.header is None or not self.header.publisher:
            return f"{topic} message"
        return f"{topic} message {self.header.sequence} of {self.header.publisher}"


class Outlet:
    """A ROS publisher that shows each sample to a recorder before it leaves."""

    def __init__(
        self, node: Node, message_type: type, topic: str, profile: QoSProfile, record: Callable[[Sample], None]
    ) -> None:
        self._publisher = node.create_publisher(message_type, topic, profile)
        self._describe = (self._publisher.topic_name, message_type, profile)
        self._record = record

    def send(self, message: Any) -> None:
        """Record, then publish, a ROS message."""
        cdr = serialize_message(message)
        now_ns = time.time_ns()
        self._record(Sample(*self._describe, cdr, now_ns, now_ns))
        self._publisher.publish(cdr)

    def wait_until_acknowledged(self, deadline: float) -> None:
        """Wait until every subscriber has what was sent, or `deadline` (monotonic seconds)."""
        # rclpy's own waiting holds the interpreter lock.
        pause = threading.Event()
        while not self._publisher.wait_for_all_acked(_NO_TIME) and time.monotonic() < deadline:
            pause.wait(0.01)


def listen(node: Node, message_type: type, topic: str, profile: QoSProfile, take: Callable[[Sample], None]) -> None:
    """Subscribe to a topic of any type; `take` gets each sample on the executor's thread and must be quick."""

    def callback(cdr: bytes, info: dict[str, int]) -> None:
        take(
            Sample(
                subscription.topic_name,
                message_type,
                profile,
                cdr,
                info["received_timestamp"],
                info["source_timestamp"],
            )
        )

    subscription = node.create_subscription(message_type, topic, callback, profile, raw=True)


class Messenger:
    """The contract topics of one node.

    Args:
        node: whose topics they are.
        publishes: the kinds of message the node may publish.
        record: shown each sample before it is published.
    """

    def __init__(
        self, node: Node, publishes: Iterable[type[Message]], record: Callable[[Sample], None] = lambda _: None
    ) -> None:
        self._node = node
        self._record = record
        self._lock = threading.Lock()
        self._outlets = {kind: self.outlet(String, TOPICS[kind].name, qos.CONTRACT) for kind in publishes}
        self._sequence = dict.fromkeys(self._outlets, 0)
        self._gaps = GapCounter()
        self.instance = f"{node.get_fully_qualified_name()}#{secrets.token_hex(4)}"
        self.health = Health(node.get_fully_qualified_name(), self.instance)
        self.health.gaps = lambda: self._gaps.missed

    def outlet(self, message_type: type, topic: str, profile: QoSProfile) -> Outlet:
        """A publisher of another type than the contract's, recorded like those."""
        return Outlet(self._node, message_type, topic, profile, self._record)

    def report_health(self, queue_length: Callable[[], int]) -> None:
        """Publish the node's state once a second."""
        self.health.queue_length = queue_length
        outlet = self.outlet(DiagnosticArray, health.TOPIC, qos.DIAGNOSTICS)
        self.health.report_every_second(self._node, outlet.send)

    def publish(self, message: Message) -> None:
        """Fill in publisher, sequence and stamp, and publish.

        Raises:
            MessageError: against the contract; nothing was published and no number used up.
        """
        kind = type(message)
        with self._lock:
            now = self._node.get_clock().now().to_msg()
            message.stamp = Stamp(sec=now.sec, nanosec=now.nanosec)
            message.publisher, message.sequence = self.instance, self._sequence[kind]
            self._outlets[kind].send(String(data=contract.encode(message).decode()))
            self._sequence[kind] += 1
        self.health.count_published(TOPICS[kind].name)

    def complain(self, problem: object) -> None:
        """Log a problem of the node itself, and keep it for /diagnostics."""
        self.health.complain(str(problem))
        self._node.get_logger().error(str(problem))

    def reject(
        self,
        source: str,
        error: Exception,
        raw_text: str = "",
        *,
        source_sha256: str | UnsetType = UNSET,
        profile_sha256: str | UnsetType = UNSET,
    ) -> Rejection:
        """Publish that an input could not be used, with the text it came as, and return what was published.

        Args:
            source: the file or message it came from.
            error: why.
            raw_text: cut to what a message may hold.
            source_sha256: identity of the file, if known.
            profile_sha256: identity of the profile, if known.
        """
        reason, remedy = _reason_and_remedy(error)
        rejection = Rejection(
            source=_printable(source)[:_MAX_NAME] or "unknown",
            reason=_printable(reason).removeprefix(f"{source}: ")[:MAX_TEXT],
            remedy=_printable(remedy)[:MAX_TEXT],
            raw_text=_printable(raw_text[:MAX_TEXT]),
            raw_truncated=len(raw_text) > MAX_TEXT,
            source_sha256=source_sha256,
            profile_sha256=profile_sha256,
        )
        self.health.complain(f"{rejection.source}: {rejection.reason}")
        self.publish(rejection)
        self._node.get_logger().warning(f"{rejection.source} rejected: {rejection.reason}; {rejection.remedy}")
        return rejection

    def listen(self, kind: type[Message], take: Callable[[Sample], None]) -> None:
        """Subscribe to a contract topic; pass what `take` gets to `open` on another thread."""
        listen(self._node, String, TOPICS[kind].name, qos.CONTRACT, take)

    def open(self, kind: type[Message], sample: Sample) -> Incoming:
        """Account for a sample of a contract topic, without judging its content."""
        text = _text(sample)
        header = header_of(text)
        if header is not None:
            self._gaps.note(TOPICS[kind].name, header)
        self.health.count_received(TOPICS[kind].name)
        return Incoming(kind, sample, text, header)

    def read(self, kind: type[M], incoming: Incoming, tell: Callable[[Rejection], None] = lambda _: None) -> M | None:
        """The message if it keeps the contract; otherwise None, and it is rejected, which `tell` is told."""
        try:
            return contract.decode(kind, incoming.text)
        except MessageError as error:
            tell(self.reject(incoming.description, error, incoming.text))
            return None

    def sent(self, kind: type[Message]) -> int:
        """How many messages of a kind were published."""
        return self._sequence.get(kind, 0)

    def taken_from(self, publisher: str, kind: type[Message]) -> int:
        """How many messages of a kind were opened of those that `publisher` sent."""
        return self._gaps.next_from(TOPICS[kind].name, publisher)

    def wait_until_acknowledged(self, timeout_s: float) -> None:
        """Wait until every subscriber has what was published, at most so long."""
        deadline = time.monotonic() + timeout_s
        for outlet in self._outlets.values():
            outlet.wait_until_acknowledged(deadline)


def _text(sample: Sample) -> str:
    try:
        return deserialize_message(sample.cdr, String).data
    except Exception:  # not CDR: what arrived is kept for the Rejection
        return sample.cdr.decode("utf-8", "replace")


def _reason_and_remedy(error: Exception) -> tuple[str, str]:
    if isinstance(error, InputError):
        return error.reason, error.remedy
    return str(error) or type(error).__name__, "check the profile; if it is in order, report this as a fault"


def _printable(text: str) -> str:
    # Half a surrogate pair, from a file name of unknown encoding, has no UTF-8 form.
    return text.encode("utf-8", "replace").decode("utf-8")
