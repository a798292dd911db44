"""Weld marks: an accepted mark is on the disk until it has ended, and no longer than that."""

import shutil
from pathlib import Path

import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.weld_marks import WeldMark, WeldMarks


def marks_in(folder: Path, now_s: float = 0.0, announced: list[str] | None = None) -> WeldMarks:
    return WeldMarks(
        folder / ".weld-marks.json", 60.0, (announced if announced is not None else []).append, lambda: now_s
    )


def mark(number: int, *, found: bool = False) -> WeldMark:
    return WeldMark(f"w{number}.csv", float(number), f"w{number}", found=found)


def test_accepted_marks_wait_over_a_restart_and_ended_ones_do_not(tmp_path: Path):
    marks, announced = marks_in(tmp_path), []
    for number in range(3):
        marks.accept(mark(number))
    marks.end(mark(0), captured=True)
    marks.end(mark(1), captured=False)
    again = marks_in(tmp_path, announced=announced)
    assert again.waiting == [mark(2)]
    assert [(again.is_waiting(m), again.is_captured(m)) for m in map(mark, range(3))] == [
        (False, True), (False, False), (True, False)
    ]  # fmt: skip
    assert announced == ["weld w2 at 2.000 m, marked before the restart, is waited for"]


def test_a_mark_whose_file_is_there_counts_as_captured(tmp_path: Path):
    marks_in(tmp_path).accept(mark(1))
    (tmp_path / "w1.csv").touch()
    again = marks_in(tmp_path)
    assert again.waiting == []
    assert again.is_captured(mark(1))


def test_time_to_wait_begins_anew_after_a_restart(tmp_path: Path):
    marks = marks_in(tmp_path, 0.0)
    marks.accept(mark(1))
    assert not marks.is_overdue(mark(1))
    assert not marks_in(tmp_path, 1000.0).is_overdue(mark(1))


def test_a_rejected_weld_may_be_marked_again_and_a_captured_one_is_known(tmp_path: Path):
    marks = marks_in(tmp_path)
    marks.accept(mark(1))
    marks.end(mark(1), captured=False)
    assert marks.at(1.0) is None
    marks.accept(mark(5, found=True))
    marks.end(mark(5, found=True), captured=True)
    found = marks.at(5.9)
    assert found is not None
    assert found.captured
    marks.forget(lambda mark: mark.chainage_m > 4.0)
    assert marks.at(5.0) is None


def test_a_mark_that_cannot_be_saved_is_not_accepted_and_an_outcome_is_saved_later(tmp_path: Path):
    announced: list[str] = []
    folder = tmp_path / "here"
    folder.mkdir()
    marks = marks_in(folder, announced=announced)
    marks.accept(mark(1))
    shutil.rmtree(folder)
    with pytest.raises(InputError, match="free space or make the folder writable"):
        marks.accept(mark(2))
    assert marks.waiting == [mark(1)]
    marks.end(mark(1), captured=True)
    marks.retry_save()
    assert len(announced) == 1
    folder.mkdir()
    marks.retry_save()
    assert marks_in(folder).is_captured(mark(1))
