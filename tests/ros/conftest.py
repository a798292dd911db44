"""Real rclpy nodes in a domain of the test's own."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from tests.harness.ros import Probe
from weld_force_ros.ros import environment


@pytest.fixture(scope="session", autouse=True)
def ros_environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("log")))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        environment.prepare()
        yield


@pytest.fixture(scope="session")
def worker_domains() -> Iterator[Iterator[int]]:
    """Domain ids that no other test process on this machine uses."""
    locks, mine = [], []

    def ids() -> Iterator[int]:
        # Processes of one run share them out, others are left alone by locks.
        process = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        for number in range(1 + process, 101, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))):
            lock = (Path(tempfile.gettempdir()) / f"weld-force-test-domain-{number}.lock").open("w")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.close()
                continue
            locks.append(lock)
            mine.append(number)
            yield number
        while mine:  # those of tests that ended longest ago
            yield from mine

    yield ids()
    for lock in locks:
        lock.close()


@pytest.fixture
def domain_id(worker_domains: Iterator[int], monkeypatch: pytest.MonkeyPatch) -> int:
    number = next(worker_domains)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    return number


@pytest.fixture
def probe(domain_id: int) -> Iterator[Probe]:
    with Probe(domain_id) as node:
        yield node


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "measurements"
    path.mkdir()
    return path
