"""Nodes as programs: signals, exit codes, the bag closed whatever happens."""

import gc
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader
from std_msgs.msg import String

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, profile_text, wait_until
from weld_force_ros.errors import TrackError
from weld_force_ros.messages import AssessmentSettings, Verdict, decode
from weld_force_ros.ros import qos
from weld_force_ros.ros.launcher import main, run_node, run_until_signal
from weld_force_ros.ros.node_suite import NodeSuite

pytestmark = pytest.mark.slow


@contextmanager
def node_process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "weld_force_ros.ros.launcher", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_sigterm_closes_the_bag_of_a_node_process(domain_id: int, probe: Probe, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    settings = probe.collect("assessment_settings", String, qos.CONTRACT)
    with node_process("assessment", "--ros-args", "-p", f"bag:={bag}") as process:
        settings.wait(1)
        probe.publish("force_map", "{broken")
        probe.collect("rejection", String, qos.CONTRACT).wait(1)
        process.terminate()
        out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0
    assert (len(out.splitlines()), out.startswith("UNREADABLE ")) == (1, True)
    assert "Traceback" not in err
    assert "clean shutdown, 0 pending" in err
    information = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in information["topics_with_message_count"]}
    assert {name: counts[name] for name in ("/assessment_settings", "/force_map", "/rejection")} == {
        "/assessment_settings": 1,
        "/force_map": 1,
        "/rejection": 1,
    }
    with AnyReader([bag]) as reader:
        texts = [data for connection, _, data in reader.messages() if connection.topic == "/assessment_settings"]
        (text,) = (reader.deserialize(data, "std_msgs/msg/String").data for data in texts)
    assert decode(AssessmentSettings, text).limits


def test_missing_folder_ends_the_process_with_code_2_and_one_line(domain_id: int) -> None:
    with node_process("profile") as process:
        out, err = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, out) == (2, "")
    assert err == "error: parameter folder is not set; name the folder to watch, e.g. -p folder:=measurements\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulator", "--ros-args", "-p", "track:=nowhere"], "nowhere"),
        (["simulator", "--", "--ros-args", "-p", "wheel_mass_kg:=heavy"], "wheel_mass_kg"),
        (["simulator", "--ros-args", "-p", "spedds:=40"], "write 'speeds'"),
        (["assessment", "--ros-args", "-p", "nonsense"], "nonsense"),
        (["assessment", "--unknown"], "--unknown"),
    ],
)
def test_bad_arguments_are_named_in_one_line(
    domain_id: int, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_node_that_cannot_work_ends_the_run(domain_id: int) -> None:
    def load(settings: Any) -> QuickSimulator:
        raise TrackError("no fit", "make one")

    with pytest.raises(TrackError, match="no fit"):
        run_until_signal(NodeSuite(("simulator",), load_simulator=load))


def slow_suite(folder: Path, bag: Path, outcomes: Outcomes, made: list[QuickSimulator]) -> NodeSuite:
    def load(settings: Any) -> QuickSimulator:
        made.append(QuickSimulator(settings))
        made[0].go_on.clear()
        return made[0]

    return NodeSuite(
        parameters={
            "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
            "simulator": {"uncertainty_samples": 0, "speeds": "40"},
            "assessment": {"bag": str(bag)},
        },
        load_simulator=load,
        on_verdict=outcomes,
    )


def aside(action: Any) -> threading.Thread:
    thread = threading.Thread(target=action)
    thread.start()
    return thread


def test_queued_profiles_are_finished_after_a_signal(domain_id: int, folder: Path, tmp_path: Path) -> None:
    for i in range(5):
        (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
    outcomes, made = Outcomes(), []
    suite = slow_suite(folder, tmp_path / "bag", outcomes, made)

    def stop_while_all_wait() -> None:
        wait_until(lambda: len(suite.nodes) == 3 and suite.nodes["simulator"].pending == 5)
        os.kill(os.getpid(), signal.SIGTERM)
        wait_until(lambda: not suite.nodes["profile"].watching)
        (folder / "late.csv").write_text(profile_text())
        made[0].go_on.set()

    thread = aside(stop_while_all_wait)
    assert run_until_signal(suite) == 0
    thread.join(DEADLINE_S)
    assert sorted(v.weld_id for v in outcomes.messages) == [f"weld-{i}" for i in range(5)]
    with AnyReader([tmp_path / "bag"]) as reader:
        assert sum(c.topic == "/verdict" for c, _, _ in reader.messages()) == 5


def test_modules_are_not_looked_at_for_garbage_while_nodes_run(domain_id: int) -> None:
    suite, frozen = NodeSuite(("assessment",)), list[int]()

    def stop() -> None:
        wait_until(lambda: gc.get_freeze_count() > 0)
        frozen.append(gc.get_freeze_count())
        os.kill(os.getpid(), signal.SIGTERM)

    gc.unfreeze()
    thread = aside(stop)
    assert run_until_signal(suite) == 0
    thread.join(DEADLINE_S)
    assert frozen[0] > 10_000
    assert gc.get_freeze_count() == 0


def test_second_signal_stops_at_once_and_says_what_is_left(
    domain_id: int, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for i in range(3):
        (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
    outcomes, made = Outcomes(), []
    suite = slow_suite(folder, tmp_path / "bag", outcomes, made)

    def stop_twice() -> None:
        wait_until(lambda: len(suite.nodes) == 3 and suite.nodes["simulator"].pending == 3)
        os.kill(os.getpid(), signal.SIGINT)
        # Signals that come before the first is dealt with are one; and the recorder is to have all but the simulations.
        wait_until(lambda: not suite.nodes["profile"].watching and suite.left == 3)
        os.kill(os.getpid(), signal.SIGINT)
        wait_until(lambda: suite.closing)
        made[0].go_on.set()

    thread = aside(stop_twice)
    assert run_until_signal(suite) == 1
    thread.join(DEADLINE_S)
    assert "3 messages pending" in capsys.readouterr().err
    assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_drain_gives_up_after_its_time(domain_id: int, folder: Path, tmp_path: Path) -> None:
    (folder / "weld.csv").write_text(profile_text())
    made: list[QuickSimulator] = []
    with slow_suite(folder, tmp_path / "bag", Outcomes(), made) as suite:
        wait_until(lambda: suite.nodes["simulator"].pending == 1)
        assert suite.drain(0.1) == 1
        made[0].go_on.set()
        wait_until(lambda: suite.left == 0)


def test_handlers_are_restored(domain_id: int) -> None:
    before = signal.getsignal(signal.SIGTERM)
    thread = aside(
        lambda: (wait_until(lambda: signal.getsignal(signal.SIGTERM) != before), os.kill(os.getpid(), signal.SIGTERM))
    )
    assert run_node("assessment") == 0
    thread.join(DEADLINE_S)
    assert signal.getsignal(signal.SIGTERM) == before


def test_three_processes_make_a_pipeline(domain_id: int, probe: Probe, folder: Path, tmp_path: Path) -> None:
    (folder / "weld.csv").write_text(profile_text(300))
    verdicts = probe.collect("verdict", String, qos.CONTRACT)
    simulator = ("simulator", "--ros-args", "-p", "speeds:=40,80", "-p", "positions:=2", "-p", "uncertainty_samples:=0")
    profile = ("profile", "--ros-args", "-p", f"folder:={folder}")
    assessment = ("assessment", "--ros-args", "-p", f"bag:={tmp_path / 'bag'}")
    with node_process(*assessment) as last, node_process(*simulator) as middle, node_process(*profile) as first:
        (text,) = verdicts.wait(1)
        for process in (first, middle, last):
            process.terminate()
        for process in (first, middle, last):
            _, err = process.communicate(timeout=DEADLINE_S)
            assert (process.returncode, "Traceback" in err) == (0, False)
    assert decode(Verdict, text.data).weld_id == "weld"
