"""Run nodes as a program until a signal: outcomes on standard output, what becomes of the nodes on standard error."""

import argparse
import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Any

from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.recording.folder_lock import shown_as_stopping
from weld_force_ros.ros.node_suite import ALL_KINDS, DRAIN_S, Kind, NodeSuite, in_flow_order
from weld_force_ros.ros.outcome_lines import OutcomePrinter

_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_ORPHAN_DRAIN_S = 5.0
"""How long a node goes on whose supervisor was killed: the next one waits for the recording, which keeps the rest."""

_CLOSE_AT_ONCE_S = 2.0


def run_node(
    kind: Kind, ros_args: Sequence[str] = (), *, drain_s: float = DRAIN_S, supervisor: int | None = None
) -> int:
    """Run one node until SIGINT, SIGTERM or SIGHUP: `weld-force node KIND [-- --ros-args ...]`; outcomes are printed.

    Args:
        kind: of node.
        ros_args: as on a ROS command line, from `--ros-args` on.
        drain_s: how long what was taken may take to finish when stopped.
        supervisor: a pipe of whoever supervises the node; its end stops the node, too.

    Returns:
        The exit code: 0 if all that was taken was finished, 1 if something was left.

    Raises:
        InputError: arguments or parameters that cannot be used.
        WeldForceError: the node cannot work.
    """
    with OutcomePrinter() as outcomes:
        suite = NodeSuite((kind,), ros_args=ros_args, on_verdict=outcomes.print, on_rejection=outcomes.print)
        return run_until_signal(suite, drain_s, supervisor)


def run_suite(
    parameters: Mapping[Kind, Mapping[str, Any]], ros_args: Sequence[str] = (), *, drain_s: float = DRAIN_S
) -> int:
    """Run nodes until SIGINT, SIGTERM or SIGHUP: `weld-force up`; outcomes are printed. See `run_node`, `NodeSuite`.

    Args:
        parameters: by kind of node, then by name; kinds beside those of the suite run with it.
        ros_args: as on a ROS command line, from `--ros-args` on.
        drain_s: how long what was taken may take to finish when stopped.
    """
    with OutcomePrinter() as outcomes:
        suite = NodeSuite(
            in_flow_order(parameters),
            parameters=parameters,
            ros_args=ros_args,
            on_verdict=outcomes.print,
            on_rejection=outcomes.print,
        )
        return run_until_signal(suite, drain_s)


def run_until_signal(suite: NodeSuite, drain_s: float = DRAIN_S, supervisor: int | None = None) -> int:
    """Run a suite until a signal or its supervisor's end, then drain and close it; a second signal ends it at once.

    Returns:
        The exit code: 0 if all that was taken was finished, 1 if something was left.

    Raises:
        WeldForceError: what kept a node from working.
    """
    with stop_signals() as (stop, abandon), ExitStack() as ending, suite:
        gc.freeze()  # modules stay: looking for garbage among them held all threads up for 70 ms, again and again
        ending.callback(gc.unfreeze)
        orphaned = _end_of(supervisor) if supervisor is not None else threading.Event()
        while not stop.wait(0.1) and not orphaned.is_set() and suite.failure is None:
            pass
        ending.enter_context(shown_as_stopping())
        if stop.is_set():
            print_line("shutting down, finishing queue; a second signal stops at once")
        elif orphaned.is_set():
            print_line("the supervisor is gone, finishing what is in hand")
        left = suite.drain(min(drain_s, _ORPHAN_DRAIN_S) if orphaned.is_set() else drain_s, abandon)
        open_count, failure = suite.open_count, suite.failure
        if left:
            print_line(f"stopped, {left} messages pending")
        if open_count:
            print_line(f"{open_count} measurements pending; {_what_becomes_of_them(suite)}")
    if failure is not None:
        raise failure if isinstance(failure, WeldForceError) else WeldForceError(f"{type(failure).__name__}: {failure}")
    if not left and not open_count:
        print_line("clean shutdown, 0 pending")
    return 1 if left or open_count else 0


def print_line(text: str) -> None:
    """Print one line about the nodes on standard error, at once; a terminal that was closed stops nobody."""
    with suppress(OSError):
        print(" ".join(text.split()) if "\n" in text else text, file=sys.stderr, flush=True)


@contextmanager
def stop_signals() -> Iterator[tuple[threading.Event, threading.Event]]:
    """Turn a first SIGINT, SIGTERM or SIGHUP into one event and a second into another; a third has its usual effect.

    After the second, the process ends in `_CLOSE_AT_ONCE_S` whatever it waits for. A SIGHUP that is ignored, as under
    `nohup`, stays so.
    """
    first, second = threading.Event(), threading.Event()
    before = {number: signal.getsignal(number) for number in _STOP_SIGNALS}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}
    ending = threading.Timer(_CLOSE_AT_ONCE_S, _end_at_once)
    ending.daemon = True

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def on_signal(number: int, frame: FrameType | None) -> None:
        if first.is_set():
            second.set()
            restore()
            ending.start()
        first.set()

    for number in before:
        signal.signal(number, on_signal)
    try:
        yield first, second
    finally:
        ending.cancel()
        restore()


def _end_of(pipe: int) -> threading.Event:
    """Return an event that is set when the other end of a pipe is closed, as it is when its process dies."""
    ended = threading.Event()

    def wait() -> None:
        while os.read(pipe, 1):
            pass
        ended.set()

    threading.Thread(target=wait, name="supervisor's end", daemon=True).start()
    return ended


def _what_becomes_of_them(suite: NodeSuite) -> str:
    if suite.nodes["assessment"].recorder.records:
        return "they are processed when the same bag is continued"
    return "without a recording they are lost, but for the files in the folder"


def _end_at_once() -> None:
    print_line("ended at once; what was recorded is kept, and completed when the same bag is continued")
    os._exit(1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one node, as `weld-force node` does, for launch files: `python -m weld_force_ros.ros.launcher KIND ...`."""
    parser = argparse.ArgumentParser(prog="weld_force_ros.ros.launcher")
    parser.add_argument("kind", choices=ALL_KINDS)
    parser.add_argument("--supervised", action="store_true", help="end when standard input does")
    known, ros_args = parser.parse_known_args(arguments)
    try:
        supervisor = sys.stdin.fileno() if known.supervised else None
        return run_node(known.kind, [argument for argument in ros_args if argument != "--"], supervisor=supervisor)
    except InputError as error:
        print_line(f"error: {error}")
        return 2
    except WeldForceError as error:
        print_line(f"error: {error}")
        return 1


def profile_node() -> int:
    """Run the profile node: a console command of a ROS installation, as the next five."""
    return main(["profile", *sys.argv[1:]])


def simulator_node() -> int:
    """Run the simulator node."""
    return main(["simulator", *sys.argv[1:]])


def assessment_node() -> int:
    """Run the assessment node."""
    return main(["assessment", *sys.argv[1:]])


def trolley_node() -> int:
    """Run the trolley node."""
    return main(["trolley", *sys.argv[1:]])


def dashboard_node() -> int:
    """Run the dashboard node."""
    return main(["dashboard", *sys.argv[1:]])


def foxglove_node() -> int:
    """Run the Foxglove node."""
    return main(["foxglove", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
