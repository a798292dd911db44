"""The nodes end as one: a closed terminal, a supervisor that is killed, a second Ctrl-C, a recording that is held."""

import fcntl
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import psutil
import pytest

from tests.harness.ros import DEADLINE_S, profile_text, wait_until
from tests.soak.field import recorded
from weld_force_ros.recording import count_outcomes, open_bag

pytestmark = pytest.mark.slow


@contextmanager
def up(
    folder: Path, bag: Path, log: Path, *more: str, terminal: int | None = None, reader: int | None = None
) -> Iterator[psutil.Popen]:
    """The suite by its command line; what it prints goes to files, which outlive it, its input is the terminal's."""
    options = ["--speeds", "80", "--positions", "2", "--uncertainty-samples", "0", *more]
    command = [sys.executable, "-m", "weld_force_ros.cli", "up", "--folder", str(folder), "--bag", str(bag), *options]
    with log.open("a") as output:
        process = psutil.Popen(
            command,
            stderr=output,
            stdout=output if reader is None else reader,
            stdin=subprocess.DEVNULL if terminal is None else terminal,
            start_new_session=True,
            preexec_fn=None if terminal is None else lambda: fcntl.ioctl(terminal, termios.TIOCSCTTY, 0),
        )
        try:
            yield process
        finally:
            for one in [*_family(process), process]:
                with suppress(psutil.NoSuchProcess):
                    one.kill()
            process.wait(DEADLINE_S)


def _family(process: psutil.Popen) -> list[psutil.Process]:
    try:
        return process.children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def judged(log: Path) -> set[str]:
    return set(re.findall(r"^(?:ACCEPT|GRIND|REJECT|UNDECIDED) +(\S+?):", log.read_text(), re.MULTILINE))


def test_nodes_end_with_their_supervisor_and_the_same_line_goes_on(
    domain_id: int, folder: Path, tmp_path: Path
) -> None:
    """Both signals, forty times under load: `python -m tests.soak.lives`."""
    bag, log = tmp_path / "bag", tmp_path / "log"
    (folder / "first.csv").write_text(profile_text(100))
    with up(folder, bag, log, "--processes") as supervisor:
        wait_until(lambda: "first" in judged(log))
        nodes = supervisor.children()
        assert len(nodes) == 3
        supervisor.kill()
        (folder / "second.csv").write_text(profile_text(200))
        with up(folder, bag, log, "--processes") as again:  # at once, while the first is still stopping
            wait_until(lambda: "second" in judged(log))
            psutil.wait_procs(nodes, DEADLINE_S)
            assert not any(node.is_running() for node in nodes)
            again.send_signal(signal.SIGTERM)
            assert again.wait(DEADLINE_S) == 0
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.verdicts, ended.open, ended.doubled) == (2, 2, 0, 0)
    assert recorded(bag).judged == {"first", "second"}


def test_a_closed_terminal_closes_the_recording_of_the_suite_in_one_process(
    domain_id: int, folder: Path, tmp_path: Path
) -> None:
    bag, log = tmp_path / "bag", tmp_path / "log"
    (folder / "first.csv").write_text(profile_text(100))
    terminal, inside = pty.openpty()
    with up(folder, bag, log, terminal=inside) as process:
        os.close(inside)
        wait_until(lambda: "first" in judged(log))
        with up(folder, bag, tmp_path / "other") as second:  # meanwhile somebody else tries to record there
            assert second.wait(DEADLINE_S) == 2
        os.close(terminal)
        assert process.wait(DEADLINE_S) == 0
    assert open_bag(bag).summary().closed
    (refusal,) = [line for line in (tmp_path / "other").read_text().splitlines() if line.startswith("weld-force:")]
    assert f"by process {process.pid}, running since 2" in refusal
    assert f"kill {process.pid}" in refusal


def test_a_second_interrupt_ends_at_once_and_says_what_is_left(domain_id: int, folder: Path, tmp_path: Path) -> None:
    bag, log = tmp_path / "bag", tmp_path / "log"
    (folder / "first.csv").write_text(profile_text(100))
    # The reference engine takes minutes over so many passages: nothing is finished in the time that is waited here.
    slow = ["--engine", "reference", "--speeds", "20:300:1", "--positions", "40"]
    with up(folder, bag, log, *slow, "--processes") as process:
        wait_until(lambda: bag.exists() and any("weld_profile" in topic for topic, _ in _counts(bag)))
        process.send_signal(signal.SIGINT)
        wait_until(lambda: "a second signal stops at once" in log.read_text())
        began_s = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 1
        assert time.monotonic() - began_s < 4.0
        assert re.search("pending|ended at once", log.read_text())
        wait_until(lambda: not _family(process))
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.open) == (1, 1)


@pytest.mark.parametrize("processes", [(), ("--processes",)], ids=["one process", "processes"])
def test_verdicts_have_standard_output_and_go_on_without_a_reader(
    processes: tuple[str, ...], domain_id: int, folder: Path, tmp_path: Path
) -> None:
    """`weld-force up ... | head -1`, or a `grep -q` that has found what it looked for."""
    bag, log = tmp_path / "bag", tmp_path / "log"
    (folder / "first.csv").write_text(profile_text(100))
    reading, writing = os.pipe()
    with up(folder, bag, log, *processes, reader=writing) as process:
        os.close(writing)
        with os.fdopen(reading) as pipe:
            first = pipe.readline()
        assert re.fullmatch(r"(ACCEPT|UNDECIDED) +first: .+\n", first)
        for later in ("second", "third"):
            (folder / f"{later}.csv").write_text(profile_text(100 + len(later)))
            wait_until(partial(_is_judged, later, bag))
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE_S) == 0
    said = log.read_text()
    assert said.count("nobody reads the verdicts any more") == 1
    assert not re.search("ACCEPT|UNDECIDED|Traceback|Broken pipe", said)
    assert open_bag(bag).summary().closed
    assert recorded(bag).judged == {"first", "second", "third"}


def _is_judged(weld: str, bag: Path) -> bool:
    return weld in recorded(bag).judged


def _counts(bag: Path) -> set[tuple[str, str]]:
    try:
        return {(topic, str(definition)) for topic, definition in open_bag(bag).statistics.counts}
    except Exception:  # it is only being begun
        return set()


def test_a_hangup_that_is_ignored_stays_so(domain_id: int, folder: Path, tmp_path: Path) -> None:
    """As under `nohup`."""
    from weld_force_ros.ros.launcher import stop_signals

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_signals() as (stop, _):
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.wait(0.2)
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
