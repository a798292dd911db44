"""The nodes of one rail, brought up as lifecycle nodes and started again when they die."""

from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription


def generate_launch_description():
    nodes = [
        LifecycleNode(
            package="weld_force_ros",
            executable=n,
            name=n,
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("config"), {"autostart": False}],
            output="screen",
            respawn=True,
            respawn_delay=2.0,
        )
        for n in ("assessment_node", "simulator_node", "profile_node")
    ]
    out = [
        DeclareLaunchArgument("namespace", default_value=""),
        DeclareLaunchArgument(
            "config", default_value=PathJoinSubstitution([FindPackageShare("weld_force_ros"), "config", "default.yaml"])
        ),
    ]
    for node in nodes:

        def change(t):
            return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=t))

        out += [
            RegisterEventHandler(
                OnProcessStart(target_action=node, on_start=[change(Transition.TRANSITION_CONFIGURE)])
            ),
            RegisterEventHandler(
                OnStateTransition(
                    target_lifecycle_node=node,
                    start_state="configuring",
                    goal_state="inactive",
                    entities=[change(Transition.TRANSITION_ACTIVATE)],
                )
            ),
        ]
    return LaunchDescription(out + nodes)
