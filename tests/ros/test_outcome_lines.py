"""Outcomes as lines of standard output, whoever reads them."""

import subprocess
import sys

import pytest

from tests.harness.ros import DEADLINE_S
from weld_force_ros.messages import Rejection
from weld_force_ros.ros.outcome_lines import OutcomePrinter, outcome_line

UNREAD = """
from weld_force_ros.messages import Rejection
from weld_force_ros.ros import outcome_lines
outcome_lines.LAST_LINES_S = 0.1
with outcome_lines.OutcomePrinter() as printer:
    for number in range(2000):
        printer.print(Rejection(source=f"{number}.csv", reason="one " * 20, remedy="two"))
"""


def rejection(reason: str) -> Rejection:
    return Rejection(source="a.csv", reason=reason, remedy="state the unit")


def test_each_outcome_is_one_line_of_standard_output(capfd: pytest.CaptureFixture[str]) -> None:
    with OutcomePrinter() as printer:
        printer.print(rejection("no unit"))
        printer.print(rejection("no\nsign \x1b[2J\u202e here"))
    assert capfd.readouterr() == (
        "UNREADABLE a.csv: no unit; state the unit\nUNREADABLE a.csv: no sign  [2J  here; state the unit\n",
        "",
    )


def test_a_reader_that_stands_still_keeps_nobody_from_ending() -> None:
    with subprocess.Popen([sys.executable, "-c", UNREAD], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.wait(DEADLINE_S) == 0
        assert process.stderr is not None
        assert process.stderr.read() == b""


def test_a_program_without_standard_output_goes_on() -> None:
    program = UNREAD.replace("range(2000)", "range(2)")
    shell = ["bash", "-c", 'exec "$0" -c "$1" >&-', sys.executable, program]
    done = subprocess.run(shell, stderr=subprocess.PIPE, timeout=DEADLINE_S, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


def test_nothing_is_left_of_what_a_terminal_would_obey() -> None:
    assert outcome_line(rejection("\x1b]0;title\x07")).isprintable()
