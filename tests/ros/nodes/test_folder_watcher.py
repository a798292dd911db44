"""The watched folder, without ROS."""

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.harness.ros import Outcomes, wait_until
from weld_force_ros.ros.nodes.folder_watcher import BATCH_FILES, FolderWatcher


@contextmanager
def watching(folder: Path, settle_s: float = 0.05) -> Iterator[tuple[FolderWatcher, Outcomes]]:
    """The watcher, and what it hands over: the file's name and its content then."""
    taken = Outcomes()
    watcher = FolderWatcher(
        folder,
        settle_s,
        60.0,
        lambda path: True,
        lambda paths: [taken((path.name, path.read_text())) for path in paths],
        lambda problem: None,
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


def test_file_is_taken_no_sooner_than_it_has_stood_still(folder: Path) -> None:
    settle_s, pause = 0.2, threading.Event()
    written_at: dict[str, float] = {}
    taken = Outcomes()
    watcher = FolderWatcher(
        folder,
        settle_s,
        60.0,
        lambda path: True,
        lambda paths: [taken((path.read_text(), time.monotonic())) for path in paths],
        lambda problem: None,
    )
    watcher.start()
    try:
        with (folder / "a.csv").open("a") as file:
            for size in range(1, 41):
                written_at["x" * size] = time.monotonic()
                file.write("x")
                file.flush()
                pause.wait(0.01)
        taken.wait(1, lambda seen: seen[0] == "x" * 40)
    finally:
        watcher.close(5.0)
    # A writer that the machine stops for longer than that may be read halfway: then, too, it had stood still.
    assert all(taken_at - written_at[content] >= settle_s for content, taken_at in taken.messages)


def test_file_that_grows_while_it_is_in_hand_is_taken_again_once_it_stands_still(folder: Path) -> None:
    settle_s, pause = 0.2, threading.Event()
    written_at: list[float] = []
    taken = Outcomes()

    def take(paths: Sequence[Path]) -> None:
        contents = [path.read_text() for path in paths]
        if not written_at:
            pause.wait(2 * settle_s)  # slow to deal with
            written_at.append(time.monotonic())
            (folder / "b.csv").write_text("first second")
        for path, content in zip(paths, contents, strict=True):
            taken((path.name, content, time.monotonic()))

    (folder / "a.csv").write_text("a")
    (folder / "b.csv").write_text("first ")
    watcher = FolderWatcher(folder, settle_s, 60.0, lambda path: True, take, lambda problem: None)
    watcher.start()
    try:
        *_, (name, content, taken_at) = taken.wait(3)
    finally:
        watcher.close(5.0)
    assert (name, content) == ("b.csv", "first second")
    assert taken_at - written_at[0] >= settle_s


def test_many_files_are_handed_over_some_at_a_time(folder: Path) -> None:
    for number in range(BATCH_FILES + 5):
        (folder / f"{number:04}.csv").write_text("x")
    handed: list[int] = []
    watcher = FolderWatcher(
        folder, 0.0, 60.0, lambda path: True, lambda paths: handed.append(len(paths)), lambda problem: None
    )
    watcher.start()
    try:
        wait_until(lambda: sum(handed) == BATCH_FILES + 5)
    finally:
        watcher.close(5.0)
    assert max(handed) <= BATCH_FILES


def test_changed_file_is_taken_again(folder: Path) -> None:
    with watching(folder) as (_, taken):
        (folder / "a.csv").write_text("one")
        taken.wait(1)
        (folder / "a.csv").write_text("another")
        assert taken.wait(2) == [("a.csv", "one"), ("a.csv", "another")]


@pytest.mark.parametrize("beside", ["measurements", "."], ids=["within the folder", "from another folder"])
def test_file_moved_into_place_is_taken(folder: Path, tmp_path: Path, beside: str) -> None:
    (tmp_path / beside / "a.csv.part").write_text("whole")
    (folder / "0.csv").write_text("first")
    with watching(folder) as (_, taken):
        taken.wait(1)
        os.replace(tmp_path / beside / "a.csv.part", folder / "a.csv")
        assert taken.wait(2)[1:] == [("a.csv", "whole")]


def test_files_of_a_relative_folder_keep_their_path(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    taken = Outcomes()
    watcher = FolderWatcher(
        Path(folder.name), 0.05, 60.0, lambda path: True, lambda paths: taken(*paths), lambda problem: None
    )
    (folder / "a.csv").write_text("there before")
    watcher.start()
    try:
        taken.wait(1)
        (folder / "b.csv").write_text("told of")
        assert taken.wait(2) == [Path("measurements/a.csv"), Path("measurements/b.csv")]
    finally:
        watcher.close(5.0)


def test_hidden_and_unfinished_files_folders_and_pipes_are_left_alone(folder: Path) -> None:
    (folder / ".hidden.csv").write_text("x")
    (folder / "a.csv.part").write_text("x")
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

    def report_problem(problem: str) -> None:
        problems.append(problem)
        noticed.set()

    watcher = FolderWatcher(folder, 0.05, 60.0, lambda path: True, lambda paths: taken(paths[0].name), report_problem)
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
    watcher = FolderWatcher(folder, 0.0, 60.0, lambda path: True, lambda paths: taken(*paths), lambda problem: None)
    if already_running:
        watcher.start()
    watcher.close(5.0)
    (folder / "a.csv").write_text("x")
    assert not watcher.running
    assert taken.messages == []


def test_file_that_does_not_say_it_is_complete_must_stand_still_for_longer(folder: Path) -> None:
    taken, content = Outcomes(), {"whole": True, "half": False}
    watcher = FolderWatcher(
        folder,
        0.05,
        1.0,
        lambda path: content[path.read_text()],
        lambda paths: [taken((path.read_text(), time.monotonic())) for path in paths],
        lambda problem: None,
    )
    began = time.monotonic()
    watcher.start()
    try:
        (folder / "a.csv").write_text("half")
        (folder / "b.dat").write_text("whole")
        (folder / "c.csv.part").write_text("whole")
        first, second = taken.wait(2)
    finally:
        watcher.close(5.0)
    assert (first[0], second[0]) == ("whole", "half")
    assert second[1] - began >= 1.0


def test_file_of_long_ago_is_taken_at_once(folder: Path) -> None:
    (folder / "a.csv").write_text("half")
    os.utime(folder / "a.csv", (time.time() - 100, time.time() - 100))
    taken = Outcomes()
    watcher = FolderWatcher(
        folder, 0.05, 60.0, lambda path: False, lambda paths: taken(paths[0].name), lambda problem: None
    )
    watcher.start()
    try:
        assert taken.wait(1) == ["a.csv"]
    finally:
        watcher.close(5.0)
