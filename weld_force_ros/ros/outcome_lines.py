"""Print the outcome of each weld on standard output, in one line."""

import os
import sys
import threading
from contextlib import suppress
from queue import SimpleQueue

from weld_force_ros.assessment.criteria import sentence_in_words
from weld_force_ros.messages import Rejection, Verdict

LAST_LINES_S = 2.0
"""How long a reader may take for the lines that are left when the nodes have ended."""


def outcome_line(outcome: Verdict | Rejection) -> str:
    """Return a verdict or a rejection as one printable line."""
    if isinstance(outcome, Verdict):
        speed = f"; {outcome.advice[0]}" if outcome.advice and outcome.decision != "accept" else ""
        under = f" under {outcome.vehicle}" if isinstance(outcome.vehicle, str) else ""
        reason = sentence_in_words(outcome.reason, outcome.criteria)
        line = f"{outcome.decision.upper():10} {outcome.weld_id}{under}: {reason}{speed}"
    else:
        line = f"UNREADABLE {outcome.source}: {outcome.reason}; {outcome.remedy}"
    return "".join(c if c.isprintable() else " " for c in line)


class OutcomePrinter:
    """A thread that writes the line of each outcome; a context manager that leaves time for the last ones.

    A reader may stand still (a terminal that is paused, `| less`) or be gone (`| head`): neither keeps a node waiting.
    Lines are written past `sys.stdout`, whose lock a thread that stands still would keep beyond the end of the program.
    """

    def __init__(self) -> None:
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._write_lines, name="outcomes", daemon=True)

    def __enter__(self) -> "OutcomePrinter":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.put(None)
        self._thread.join(LAST_LINES_S)

    def print(self, outcome: Verdict | Rejection) -> None:
        """Have the line of an outcome written; never waits."""
        self._lines.put(outcome_line(outcome))

    def _write_lines(self) -> None:
        if sys.stdout is None:  # closed when the program began; its number may be another file's by now
            return
        while (line := self._lines.get()) is not None:
            rest = f"{line}\n".encode(sys.stdout.encoding, "backslashreplace")
            try:
                while rest:
                    rest = rest[os.write(sys.stdout.fileno(), rest) :]
            except BrokenPipeError:
                with suppress(OSError):
                    print("nobody reads the verdicts any more; the nodes go on, Ctrl-C stops them", file=sys.stderr)
                return
            except OSError:
                continue  # a closed terminal, a full disk: the recording has the outcome
