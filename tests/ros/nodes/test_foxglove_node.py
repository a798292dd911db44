"""Streaming to Foxglove: a client of its protocol sees every message with its schema, whenever it joins."""

import json
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, profile_text
from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError
from weld_force_ros.messages import RailSurface, Verdict, decode, encode
from weld_force_ros.ros.node_suite import Kind, NodeSuite, in_flow_order

pytestmark = pytest.mark.slow

pytest.importorskip("foxglove")
geometry = pytest.importorskip("geometry_msgs.msg")
jsonschema = pytest.importorskip("jsonschema")
websockets = pytest.importorskip("websockets.sync.client")


class Client:
    """A client of the protocol: github.com/foxglove/ws-protocol, docs/spec.md; its SDK's own name for it is newer."""

    def __init__(self, connection: Any) -> None:
        self._socket = connection
        assert json.loads(self._socket.recv(DEADLINE_S))["op"] == "serverInfo"
        advertised = json.loads(self._socket.recv(DEADLINE_S))
        assert advertised["op"] == "advertise"
        self.channels: dict[str, dict[str, Any]] = {channel["topic"]: channel for channel in advertised["channels"]}

    def subscribe(self, *topics: str) -> None:
        ids = [{"id": self.channels[topic]["id"], "channelId": self.channels[topic]["id"]} for topic in topics]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": ids}))

    def next(self) -> tuple[str, int, bytes]:
        """Topic, time and data of the next message: operation 1, subscription, nanoseconds, payload."""
        while True:
            data = self._socket.recv(DEADLINE_S)
            if isinstance(data, bytes) and data[0] == 1:
                number, at_ns = struct.unpack_from("<IQ", data, 1)
                topic = next(topic for topic, channel in self.channels.items() if channel["id"] == number)
                return topic, at_ns, data[13:]


@contextmanager
def connected(url: str) -> Iterator[Client]:
    with websockets.connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as connection:
        yield Client(connection)


@contextmanager
def running(folder: Path, outcomes: Outcomes, namespace: str = "") -> Iterator[str]:
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": "40,80,120", "positions": "0.15,0.30"},
        "foxglove": {"port": 0},
    }
    kinds = in_flow_order(["foxglove"])
    with NodeSuite(
        kinds,
        parameters=parameters,
        load_simulator=QuickSimulator,
        on_verdict=outcomes,
        on_rejection=outcomes,
        ros_args=["--ros-args", "-r", f"__ns:={namespace}"] if namespace else [],
    ) as suite:
        yield suite.nodes["foxglove"].url
        assert suite.drain(10.0) == 0


def test_a_panel_fills_while_welds_are_judged(domain_id: int, folder: Path, probe: Probe) -> None:
    outcomes = Outcomes()
    with running(folder, outcomes, "/left") as url, connected(url) as client:
        client.subscribe("/left/verdict", "/left/peak_force", "/left/rail_surface")
        for i in range(3):
            (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
        verdicts = {verdict.weld_id: verdict for verdict in outcomes.wait(3)}
        seen: dict[str, list[Any]] = {"/left/verdict": [], "/left/peak_force": []}
        while not all(len(found) >= 3 for found in seen.values()):
            topic, at_ns, data = client.next()
            assert at_ns > 1.7e18
            seen[topic].append(data)
        channel = client.channels["/left/verdict"]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        for data in seen["/left/verdict"]:
            jsonschema.validate(json.loads(data), json.loads(channel["schema"]))
            verdict = decode(Verdict, data)
            assert verdict.peak_force_n == verdicts[verdict.weld_id].peak_force_n
        channel = client.channels["/left/peak_force"]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        assert (channel["schemaName"], "MSG: geometry_msgs/Wrench" in channel["schema"]) == (
            "geometry_msgs/msg/WrenchStamped",
            True,
        )
        forces = [deserialize_message(data, geometry.WrenchStamped).wrench.force.z for data in seen["/left/peak_force"]]
        assert sorted(forces) == sorted(verdict.peak_force_n for verdict in verdicts.values())
        rail = RailSurface(
            chainage=[1.0, 2.0], height=[0.1, 0.2], chainage_unit="m", height_unit="mm", height_positive="up"
        )
        probe.publish("/left/rail_surface", encode(rail).decode())
        topic, _, data = client.next()
        assert topic == "/left/rail_surface"
        assert decode(RailSurface, data).height == [0.1, 0.2]


def test_who_joins_late_gets_the_newest_of_each_latched_topic(domain_id: int, folder: Path, probe: Probe) -> None:
    outcomes = Outcomes()
    with running(folder, outcomes) as url:
        with connected(url) as first:
            first.subscribe("/verdict")
            for i in range(2):
                (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
                outcomes.wait(i + 1)
            newest = [first.next() for _ in range(2)][-1]
        probe.publish("verdict", "{not json")  # neither shown nor a reason to stop
        with connected(url) as late:
            late.subscribe("/verdict")
            assert late.next() == newest


def test_nobody_else_can_connect_and_a_used_port_is_one_line(
    domain_id: int, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with (
            pytest.raises(InputError, match=f"port {port} for Foxglove cannot be used.*--foxglove-port"),
            NodeSuite(("foxglove",), parameters={"foxglove": {"port": port}}),
        ):
            pass
    with NodeSuite(("foxglove",), parameters={"foxglove": {"port": 0}}) as suite:
        port = int(suite.nodes["foxglove"].url.rpartition(":")[2])
        with socket.socket() as other, pytest.raises(ConnectionRefusedError):
            other.connect(("127.0.0.2", port))
    assert main(["up", "--folder", str(folder), "--foxglove-port", "8766"]) == 2
    assert "--foxglove-port says where Foxglove connects to; add --foxglove" in capfd.readouterr().err
