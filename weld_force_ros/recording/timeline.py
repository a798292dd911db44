"""The time in a recording without the gaps that a clock leaves which was set while it was recorded."""

from collections.abc import Iterable
from datetime import UTC, datetime
from itertools import pairwise
from typing import NamedTuple

GAP_NS = 24 * 3600 * 10**9
"""A longer time without any message counts as a gap: nobody waits for it."""


class Gap(NamedTuple):
    """A time without messages, between the log times of two."""

    start_ns: int
    end_ns: int

    @property
    def duration_ns(self) -> int:
        """Return how long it is."""
        return self.end_ns - self.start_ns


class Timeline:
    """Log times from the first message to the last, and the gaps between.

    Attributes:
        start_ns: the earliest log time; 0 without messages.
        gaps: in order.
    """

    def __init__(self, stretches: Iterable[tuple[int, int]]) -> None:
        """Find the gaps between stretches of time that do not overlap, each with its first and last log time in ns."""
        ordered = sorted(stretches)
        self.start_ns, self._end_ns = (ordered[0][0], ordered[-1][1]) if ordered else (0, 0)
        between = (Gap(last, first) for (_, last), (first, _) in pairwise(ordered))
        self.gaps = tuple(gap for gap in between if gap.duration_ns > GAP_NS)

    @property
    def duration_ns(self) -> int:
        """Return the time from the first message to the last without the gaps."""
        return self.elapsed_ns(self._end_ns)

    def elapsed_ns(self, log_time_ns: int) -> int:
        """Return the time from the first message to a log time without the gaps."""
        skipped_ns = sum(min(gap.end_ns, log_time_ns) - gap.start_ns for gap in self.gaps if gap.start_ns < log_time_ns)
        return log_time_ns - self.start_ns - skipped_ns

    def log_time_ns(self, elapsed_ns: int) -> int:
        """Return the log time so long after the first message, the gaps not counted."""
        log_time_ns = self.start_ns + elapsed_ns
        for gap in self.gaps:
            if log_time_ns > gap.start_ns:
                log_time_ns += gap.duration_ns
        return log_time_ns


def gap_in_words(gap: Gap) -> str:
    """Return a sentence that says when a gap was and how long."""
    days = gap.duration_ns / GAP_NS
    length = f"{days / 365.25:.1f} years" if days > 365.25 else f"{days:.1f} days"
    return f"gap of {length}, not counted: {local_time(gap.start_ns)} to {local_time(gap.end_ns)} (was the clock set?)"


def local_time(log_time_ns: int) -> str:
    """Return a log time as date and time of this machine's zone, which is named."""
    return datetime.fromtimestamp(log_time_ns // 10**9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S %Z")
