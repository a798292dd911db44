"""Run nodes as a program until a signal, and print their outcomes."""

import argparse
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.messages import Rejection, Verdict
from weld_force_ros.ros.node_suite import ALL_KINDS, DRAIN_S, Kind, NodeSuite, in_flow_order


def run_node(kind: Kind, ros_args: Sequence[str] = (), *, drain_s: float = DRAIN_S) -> int:
    """Run one node until SIGINT or SIGTERM: `weld-force node KIND [-- --ros-args ...]`; outcomes are printed.

    Returns:
        The exit code: 0 if all that was taken was finished, 1 if something was left.

    Raises:
        InputError: arguments or parameters that cannot be used.
        WeldForceError: the node cannot work.
    """
    return run_until_signal(
        NodeSuite((kind,), ros_args=ros_args, on_verdict=print_outcome, on_rejection=print_outcome), drain_s
    )


def run_suite(
    parameters: Mapping[Kind, Mapping[str, Any]], ros_args: Sequence[str] = (), *, drain_s: float = DRAIN_S
) -> int:
    """Run nodes until SIGINT or SIGTERM: `weld-force up`; outcomes are printed. See `run_node` and `NodeSuite`.

    Args:
        parameters: by kind of node, then by name; kinds beside those of the suite run with it.
        ros_args: as on a ROS command line, from `--ros-args` on.
        drain_s: how long what was taken may take to finish when stopped.
    """
    suite = NodeSuite(
        in_flow_order(parameters),
        parameters=parameters,
        ros_args=ros_args,
        on_verdict=print_outcome,
        on_rejection=print_outcome,
    )
    return run_until_signal(suite, drain_s)


def run_until_signal(suite: NodeSuite, drain_s: float = DRAIN_S) -> int:
    """Run a suite until SIGINT or SIGTERM, then drain and close it; a second signal stops at once.

    Returns:
        The exit code: 0 if all that was taken was finished, 1 if something was left.

    Raises:
        WeldForceError: what kept a node from working.
    """
    with stop_signals() as (stop, abandon), suite:
        while not stop.wait(0.1) and suite.failure is None:
            pass
        if stop.is_set():
            print_line("shutting down, finishing queue; a second signal stops at once")
        left = suite.drain(drain_s, abandon)
        open_count, failure = suite.open_count, suite.failure
    if failure is not None:
        raise failure if isinstance(failure, WeldForceError) else WeldForceError(f"{type(failure).__name__}: {failure}")
    if left:
        print_line(f"stopped, {left} messages pending")
    elif not open_count:
        print_line("clean shutdown, 0 pending")
    if open_count:
        print_line(f"{open_count} measurements pending; they are processed when the same bag is continued")
    return 1 if left or open_count else 0


def print_outcome(outcome: Verdict | Rejection) -> None:
    """Print an outcome in one line."""
    if isinstance(outcome, Verdict):
        speed = f"; {outcome.advice[0]}" if outcome.advice and outcome.decision != "accept" else ""
        under = f" under {outcome.vehicle}" if isinstance(outcome.vehicle, str) else ""
        print_line(f"{outcome.decision.upper():10} {outcome.weld_id}{under}: {outcome.reason}{speed}")
    else:
        print_line(f"UNREADABLE {outcome.source}: {outcome.reason}; {outcome.remedy}")


def print_line(text: str) -> None:
    """Print one line on standard error, at once."""
    print(" ".join(text.split()) if "\n" in text else text, file=sys.stderr, flush=True)


@contextmanager
def stop_signals() -> Iterator[tuple[threading.Event, threading.Event]]:
    """Turn a first SIGINT or SIGTERM into one event and a second into another; a third has its usual effect."""
    first, second = threading.Event(), threading.Event()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def on_signal(number: int, frame: FrameType | None) -> None:
        if first.is_set():
            second.set()
            restore()
        first.set()

    for number in before:
        signal.signal(number, on_signal)
    try:
        yield first, second
    finally:
        restore()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one node, as `weld-force node` does, for launch files: `python -m weld_force_ros.ros.launcher KIND ...`."""
    parser = argparse.ArgumentParser(prog="weld_force_ros.ros.launcher")
    parser.add_argument("kind", choices=ALL_KINDS)
    known, ros_args = parser.parse_known_args(arguments)
    try:
        return run_node(known.kind, [argument for argument in ros_args if argument != "--"])
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
