"""The three nodes together: a file dropped, a verdict out, everything in the bag."""

import json
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import String

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, profile_text, wait_until
from weld_force_ros.assessment.judge import assess_vehicles
from weld_force_ros.assessment.limits import worst
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError, TrackError
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.messages import (
    SCHEMA_VERSION,
    TOPICS,
    ForceHistory,
    ForceMap,
    Message,
    Rejection,
    Settled,
    SimulationSettings,
    Verdict,
    WeldProfile,
    decode,
    encode,
)
from weld_force_ros.recording import STRING, Recorder, string_cdr
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.recording.replay import replay
from weld_force_ros.recording.weld_records import records_of_recording
from weld_force_ros.ros import qos
from weld_force_ros.ros.node_suite import KINDS, Kind, NodeSuite
from weld_force_ros.simulation.curve_refinement import Asks
from weld_force_ros.simulation.simulator import Simulator

SPEEDS = "40,80,120"
POSITIONS = "0.15,0.30"


@contextmanager
def running(
    outcomes: Outcomes,
    kinds: tuple[Kind, ...] = KINDS,
    *,
    folder: Path | None = None,
    bag: Path | None = None,
    load: Callable[[SimulationSettings], Any] = QuickSimulator,
    **simulator: Any,
) -> Iterator[NodeSuite]:
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder or ""), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": SPEEDS, "positions": POSITIONS, **simulator},
        "assessment": {"bag": str(bag or "")},
    }
    with NodeSuite(
        kinds, parameters=parameters, load_simulator=load, on_verdict=outcomes, on_rejection=outcomes
    ) as suite:
        yield suite


def read_bag(bag: Path) -> dict[str, list[Any]]:
    """All messages by topic, in log order, by a reader that is not ours."""
    messages = defaultdict(list)
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            messages[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return messages


def contract_messages(messages: dict[str, list[Any]], kind: type[Message]) -> list[Any]:
    return [decode(kind, message.data) for message in messages[f"/{TOPICS[kind].name}"]]


def one_of_each(outcomes: Outcomes) -> tuple[Rejection, Verdict]:
    """The only rejection and the only verdict; which comes first is open, they are of different nodes."""
    outcomes.wait(2)
    (rejection,), (verdict,) = outcomes.of(Rejection), outcomes.of(Verdict)
    return rejection, verdict


def profile(weld_id: str, height_um: float = 200.0) -> WeldProfile:
    return parse_profile(profile_text(height_um, weld_id), f"{weld_id}.csv")


def test_every_file_has_one_outcome_and_the_bag_holds_all(domain_id: int, folder: Path, tmp_path: Path) -> None:
    for i in range(20):
        (folder / f"good-{i:02}.csv").write_text(profile_text(100 + i))
    for i in range(10):
        (folder / f"bad-{i:02}.csv").write_text(f"# x_unit: mm\nx,z\n{i},nonsense\n")
    outcomes, bag = Outcomes(), tmp_path / "bag"
    with running(outcomes, folder=folder, bag=bag) as suite:
        outcomes.wait(30)
        assert suite.drain(10.0) == 0
    assert sorted(v.weld_id for v in outcomes.of(Verdict)) == [f"good-{i:02}" for i in range(20)]
    assert sorted(r.source for r in outcomes.of(Rejection)) == [f"bad-{i:02}.csv" for i in range(10)]

    messages = read_bag(bag)
    for kind, topic in TOPICS.items():
        recorded = contract_messages(messages, kind)
        if topic.name not in ("settled", "inquiry", "rail_surface", "weld_marker"):
            assert len(recorded) == {"rejection": 10}.get(topic.name, 1 if topic.name.endswith("_settings") else 20)
        assert [m.sequence for m in recorded] == list(range(len(recorded)))
    ends = [m.profile_id for kind in (Verdict, Rejection) for m in contract_messages(messages, kind)]
    confirmed = [i for m in contract_messages(messages, Settled) if not m.asked_by for i in m.profile_ids]
    assert sorted(ends) == sorted(confirmed)
    assert len(set(ends)) == 30
    assert [v.weld_id for v in contract_messages(messages, Verdict)] == [v.weld_id for v in outcomes.of(Verdict)]
    assert [w.wrench.force.z for w in messages["/peak_force"]] == [v.peak_force_n for v in outcomes.of(Verdict)]
    assert [plotted(array)["weld/peak_force_n"] for array in messages["/criteria"]] == [
        v.peak_force_n for v in outcomes.of(Verdict)
    ]


def plotted(array: Any) -> dict[str, float | str]:
    """What PlotJuggler makes of a DiagnosticArray (`ParserROS::parseDiagnosticMsg`): names of series and values."""
    found: dict[str, float | str] = {}
    for status in array.status:
        prefix = f"{status.hardware_id}/{status.name}" if status.hardware_id else status.name
        found |= {f"{prefix}/level": float(ord(status.level)) if isinstance(status.level, bytes) else status.level}
        for pair in status.values:
            try:
                found[f"{prefix}/{pair.key}"] = float(pair.value)
            except ValueError:
                found[f"{prefix}/{pair.key}"] = pair.value
    return found


def test_real_simulation_from_file_to_recorded_verdict(domain_id: int, folder: Path, tmp_path: Path) -> None:
    outcomes, bag = Outcomes(), tmp_path / "bag"
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": SPEEDS, "positions": POSITIONS},
        "assessment": {"bag": str(bag)},
    }
    with NodeSuite(parameters=parameters, on_verdict=outcomes, on_rejection=outcomes) as suite:
        (folder / "dip.csv").write_text(profile_text(300))
        (verdict,) = outcomes.wait(1)
        assert suite.drain(10.0) == 0
    (force_map,) = contract_messages(read_bag(bag), ForceMap)
    assert (force_map.speeds_kmh, force_map.positions_m) == ([40.0, 80.0, 120.0], [0.15, 0.30])
    assert verdict.weld_id == "dip"
    peaks_n = [*force_map.peak_force_n, *force_map.against.peak_force_n]
    assert verdict.peak_force_n == max(peaks_n) > 1.1 * force_map.static_load_n


class VehicleSimulator(QuickSimulator):
    """Forces rise with the unsprung mass; a weld named `derails` cannot be computed under the locomotive."""

    def force_map(self, profile: WeldProfile, asks: Asks | None = None) -> ForceMap:
        force_map = super().force_map(profile, asks)
        if profile.weld_id == "derails" and self.settings.vehicle == "locomotive":
            raise ArithmeticError("no such passage")
        force_map.peak_force_n = [peak + self.settings.wheel_mass_kg for peak in force_map.peak_force_n]
        return force_map


SEVERAL = {"load": VehicleSimulator, "vehicle": "passenger,locomotive,metro"}


def test_a_weld_under_several_vehicles_has_one_verdict(domain_id: int, folder: Path, tmp_path: Path) -> None:
    names = [f"weld-{i:02}" for i in range(10)]
    for number, name in enumerate(names):
        (folder / f"{name}.csv").write_text(profile_text(100 + number))
    (folder / "derails.csv").write_text(profile_text(500))
    outcomes, bag = Outcomes(), tmp_path / "bag"
    with running(outcomes, folder=folder, bag=bag, **SEVERAL) as suite:
        outcomes.wait(11)
        assert suite.drain(10.0) == 0
    messages = read_bag(bag)
    heaviest = max(contract_messages(messages, SimulationSettings), key=lambda s: s.wheel_mass_kg)
    assert heaviest.vehicle == "locomotive"
    verdicts = {verdict.weld_id: verdict for verdict in contract_messages(messages, Verdict)}
    assert sorted(v.weld_id for v in outcomes.of(Verdict)) == sorted(verdicts) == names
    for number, name in enumerate(names):
        assert (verdicts[name].vehicle, verdicts[name].config_sha256) == ("locomotive", heaviest.config_sha256)
        expected = QuickSimulator.peak_n((100 + number) * 1e-6, 120.0, 0.30) + heaviest.wheel_mass_kg
        assert verdicts[name].peak_force_n == pytest.approx(expected)
    (rejection,) = contract_messages(messages, Rejection)
    assert (rejection.source, rejection.reason) == ("derails.csv", "no such passage")
    of_each = ["passenger", "locomotive", "metro"]
    maps = contract_messages(messages, ForceMap)
    assert [(m.weld_id, m.vehicle) for m in maps] == [(m.weld_id, v) for m in maps[::3] for v in of_each]
    assert len(maps) == len(contract_messages(messages, ForceHistory)) == 30
    settled = [i for m in contract_messages(messages, Settled) if not m.asked_by for i in m.profile_ids]
    assert len(settled) == len(set(settled)) == 11


def test_vehicles_may_be_named_anew_while_welds_come(domain_id: int, folder: Path) -> None:
    outcomes = Outcomes()
    with running(outcomes, folder=folder, **SEVERAL) as suite:
        (folder / "a.csv").write_text(profile_text(100))
        outcomes.wait(1)
        suite.nodes["simulator"].set_parameters([Parameter("speeds", value="40,80")])
        (folder / "b.csv").write_text(profile_text(100))
        outcomes.wait(2)
        assert suite.drain(10.0) == 0
    assert [(v.weld_id, v.vehicle) for v in outcomes.messages] == [("a", "locomotive"), ("b", "locomotive")]


@pytest.mark.parametrize("recorded", [1, 2, 3])
def test_a_bag_cut_between_the_maps_of_a_weld_is_continued_to_one_verdict(
    domain_id: int, folder: Path, tmp_path: Path, recorded: int
) -> None:
    (folder / "w.csv").write_text(profile_text(300))
    with running(Outcomes(), folder=folder, bag=tmp_path / "whole", **SEVERAL) as suite:
        wait_until(lambda: suite.nodes["assessment"].topics.sent(Verdict))
        assert suite.drain(10.0) == 0
    whole = read_bag(tmp_path / "whole")
    with Recorder(tmp_path / "cut") as recorder:
        kept = [*whole["/simulation_settings"], *whole["/weld_profile"], *whole["/force_map"][:recorded]]
        topics = ["simulation_settings"] * 3 + ["weld_profile"] + ["force_map"] * recorded
        for at, (topic, message) in enumerate(zip(topics, kept, strict=True)):
            recorder.write(f"/{topic}", STRING, string_cdr(message.data), log_time_ns=at, publish_time_ns=at)
    outcomes = Outcomes()
    kinds: tuple[Kind, ...] = ("assessment",) if recorded == 3 else KINDS
    with running(outcomes, kinds, folder=folder, bag=tmp_path / "cut", **SEVERAL) as suite:
        outcomes.wait(1)
        assert suite.drain(10.0) == 0
    (verdict,) = contract_messages(read_bag(tmp_path / "cut"), Verdict)
    assert (verdict.weld_id, verdict.vehicle) == ("w", "locomotive")
    assert [v.weld_id for v in outcomes.messages] == ["w"]


def test_a_recording_of_several_vehicles_is_replayed(domain_id: int, folder: Path, tmp_path: Path) -> None:
    named = {"speeds": "60,120", "positions": "0.15,0.30", "vehicle": "passenger,freight-22.5t"}
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, **named},
        "assessment": {"bag": str(tmp_path / "bag")},
    }
    outcomes = Outcomes()
    with NodeSuite(parameters=parameters, on_verdict=outcomes, on_rejection=outcomes) as suite:
        for height_um in (100, 300):
            (folder / f"dip-{height_um}.csv").write_text(profile_text(height_um))
        outcomes.wait(2)
        assert suite.drain(10.0) == 0
    recording = open_recording(tmp_path / "bag")
    replayed = list(replay(recording))
    assert [(r.kind, r.differences) for r in replayed] == [
        (kind, ()) for _ in range(2) for kind in ("force_map", "force_map", "verdict")
    ]
    by_config = {one.config_sha256: Simulator(one) for one in recording.settings.values()}
    for verdict in recording.verdicts:
        profile = recording.profiles[verdict.weld_id, verdict.profile_sha256]
        alone = assess_vehicles(profile, list(by_config.values()), load_limits()).verdict
        assert (verdict.vehicle, verdict.peak_force_n) == (alone.vehicle, alone.peak_force_n)
    records = records_of_recording(recording, load_limits("force"), load_limits())
    assert [record.verdict.weld_id for record in records] == ["dip-100", "dip-300"]
    assert all(r.force_map.config_sha256 == r.history.config_sha256 == r.verdict.config_sha256 for r in records)


def test_verdict_names_the_worst_passage_and_has_typed_twins(domain_id: int, probe: Probe) -> None:
    outcomes, wrenches = Outcomes(), probe.collect("peak_force", WrenchStamped, qos.PLOT)
    arrays = probe.collect("criteria", DiagnosticArray, qos.PLOT)
    with running(outcomes, ("simulator", "assessment")):
        probe.publish("weld_profile", encode(profile("known", 500.0)).decode())
        (verdict,) = outcomes.wait(1)
        (wrench,), (array,) = wrenches.wait(1), arrays.wait(1)
    expected = 50e3 + 1e3 * (0.5 + 120.0 + 0.30)  # 0.5 mm, 120 km/h, 0.30 m, by the formula of QuickSimulator
    assert verdict.peak_force_n == pytest.approx(expected)
    assert (verdict.worst_speed_kmh, verdict.worst_position_m) == (120.0, 0.30)
    assert wrench.wrench.force.z == pytest.approx(expected)
    assert wrench.header.frame_id == "rail"
    numbers = plotted(array)
    assert (numbers["weld/weld_id"], numbers["weld/decision"]) == ("known", verdict.decision)
    assert numbers["weld/peak_force_n"] == numbers["weld/peak_force/value"] == verdict.peak_force_n
    for criterion in verdict.criteria:
        assert numbers[f"weld/{criterion.name}/value"] == criterion.value
        assert numbers[f"weld/{criterion.name}/limit"] == criterion.limit
        if criterion.limit:
            assert numbers[f"weld/{criterion.name}/ratio"] == criterion.value / criterion.limit


class UnloadingSimulator(QuickSimulator):
    """The wheel is unloaded most in the slowest passage, at the first position: not where the peak is highest."""

    def force_map(self, profile: WeldProfile, asks: Asks | None = None) -> ForceMap:
        force_map = super().force_map(profile, asks)
        force_map.min_force_n[0] = 5e3
        return force_map


def test_history_is_of_the_passage_that_decided_by_the_limits_that_hold(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    criterion = "- {{name: {}, limit: {}, reject_limit: 1.0e+6, unit: '{}', source: hand}}\n"
    unloading, peak = tmp_path / "unloading.yaml", tmp_path / "peak.yaml"
    unloading.write_text(criterion.format("peak_force", 1e6, "N") + criterion.format("unloading", 0.1, "1"))
    peak.write_text(criterion.format("peak_force", 1e3, "N"))
    outcomes, histories = Outcomes(), probe.collect("force_history", String, qos.CONTRACT)
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": SPEEDS, "positions": POSITIONS},
        "assessment": {"limits": str(unloading)},
    }
    with NodeSuite(parameters=parameters, load_simulator=UnloadingSimulator, on_verdict=outcomes) as suite:
        simulator = suite.nodes["simulator"].topics.diagnostics
        for number, limits in enumerate((unloading, peak)):
            suite.nodes["assessment"].set_parameters([Parameter("limits", value=str(limits))])
            wait_until(lambda count=number + 2: simulator.received["assessment_settings"] >= count)
            (folder / f"weld-{number}.csv").write_text(profile_text(100 + number))
            histories.wait(number + 1)
            outcomes.wait(number + 1)
    verdicts = outcomes.messages
    for message, verdict, name in zip(histories.messages, verdicts, ("unloading", "peak_force"), strict=True):
        history = decode(ForceHistory, message.data)
        decided = worst(verdict.criteria)
        assert (decided.name, history.profile_id) == (name, verdict.profile_id)
        assert (history.speed_kmh, history.position_m) == (decided.speed_kmh, decided.position_m)
    assert [decode(ForceHistory, m.data).speed_kmh for m in histories.messages] == [40.0, 120.0]


def test_without_limits_the_history_is_of_the_highest_peak(domain_id: int, probe: Probe) -> None:
    histories = probe.collect("force_history", String, qos.CONTRACT)
    with running(Outcomes(), ("simulator",), load=UnloadingSimulator):
        probe.publish("assessment_settings", '{"schema_version": "7.0"}')  # of a later version: not valid here
        probe.publish("weld_profile", encode(profile("known")).decode())
        (message,) = histories.wait(1)
    history = decode(ForceHistory, message.data)
    assert (history.speed_kmh, history.position_m) == (120.0, 0.30)


@pytest.mark.slow
def test_late_simulator_gets_every_profile(domain_id: int, folder: Path) -> None:
    welds = 150  # more than the topic of profiles keeps
    for i in range(welds):
        (folder / f"weld-{i:03}.csv").write_text(profile_text(100 + i))
    outcomes = Outcomes()
    with running(outcomes, ("profile", "assessment"), folder=folder) as early:
        wait_until(
            lambda: early.nodes["profile"].topics.sent(WeldProfile) == qos.MAX_OUTSTANDING
        )  # the others wait as files
        with running(outcomes, ("simulator",)):
            outcomes.wait(welds)
    assert sorted(v.weld_id for v in outcomes.messages) == [f"weld-{i:03}" for i in range(welds)]


def test_restarted_simulator_brings_no_second_verdict(domain_id: int, folder: Path, tmp_path: Path) -> None:
    for i in range(5):
        (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
    outcomes = Outcomes()
    with running(outcomes, ("profile", "assessment"), folder=folder, bag=tmp_path / "bag"):
        for i in range(3):
            with running(Outcomes(), ("simulator",)):
                # A new weld comes last: when it is judged, the latched profiles have been dealt with.
                (folder / f"weld-{5 + i}.csv").write_text(profile_text(300 + i))
                outcomes.wait(1, lambda v, i=i: v.weld_id == f"weld-{5 + i}")
    assert sorted(v.weld_id for v in outcomes.messages) == [f"weld-{i}" for i in range(8)]


def test_copies_of_a_file_each_get_a_verdict(domain_id: int, folder: Path) -> None:
    for name in ("one.csv", "two.csv"):
        (folder / name).write_text(profile_text(weld_id="same"))
    outcomes = Outcomes()
    with running(outcomes, folder=folder) as suite:
        outcomes.wait(2)
        assert suite.drain(10.0) == 0
    assert [v.weld_id for v in outcomes.messages] == ["same", "same"]


def test_same_message_twice_is_computed_once(domain_id: int, probe: Probe) -> None:
    outcomes = Outcomes()
    with running(outcomes, ("simulator", "assessment")):
        for weld_id in ("a", "a", "b"):
            probe.publish("weld_profile", encode(profile(weld_id)).decode())
        outcomes.wait(1, lambda v: v.weld_id == "b")
    assert [v.weld_id for v in outcomes.messages] == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{not json", "malformed"),
        ("", "truncated"),
        (encode(profile("new")).decode().replace(f'"{SCHEMA_VERSION}"', '"2.0"'), "version 2.0"),
        (encode(profile("new")).decode().replace('"z_m":[', '"z_m":[null,'), "null"),
    ],
)
def test_unusable_profile_message_becomes_a_rejection(domain_id: int, probe: Probe, text: str, reason: str) -> None:
    outcomes = Outcomes()
    with running(outcomes, ("simulator", "assessment")):
        probe.publish("weld_profile", text)
        probe.publish("weld_profile", encode(profile("good")).decode())
        rejection, verdict = one_of_each(outcomes)
    assert rejection.raw_text == text
    assert reason in rejection.reason
    assert rejection.source == "weld_profile message"
    assert verdict.weld_id == "good"


@pytest.mark.parametrize("text", ["[1, 2", '{"schema_version": "7.1"}', '{"schema_version": "1.0"}'])
def test_unusable_force_map_becomes_a_rejection_in_the_bag(
    domain_id: int, probe: Probe, tmp_path: Path, text: str
) -> None:
    outcomes = Outcomes()
    with running(outcomes, ("assessment",), bag=tmp_path / "bag"):
        probe.publish("force_map", text)
        outcomes.wait(1)
    messages = read_bag(tmp_path / "bag")
    (rejection,) = contract_messages(messages, Rejection)
    assert rejection.raw_text == text
    assert [m.data for m in messages["/force_map"]] == [text]


def test_bytes_that_are_no_text_do_not_stop_the_node(domain_id: int, probe: Probe) -> None:
    outcomes = Outcomes()
    with running(outcomes, ("simulator", "assessment")):
        probe.publish("weld_profile", b"\x00\x01\x00\x00\x04\x00\x00\x00\xff\xfe\x80\x00")
        probe.publish("weld_profile", encode(profile("good")).decode())
        rejection, verdict = one_of_each(outcomes)
    assert "\N{REPLACEMENT CHARACTER}" in rejection.raw_text
    assert verdict.weld_id == "good"


def test_long_text_is_kept_in_part_and_says_so(domain_id: int, probe: Probe) -> None:
    outcomes = Outcomes()
    with running(outcomes, ("simulator", "assessment")):
        probe.publish("weld_profile", "x" * 70_000)
        (rejection,) = outcomes.wait(1)
    assert (len(rejection.raw_text), rejection.raw_truncated) == (65_536, True)


def test_profile_that_cannot_be_simulated_becomes_a_rejection(domain_id: int, folder: Path) -> None:
    (folder / "a.csv").write_text(profile_text(weld_id="impossible"))
    (folder / "b.csv").write_text(profile_text(weld_id="possible"))
    outcomes = Outcomes()
    with running(outcomes, folder=folder):
        rejection, verdict = one_of_each(outcomes)
    assert (rejection.source, rejection.reason) == ("a.csv", "no such weld")
    assert json.loads(rejection.raw_text)["weld_id"] == "impossible"
    assert verdict.weld_id == "possible"


def test_failed_loading_is_a_failure_of_the_suite(domain_id: int) -> None:
    def load(settings: SimulationSettings) -> QuickSimulator:
        raise TrackError("no fit", "make one")

    with running(Outcomes(), ("simulator",), load=load) as suite:
        wait_until(lambda: suite.failure)
        assert str(suite.failure) == "no fit; make one"


def test_lost_messages_are_counted(domain_id: int, probe: Probe) -> None:
    outcomes, diagnostics = Outcomes(), probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)

    def gaps(array: DiagnosticArray) -> str:
        (status,) = (s for s in array.status if s.name == "/simulator_node")
        return {v.key: v.value for v in status.values}["sequence gaps"]

    with running(outcomes, ("simulator",)) as suite:
        for sequence in (0, 1, 4, 5):
            message = profile(f"weld-{sequence}")
            message.publisher, message.sequence = "/trolley#1", sequence
            probe.publish("weld_profile", encode(message).decode())
        wait_until(lambda: suite.nodes["simulator"].topics.sent(ForceMap) == 4)
        diagnostics.wait(1, lambda array: gaps(array) == "2")


def test_each_node_reports_its_state_and_the_bag_has_it_once(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    names = {f"/{kind}_node" for kind in KINDS}
    with running(Outcomes(), folder=folder, bag=tmp_path / "bag"):
        for name in names:
            diagnostics.wait(2, lambda array, name=name: array.status[0].name == name)
    recorded = [
        (m.status[0].name, m.header.stamp.sec, m.header.stamp.nanosec)
        for m in read_bag(tmp_path / "bag")["/diagnostics"]
    ]
    assert {name for name, *_ in recorded} == names
    assert len(set(recorded)) == len(recorded)


@pytest.mark.parametrize(
    ("parameter", "value", "speeds", "positions"),
    [
        ("speeds", "20:40:10", [20.0, 30.0, 40.0], [0.15, 0.30]),
        ("speeds", [60, 90], [60.0, 90.0], [0.15, 0.30]),
        ("speeds", 50.0, [50.0], [0.15, 0.30]),
        ("positions", 2, [40.0, 80.0, 120.0], [0.0, 0.30]),
        ("positions", [0.1, 0.2], [40.0, 80.0, 120.0], [0.1, 0.2]),
    ],
)
def test_lists_may_be_given_in_any_form_ros_reads(
    domain_id: int, probe: Probe, parameter: str, value: Any, speeds: list[float], positions: list[float]
) -> None:
    latched = probe.collect("simulation_settings", String, qos.CONTRACT)
    with running(Outcomes(), ("simulator",), **{parameter: value}):
        (text,) = latched.wait(1)
    settings = decode(SimulationSettings, text.data)
    assert (settings.speeds_kmh, settings.positions_m) == (speeds, pytest.approx(positions))


@pytest.mark.parametrize(
    ("kind", "parameters", "message"),
    [
        ("profile", {}, "folder is not set"),
        ("profile", {"folder": "/does/not/exist"}, "does not exist"),
        ("simulator", {"speeds": "fast"}, "fast"),
        ("simulator", {"track": "no-such-track"}, "no-such-track"),
        ("simulator", {"wheel_mass_kg": -1.0}, "wheel_mass_kg"),
        ("simulator", {"wheel_mass_kg": "heavy"}, "wheel_mass_kg"),
        ("assessment", {"limits": "/does/not/exist.yaml"}, "exist.yaml"),
    ],
)
def test_unusable_parameter_is_refused_in_one_line(
    domain_id: int, kind: Kind, parameters: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as caught, NodeSuite((kind,), parameters={kind: parameters}):
        pass
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_existing_bag_is_not_overwritten(domain_id: int, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "keep").write_text("evidence")
    with pytest.raises(InputError), running(Outcomes(), ("assessment",), bag=tmp_path / "bag"):
        pass
    assert [p.name for p in (tmp_path / "bag").iterdir()] == ["keep"]


def test_namespaces_keep_two_rails_apart(domain_id: int, tmp_path: Path) -> None:
    outcomes = {"left": Outcomes(), "right": Outcomes()}
    suites = []
    for side, collected in outcomes.items():
        (tmp_path / side).mkdir()
        (tmp_path / side / f"{side}.csv").write_text(profile_text())
        suites.append(
            NodeSuite(
                parameters={
                    "profile": {"folder": str(tmp_path / side), "settle_s": 0.05, "unfinished_s": 0.3},
                    "simulator": {"uncertainty_samples": 0, "speeds": SPEEDS},
                },
                ros_args=["--ros-args", "-r", f"__ns:=/{side}"],
                load_simulator=QuickSimulator,
                on_verdict=collected,
            )
        )
    with suites[0], suites[1]:
        for collected in outcomes.values():
            collected.wait(1)
        assert [suite.drain(10.0) for suite in suites] == [0, 0]
    assert {side: [v.weld_id for v in c.messages] for side, c in outcomes.items()} == {
        "left": ["left"],
        "right": ["right"],
    }


def test_nodes_leave_the_graph_as_they_are_closed(domain_id: int, probe: Probe, folder: Path, tmp_path: Path) -> None:
    """Others would publish to them for the twenty seconds after which a silent participant is given up."""
    outcomes = Outcomes()
    with running(outcomes, folder=folder, bag=tmp_path / "bag"):
        wait_until(lambda: {f"{kind}_node" for kind in KINDS} <= probe.nodes())
    gone_s = time.monotonic() + 5.0
    wait_until(lambda: probe.nodes() == {"probe"})
    assert time.monotonic() < gone_s


def test_a_middleware_that_never_lets_go_keeps_no_process(domain_id: int, tmp_path: Path) -> None:
    program = f"""
import time
from weld_force_ros.ros import lifecycle, node_suite

node_suite.LEAVE_S = 0.5
lifecycle.LifecycleNodeBase.destroy_node = lambda _: time.sleep(60.0)
with node_suite.NodeSuite(("assessment",), parameters={{"assessment": {{"bag": {str(tmp_path / "bag")!r}}}}}):
    pass
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert ended.returncode == 1
    assert "Timeout" in ended.stderr
    with AnyReader([tmp_path / "bag"]) as reader:  # its index was written
        assert reader.message_count
