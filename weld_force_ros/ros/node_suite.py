"""Run nodes in one process, and stop them without losing what they took.

with NodeSuite(parameters={"profile": {"folder": "measurements"}}, on_verdict=print) as suite:
    ...
    suite.drain(timeout_s=30.0)
"""

import faulthandler
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import Any, Literal, Self

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from weld_force_ros.assessment.judge import Simulates
from weld_force_ros.errors import InputError
from weld_force_ros.messages import ForceHistory, ForceMap, Message, Rejection, SimulationSettings, Verdict, WeldProfile
from weld_force_ros.ros import environment
from weld_force_ros.ros.executor import OneThreadExecutor
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.assessment_node import AssessmentNode
from weld_force_ros.ros.nodes.dashboard_node import DashboardNode
from weld_force_ros.ros.nodes.profile_node import ProfileNode
from weld_force_ros.ros.nodes.simulator_node import SimulatorNode
from weld_force_ros.ros.nodes.trolley_node import TrolleyNode
from weld_force_ros.simulation import simulator

Kind = Literal["trolley", "profile", "simulator", "assessment", "dashboard", "foxglove"]

KINDS: tuple[Kind, ...] = ("profile", "simulator", "assessment")
"""The nodes of the suite, in the order in which messages pass them."""
ALL_KINDS: tuple[Kind, ...] = ("trolley", *KINDS, "dashboard", "foxglove")
DRAIN_S = 30.0
LEAVE_S = 10.0
"""How long the middleware may take to let nodes go."""
_POLL_S = 0.02
"""Pause between two looks at a condition that has no event of its own."""
_IDLE_POLLS = 5

# When draining, the second node has to have taken what the first has published of these types.
_FLOWS: tuple[tuple[Kind, Kind, tuple[type[Message], ...]], ...] = (
    ("profile", "simulator", (WeldProfile,)),
    ("profile", "assessment", (WeldProfile, Rejection)),
    ("simulator", "assessment", (SimulationSettings, ForceMap, ForceHistory, Rejection)),
)


class NodeSuite:
    """Nodes in one process, on the thread of one executor; a context manager.

    Args:
        kinds: which nodes.
        parameters: by kind of node, then by name; they override those of `ros_args`.
        ros_args: as on a ROS command line, from `--ros-args` on.
        domain_id: ROS domain; `ROS_DOMAIN_ID` if absent.
        load_simulator: returns the simulator for given settings.
        on_force_map: called with each valid force map (needs the assessment node, as the next two).
        on_verdict: called with each verdict, in the assessment node's worker thread, once it is recorded and published.
        on_rejection: called with each rejection of any node, likewise.

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
        self._on_message: dict[str, Any] = {
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
        environment.check_message_extensions()
        environment.stay_on_this_machine()
        self._start_ros()
        self._executor = OneThreadExecutor(context=self._context)
        self._thread = threading.Thread(target=self._spin, name="executor", daemon=True)
        try:
            for kind in reversed(ALL_KINDS):  # subscribers before publishers
                if kind in self._kinds:
                    node = self.nodes[kind] = self._create_node(kind)
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
        """Return what keeps a node from working at all; None if nothing does."""
        failures = (node.topics.diagnostics.failure for node in self.nodes.values() if node.configured)
        return self._crash or next(filter(None, failures), None)

    @property
    def left(self) -> int:
        """Return how many messages wait in and between the nodes; 0 once all that was taken has its outcome."""
        # In the order of the flow: what a node has published is counted before the next node's queue.
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
        """Return how many accepted measurements have no outcome; they get it when their bag is continued."""
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
        idle = 0  # what the middleware still holds shows up between two looks
        while idle < _IDLE_POLLS and not self.failure and time.monotonic() < deadline:
            idle = 0 if self.left else idle + 1
            if abandon.wait(_POLL_S):
                break
        return 0 if idle >= _IDLE_POLLS else self.left  # the nodes exchange diagnostics for as long as they run

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
            stack.callback(self._leave)
            for kind in reversed(ALL_KINDS):
                if kind in self.nodes:
                    stack.callback(self.nodes[kind].close)

    def _leave(self) -> None:
        """Take the nodes out of the ROS graph; the process ends with 1 if the middleware never comes back from it.

        Fast DDS 2.14 waits for itself for ever if it hears of another participant at the wrong moment, and lets no
        other thread of Python run meanwhile. All that is to be kept is closed by then.
        """
        faulthandler.dump_traceback_later(LEAVE_S, exit=True, file=sys.__stderr__ or 2)
        try:
            for node in self.nodes.values():
                node.destroy_node()
            self._context.try_shutdown()
        finally:
            faulthandler.cancel_dump_traceback_later()

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

    def _create_node(self, kind: Kind) -> LifecycleNodeBase:
        overrides = [Parameter(name, value=value) for name, value in self._parameters.get(kind, {}).items()]
        options: dict[str, Any] = {"context": self._context, "parameter_overrides": overrides}
        try:
            if kind == "trolley":
                return TrolleyNode(**options)
            if kind == "dashboard":
                return DashboardNode(**options)
            if kind == "foxglove":
                return _foxglove_node(**options)
            if kind == "profile":
                return ProfileNode(**options)
            if kind == "simulator":
                return SimulatorNode(load=self._load_simulator, **options)
            return AssessmentNode(**self._on_message, **options)
        except ParameterException as error:
            raise InputError(_one_line(error), "give a value of that type and range") from None

    def _spin(self) -> None:
        try:
            with suppress(ExternalShutdownException):
                self._executor.spin()
        except Exception as error:  # a fault of a callback would otherwise end the thread unnoticed
            self._crash = error

    def _stop_intake(self) -> None:
        """Stop the first node of the chain: only it takes from outside, the others get what it still publishes."""
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


def _foxglove_node(**options: Any) -> LifecycleNodeBase:
    try:
        from weld_force_ros.ros.nodes.foxglove_node import FoxgloveNode
    except ModuleNotFoundError as error:
        raise InputError(
            f"streaming to Foxglove needs {error.name}", "install it with `pip install 'weld_force_ros[foxglove]'`"
        ) from None
    return FoxgloveNode(**options)


def in_flow_order(kinds: Iterable[Kind]) -> tuple[Kind, ...]:
    """Return the nodes of the suite and those of `kinds`, in the order in which messages pass them."""
    wanted = {*KINDS, *kinds}
    return tuple(kind for kind in ALL_KINDS if kind in wanted)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
