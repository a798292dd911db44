"""Read-only node parameters with descriptors and ranges."""

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node


def text(node: Node, name: str, default: str, description: str) -> str:
    """Declare a string parameter and return its value."""
    return node.declare_parameter(name, default, _descriptor(description)).value


def number(node: Node, name: str, default: float, description: str, *, low: float, high: float) -> float:
    """Declare a number between `low` and `high` and return its value."""
    descriptor = _descriptor(description)
    descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return node.declare_parameter(name, default, descriptor).value


def list_text(node: Node, name: str, default: str, description: str) -> str:
    """Declare a list in text form and return it.

    On a ROS command line `15`, `0.15`, `[40, 80]` and `20:300:5` have four types; all of them are meant.
    """
    value = node.declare_parameter(name, default, _descriptor(description, dynamic_typing=True)).value
    return ",".join(map(str, value)) if isinstance(value, list) or hasattr(value, "typecode") else str(value)


def _descriptor(description: str, *, dynamic_typing: bool = False) -> ParameterDescriptor:
    return ParameterDescriptor(description=description, read_only=True, dynamic_typing=dynamic_typing)
