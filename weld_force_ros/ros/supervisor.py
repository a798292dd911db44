"""Run the nodes as one process each; one that dies is started again, and that is printed."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import yaml

from weld_force_ros.errors import WeldForceError
from weld_force_ros.ros import environment
from weld_force_ros.ros.launcher import print_line, stop_signals
from weld_force_ros.ros.node_suite import DRAIN_S, Kind, in_flow_order

_POLL_S = 0.1
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 5.0
_STEADY_S = 3.0
_BAD_INPUT = 2
_FEW_ARENAS = {"MALLOC_ARENA_MAX": "2"}  # each thread's own arena would keep 10 MB and more that it needed once


class NodeProcess:
    """The process of one node.

    Attributes:
        kind: of node.
        starts: how often it was started.
    """

    def __init__(self, kind: Kind, arguments: Sequence[str]) -> None:
        self.kind = kind
        self.starts = 0
        self._command = [sys.executable, "-m", "weld_force_ros.ros.launcher", kind, *arguments]
        self._wait_s = _FIRST_PAUSE_S
        self._start_at_s = 0.0
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int | None:
        """Return the id of the running process; None while there is none."""
        return self._process.pid if self._process is not None else None

    def start(self) -> None:
        """Start the process; signals of the terminal do not reach it, it is stopped in its turn."""
        self._process = subprocess.Popen(self._command, start_new_session=True, env={**_FEW_ARENAS, **os.environ})
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

    def stop(self, timeout_s: float) -> int:
        """End the process once it has finished what it took, and return its exit code."""
        if self._process is None:
            return 0
        self._process.terminate()
        try:
            code = self._process.wait(timeout_s)
            # Ended by the signal itself: it had no handler for it yet, so it had taken nothing.
            return 0 if code == -signal.SIGTERM else code
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


class Supervisor:
    """The nodes as processes; a context manager that stops them in the order in which messages pass them.

    Args:
        parameters: by kind of node, then by name; kinds beside those of the suite run with it.
        ros_args: as on a ROS command line, from `--ros-args` on; for every node.
    """

    def __init__(self, parameters: Mapping[Kind, Mapping[str, Any]], ros_args: Sequence[str] = ()) -> None:
        self._parameters = parameters
        self._kinds = in_flow_order(parameters)
        self._ros_args = list(ros_args) or ["--ros-args"]
        self.processes: dict[Kind, NodeProcess] = {}
        self.code = 0

    def __enter__(self) -> "Supervisor":
        environment.stay_on_this_machine()
        self._stack = ExitStack()
        file = Path(self._stack.enter_context(tempfile.TemporaryDirectory())) / "parameters.yaml"
        nodes = {f"/**/{k}_node": {"ros__parameters": dict(given)} for k, given in self._parameters.items()}
        file.write_text(yaml.safe_dump({k: v for k, v in nodes.items() if v["ros__parameters"]}))
        arguments = [*self._ros_args, "--params-file", str(file)] if any(self._parameters.values()) else self._ros_args
        self.processes = {kind: NodeProcess(kind, arguments) for kind in self._kinds}
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
                self.code |= int(self.processes[kind].stop(DRAIN_S + 10.0) != 0)


def supervise(parameters: Mapping[Kind, Mapping[str, Any]], ros_args: Sequence[str] = ()) -> int:
    """Run the nodes as processes until SIGINT or SIGTERM: `weld-force up --processes`.

    Returns:
        The exit code: 0 if all that was taken was finished, 1 if something was left.

    Raises:
        WeldForceError: a node cannot be started as it is configured.
    """
    with stop_signals() as (stop, _):
        supervisor = Supervisor(parameters, ros_args)
        with supervisor:
            while not stop.wait(_POLL_S):
                supervisor.restart_dead()
            print_line("shutting down, each node finishes its queue")
    return supervisor.code
