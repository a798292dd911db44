"""The dashboard's long run, short; see `tests.soak.dashboard`."""

import os
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not there")
pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

from weld_force_ros.report.pdf import find_browser

from . import dashboard

pytestmark = pytest.mark.slow


@pytest.mark.skipif(find_browser() is None, reason="no Chromium was found on PATH (apt install chromium)")
def test_rows_come_to_the_page_as_verdicts_are_published(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(101 + os.getpid() % 100))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    result = dashboard.run(0.1, rate_hz=3.0, samples=2)
    assert (result.shown, result.complaints) == (result.welds, [])
    assert result.welds > 10
    assert result.figures["delay ms, median"] < 1000
