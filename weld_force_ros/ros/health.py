"""The state of a node as /diagnostics tells it, once a second."""

import threading
from collections import Counter
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

TOPIC = "/diagnostics"
PERIOD_S = 1.0


class Health:
    """Counts of one node; `count` and `complain` may be called from any thread."""

    def __init__(self, node_name: str, instance: str) -> None:
        self.node_name = node_name
        self.instance = instance
        self.last_error = ""
        self.queue_length: Callable[[], int] = lambda: 0
        self.gaps: Callable[[], int] = lambda: 0
        self.received: Counter[str] = Counter()
        self.published: Counter[str] = Counter()
        self.failure: Exception | None = None
        self._lock = threading.Lock()

    def count_received(self, topic: str) -> None:
        """One message in."""
        with self._lock:
            self.received[topic] += 1

    def count_published(self, topic: str) -> None:
        """One message out."""
        with self._lock:
            self.published[topic] += 1

    def complain(self, problem: str) -> None:
        """Keep a problem as the last error."""
        self.last_error = problem

    def fail(self, error: Exception) -> None:
        """Keep what keeps the node from working at all."""
        self.failure = error
        self.complain(str(error))

    def status(self) -> DiagnosticStatus:
        """The state now."""
        with self._lock:
            counts = [(f"received {topic}", n) for topic, n in sorted(self.received.items())]
            counts += [(f"published {topic}", n) for topic, n in sorted(self.published.items())]
        values = [*counts, ("queue length", self.queue_length()), ("sequence gaps", self.gaps())]
        level, message = self._judged()
        return DiagnosticStatus(
            level=level,
            name=self.node_name,
            message=message,
            hardware_id=self.instance,
            values=[KeyValue(key=k, value=str(v)) for k, v in [*values, ("last error", self.last_error)]],
        )

    def report_every_second(self, node: Node, publish: Callable[[DiagnosticArray], None]) -> None:
        """Publish the state by a timer of the steady clock: simulated time may stand still."""

        def report() -> None:
            array = DiagnosticArray(status=[self.status()])
            array.header.stamp = node.get_clock().now().to_msg()
            publish(array)

        node.create_timer(PERIOD_S, report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _judged(self) -> tuple[bytes, str]:
        if self.failure is not None:
            return DiagnosticStatus.ERROR, self.last_error
        if self.gaps():
            return DiagnosticStatus.WARN, f"{self.gaps()} messages were lost on the way"
        if self.published["rejection"] or self.last_error:
            return DiagnosticStatus.WARN, "see last error"
        return DiagnosticStatus.OK, "running"
