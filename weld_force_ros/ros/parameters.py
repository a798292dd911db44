"""Node parameters of `node_parameters` in ROS: declared with descriptors and ranges, and read."""

from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from weld_force_ros.ros.parameter_file import PARAMETERS, NodeParameter


def declare(node: Node, kind: str) -> None:
    """Declare what a kind of node has (a key of `PARAMETERS`); a value given at the start is in place then.

    Raises:
        ParameterException: a value of another type or out of its range.
    """
    for parameter in PARAMETERS[kind]:
        node.declare_parameter(parameter.name, parameter.default, _descriptor(parameter))


def values(node: Node, kind: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """A node's parameters by name, with `changes` in place of what they are now."""
    return {p.name: node.get_parameter(p.name).value for p in PARAMETERS[kind]} | dict(changes)


def _descriptor(parameter: NodeParameter) -> ParameterDescriptor:
    when = "" if parameter.live else " (fixed while the node is configured)"
    descriptor = ParameterDescriptor(description=f"{parameter.description}{when}", dynamic_typing=parameter.listed)
    if parameter.low is not None and parameter.high is not None:
        if isinstance(parameter.default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high))]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    return descriptor
