"""What happens in the field: late joiners, restarts, two of a kind, slow subscribers, clocks that are set."""

import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import String

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, profile_text, wait_until
from weld_force_ros.errors import BagError
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.messages import ForceMap, Inquiry, Rejection, Settled, Verdict, WeldProfile, decode, encode
from weld_force_ros.recording import open_bag
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.ros import contract_topics, qos
from weld_force_ros.ros.diagnostics import NodeDiagnostics
from weld_force_ros.ros.node_suite import KINDS, Kind, NodeSuite

pytestmark = pytest.mark.slow

BAD = "# x_unit: mm\nx,z\n0,nonsense\n"


def suite(
    folder: Path, bag: Path | str = "", kinds: tuple[Kind, ...] = KINDS, outcomes: Outcomes | None = None
) -> NodeSuite:
    return NodeSuite(
        kinds,
        parameters={
            "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
            "simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "0.15"},
            "assessment": {"bag": str(bag)},
        },
        load_simulator=QuickSimulator,
        on_verdict=outcomes,
        on_rejection=outcomes,
    )


def drop(folder: Path, first: int, last: int) -> None:
    for i in range(first, last):
        (folder / f"weld-{i:03}.csv").write_text(profile_text(100 + i))


def welds(first: int, last: int) -> list[str]:
    return [f"weld-{i:03}" for i in range(first, last)]


def judged(bag: Path) -> Counter[str]:
    return Counter(v.weld_id for v in open_recording(bag).verdicts)


def values_of(array: DiagnosticArray) -> dict[str, str]:
    return {value.key: value.value for value in array.status[0].values}


@pytest.mark.parametrize("late", KINDS)
def test_node_that_joins_late_makes_good_what_it_missed(
    domain_id: int, folder: Path, tmp_path: Path, late: Kind
) -> None:
    drop(folder, 0, 20)
    (folder / "bad.csv").write_text(BAD)
    bag, outcomes = tmp_path / "bag", Outcomes()
    early: tuple[Kind, ...] = tuple(kind for kind in KINDS if kind != late)
    with suite(folder, bag, early, outcomes) as running:
        if late == "assessment":
            wait_until(lambda: running.nodes["simulator"].topics.sent(ForceMap) == 20)
        elif late == "simulator":
            wait_until(lambda: running.nodes["profile"].topics.sent(WeldProfile) == 20)
        with suite(folder, bag, (late,), outcomes):
            outcomes.wait(21)
    assert sorted(v.weld_id for v in outcomes.of(Verdict)) == welds(0, 20)
    assert judged(bag) == Counter(welds(0, 20))
    assert len(open_recording(bag).rejections) == 1


def test_continued_bag_holds_every_outcome_once(domain_id: int, folder: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    for day in range(3):
        drop(folder, 0, 5 * (day + 1))
        (folder / f"bad-{day}.csv").write_text(BAD + "#" * day)
        outcomes = Outcomes()
        with suite(folder, bag, outcomes=outcomes) as running:
            outcomes.wait(6)
            assert running.drain(10.0) == 0
        assert sorted(v.weld_id for v in outcomes.of(Verdict)) == welds(5 * day, 5 * day + 5)
        assert [r.source for r in outcomes.of(Rejection)] == [f"bad-{day}.csv"]
    assert judged(bag) == Counter(welds(0, 15))
    assert len(open_recording(bag).rejections) == 3
    assert open_bag(bag).damage is None


def test_another_bag_is_another_day(domain_id: int, folder: Path, tmp_path: Path) -> None:
    drop(folder, 0, 3)
    for day in ("monday", "tuesday"):
        outcomes = Outcomes()
        with suite(folder, tmp_path / day, outcomes=outcomes):
            outcomes.wait(3)
        assert judged(tmp_path / day) == Counter(welds(0, 3))


def test_what_was_accepted_without_an_outcome_gets_it_when_the_bag_is_continued(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    """A profile of a foreign publisher lies in no folder: the bag is its only copy."""
    bag = tmp_path / "bag"
    profile = parse_profile(profile_text(weld_id="foreign"), "foreign.csv")
    with suite(folder, bag, ("assessment",)) as first:
        probe.publish("weld_profile", encode(profile).decode())
        wait_until(lambda: first.open_count == 1)
    probe_gone = Outcomes()
    with suite(folder, bag, ("simulator", "assessment"), probe_gone):
        (verdict,) = probe_gone.wait(1)
    assert verdict.weld_id == "foreign"
    assert judged(bag) == Counter(["foreign"])


def test_map_that_was_recorded_but_not_judged_is_judged_without_being_computed_again(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from weld_force_ros.ros.nodes.assessment_node import AssessmentNode

    bag, outcomes = tmp_path / "bag", Outcomes()
    drop(folder, 0, 1)
    with monkeypatch.context() as killed, suite(folder, bag) as first:
        killed.setattr(AssessmentNode, "_assess", lambda *_: None)  # as if killed in between
        wait_until(lambda: first.nodes["assessment"].topics.diagnostics.received["force_history"] == 1)
    with suite(folder, bag, ("assessment",), outcomes):
        outcomes.wait(1)
    assert judged(bag) == Counter(welds(0, 1))


def test_verdict_that_was_recorded_but_perhaps_not_sent_is_sent_as_it_was(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from weld_force_ros.ros.nodes.published_ledger import PublishedLedger

    bag = tmp_path / "bag"
    drop(folder, 0, 1)
    with monkeypatch.context() as killed, suite(folder, bag) as first:
        killed.setattr(PublishedLedger, "settle", lambda *_: None)  # as if killed in between
        wait_until(lambda: first.nodes["assessment"].topics.sent(Verdict) == 1)
    (recorded,) = open_recording(bag).verdicts
    verdicts = probe.collect("verdict", String, qos.CONTRACT)
    with suite(folder, bag) as again:
        (message,) = verdicts.wait(1)
        wait_until(lambda: again.nodes["assessment"].topics.sent(Settled) >= 1)
    assert decode(Verdict, message.data) == recorded
    assert judged(bag) == Counter(welds(0, 1))


def test_ledger_answers_inquiries(domain_id: int, probe: Probe, folder: Path) -> None:
    outcomes, answers = Outcomes(), probe.collect("settled", String, qos.CONTRACT)
    drop(folder, 0, 1)
    with suite(folder, outcomes=outcomes):
        (verdict,) = outcomes.wait(1)
        question = Inquiry(profile_ids=[verdict.profile_id, "0" * 64], publisher="/asker#1", sequence=7)
        probe.publish("inquiry", encode(question).decode(), qos.STREAM)
        (answer,) = answers.wait(1, lambda m: decode(Settled, m.data).asked_by == "/asker#1")
    settled = decode(Settled, answer.data)
    assert (settled.profile_ids, settled.asked_sequence) == ([verdict.profile_id], 7)


def test_two_simulators_by_mistake_make_one_verdict_each_and_are_named(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    outcomes, bag = Outcomes(), tmp_path / "bag"
    with suite(folder, bag, outcomes=outcomes), suite(folder, "", ("simulator",)):
        diagnostics.wait(1, lambda a: a.status[0].name == "/simulator_node" and "2 simulators" in a.status[0].message)
        drop(folder, 0, 10)
        (folder / "impossible.csv").write_text(profile_text(weld_id="impossible"))
        outcomes.wait(11)
    assert judged(bag) == Counter(welds(0, 10))
    assert [r.source for r in open_recording(bag).rejections] == ["impossible.csv"]


def test_second_assessment_node_cannot_write_the_same_bag(domain_id: int, folder: Path, tmp_path: Path) -> None:
    with (
        suite(folder, tmp_path / "bag", ("assessment",)),
        pytest.raises(BagError, match="bag"),
        suite(folder, tmp_path / "bag", ("assessment",)),
    ):
        pass


def test_subscriber_that_is_stuck_holds_nobody_up(
    domain_id: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(qos.KEPT_DEPTH, ForceMap, 16)  # full sooner
    code = (
        "import rclpy, sys; from std_msgs.msg import String; from weld_force_ros.ros import qos; rclpy.init();"
        "node = rclpy.create_node('slow');"
        "node.create_subscription(String, 'force_map', lambda m: (print('received', flush=True)), qos.CONTRACT);"
        "rclpy.spin(node)"
    )
    outcomes = Outcomes()
    listener = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        with suite(folder, tmp_path / "bag", outcomes=outcomes):
            drop(folder, 0, 1)
            assert listener.stdout is not None
            assert listener.stdout.readline() == "received\n"
            listener.send_signal(signal.SIGSTOP)
            drop(folder, 1, 2 * qos.KEPT_DEPTH[ForceMap])
            outcomes.wait(2 * qos.KEPT_DEPTH[ForceMap])
    finally:
        listener.kill()
        listener.communicate()
    assert judged(tmp_path / "bag") == Counter(welds(0, 2 * qos.KEPT_DEPTH[ForceMap]))


def test_clock_set_back_by_an_hour_loses_nothing(
    domain_id: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real_ns, outcomes, bag = time.time_ns, Outcomes(), tmp_path / "bag"
    with suite(folder, bag, outcomes=outcomes) as running:
        drop(folder, 0, 3)
        outcomes.wait(3)
        monkeypatch.setattr(contract_topics.time, "time_ns", lambda: real_ns() - 3_600_000_000_000)
        drop(folder, 3, 6)
        outcomes.wait(6)
        assert running.drain(10.0) == 0
    assert judged(bag) == Counter(welds(0, 6))
    times = [m.log_time_ns for m in open_bag(bag).messages()]
    assert times == sorted(times)
    assert times[-1] - times[0] > 3_000_000_000_000


def test_clock_that_was_set_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    from weld_force_ros.ros import diagnostics

    node, real = NodeDiagnostics("/node", "/node#1"), time.time
    assert node.status().values[-1].value == ""
    monkeypatch.setattr(diagnostics.time, "time", lambda: real() + 60)
    assert "clock was set by +60.0 s" in node.status().values[-1].value


def test_flood_of_a_foreign_publisher_waits_where_it_is_kept(domain_id: int, probe: Probe, folder: Path) -> None:
    made: list[QuickSimulator] = []

    def load(settings: Any) -> QuickSimulator:
        made.append(QuickSimulator(settings))
        made[0].go_on.clear()
        return made[0]

    maps = probe.collect("force_map", String, qos.CONTRACT)
    with NodeSuite(
        ("simulator",), parameters={"simulator": {"uncertainty_samples": 0, "speeds": "40"}}, load_simulator=load
    ) as running:
        longest = 0
        for i in range(300):
            profile = parse_profile(profile_text(100 + i, f"weld-{i:03}"), f"{i}.csv")
            probe.publish("weld_profile", encode(profile).decode())
            longest = max(longest, running.nodes["simulator"].pending)
        wait_until(lambda: running.nodes["simulator"].pending >= 64)
        assert running.nodes["simulator"].pending <= 66
        made[0].go_on.set()
        maps.wait(300)
    assert longest <= 66
    assert sorted(decode(ForceMap, m.data).weld_id for m in maps.messages) == welds(0, 300)


def test_message_too_large_is_not_even_parsed(domain_id: int, probe: Probe, folder: Path) -> None:
    outcomes = Outcomes()
    with suite(folder, "", ("simulator", "assessment"), outcomes):
        probe.publish("weld_profile", "[" * (17 * 2**20))
        (rejection,) = outcomes.wait(1)
    assert "bytes, which was not read" in rejection.raw_text


def test_diagnostics_hold_what_an_operator_needs(domain_id: int, probe: Probe, folder: Path, tmp_path: Path) -> None:
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    outcomes = Outcomes()
    with suite(folder, tmp_path / "bag", outcomes=outcomes):
        drop(folder, 0, 3)
        outcomes.wait(3)
        (array, *_) = diagnostics.wait(
            1,
            lambda a: a.status[0].name == "/assessment_node" and values_of(a)["measurements with outcome"] == "3",
        )
    values = values_of(array)
    assert int(values["seconds since last verdict"]) < DEADLINE_S
    assert float(values["disk free MB"]) > 0
    assert values["measurements without outcome"] == "0"
    assert values["sequence gaps"] == "0"
    assert float(values["received force_map per s"]) >= 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    mount = tmp_path / "disk"
    mount.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=200m", "tmpfs", str(mount)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"no file system can be mounted here: {made.stderr.strip()}")
    yield mount
    subprocess.run(["umount", "-l", str(mount)], check=True)


def test_full_disk_is_announced_stops_judging_and_goes_on_when_there_is_room(
    domain_id: int, probe: Probe, folder: Path, small_disk: Path
) -> None:
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    outcomes, bag, ballast = Outcomes(), small_disk / "bag", small_disk / "ballast"

    def has(level: bytes, clause: str) -> Callable[[DiagnosticArray], bool]:
        return lambda a: (
            a.status[0].name == "/assessment_node" and a.status[0].level == level and clause in a.status[0].message
        )

    with suite(folder, bag, outcomes=outcomes) as running:
        drop(folder, 0, 3)
        outcomes.wait(3)
        diagnostics.wait(1, has(DiagnosticStatus.WARN, "disk nearly full"))
        ballast.write_bytes(bytes(150_000_000))
        drop(folder, 3, 9)
        diagnostics.wait(1, has(DiagnosticStatus.ERROR, "disk full"))
        assert len(outcomes.messages) == 3
        ballast.unlink()
        outcomes.wait(9)
        assert running.drain(10.0) == 0
    assert judged(bag) == Counter(welds(0, 9))
    assert len(list(bag.glob("*.mcap"))) == 2
    assert open_bag(bag).damage is None


def test_outcomes_that_a_killed_ledger_did_not_publish_are_inquired_for(
    domain_id: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = tmp_path / "bag"
    with suite(folder, bag, ("profile",)) as early:
        with suite(folder, bag, ("simulator", "assessment")) as killed:
            # Recorded, as if the process were killed before the message leaves it.
            monkeypatch.setattr(
                killed.nodes["assessment"].topics._publishers[Settled], "publish_recorded", lambda cdr: None
            )
            drop(folder, 0, 3)
            wait_until(lambda: killed.nodes["assessment"].topics.sent(Settled) >= 3)
            assert early.nodes["profile"]._flow_control.under_way == 3
        with suite(folder, bag, ("simulator", "assessment")):
            wait_until(lambda: early.nodes["profile"]._flow_control.under_way == 0)
    assert judged(bag) == Counter(welds(0, 3))


def test_suite_started_on_a_full_disk_waits_for_room_and_can_be_stopped(
    domain_id: int, folder: Path, small_disk: Path
) -> None:
    (small_disk / "ballast").write_bytes(bytes(150_000_000))
    drop(folder, 0, 2)
    outcomes = Outcomes()
    with suite(folder, small_disk / "bag") as stopped:
        wait_until(lambda: stopped.nodes["assessment"].recorder.disk_full)
    with suite(folder, small_disk / "bag", outcomes=outcomes) as running:
        wait_until(lambda: running.nodes["assessment"].recorder.disk_full)
        (small_disk / "ballast").unlink()
        outcomes.wait(2)
    assert judged(small_disk / "bag") == Counter(welds(0, 2))
