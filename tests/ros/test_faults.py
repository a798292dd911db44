"""What people reported of ROS 2 and of recordings, tried here: docs/faults.md has each with its source."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, profile_text, wait_until
from weld_force_ros.errors import BagError
from weld_force_ros.messages import Settled, Verdict, decode
from weld_force_ros.recording import count_outcomes, open_bag
from weld_force_ros.recording.mcap_writer import AppendFile
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.ros import environment, qos
from weld_force_ros.ros.node_suite import KINDS, Kind, NodeSuite


def suite(folder: Path, bag: Path, outcomes: Outcomes, *ros_args: str, kinds: tuple[Kind, ...] = KINDS) -> NodeSuite:
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "2"},
        "assessment": {"bag": str(bag)},
    }
    return NodeSuite(
        kinds,
        parameters=parameters,
        ros_args=["--ros-args", *ros_args] if ros_args else [],
        load_simulator=QuickSimulator,
        on_verdict=outcomes,
        on_rejection=outcomes,
    )


def test_simulated_time_that_stands_still_or_goes_back_holds_nothing_up(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    """`use_sim_time` without `/clock`, then a clock that goes back, as of a player that begins again."""
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    clock = probe.publisher("/clock", 10, Clock)
    outcomes, bag = Outcomes(), tmp_path / "bag"
    with suite(folder, bag, outcomes, "-p", "use_sim_time:=true") as nodes:
        node = nodes.nodes["assessment"]
        for number, at_s in enumerate((0, 100, 50)):
            if at_s:
                clock.publish(Clock(clock=Time(sec=at_s)))
                wait_until(lambda at_s=at_s: node.get_clock().now().nanoseconds == at_s * 10**9)
            (folder / f"weld-{at_s}.csv").write_text(profile_text(100 + number))
            outcomes.wait(number + 1)
        diagnostics.wait(6)  # of each node two: its timer goes on, too
        assert nodes.drain(10.0) == 0
    recording = open_recording(bag)
    assert [(v.weld_id, v.stamp.sec) for v in recording.verdicts] == [("weld-0", 0), ("weld-100", 100), ("weld-50", 50)]
    # The recording's own times are the computer's: it is in order, and lasts as long as it did.
    newest_ns = max(message.log_time_ns for message in open_bag(bag).messages())
    assert abs(newest_ns * 1e-9 - time.time()) < DEADLINE_S


def test_remapped_topics_are_recorded_under_their_own_names(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    remapped = ("-r", "weld_profile:=/shop/welds", "-r", "verdict:=/shop/answers", "-r", "__ns:=/left")
    answers = probe.collect("/shop/answers", String, qos.CONTRACT)
    outcomes, bag = Outcomes(), tmp_path / "bag"
    (folder / "weld.csv").write_text(profile_text(100))
    with suite(folder, bag, outcomes, *remapped) as nodes:
        (text,) = answers.wait(1)
        assert decode(Verdict, text.data).weld_id == "weld"
        assert nodes.drain(10.0) == 0
    assert {"/left/weld_profile", "/left/verdict"} <= {topic for topic, _ in open_bag(bag).statistics.counts}
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.verdicts, ended.open) == (1, 1, 0)
    again = Outcomes()
    with suite(folder, bag, again, *remapped) as nodes:
        wait_until(lambda: nodes.nodes["assessment"].topics.sent(Settled))  # the file's outcome is known
        assert nodes.drain(10.0) == 0
    assert again.messages == []


@pytest.mark.parametrize(
    ("older", "newer", "left"),
    [
        (None, None, "LOCALHOST"),
        ("1", None, None),
        ("0", None, None),
        ("1", "SUBNET", "SUBNET"),
        (None, "SUBNET", "SUBNET"),
    ],
)
def test_the_older_variable_is_a_choice_as_the_newer_one_is(
    monkeypatch: pytest.MonkeyPatch, older: str | None, newer: str | None, left: str | None
) -> None:
    for name, value in (("ROS_LOCALHOST_ONLY", older), ("ROS_AUTOMATIC_DISCOVERY_RANGE", newer)):
        monkeypatch.delenv(name, raising=False)
        if value is not None:
            monkeypatch.setenv(name, value)
    environment.stay_on_this_machine()
    assert os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == left


def test_nodes_hear_each_other_where_both_variables_are_set(
    domain_id: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    outcomes = Outcomes()
    (folder / "weld.csv").write_text(profile_text(100))
    with (
        suite(folder, tmp_path / "bag", outcomes, kinds=("assessment",)),
        suite(folder, tmp_path / "bag", outcomes, kinds=("profile", "simulator")),
    ):
        outcomes.wait(1)


def test_another_domain_hears_nothing(domain_id: int, folder: Path, tmp_path: Path) -> None:
    outcomes, elsewhere = Outcomes(), domain_id % 100 + 101
    (folder / "weld.csv").write_text(profile_text(100))
    with Probe(elsewhere) as stranger:
        heard = stranger.collect("verdict", String, qos.CONTRACT)
        with suite(folder, tmp_path / "bag", outcomes):
            outcomes.wait(1)
    assert heard.messages == []


_LOOPBACK_UP = """
import fcntl, socket, struct
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
    fcntl.ioctl(any_socket, 0x8914, struct.pack("16sH14x", b"lo", 0x41))  # SIOCSIFFLAGS: up, running
"""
_SUITE = """
import sys
from pathlib import Path
from tests.harness.ros import Outcomes, profile_text
from tests.ros.test_faults import suite
folder, bag, outcomes = Path(sys.argv[1]), Path(sys.argv[1]).parent / "bag", Outcomes()
(folder / "weld.csv").write_text(profile_text(100))
"""
_IN_ONE_PROCESS = "with suite(folder, bag, outcomes): print(outcomes.wait(1)[0].weld_id)"
_APART = """
with suite(folder, bag, outcomes, kinds=("assessment",)), suite(folder, bag, outcomes, kinds=("profile", "simulator")):
    print(outcomes.wait(1)[0].weld_id)
"""
_CHECK = "from weld_force_ros.ros.environment import check_loopback; check_loopback()"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "printed", "complaint"),
    [
        (_SUITE + _IN_ONE_PROCESS, "weld", ""),
        (_LOOPBACK_UP + _SUITE + _APART, "weld", ""),
        (_CHECK, "", "ip link set lo up"),
    ],
    ids=["one process, no interface at all", "two participants, the loopback alone", "two, none: said"],
)
def test_a_computer_without_a_network(domain_id: int, folder: Path, script: str, printed: str, complaint: str) -> None:
    if subprocess.run(["unshare", "--net", "true"], capture_output=True, check=False).returncode:
        pytest.skip("no network namespace can be made here")
    root = str(Path(__file__).parents[2])
    command = ["unshare", "--net", sys.executable, "-c", script, str(folder)]
    given = {**os.environ, "PYTHONPATH": root}
    done = subprocess.run(command, env=given, cwd=root, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.strip() == printed, done.stderr[-2000:]
    assert complaint in done.stderr


def test_a_disk_that_becomes_read_only_is_said_and_its_welds_are_recorded_after_it_is_mended(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    outcomes, bag = Outcomes(), tmp_path / "bag"

    def refuse(self: AppendFile, data: bytes) -> int:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    (folder / "before.csv").write_text(profile_text(100))
    with suite(folder, bag, outcomes) as nodes:
        outcomes.wait(1)
        wait_until(lambda: nodes.nodes["assessment"].topics.sent(Settled) and not nodes.left)
        with monkeypatch.context() as patch:
            patch.setattr(AppendFile, "write", refuse)
            (folder / "meanwhile.csv").write_text(profile_text(200))
            outcomes.wait(2)  # a verdict that cannot be recorded is still worth publishing
            diagnostics.wait(1, lambda array: "not recorded" in array.status[0].message)
            with pytest.raises(BagError, match="Read-only file system"):
                nodes.close()
    assert [v.weld_id for v in open_recording(bag).verdicts] == ["before"]
    with suite(folder, bag, outcomes) as nodes:
        outcomes.wait(3)
        assert nodes.drain(10.0) == 0
    assert [v.weld_id for v in open_recording(bag).verdicts] == ["before", "meanwhile"]
