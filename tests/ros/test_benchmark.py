"""The nodes' measurement: that it counts every weld, and notices one that is missing."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import nodes
from weld_force_ros.recording.recording import Recording, open_recording

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def few_at_once(domain_id: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nodes, "_FLOOD", 3)
    monkeypatch.setattr(nodes, "SPEEDS", "80,120")
    monkeypatch.setattr(nodes, "DEFAULT_UNCERTAINTY_SAMPLES", 4)


def test_every_weld_is_counted_and_none_lost() -> None:
    found = nodes.sustained(seconds=1.0, welds_per_s=4.0)
    assert (found["sustained_welds"], found["sustained_lost"]) == (4, 0)
    assert found["sustained_welds_per_s"] == pytest.approx(4 / found["sustained_s"])


def test_weld_without_a_recorded_verdict_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_the_last(bag: Path, read: Callable[[Path], Recording] = open_recording) -> Recording:
        recording = read(bag)
        return replace(recording, verdicts=recording.verdicts[:-1])

    monkeypatch.setattr(nodes, "open_recording", without_the_last)
    assert nodes.sustained(seconds=0.5, welds_per_s=4.0)["sustained_lost"] == 3  # one of each run


def test_without_ros_there_is_nothing_to_measure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "weld_force_ros.ros.node_suite", None)
    assert nodes.latencies() == {}
    assert nodes.sustained() == {}
