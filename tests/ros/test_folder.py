"""The watched folder, without ROS."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from ros_harness import Outcomes, wait_until

from weld_force_ros.ros.folder import FolderWatcher


@contextmanager
def watching(folder: Path, settle_s: float = 0.05) -> Iterator[tuple[FolderWatcher, Outcomes]]:
    """The watcher, and what it hands over: the file's name and its content then."""
    taken = Outcomes()
    watcher = FolderWatcher(
        folder, (".csv", ".txt"), settle_s, lambda path: taken((path.name, path.read_text())), lambda problem: None
    )
    watcher.start()
    try:
        yield watcher, taken
    finally:
        watcher.close(5.0)


def test_files_already_there_come_in_order_of_name(folder: Path) -> None:
    for name in ("c.csv", "a.txt", "B.CSV"):
        (folder / name).write_text(name)
    with watching(folder) as (_, taken):
        assert [name for name, _ in taken.wait(3)] == ["B.CSV", "a.txt", "c.csv"]


def test_file_written_in_two_parts_is_taken_once_and_whole(folder: Path) -> None:
    with watching(folder, settle_s=0.5) as (watcher, taken):
        with (folder / "slow.csv").open("w") as file:
            file.write("first ")
            file.flush()
            wait_until(lambda: watcher.waiting == 1)
            file.write("second")
        assert taken.wait(1) == [("slow.csv", "first second")]
        (folder / "z.csv").write_text("last")
        assert taken.wait(2) == [("slow.csv", "first second"), ("z.csv", "last")]


def test_changed_file_is_taken_again(folder: Path) -> None:
    with watching(folder) as (_, taken):
        (folder / "a.csv").write_text("one")
        taken.wait(1)
        (folder / "a.csv").write_text("another")
        assert taken.wait(2) == [("a.csv", "one"), ("a.csv", "another")]


def test_file_moved_into_place_is_taken(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv.part").write_text("whole")
    with watching(folder) as (_, taken):
        os.replace(tmp_path / "a.csv.part", folder / "a.csv")
        assert taken.wait(1) == [("a.csv", "whole")]


def test_what_is_no_measurement_file_is_left_alone(folder: Path) -> None:
    (folder / ".hidden.csv").write_text("x")
    (folder / "picture.png").write_text("x")
    (folder / "folder.csv").mkdir()
    (folder / "folder.csv" / "below.csv").write_text("x")
    os.mkfifo(folder / "pipe.csv")
    (folder / "z.csv").write_text("last")
    with watching(folder) as (_, taken):
        assert taken.wait(1) == [("z.csv", "last")]


def test_folder_that_comes_back_is_watched_again(folder: Path, tmp_path: Path) -> None:
    problems: list[str] = []
    noticed = threading.Event()
    taken = Outcomes()

    def complain(problem: str) -> None:
        problems.append(problem)
        noticed.set()

    watcher = FolderWatcher(folder, (".csv",), 0.05, lambda path: taken(path.name), complain)
    folder.rmdir()
    watcher.start()
    try:
        assert noticed.wait(20.0)
        assert str(folder) in problems[0]
        folder.mkdir()
        (folder / "a.csv").write_text("x")
        assert taken.wait(1) == ["a.csv"]
    finally:
        watcher.close(5.0)


@pytest.mark.parametrize("already_running", [True, False])
def test_closed_watcher_takes_nothing_more(folder: Path, already_running: bool) -> None:
    taken = Outcomes()
    watcher = FolderWatcher(folder, (".csv",), 0.0, taken, lambda problem: None)
    if already_running:
        watcher.start()
    watcher.close(5.0)
    (folder / "a.csv").write_text("x")
    assert not watcher.running
    assert taken.messages == []
