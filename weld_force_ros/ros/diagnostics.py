"""Report the state of a node on /diagnostics once a second."""

import threading
import time
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

TOPIC = "/diagnostics"
PERIOD_S = 1.0
RECOVERY_S = 300.0
"""A node is at WARN for so long after its last problem. A crew measures a weld every few minutes and looks at the
screen then: it does not miss a file that was rejected, and the next rejected file changes what it sees."""

_CLOCK_JUMP_S = 2.0


class NodeDiagnostics:
    """Counts and problems of one node; `count_...` and `report_problem` may be called from any thread.

    Problems, lost messages included, keep the node at WARN until `RECOVERY_S` after the last one; the status says since
    when. What lasts, `warning`, `blocked_by` and `failure`, counts for as long as it lasts.

    Attributes:
        queue_length: how many messages or files wait in the node.
        gaps: how many messages were missed.
        facts: what else there is to be known, by name.
        warning: what needs a person's attention now, or None.
        blocked_by: what keeps the node from doing its work now, or None.
        failure: what keeps it from working at all.
    """

    def __init__(self, node_name: str, instance: str) -> None:
        self.node_name = node_name
        self.instance = instance
        self.queue_length: Callable[[], int] = lambda: 0
        self.gaps: Callable[[], int] = lambda: 0
        self.facts: Callable[[], dict[str, object]] = dict
        self.warning: Callable[[], str | None] = lambda: None
        self.blocked_by: Callable[[], str | None] = lambda: None
        self.received: Counter[str] = Counter()
        self.published: Counter[str] = Counter()
        self.failure: Exception | None = None
        self._lock = threading.Lock()
        self._timer: Timer | None = None
        self._problems = _RecentProblems()
        self._gaps_reported = 0
        self._rates = _Rates()
        self._clocks = _ClockJumps()

    @property
    def last_error(self) -> str:
        """Return the last problem, however long ago; empty if there was none."""
        return self._problems.last

    def count_received(self, topic: str) -> None:
        """Count a message that came in."""
        with self._lock:
            self.received[topic] += 1

    def count_published(self, topic: str) -> None:
        """Count a message that went out."""
        with self._lock:
            self.published[topic] += 1

    def report_problem(self, problem: str) -> None:
        """Keep a problem as the last error; one that lasts is to be reported again each time it is met."""
        with self._lock:
            self._problems.note(problem)

    def fail(self, error: Exception) -> None:
        """Keep what keeps the node from working at all."""
        self.failure = error
        self.report_problem(str(error))

    def status(self) -> DiagnosticStatus:
        """Return the state as it is now."""
        if jump_s := self._clocks.jump_s():
            self.report_problem(f"the computer's clock was set by {jump_s:+.1f} s; stamps follow it")
        if (gaps := self.gaps()) > self._gaps_reported:
            self._gaps_reported = gaps
            self.report_problem(f"{gaps} messages were lost on the way")
        with self._lock:
            counts = {f"received {topic}": n for topic, n in sorted(self.received.items())}
            counts |= {f"published {topic}": n for topic, n in sorted(self.published.items())}
            problems = self._problems.values()
        values = {
            **counts,
            **self._rates.per_second(counts),
            "queue length": self.queue_length(),
            "sequence gaps": gaps,
            **self.facts(),
            **problems,
        }
        level, message = self._level_and_message()
        return DiagnosticStatus(
            level=level,
            name=self.node_name,
            message=message,
            hardware_id=self.instance,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )

    def publish_periodically(self, node: Node, publish: Callable[[DiagnosticArray], None]) -> None:
        """Publish the state by a timer of the steady clock: simulated time may stand still."""

        def report() -> None:
            array = DiagnosticArray(status=[self.status()])
            array.header.stamp = node.get_clock().now().to_msg()
            publish(array)

        self._timer = node.create_timer(PERIOD_S, report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def stop(self, node: Node) -> None:
        """Publish no more."""
        if self._timer is not None:
            node.destroy_timer(self._timer)

    def _level_and_message(self) -> tuple[bytes, str]:
        if self.failure is not None:
            return DiagnosticStatus.ERROR, str(self.failure)
        if blocked_by := self.blocked_by():
            return DiagnosticStatus.ERROR, blocked_by
        if warning := self.warning():
            return DiagnosticStatus.WARN, warning
        with self._lock:
            if problem := self._problems.message():
                return DiagnosticStatus.WARN, problem
        return DiagnosticStatus.OK, "running"


class _RecentProblems:
    """Problems without a pause of `RECOVERY_S` between them: how many, since when, and the last one."""

    def __init__(self) -> None:
        self.last = ""
        self._count = 0
        self._since = self._last_at = ""
        self._last_s = float("-inf")

    def note(self, problem: str) -> None:
        now_s, now = time.monotonic(), datetime.fromtimestamp(time.time(), UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        if now_s - self._last_s >= RECOVERY_S:
            self._count, self._since = 0, now
        self.last, self._last_at, self._last_s = problem, now, now_s
        self._count += 1

    def message(self) -> str | None:
        """Say what is wrong and since when; None once the node has recovered."""
        left_s = self._last_s + RECOVERY_S - time.monotonic()
        if left_s <= 0:
            return None
        when = f"at {self._last_at}" if self._count == 1 else f"last of {self._count} problems since {self._since}"
        return f"{self.last} ({when}; OK again in {left_s:.0f} s without another)"

    def values(self) -> dict[str, str]:
        recent = self.message() is not None
        return {
            "problems since": self._since if recent else "",
            "last error at": self._last_at,
            "last error": self.last,
        }


class _Rates:
    """Rates at which counts grow, from one call to the next."""

    def __init__(self) -> None:
        self._before: dict[str, int] = {}
        self._called_s = time.monotonic()

    def per_second(self, counts: dict[str, int]) -> dict[str, str]:
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._called_s, 1e-3)
        rates = {f"{name} per s": f"{(n - self._before.get(name, 0)) / elapsed_s:.1f}" for name, n in counts.items()}
        self._before, self._called_s = counts, now_s
        return rates


class _ClockJumps:
    """Notices when somebody sets the computer's clock."""

    def __init__(self) -> None:
        self._apart_s = time.time() - time.monotonic()

    def jump_s(self) -> float:
        """Return by how much the clock was set since the last call; 0 if it was not."""
        apart_s = time.time() - time.monotonic()
        jump_s, self._apart_s = apart_s - self._apart_s, apart_s
        return jump_s if abs(jump_s) > _CLOCK_JUMP_S else 0.0
