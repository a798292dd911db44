"""The state of a node as /diagnostics tells it, once a second."""

import threading
import time
from collections import Counter
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

TOPIC = "/diagnostics"
PERIOD_S = 1.0
_CLOCK_JUMP_S = 2.0


class Health:
    """Counts of one node; `count` and `report_problem` may be called from any thread.

    Attributes:
        queue_length: how many messages or files wait in the node.
        gaps: how many messages were missed.
        facts: what else there is to be known, by name.
        warning: what needs a person's attention now, or None.
        alarm: what keeps the node from doing its work now, or None.
        failure: what keeps it from working at all.
    """

    def __init__(self, node_name: str, instance: str) -> None:
        self.node_name = node_name
        self.instance = instance
        self.last_error = ""
        self.queue_length: Callable[[], int] = lambda: 0
        self.gaps: Callable[[], int] = lambda: 0
        self.facts: Callable[[], dict[str, object]] = dict
        self.warning: Callable[[], str | None] = lambda: None
        self.alarm: Callable[[], str | None] = lambda: None
        self.received: Counter[str] = Counter()
        self.published: Counter[str] = Counter()
        self.failure: Exception | None = None
        self._lock = threading.Lock()
        self._timer: Timer | None = None
        self._rates = _Rates()
        self._clocks = _Clocks()

    def count_received(self, topic: str) -> None:
        """One message in."""
        with self._lock:
            self.received[topic] += 1

    def count_published(self, topic: str) -> None:
        """One message out."""
        with self._lock:
            self.published[topic] += 1

    def report_problem(self, problem: str) -> None:
        """Keep a problem as the last error."""
        self.last_error = problem

    def fail(self, error: Exception) -> None:
        """Keep what keeps the node from working at all."""
        self.failure = error
        self.report_problem(str(error))

    def status(self) -> DiagnosticStatus:
        """The state now."""
        if jump_s := self._clocks.jump_s():
            self.report_problem(f"the computer's clock was set by {jump_s:+.1f} s; stamps follow it")
        with self._lock:
            counts = {f"received {topic}": n for topic, n in sorted(self.received.items())}
            counts |= {f"published {topic}": n for topic, n in sorted(self.published.items())}
        values = {
            **counts,
            **self._rates.of(counts),
            "queue length": self.queue_length(),
            "sequence gaps": self.gaps(),
            **self.facts(),
            "last error": self.last_error,
        }
        level, message = self._judged()
        return DiagnosticStatus(
            level=level,
            name=self.node_name,
            message=message,
            hardware_id=self.instance,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )

    def report_every_second(self, node: Node, publish: Callable[[DiagnosticArray], None]) -> None:
        """Publish the state by a timer of the steady clock: simulated time may stand still."""

        def report() -> None:
            array = DiagnosticArray(status=[self.status()])
            array.header.stamp = node.get_clock().now().to_msg()
            publish(array)

        self._timer = node.create_timer(PERIOD_S, report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def stop(self, node: Node) -> None:
        """Report no more."""
        if self._timer is not None:
            node.destroy_timer(self._timer)

    def _judged(self) -> tuple[bytes, str]:
        if self.failure is not None:
            return DiagnosticStatus.ERROR, self.last_error
        if alarm := self.alarm():
            return DiagnosticStatus.ERROR, alarm
        if warning := self.warning():
            return DiagnosticStatus.WARN, warning
        if self.gaps():
            return DiagnosticStatus.WARN, f"{self.gaps()} messages were lost on the way"
        if self.published["rejection"] or self.last_error:
            return DiagnosticStatus.WARN, "see last error"
        return DiagnosticStatus.OK, "running"


class _Rates:
    """How fast counts grow, between one look and the next."""

    def __init__(self) -> None:
        self._before: dict[str, int] = {}
        self._looked_s = time.monotonic()

    def of(self, counts: dict[str, int]) -> dict[str, str]:
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._looked_s, 1e-3)
        rates = {f"{name} per s": f"{(n - self._before.get(name, 0)) / elapsed_s:.1f}" for name, n in counts.items()}
        self._before, self._looked_s = counts, now_s
        return rates


class _Clocks:
    """Notices when somebody sets the computer's clock."""

    def __init__(self) -> None:
        self._apart_s = time.time() - time.monotonic()

    def jump_s(self) -> float:
        """By how much it was set since the last look; 0 if it was not."""
        apart_s = time.time() - time.monotonic()
        jump_s, self._apart_s = apart_s - self._apart_s, apart_s
        return jump_s if abs(jump_s) > _CLOCK_JUMP_S else 0.0
