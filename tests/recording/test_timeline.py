"""Gaps of a clock that was set while it was recorded: found, not counted, said."""

import json
import time
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.harness.bags import record
from weld_force_ros import recording
from weld_force_ros.cli.main import main
from weld_force_ros.recording.rosbag2_format import ChannelStatistics, merged

DAY_NS = 86_400 * 10**9
YEARS_57_NS = 57 * 365 * DAY_NS


@settings(deadline=None, max_examples=60)
@given(
    parts=st.lists(st.lists(st.integers(0, 12).map(lambda n: n * DAY_NS // 3) | st.integers(0, 9 * DAY_NS)), max_size=3)
)
def test_gaps_are_those_between_neighbours_in_time_whatever_the_order(parts):
    statistics = [ChannelStatistics() for _ in parts]
    for one, times in zip(statistics, parts, strict=True):
        for time_ns in times:
            one.add("/n", recording.STRING, time_ns)
    timeline = merged(statistics).timeline
    times = sorted(time_ns for part in parts for time_ns in part)
    steps = [b - a for a, b in pairwise(times)]
    assert [gap.duration_ns for gap in timeline.gaps] == [step for step in steps if step > DAY_NS]
    elapsed = [sum(step for step in steps[:i] if step <= DAY_NS) for i in range(len(times))]
    assert [timeline.elapsed_ns(time_ns) for time_ns in times] == elapsed
    assert timeline.duration_ns == (elapsed[-1] if times else 0)
    for after_ns in elapsed:  # of a time at which a gap begins, the time before it
        assert timeline.log_time_ns(after_ns) == times[elapsed.index(after_ns)]


def test_info_leaves_out_the_years_and_says_so(tmp_path, capfd, monkeypatch):
    """A clock at 1970 when the recording began, set right after two seconds; times are those of the zone."""
    monkeypatch.setenv("TZ", "CET-1")
    time.tzset()
    with recording.Recorder(tmp_path / "run") as recorder:
        for time_ns in (0, 2 * 10**9, YEARS_57_NS, YEARS_57_NS + 3 * 10**9):
            recorder.write(
                "/n", recording.STRING, recording.string_cdr("x"), log_time_ns=time_ns, publish_time_ns=time_ns
            )
    found = recording.summary(tmp_path / "run")
    assert found.duration_s == pytest.approx(5.0)
    assert [file.duration_s for file in found.files] == [pytest.approx(5.0)]
    assert found.gaps == ((2 * 10**9, YEARS_57_NS),)
    assert main(["bag", "info", str(tmp_path / "run"), "--json", "-"]) == 0
    printed = capfd.readouterr()
    assert json.loads(printed.out)["gaps"] == [{"start_ns": 2 * 10**9, "end_ns": YEARS_57_NS}]
    said = " ".join(printed.err.split())
    assert "4 messages, 5.0 s" in said
    assert "gap of 57.0 years, not counted: 1970-01-01 01:00:02 CET to 2026-12-18 01:00:00 CET" in said


def test_recording_of_an_hour_has_no_gap(tmp_path):
    bag = record(tmp_path / "run", [("/n", "a", 0), ("/n", "b", 3600 * 10**9)])
    assert (recording.summary(bag).gaps, recording.summary(bag).duration_s) == ((), 3600.0)
