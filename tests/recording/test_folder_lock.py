"""A recording's folder is one process's; who stops, or is a node of who stops, is waited for."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from weld_force_ros.errors import BagError
from weld_force_ros.recording import folder_lock
from weld_force_ros.recording.folder_lock import lock_folder

NODE = """
import sys, time
from pathlib import Path
from weld_force_ros.recording.folder_lock import lock_folder
lock_folder(Path(sys.argv[1]), print)
print("held", flush=True)
time.sleep(60)
"""
SUPERVISOR = f"""
import subprocess, sys
from weld_force_ros.recording.folder_lock import shown_as_stopping
node = subprocess.Popen([sys.executable, "-c", {NODE!r}, sys.argv[1]])
sys.stdin.readline()
with shown_as_stopping():  # the node is not told yet
    print("stopping", flush=True)
    sys.stdin.readline()
    node.kill()
    node.wait()
"""


def test_a_node_whose_supervisor_is_stopping_is_waited_for(tmp_path: Path) -> None:
    said: list[str] = []
    with subprocess.Popen(
        [sys.executable, "-c", SUPERVISOR, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as supervisor:
        assert supervisor.stdin is not None
        assert supervisor.stdout is not None
        goes_on = supervisor.stdin

        def say(line: str) -> None:
            said.append(line)
            print(file=goes_on, flush=True)

        assert supervisor.stdout.readline() == "held\n"
        with pytest.raises(BagError, match="is being recorded to by process"):
            lock_folder(tmp_path, say)
        print(file=goes_on, flush=True)
        assert supervisor.stdout.readline() == "stopping\n"
        os.close(lock_folder(tmp_path, say))
    (line,) = said
    assert "which is stopping" in line


def test_a_process_that_lets_go_as_it_is_looked_for_is_no_hindrance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = [lock_folder(tmp_path, print)]

    def let_go(_: Path) -> None:
        os.close(held.pop())

    monkeypatch.setattr(folder_lock, "_holder", let_go)
    os.close(lock_folder(tmp_path, print))


def test_a_holder_that_cannot_be_named_is_not_waited_for_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held = lock_folder(tmp_path, print)
    monkeypatch.setattr(folder_lock, "_holder", lambda _: None)
    monkeypatch.setattr(folder_lock, "_POLL_S", 0.0)
    with pytest.raises(BagError, match="is being recorded to already"):
        lock_folder(tmp_path, print)
    os.close(held)
