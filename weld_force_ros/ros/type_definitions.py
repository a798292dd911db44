"""Describe ROS message types for a recording: definition, hash and quality of service."""

import functools
import json
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rosidl_adapter.parser import parse_message_string

from weld_force_ros.recording import MessageDefinition, offered_qos

_SEPARATOR = "=" * 80


def message_definition(message_type: type, qos: QoSProfile) -> MessageDefinition:
    """Return what the recorder has to know of a message type.

    Args:
        message_type: an rclpy message class.
        qos: what the topic is offered with.
    """
    package, name = message_type.__module__.split(".")[0], message_type.__name__
    return MessageDefinition(
        name=f"{package}/msg/{name}",
        text=definition_text(f"{package}/{name}"),
        type_hash=type_hash(f"{package}/{name}"),
        offered_qos_profiles=offered_qos(
            depth=None if qos.history == HistoryPolicy.KEEP_ALL else qos.depth,
            latched=qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        ),
    )


@functools.cache
def definition_text(name: str) -> str:
    """Return the text of a type (`package/Type`) and of all types in it, in the form of encoding `ros2msg`."""
    texts: dict[str, str] = {}
    waiting = [name]
    while waiting:
        current = waiting.pop(0)
        if current not in texts:
            texts[current] = _share(current, "msg").read_text()
            waiting += _field_types(current, texts[current])
    first, *parts = texts.items()
    return "\n".join([first[1], *(f"{_SEPARATOR}\nMSG: {part}\n{text}" for part, text in parts)])


@functools.cache
def type_hash(name: str) -> str:
    """Return the REP-2011 hash of a type (`package/Type`)."""
    package, short = name.split("/")
    hashes = json.loads(_share(name, "json").read_text())["type_hashes"]
    return next(entry["hash_string"] for entry in hashes if entry["type_name"] == f"{package}/msg/{short}")


def _share(name: str, suffix: str) -> Path:
    package, short = name.split("/")
    return Path(get_package_share_directory(package)) / "msg" / f"{short}.{suffix}"


def _field_types(name: str, text: str) -> list[str]:
    package, short = name.split("/")
    types = [field.type for field in parse_message_string(package, short, text).fields]
    return [f"{t.pkg_name}/{t.type}" for t in types if not t.is_primitive_type()]
