"""Nodes as a running program: one or all in a process, stopped without losing what was taken.

with NodeSuite(parameters={"profile": {"folder": "measurements"}}, on_verdict=print) as suite:
    ...
    suite.drain(timeout_s=30.0)
"""

import argparse
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType, TracebackType
from typing import Any, Literal, Self

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from weld_force_ros.assessment.judge import Simulates
from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.messages import ForceHistory, ForceMap, Message, Rejection, SimulationSettings, Verdict, WeldProfile
from weld_force_ros.ros import environment
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.assessment_node import AssessmentNode
from weld_force_ros.ros.nodes.dashboard_node import DashboardNode
from weld_force_ros.ros.nodes.profile_node import ProfileNode
from weld_force_ros.ros.nodes.simulator_node import SimulatorNode
from weld_force_ros.ros.nodes.trolley_node import TrolleyNode
from weld_force_ros.simulation import simulator

Kind = Literal["trolley", "profile", "simulator", "assessment", "dashboard"]

KINDS: tuple[Kind, ...] = ("profile", "simulator", "assessment")
"""The suite, in the order of the flow."""
ALL_KINDS: tuple[Kind, ...] = ("trolley", *KINDS, "dashboard")
DRAIN_S = 30.0
_LOOK_S = 0.02
"""How often a condition that has no event of its own is looked at."""
_QUIET_LOOKS = 5

# Who waits for whom when draining: what the first publishes of a kind, the second has to have taken.
_FLOWS: tuple[tuple[Kind, Kind, tuple[type[Message], ...]], ...] = (
    ("profile", "simulator", (WeldProfile,)),
    ("profile", "assessment", (WeldProfile, Rejection)),
    ("simulator", "assessment", (SimulationSettings, ForceMap, ForceHistory, Rejection)),
)


class NodeSuite:
    """Nodes of the suite in one process, on one executor's thread; a context manager.

    Args:
        kinds: which nodes.
        parameters: by kind, then by name; they go before those of `ros_args`.
        ros_args: as on a ROS command line, from `--ros-args` on.
        domain_id: ROS domain; `ROS_DOMAIN_ID` if absent.
        load_simulator: makes the simulator from its settings.
        on_force_map: told of each valid force map (needs the assessment node, as the next two).
        on_verdict: told of each verdict, on the assessment node's worker thread, after it is recorded and published.
        on_rejection: told of each rejection of any node, likewise.

    Raises:
        InputError: (on entering) ROS arguments or parameters that cannot be used.
    """

    def __init__(
        self,
        kinds: Sequence[Kind] = KINDS,
        *,
        parameters: Mapping[Kind, Mapping[str, Any]] | None = None,
        ros_args: Sequence[str] = (),
        domain_id: int | None = None,
        load_simulator: Callable[[SimulationSettings], Simulates] = simulator.Simulator,
        on_force_map: Callable[[ForceMap], None] | None = None,
        on_verdict: Callable[[Verdict], None] | None = None,
        on_rejection: Callable[[Rejection], None] | None = None,
    ) -> None:
        self._kinds = kinds
        self._parameters = parameters or {}
        self._ros_args = list(ros_args)
        self._domain_id = domain_id
        self._load_simulator = load_simulator
        self._callbacks: dict[str, Any] = {
            "on_force_map": on_force_map,
            "on_verdict": on_verdict,
            "on_rejection": on_rejection,
        }
        self._context = rclpy.Context()
        self.closing = False
        self._crash: Exception | None = None
        self.nodes: dict[Kind, Any] = {}

    def __enter__(self) -> Self:
        environment.prepare()
        environment.stay_on_this_machine()
        self._start_ros()
        self._executor = SingleThreadedExecutor(context=self._context)
        self._thread = threading.Thread(target=self._spin, name="executor", daemon=True)
        try:
            for kind in reversed(ALL_KINDS):  # those that listen first
                if kind in self._kinds:
                    node = self.nodes[kind] = self._make(kind)
                    self._executor.add_node(node)
                    if node.autostarts:
                        node.start()
        except BaseException:
            self.close()
            raise
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def failure(self) -> Exception | None:
        """What keeps a node from working at all, if anything does."""
        failures = (node.topics.diagnostics.failure for node in self.nodes.values() if node.configured)
        return self._crash or next(filter(None, failures), None)

    @property
    def left(self) -> int:
        """How many messages between and in the nodes still wait; 0 when all that was taken has its outcome."""
        # In the order of the flow: what a node has handed on is counted before the next is asked.
        waiting = 0
        for kind in ALL_KINDS:
            if kind in self.nodes and self.nodes[kind].configured:
                # What is queued in a node is under way to it, too.
                waiting += max(self._under_way_to(kind), self.nodes[kind].pending)
        return max(waiting, self.nodes["assessment"].awaited) if self._lone_assessment else waiting

    @property
    def _lone_assessment(self) -> bool:
        return set(self.nodes) == {"assessment"} and self.nodes["assessment"].configured

    @property
    def open_count(self) -> int:
        """Measurements accepted that have no outcome; their bag, continued, gives it to them."""
        assessment = self.nodes.get("assessment")
        return assessment.open_count if assessment is not None and assessment.configured else 0

    def drain(self, timeout_s: float = DRAIN_S, abandon: threading.Event | None = None) -> int:
        """Take nothing new and finish what was taken.

        Args:
            timeout_s: how long at most.
            abandon: set by another thread to stop at once.

        Returns:
            How many messages were left.
        """
        abandon = abandon or threading.Event()
        deadline = time.monotonic() + timeout_s
        self._stop_intake()
        quiet = 0  # what the middleware still holds shows up between two looks
        while quiet < _QUIET_LOOKS and not self.failure and time.monotonic() < deadline:
            quiet = 0 if self.left else quiet + 1
            if abandon.wait(_LOOK_S):
                break
        return 0 if quiet >= _QUIET_LOOKS else self.left  # diagnostics come and go for ever

    def close(self) -> None:
        """Stop at once, but close and index the bag; after `drain` nothing is lost by it.

        Raises:
            BagError: the bag could not be completed; its messages are kept.
        """
        if self.closing:
            return
        self.closing = True
        self._stop_intake()
        self._executor.shutdown(timeout_sec=CLOSE_S)
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)
        with ExitStack() as stack:  # whatever one of them cannot complete, the others are closed
            stack.callback(self._context.try_shutdown)
            for kind in reversed(ALL_KINDS):
                if kind in self.nodes:
                    stack.callback(self.nodes[kind].destroy_node)
                    stack.callback(self.nodes[kind].close)

    def _start_ros(self) -> None:
        remedy = "check the arguments after --ros-args"
        try:
            foreign = remove_ros_args(["", *self._ros_args])[1:]
            rclpy.init(
                args=self._ros_args,
                context=self._context,
                domain_id=self._domain_id,
                signal_handler_options=SignalHandlerOptions.NO,
            )
        except Exception as error:  # rclpy has no common class for the errors of its arguments
            raise InputError(f"ROS does not start: {_one_line(error)}", remedy) from None
        if foreign:
            self._context.try_shutdown()
            raise InputError(f"{' '.join(foreign)} is unknown", remedy)

    def _make(self, kind: Kind) -> LifecycleNodeBase:
        overrides = [Parameter(name, value=value) for name, value in self._parameters.get(kind, {}).items()]
        options: dict[str, Any] = {"context": self._context, "parameter_overrides": overrides}
        try:
            if kind == "trolley":
                return TrolleyNode(**options)
            if kind == "dashboard":
                return DashboardNode(**options)
            if kind == "profile":
                return ProfileNode(**options)
            if kind == "simulator":
                return SimulatorNode(load=self._load_simulator, **options)
            return AssessmentNode(**self._callbacks, **options)
        except ParameterException as error:
            raise InputError(
                _one_line(error), "give a value of that type and range; 600 is no double, 600.0 is"
            ) from None

    def _spin(self) -> None:
        try:
            with suppress(ExternalShutdownException):
                self._executor.spin()
        except Exception as error:  # a fault of a callback would otherwise end the thread unnoticed
            self._crash = error

    def _stop_intake(self) -> None:
        """Only the first node of the chain takes from outside; the others get what it still hands on."""
        for kind in ALL_KINDS:
            if kind in self.nodes:
                self.nodes[kind].stop_intake()
                if kind in KINDS:  # a simulated trolley goes before the chain
                    return

    def _under_way_to(self, taker: Kind) -> int:
        return sum(
            self.nodes[sender].topics.sent(message)
            - self.nodes[taker].topics.taken_from(self.nodes[sender].topics.instance, message)
            for sender, receiver, messages in _FLOWS
            if receiver == taker and sender in self.nodes and self.nodes[sender].configured
            for message in messages
        )


def run_node(kind: Kind, ros_args: Sequence[str] = (), *, drain_s: float = DRAIN_S) -> int:
    """Run one node until SIGINT or SIGTERM: `weld-force node KIND [-- --ros-args ...]`; outcomes are shown.

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
    """Run nodes until SIGINT or SIGTERM: `weld-force up`; outcomes are shown. See `run_node` and `Suite`.

    Args:
        parameters: by kind, then by name; kinds beside those of the suite run with it.
        ros_args: as on a ROS command line, from `--ros-args` on.
        drain_s: how long what was taken may take when stopped.
    """
    suite = NodeSuite(
        in_flow_order(parameters),
        parameters=parameters,
        ros_args=ros_args,
        on_verdict=print_outcome,
        on_rejection=print_outcome,
    )
    return run_until_signal(suite, drain_s)


def in_flow_order(kinds: Iterable[Kind]) -> tuple[Kind, ...]:
    """The nodes of the suite, and others beside them, in the order of the flow."""
    wanted = {*KINDS, *kinds}
    return tuple(kind for kind in ALL_KINDS if kind in wanted)


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
            print_line("stopping: finishing what was taken; a second signal stops at once")
        left = suite.drain(drain_s, abandon)
        open_count, failure = suite.open_count, suite.failure
    if failure is not None:
        raise failure if isinstance(failure, WeldForceError) else WeldForceError(f"{type(failure).__name__}: {failure}")
    print_line(f"stopped with {left} messages left unfinished" if left else "stopped, nothing left unfinished")
    if open_count:
        print_line(f"{open_count} measurements have no outcome yet; they get it when the same bag is continued")
    return 1 if left or open_count else 0


def print_outcome(outcome: Verdict | Rejection) -> None:
    """One line for whoever stands beside the trolley."""
    if isinstance(outcome, Verdict):
        speed = f"; {outcome.advice[0]}" if outcome.advice and outcome.decision != "accept" else ""
        print_line(f"{outcome.decision.upper():9} {outcome.weld_id}: {outcome.reason}{speed}")
    else:
        print_line(f"UNUSABLE  {outcome.source}: {outcome.reason}; {outcome.remedy}")


def print_line(text: str) -> None:
    """A line on standard error, at once."""
    print(" ".join(text.split()) if "\n" in text else text, file=sys.stderr, flush=True)


@contextmanager
def stop_signals() -> Iterator[tuple[threading.Event, threading.Event]]:
    """Turn a first SIGINT or SIGTERM into one event and a second into another; a third has its usual effect."""
    first, second = threading.Event(), threading.Event()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def note(number: int, frame: FrameType | None) -> None:
        if first.is_set():
            second.set()
            restore()
        first.set()

    for number in before:
        signal.signal(number, note)
    try:
        yield first, second
    finally:
        restore()


def main(arguments: Sequence[str] | None = None) -> int:
    """`python -m weld_force_ros.ros.launcher KIND [--ros-args ...]`, for launch files, as `weld-force node`."""
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
    """Console entry of a ROS installation, as the next four."""
    return main(["profile", *sys.argv[1:]])


def simulator_node() -> int:
    """See `profile_node`."""
    return main(["simulator", *sys.argv[1:]])


def assessment_node() -> int:
    """See `profile_node`."""
    return main(["assessment", *sys.argv[1:]])


def trolley_node() -> int:
    """See `profile_node`."""
    return main(["trolley", *sys.argv[1:]])


def dashboard_node() -> int:
    """See `profile_node`."""
    return main(["dashboard", *sys.argv[1:]])


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
