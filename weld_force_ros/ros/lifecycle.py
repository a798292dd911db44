"""Give every node its lifecycle, its checked parameters and its contract topics."""

from abc import abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.parameters import PARAMETERS, NodeParameter, check_names
from weld_force_ros.ros.worker import BackPressureGroup, Worker

CLOSE_S = 5.0
"""How long a node that is closed waits for the message it handles and for what it has published to arrive."""


class LifecycleNodeBase(LifecycleNode):
    """A lifecycle node with the parameters of its kind.

    Configured, it has its topics and resources; active, it takes what comes in. Inactive, it leaves messages where they
    are: in the middleware, in the folder. Cleaned up, it has released everything, bag included.

    Attributes:
        kind: its name and the key of its parameters in `PARAMETERS`.
        problem: why the last transition failed; None if it did not.
        topics: its contract topics; only while configured.
    """

    kind: str
    topics: ContractTopics
    _worker: Worker[Any] | None = None  # made when configured, by nodes that have one

    def __init__(self, **node_options: Any) -> None:
        super().__init__(self.kind, **node_options)
        self.problem: Exception | None = None
        self._active = False
        self._configured = False
        self._managed = True
        self._resources = ExitStack()
        given: dict[str, Parameter] = self._parameter_overrides  # rclpy has no public name for what a node was given
        check_names(self.kind, given)
        given.update({parameter.name: parameter for parameter in self._as_declared(list(given.values()))})
        for parameter in PARAMETERS[self.kind]:
            self.declare_parameter(parameter.name, parameter.default, _descriptor(parameter))
        self.add_pre_set_parameters_callback(self._as_declared)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._change_parameters)

    @property
    def configured(self) -> bool:
        """Return whether the node has its topics."""
        return self._configured

    @property
    def pending(self) -> int:
        """Return how many messages are queued or being handled, by the node's worker if it has one."""
        return self._worker.pending if self._configured and self._worker is not None else 0

    @property
    def active(self) -> bool:
        """Return whether the node takes what comes in."""
        return self._active

    @property
    def autostarts(self) -> bool:
        """Return whether the node is to be started without a lifecycle manager."""
        return bool(self.get_parameter("autostart").value)

    @property
    def intake_group(self) -> BackPressureGroup:
        """Return a new callback group whose messages wait until the node is active and has room for them."""
        return BackPressureGroup(lambda: self._active and self._has_room)

    @property
    def _has_room(self) -> bool:
        return self._worker is None or self._worker.has_room

    @abstractmethod
    def _configure(self, values: dict[str, Any]) -> None:
        """Make topics and resources; what is to be released goes onto `_resources`.

        Raises:
            WeldForceError: the node cannot work with these parameters.
        """

    def _activate(self) -> None:
        """Begin to take what comes in."""
        self._active = True
        self.wake()

    def _deactivate(self) -> None:
        """Take nothing more; leave what comes in where it is."""
        self._active = False

    def _check_change(self, values: dict[str, Any]) -> None:
        """Raise an InputError if parameters cannot change to these values while the node is configured."""

    def _change(self, values: dict[str, Any]) -> None:
        """Apply a change that was checked; called on the executor's thread."""

    def start(self) -> None:
        """Configure and activate, as a lifecycle manager would.

        Raises:
            WeldForceError: the node cannot be configured.
        """
        self._managed = False
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise self.problem or WeldForceError(f"{self.get_name()} does not start")
        self._managed = True

    def stop_intake(self) -> None:
        """Take nothing new from outside; what upstream nodes still publish belongs to what was taken."""

    def close(self) -> None:
        """Stop after the message being handled and release everything.

        Raises:
            WeldForceError: a resource could not be completed, such as a bag on a full disk.
        """
        if self._active:
            self._deactivate()
        if self._configured:
            self._configured = False
            self._resources.close()

    def destroy_node(self) -> None:
        """Leave the ROS graph, with the state machine that rclpy forgets and that would keep the node in it."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make topics and resources."""
        return self._attempt(self._configure_from_parameters)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to take what comes in."""
        return self._attempt(self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take nothing more."""
        return self._attempt(self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything."""
        return self._attempt(self.close)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything."""
        return self._attempt(self.close)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, so that the node can be configured anew."""
        return self._attempt(self.close)

    def _configure_from_parameters(self) -> None:
        self._configured = True
        try:
            self._configure(self._values({}))
        except Exception:
            self.close()
            raise

    def wake(self) -> None:
        """Let the executor look again at what the intake group held back."""
        if self.executor is not None:
            self.executor.wake()

    def _attempt(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            step()
        except Exception as error:  # the transition is answered with a failure; the node lives on
            self.problem = error
            if self._managed:  # who started the node otherwise raises it
                self.get_logger().error(" ".join(str(error).split()))
            return TransitionCallbackReturn.FAILURE
        self.problem = None
        return TransitionCallbackReturn.SUCCESS

    def _as_declared(self, given: list[Parameter]) -> list[Parameter]:
        """Return parameters with whole numbers as float where the node has a float: YAML makes `600` an integer."""
        floats = {p.name for p in PARAMETERS[self.kind] if isinstance(p.default, float)}
        return [
            Parameter(p.name, value=float(p.value)) if p.name in floats and type(p.value) is int else p for p in given
        ]

    def _check_parameters(self, given: list[Parameter]) -> SetParametersResult:
        changes = self._own(given)
        fixed = [p.name for p in PARAMETERS[self.kind] if p.name in changes and not p.live]
        if not self._configured or not changes:
            return SetParametersResult(successful=True)
        if fixed:
            return SetParametersResult(
                successful=False,
                reason=f"{', '.join(fixed)} cannot change while {self.get_name()} is configured; "
                "deactivate and clean up the node first",
            )
        try:
            self._check_change(self._values(changes))
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _change_parameters(self, given: list[Parameter]) -> None:
        changes = self._own(given)
        if self._configured and changes:
            self._change(self._values(changes))

    def _values(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Return the node's parameters by name, with `changes` in place of what they are now."""
        return {p.name: self.get_parameter(p.name).value for p in PARAMETERS[self.kind]} | changes

    def _own(self, given: list[Parameter]) -> dict[str, Any]:
        own = {parameter.name for parameter in PARAMETERS[self.kind]}
        return {parameter.name: parameter.value for parameter in given if parameter.name in own}


def _descriptor(parameter: NodeParameter) -> ParameterDescriptor:
    when = "" if parameter.live else " (fixed while the node is configured)"
    descriptor = ParameterDescriptor(description=f"{parameter.description}{when}", dynamic_typing=parameter.is_list)
    if parameter.minimum is not None and parameter.maximum is not None:
        if isinstance(parameter.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(parameter.minimum), to_value=int(parameter.maximum))
            ]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=parameter.minimum, to_value=parameter.maximum)
            ]
    return descriptor
