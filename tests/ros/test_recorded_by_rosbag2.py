"""The suite without its own recorder, recorded as `ros2 bag record` does: what replay and report have of it."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from std_msgs.msg import String

from tests.harness.ros import Outcomes, Probe, profile_text, wait_until
from weld_force_ros.cli.main import main
from weld_force_ros.recording import STRING, count_outcomes, open_bag
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.recording.replay import replay
from weld_force_ros.ros.node_suite import Kind, NodeSuite

TOPICS = (
    "/weld_profile", "/simulation_settings", "/assessment_settings", "/force_map", "/force_history", "/verdict",
    "/rejection",
)  # fmt: skip
ADAPTED = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""What rosbag2 asks for where all publishers are reliable and latched; its depth is rmw's default."""


class Rosbag2(Probe):
    """Subscribes as rosbag2's recorder does, and writes as it does when it is stopped."""

    def listen(self) -> None:
        self.taken: list[tuple[str, bytes, int]] = []

        def taking(topic: str) -> Any:
            return lambda cdr, info: self.taken.append((topic, cdr, info["received_timestamp"]))

        for topic in TOPICS:
            self._node.create_subscription(String, topic, taking(topic), ADAPTED, raw=True)

    def count(self, topic: str) -> int:
        return sum(name == topic for name, _, _ in self.taken)

    def write(self, folder: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
        writer = Writer(folder, version=9, storage_plugin=storage)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connections = {
                topic: writer.add_connection(topic, STRING.name, msgdef=STRING.text, rihs01=STRING.type_hash)
                for topic in TOPICS
            }
            for topic, cdr, time_ns in self.taken:
                writer.write(connections[topic], time_ns, cdr)
        return folder


@contextmanager
def measuring(folder: Path) -> Iterator[tuple[NodeSuite, Outcomes]]:
    outcomes = Outcomes()
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "0.15"},
        "assessment": {"bag": ""},
    }
    with NodeSuite(parameters=parameters, on_verdict=outcomes, on_rejection=outcomes) as suite:
        yield suite, outcomes


@pytest.mark.parametrize(
    ("first", "storage", "mode"),
    [
        (True, StoragePlugin.SQLITE3, CompressionMode.NONE),
        (False, StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ],
    ids=["from the start, sqlite3", "joined late, MCAP by message"],
)
def test_verdicts_replay_and_report_from_it(
    domain_id: int,
    folder: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    first: bool,
    storage: StoragePlugin,
    mode: CompressionMode,
) -> None:
    for number in range(3):
        (folder / f"weld-{number}.csv").write_text(profile_text(100 + 50 * number))
    (folder / "bad.csv").write_text("# x_unit: mm\nx,z\n1,nonsense\n")
    with Rosbag2(domain_id) as recorder:
        if first:
            recorder.listen()
        with measuring(folder) as (suite, outcomes):
            outcomes.wait(4)
            if not first:
                recorder.listen()
            wait_until(lambda: recorder.count("/verdict") == 3 and recorder.count("/rejection") == 1)
            wait_until(lambda: recorder.count("/force_history") == 3)
            assert suite.drain(10.0) == 0
        bag = recorder.write(tmp_path / "bag", storage, mode)

    recording = open_recording(bag)
    assert [v.weld_id for v in recording.verdicts] == [v.weld_id for v in outcomes.messages if hasattr(v, "decision")]
    assert [r.differences for r in replay(recording)] == [()] * 6
    counts = count_outcomes(open_bag(bag))
    assert counts is not None
    assert dataclasses.asdict(counts) == {"measurements": 3, "verdicts": 3, "rejections": 1, "open": 0, "doubled": 0}
    assert main(["report", str(bag), "--out", str(tmp_path / "page.html")]) == 0
    assert main(["show", str(bag)]) == 0
    assert "weld-2" in capfd.readouterr().out
