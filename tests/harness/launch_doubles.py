"""Stands in for launch and launch_ros, which PyPI does not have: records what a launch file makes of them.

The signatures are those of launch 3.4 and launch_ros 0.26 (Jazzy), as far as the launch file uses them: another
name for an argument fails here, too.
"""

import asyncio
import sys
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import pytest


class LaunchDescriptionEntity:
    pass


@dataclass
class LaunchDescription:
    entities: list[Any]


class LaunchContext:
    """What a launch file may ask of the running launch."""

    def __init__(self, configurations: dict[str, str]) -> None:
        self.configurations = configurations
        self.is_shutdown = False
        self.emitted: list[Any] = []
        self.tasks: list[asyncio.Task[None]] = []
        self.ros_node = RosNode()

    @property
    def asyncio_loop(self) -> asyncio.AbstractEventLoop:
        return asyncio.get_running_loop()

    def add_completion_future(self, task: asyncio.Task[None]) -> None:
        self.tasks.append(task)

    async def emit_event(self, event: Any) -> None:
        self.emitted.append(event)


@dataclass(frozen=True)
class LaunchConfiguration:
    name: str

    def perform(self, context: LaunchContext) -> str:
        return context.configurations[self.name]


@dataclass
class PathJoinSubstitution:
    parts: list[Any]


@dataclass
class FindPackageShare:
    package: str


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: Any = None
    description: str = ""
    choices: list[str] | None = None


@dataclass
class OpaqueFunction:
    function: Callable[[LaunchContext], list[Any]]


@dataclass
class EmitEvent:
    event: Any


@dataclass
class RegisterEventHandler:
    event_handler: Any


@dataclass
class OnProcessStart:
    target_action: Any
    on_start: Callable[[Any, LaunchContext], None]


@dataclass
class ProcessStarted:
    action: Any


def matches_action(action: Any) -> Callable[[Any], bool]:
    return lambda other: other is action


@dataclass(frozen=True)
class ParameterValue:
    value: Any
    value_type: type


@dataclass(eq=False)
class LifecycleNode:
    name: str
    namespace: Any
    package: str
    executable: str
    parameters: list[Any]
    output: str
    respawn: bool
    respawn_delay: float
    sigterm_timeout: str

    @property
    def node_name(self) -> str:
        return f"/{self.name}"


@dataclass
class OnStateTransition:
    target_lifecycle_node: LifecycleNode
    start_state: str
    goal_state: str
    entities: list[EmitEvent]


@dataclass
class ChangeState:
    lifecycle_node_matcher: Callable[[Any], bool]
    transition_id: int


@dataclass
class Request:
    """A call to a service: a future that is done when somebody answers."""

    callbacks: list[Callable[[Any], None]] = field(default_factory=list)

    def add_done_callback(self, callback: Callable[[Any], None]) -> None:
        self.callbacks.append(callback)

    def answer(self) -> None:
        for callback in self.callbacks:
            callback(self)


@dataclass
class Client:
    service: str
    waiting: list[Request] = field(default_factory=list)
    requests: int = 0

    def call_async(self, request: Any) -> Request:
        self.requests += 1
        self.waiting.append(Request())
        return self.waiting[-1]

    def remove_pending_request(self, request: Request) -> None:
        self.waiting.remove(request)


@dataclass
class RosNode:
    clients: dict[str, Client] = field(default_factory=dict)

    def create_client(self, service_type: type, name: str) -> Client:
        assert name not in self.clients, "one client a service"
        return self.clients.setdefault(name, Client(name))


def get_ros_node(context: LaunchContext) -> RosNode:
    return context.ros_node


MODULES: dict[str, tuple[Any, ...]] = {
    "launch": (LaunchContext, LaunchDescription, LaunchDescriptionEntity),
    "launch.actions": (DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler),
    "launch.event_handlers": (OnProcessStart,),
    "launch.events": (matches_action,),
    "launch.events.process": (ProcessStarted,),
    "launch.substitutions": (LaunchConfiguration, PathJoinSubstitution),
    "launch_ros": (),
    "launch_ros.actions": (LifecycleNode,),
    "launch_ros.event_handlers": (OnStateTransition,),
    "launch_ros.events": (),
    "launch_ros.events.lifecycle": (ChangeState,),
    "launch_ros.parameter_descriptions": (ParameterValue,),
    "launch_ros.ros_adapters": (get_ros_node,),
    "launch_ros.substitutions": (FindPackageShare,),
}


def install(patch: pytest.MonkeyPatch) -> None:
    """Let launch files import these."""
    for name, contents in MODULES.items():
        module = ModuleType(name)
        for content in contents:
            setattr(module, content.__name__, content)
        patch.setitem(sys.modules, name, module)


def run(scenario: Coroutine[Any, Any, None]) -> None:
    """Run a scenario on a loop of its own; one that does not end is a failure."""
    asyncio.run(asyncio.wait_for(scenario, 20.0))
