"""Publishers that are not of the suite: any language's JSON, any quality of service, whatever they get wrong."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, wait_until
from weld_force_ros.errors import InputError
from weld_force_ros.messages import ForceMap, Rejection, Verdict, WeldProfile, decode, encode
from weld_force_ros.recording import count_outcomes, open_bag
from weld_force_ros.ros import qos
from weld_force_ros.ros.node_suite import NodeSuite
from weld_force_ros.ros.parameters import read_parameter_file, settings_from_parameters, values_of_node

ROOT = Path(__file__).parents[2]
VECTOR = json.loads((ROOT / "examples" / "weld_profile.json").read_text())


def weld(number: int, **changes: Any) -> str:
    """JSON as Python's own library writes it, without the hash."""
    content = VECTOR | {"weld_id": f"weld-{number}", "profile_sha256": None} | changes
    return json.dumps({key: value for key, value in content.items() if value is not None})


def suite(bag: Path, outcomes: Outcomes) -> NodeSuite:
    return NodeSuite(
        ("simulator", "assessment"),
        parameters={
            "simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "2"},
            "assessment": {"bag": str(bag)},
        },
        load_simulator=QuickSimulator,
        on_verdict=outcomes,
        on_rejection=outcomes,
    )


BROKEN = {
    "no JSON": "{",
    "a wrong hash": weld(1, profile_sha256="0" * 64),
    "no samples": weld(2, x_m=None, profile_id="a" * 64),
    "unequal columns": weld(3, z_m=[0.0] * 3, publisher="/trolley#1", sequence=3),
    "a weld's number as its name": weld(4, weld_id=4, profile_id="b" * 64),
    "too high": weld(5, z_m=[1.0] * 10 + [0.0] * 11, publisher="/trolley#1", sequence=5),
}


def test_each_message_has_one_outcome_and_a_recording_that_is_continued_sends_none_again(
    domain_id: int, probe: Probe, tmp_path: Path
) -> None:
    outcomes, bag, good = Outcomes(), tmp_path / "bag", range(10, 16)
    with suite(bag, outcomes) as nodes:
        for text in [*BROKEN.values(), *map(weld, good)]:
            probe.publish("weld_profile", text)
        outcomes.wait(len(BROKEN) + len(good))
        assert nodes.drain(10.0) == 0
        assert nodes.open_count == 0
    assert sorted(v.weld_id for v in outcomes.of(Verdict)) == [f"weld-{n}" for n in good]
    assert sorted(r.raw_text for r in outcomes.of(Rejection)) == sorted(BROKEN.values())
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.open, ended.doubled) == (len(BROKEN) + len(good), 0, 0)

    again = Outcomes()
    with suite(bag, again) as nodes:
        # The publisher keeps its messages for who comes late: they arrive once more, and are known.
        simulator = nodes.nodes["simulator"].topics.diagnostics
        wait_until(lambda: simulator.received["weld_profile"] == len(BROKEN) + len(good))
        assert nodes.drain(10.0) == 0
        assert (nodes.open_count, again.messages) == (0, [])
    assert count_outcomes(open_bag(bag)) == ended


def test_a_message_that_nobody_rejected_before_a_kill_is_rejected_when_the_recording_is_continued(
    domain_id: int, tmp_path: Path
) -> None:
    from tests.harness.bags import record

    bag = record(tmp_path / "bag", [("/weld_profile", text, n) for n, text in enumerate(BROKEN.values())])
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert ended.open == len(BROKEN)
    outcomes = Outcomes()
    with suite(bag, outcomes) as nodes:
        outcomes.wait(len(BROKEN))
        wait_until(lambda: nodes.open_count == 0)
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.rejections, ended.open, ended.doubled) == (len(BROKEN), len(BROKEN), 0, 0)


def test_what_a_publisher_sent_that_is_gone_is_recorded_by_an_assessment_node_that_comes_later(
    domain_id: int, tmp_path: Path
) -> None:
    """There is no verdict without its measurement, though rclpy's default keeps nothing for who comes later."""
    outcomes, bag, texts = Outcomes(), tmp_path / "bag", [weld(1), "{"]
    values = {"simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "2"}}
    with NodeSuite(("simulator",), parameters=values, load_simulator=QuickSimulator) as simulating:
        simulator = simulating.nodes["simulator"].topics
        with Probe(domain_id) as client:
            publisher = client.publisher("weld_profile", QoSProfile(depth=10))
            wait_until(publisher.get_subscription_count)
            for text in texts:
                publisher.publish(String(data=text))
            wait_until(lambda: (simulator.sent(ForceMap), simulator.sent(Rejection)) == (1, 1))
        with NodeSuite(
            ("assessment",), parameters={"assessment": {"bag": str(bag)}}, on_verdict=outcomes, on_rejection=outcomes
        ) as assessing:
            outcomes.wait(2)
            assert assessing.drain(10.0) == 0
        assert simulator.sent(ForceMap) == 1
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.verdicts, ended.rejections, ended.open, ended.doubled) == (2, 1, 1, 0, 0)


RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
VOLATILE, LATCHED = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.parametrize(
    ("reliability", "durability"),
    [(RELIABLE, VOLATILE), (BEST_EFFORT, VOLATILE), (BEST_EFFORT, LATCHED), (RELIABLE, LATCHED)],
    ids=["the default of ros2 topic pub and rclpy", "sensor data", "best effort, latched", "as the suite"],
)
def test_publishers_of_any_quality_of_service_are_heard_once(
    domain_id: int, probe: Probe, tmp_path: Path, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> None:
    outcomes, bag, profile = Outcomes(), tmp_path / "bag", QoSProfile(depth=10)
    profile.reliability, profile.durability = reliability, durability
    with suite(bag, outcomes) as nodes:
        # Another client as the suite expects them has both subscriptions of a node receive what it sends.
        probe.publish("weld_profile", weld(100))
        publisher = probe.publisher("weld_profile", profile)
        wait_until(lambda: publisher.get_subscription_count() >= 2)
        for number in range(20):
            publisher.publish(String(data=weld(number)))
            outcomes.wait(number + 1)
        probe.publish("weld_profile", weld(101))
        outcomes.wait(22)
        assert nodes.drain(10.0) == 0
        counts = [nodes.nodes[kind].topics.diagnostics.received for kind in ("simulator", "assessment")]
    assert sorted(v.weld_id for v in outcomes.messages) == sorted(f"weld-{n}" for n in [*range(20), 100, 101])
    copies = 0 if (reliability, durability) == (RELIABLE, LATCHED) else 20  # what the simulator keeps for latecomers
    assert counts[0]["weld_profile"] == 22
    assert 22 <= counts[1]["weld_profile"] <= 22 + copies
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.verdicts, ended.open, ended.doubled) == (22, 22, 0, 0)


def test_a_publisher_of_the_nodes_own_topics_that_is_not_heard_is_complained_of(
    domain_id: int, probe: Probe, tmp_path: Path
) -> None:
    diagnostics = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    with suite(tmp_path / "bag", Outcomes()):
        probe.publisher("force_map", QoSProfile(depth=10))
        diagnostics.wait(1, lambda array: "a publisher of force_map is not heard" in array.status[0].message)


def test_a_profile_that_arrives_after_its_verdict_is_recorded(domain_id: int, probe: Probe, tmp_path: Path) -> None:
    outcomes, bag, number = Outcomes(), tmp_path / "bag", 7
    with suite(bag, outcomes) as nodes:
        message = decode(WeldProfile, weld(number))
        (settings,) = settings_from_parameters({"uncertainty_samples": 0})
        force_map = QuickSimulator(settings).force_map(message)
        probe.publish("force_map", encode(force_map).decode())
        outcomes.wait(1)
        for _ in range(2):
            probe.publish("weld_profile", weld(number))
        received = nodes.nodes["assessment"].topics.diagnostics.received
        wait_until(lambda: received["weld_profile"] == 2)
        assert nodes.drain(10.0) == 0
    assert {name: n for (name, _), n in open_bag(bag).statistics.counts.items()}["/weld_profile"] == 1
    ended = count_outcomes(open_bag(bag))
    assert ended is not None
    assert (ended.measurements, ended.verdicts, ended.open) == (1, 1, 0)


def test_parameters_are_taken_as_they_are_meant_or_refused_by_name(domain_id: int, tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("/**:\n  ros__parameters: {speeds: [20, 40], static_load_n: 110000, folder: somewhere}\n")
    with NodeSuite(("simulator",), ros_args=["--ros-args", "--params-file", str(file)]) as nodes:
        node = nodes.nodes["simulator"]
        assert node.get_parameter("static_load_n").value == 110e3
        assert list(node.get_parameter("speeds").value) == [20, 40]
        assert values_of_node(read_parameter_file(file), "simulator_node", "") == {
            "speeds": [20, 40], "static_load_n": 110_000
        }  # fmt: skip
    for given, nearest in (("spedds:=40", "speeds"), ("static_load:=110000", "static_load_n"), ("limit:=f", "limits")):
        with (
            pytest.raises(InputError, match=f"no node has a parameter .*; write '{nearest}'"),
            NodeSuite(("simulator",), ros_args=["--ros-args", "-p", given]),
        ):
            pass


def test_a_whole_number_may_be_set_live_where_a_parameter_is_a_float(domain_id: int) -> None:
    with NodeSuite(("assessment",), parameters={"assessment": {"autostart": False, "split_minutes": 5}}) as nodes:
        node = nodes.nodes["assessment"]
        assert node.get_parameter("split_minutes").value == 5.0
        (result,) = node.set_parameters([Parameter("split_mb", value=64)])
        assert (result.successful, node.get_parameter("split_mb").value) == (True, 64.0)
        (result,) = node.set_parameters([Parameter("split_mb", value="much")])
        assert not result.successful


def test_the_example_client_gets_the_outcome_of_what_it_published(domain_id: int, tmp_path: Path) -> None:
    """With rclpy's default quality of service, in a process of its own that knows nothing of the suite."""
    broken = tmp_path / "broken.json"
    broken.write_text(weld(7, z_m=[0.0] * 3))
    outcomes, example = Outcomes(), ROOT / "examples" / "ros_client.py"
    with suite(tmp_path / "bag", outcomes):
        clients = [
            subprocess.Popen([sys.executable, str(example), str(file)], stdout=subprocess.PIPE, text=True)
            for file in (ROOT / "examples" / "weld_profile.json", broken)
        ]
        (verdict_line, _), (rejection_line, _) = [client.communicate(timeout=DEADLINE_S) for client in clients]
        outcomes.wait(2)
    (verdict,), (rejection,) = outcomes.of(Verdict), outcomes.of(Rejection)
    assert verdict_line == f"{verdict.decision} KM12-L-004 {verdict.reason}\n"
    assert rejection_line == f"no verdict  {rejection.reason}\n"
    assert "21 positions but 3 heights" in rejection.reason or "z_m" in rejection.reason
    assert [client.returncode for client in clients] == [verdict.decision != "accept", 1]
