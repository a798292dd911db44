"""Run the nodes as one process each; one that dies is started again, and that is printed."""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import yaml

from weld_force_ros.errors import WeldForceError
from weld_force_ros.recording.folder_lock import shown_as_stopping
from weld_force_ros.ros import environment
from weld_force_ros.ros.launcher import print_line, stop_signals
from weld_force_ros.ros.node_suite import DRAIN_S, Kind, in_flow_order

_POLL_S = 0.1
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 5.0
_STEADY_S = 3.0
_BAD_INPUT = 2
_AT_ONCE_S = 5.0
_FEW_ARENAS = {"MALLOC_ARENA_MAX": "2"}  # each thread's own arena would keep 10 MB and more that it needed once


class NodeProcess:
    """The process of one node.

    Args:
        kind: of node.
        arguments: of a ROS command line.
        standard_input: a pipe that ends with this process, which the node's notices.

    Attributes:
        kind: of node.
        starts: how often it was started.
    """

    def __init__(self, kind: Kind, arguments: Sequence[str], standard_input: int) -> None:
        self._standard_input = standard_input
        self.kind = kind
        self.starts = 0
        self._command = [sys.executable, "-m", "weld_force_ros.ros.launcher", kind, "--supervised", *arguments]
        self._wait_s = _FIRST_PAUSE_S
        self._start_at_s = 0.0
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int | None:
        """Return the id of the running process; None while there is none."""
        return self._process.pid if self._process is not None else None

    def start(self) -> None:
        """Start the process; signals of the terminal do not reach it, it is stopped in its turn."""
        self._process = subprocess.Popen(
            self._command, start_new_session=True, env={**_FEW_ARENAS, **os.environ}, stdin=self._standard_input
        )
        self._started_s = time.monotonic()
        self.starts += 1

    def restart_dead(self) -> int | None:
        """Start the process again if it has died, after a pause that grows while it keeps dying.

        Returns:
            The exit code if it has just died, else None.
        """
        if self._process is None:
            if time.monotonic() >= self._start_at_s:
                self.start()
            return None
        code = self._process.poll()
        if code is not None:
            self._process = None
            steady = time.monotonic() - self._started_s > _STEADY_S
            self._wait_s = _FIRST_PAUSE_S if steady or self.starts == 1 else min(2 * self._wait_s, _LONGEST_PAUSE_S)
            self._start_at_s = time.monotonic() + self._wait_s
            how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
            print_line(f"{self.kind} node {how}; starting it again in {self._wait_s:g} s, nothing accepted is lost")
        return code

    def stop(self, timeout_s: float, abandon: threading.Event | None = None) -> int:
        """End the process once it has finished what it took, at once if `abandon` is set, and return its exit code."""
        process, abandon = self._process, abandon or threading.Event()
        if process is None:
            return 0
        process.terminate()
        deadline_s = time.monotonic() + timeout_s
        while process.poll() is None and time.monotonic() < deadline_s and not abandon.wait(_POLL_S):
            pass
        if abandon.is_set() and self.kind == "assessment":  # the others keep nothing that is not in folder or recording
            _terminate_at_once(process)
        process.kill()
        code = process.wait()
        # Ended by the signal itself: it had no handler for it yet, so it had taken nothing.
        return 0 if code == -signal.SIGTERM else code


def _terminate_at_once(process: "subprocess.Popen[bytes]") -> None:
    for _ in range(2):  # a second signal ends it at once; the first of these may be the second
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_AT_ONCE_S / 2)


class Supervisor:
    """The nodes as processes; a context manager that stops them in the order in which messages pass them.

    Args:
        parameters: by kind of node, then by name; kinds beside those of the suite run with it.
        ros_args: as on a ROS command line, from `--ros-args` on; for every node.
        abandon: set to have the processes ended at once.
    """

    def __init__(
        self,
        parameters: Mapping[Kind, Mapping[str, Any]],
        ros_args: Sequence[str] = (),
        abandon: threading.Event | None = None,
    ) -> None:
        self._abandon = abandon or threading.Event()
        self._parameters = parameters
        self._kinds = in_flow_order(parameters)
        self._ros_args = list(ros_args) or ["--ros-args"]
        self.processes: dict[Kind, NodeProcess] = {}
        self.code = 0

    def __enter__(self) -> "Supervisor":
        environment.stay_on_this_machine()
        environment.check_loopback()
        self._stack = ExitStack()
        file = Path(self._stack.enter_context(tempfile.TemporaryDirectory())) / "parameters.yaml"
        nodes = {f"/**/{k}_node": {"ros__parameters": dict(given)} for k, given in self._parameters.items()}
        file.write_text(yaml.safe_dump({k: v for k, v in nodes.items() if v["ros__parameters"]}))
        arguments = [*self._ros_args, "--params-file", str(file)] if any(self._parameters.values()) else self._ros_args
        read_end, write_end = os.pipe()  # the write end is not inherited: it closes when this process ends
        self._stack.callback(os.close, read_end)
        self._stack.callback(os.close, write_end)
        self.processes = {kind: NodeProcess(kind, arguments, read_end) for kind in self._kinds}
        for kind in reversed(self._kinds):  # subscribers before publishers
            self.processes[kind].start()
        return self

    def restart_dead(self) -> None:
        """Start the processes again that have died.

        Raises:
            WeldForceError: a node cannot be started as it is configured.
        """
        for process in self.processes.values():
            if process.restart_dead() == _BAD_INPUT and process.starts == 1:
                raise WeldForceError(f"the {process.kind} node cannot work like this; see the line above")

    def __exit__(self, *_: object) -> None:
        with self._stack:
            for kind in self._kinds:  # each has published what it took before the next is stopped
                self.code |= int(self.processes[kind].stop(DRAIN_S + 10.0, self._abandon) != 0)
        if self._abandon.is_set():
            print_line("nodes ended at once; what they had in hand is processed when the same bag is continued")


def supervise(parameters: Mapping[Kind, Mapping[str, Any]], ros_args: Sequence[str] = ()) -> int:
    """Run the nodes as processes until SIGINT, SIGTERM or SIGHUP: `weld-force up --processes`.

    Returns:
        The exit code: 0 if all that was taken was finished, 1 if something was left.

    Raises:
        InputError: the nodes cannot find each other.
        WeldForceError: a node cannot be started as it is configured.
    """
    with stop_signals() as (stop, abandon), ExitStack() as ending:
        supervisor = Supervisor(parameters, ros_args, abandon)
        with supervisor:
            while not stop.wait(_POLL_S):
                supervisor.restart_dead()
            ending.enter_context(shown_as_stopping())  # of its nodes that are not told yet, too
            print_line("shutting down, each node finishes its queue; a second signal stops at once")
    return supervisor.code
