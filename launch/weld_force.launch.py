"""Launch the nodes of one rail: bring them up through their lifecycle, and start them again when they die.

ros2 launch weld_force_ros weld_force.launch.py namespace:=left folder:=measurements/left bag:=monday-left
"""

import asyncio
from contextlib import suppress
from pathlib import Path

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.events.process import ProcessStarted
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.ros_adapters import get_ros_node
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import GetState

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity

PACKAGE = "weld_force_ros"
RESPAWN_DELAY_S = 2.0
ANSWER_S = 1.0
STOP_S = 35.0
"""A node that gets a signal to stop has 30 s to finish what it has taken; another signal would cut that short."""


class BringUp:
    """Configures and activates a node whenever its process has started.

    A request is only sent once the new process answers: for some 20 s after a kill, ROS still shows the services of the
    old one, and requests to them are lost.
    """

    def __init__(self, node: LifecycleNode) -> None:
        self._node = node
        self._waits = False
        self._state = None

    def handlers(self) -> list[LaunchDescriptionEntity]:
        """Return what is to happen when the process has started and when the node is configured."""
        return [
            RegisterEventHandler(OnProcessStart(target_action=self._node, on_start=self._on_start)),
            RegisterEventHandler(
                OnStateTransition(
                    target_lifecycle_node=self._node,
                    start_state="configuring",
                    goal_state="inactive",
                    entities=[EmitEvent(event=self._change(Transition.TRANSITION_ACTIVATE))],
                )
            ),
        ]

    def _on_start(self, event: ProcessStarted, context: LaunchContext) -> None:
        if not self._waits:
            self._waits = True
            context.add_completion_future(context.asyncio_loop.create_task(self._configure(context)))

    async def _configure(self, context: LaunchContext) -> None:
        if self._state is None:
            self._state = get_ros_node(context).create_client(GetState, f"{self._node.node_name}/get_state")
        while not context.is_shutdown and not await self._answers(context):
            pass
        self._waits = False
        if not context.is_shutdown:
            await context.emit_event(self._change(Transition.TRANSITION_CONFIGURE))

    async def _answers(self, context: LaunchContext) -> bool:
        answered = asyncio.Event()
        request = self._state.call_async(GetState.Request())
        request.add_done_callback(lambda _: context.asyncio_loop.call_soon_threadsafe(answered.set))
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(answered.wait(), ANSWER_S)
        self._state.remove_pending_request(request)
        return answered.is_set()

    def _change(self, transition: int) -> ChangeState:
        return ChangeState(lifecycle_node_matcher=matches_action(self._node), transition_id=transition)


def bring_up(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the nodes and what brings them up, with the arguments that were given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ("config", "folder", "bag", "autostart")}
    if not Path(given["config"]).is_file():
        raise RuntimeError(f"config {given['config']}: no such file; name a file of ROS parameters")
    nodes = [
        _node("assessment_node", given["config"], {"bag": given["bag"]}),
        _node("simulator_node", given["config"], {}),
        _node("profile_node", given["config"], {"folder": given["folder"]}),
    ]
    handlers = [handler for node in nodes for handler in BringUp(node).handlers()]
    return [*(handlers if given["autostart"] == "true" else []), *nodes]


def _node(name: str, config: str, folders: dict[str, str]) -> LifecycleNode:
    paths = {key: str(Path(value).expanduser().absolute()) for key, value in folders.items() if value}
    own = {key: ParameterValue(path, value_type=str) for key, path in paths.items()}
    return LifecycleNode(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[config, {"autostart": False, **own}],
        output="screen",
        respawn=True,
        respawn_delay=RESPAWN_DELAY_S,
        sigterm_timeout=str(STOP_S),
    )


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes, as `ros2 launch` requires."""
    shipped = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "default.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", default_value=shipped, description="file of ROS parameters (YAML)"),
            DeclareLaunchArgument("namespace", default_value="", description="of the nodes, such as left or right"),
            DeclareLaunchArgument(
                "folder", default_value="", description="folder of measurement files; empty: as in config"
            ),
            DeclareLaunchArgument("bag", default_value="", description="folder to record to; empty: as in config"),
            DeclareLaunchArgument(
                "autostart",
                default_value="true",
                choices=["true", "false"],
                description="configure and activate the nodes; false leaves that to a lifecycle manager",
            ),
            OpaqueFunction(function=bring_up),
        ]
    )
