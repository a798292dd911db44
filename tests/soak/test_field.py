"""The long runs, short: the suite as processes, killed and not; see `make soak`."""

import os
import signal
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not there")

from weld_force_ros.errors import WeldForceError
from weld_force_ros.ros.supervisor import Supervisor

from . import endurance, kills
from .field import wait_until

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def own_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(101 + os.getpid() % 100))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))


def test_nodes_killed_under_load_lose_and_double_nothing() -> None:
    result = kills.run(1, seed=3)
    assert result.passed, vars(result)
    assert sum(result.kills.values()) == 3
    assert result.welds > 5


def test_every_weld_of_a_run_has_one_outcome() -> None:
    result = endurance.run(30, speeds="80,160", positions="2")
    assert (result.lost, result.doubled, result.restarts, result.received) == (0, 0, 0, 30)


def test_node_that_dies_is_started_again_and_that_is_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with Supervisor({"profile": {"folder": str(tmp_path)}}) as supervisor:
        process = supervisor.processes["simulator"]
        before = process.pid
        os.kill(before or 0, signal.SIGKILL)
        assert wait_until(lambda: process.pid not in (before, None), 10.0, supervisor)
    assert supervisor.code == 0
    assert "simulator node was killed by signal 9; starting it again" in capfd.readouterr().err


def test_suite_that_cannot_work_ends_with_its_reason(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with (
        Supervisor({"profile": {"folder": str(tmp_path / "nowhere")}}) as supervisor,
        pytest.raises(WeldForceError, match="profile node"),
    ):
        wait_until(lambda: False, 20.0, supervisor)
    assert "nowhere does not exist" in capfd.readouterr().err
