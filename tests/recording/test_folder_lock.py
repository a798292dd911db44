"""A recording's folder is one process's; who stops, or is a node of who stops, is waited for."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from weld_force_ros.errors import BagError
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
