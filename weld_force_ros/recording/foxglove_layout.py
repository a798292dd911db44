"""A layout for Foxglove and Lichtblick that shows an export: verdicts, forces, rejections."""

from importlib import resources
from typing import Any

import msgspec


def foxglove_layout(namespace: str = "") -> bytes:
    """Return the layout's JSON for the topics of a namespace.

    Args:
        namespace: such as `/left`; empty: none.
    """
    file = resources.files("weld_force_ros.data") / "foxglove" / "weld-force.json"
    content = _in_namespace(msgspec.json.decode(file.read_bytes()), namespace)
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"


def _in_namespace(content: Any, namespace: str) -> Any:
    match content:
        case dict():
            return {name: _in_namespace(value, namespace) for name, value in content.items()}
        case list():
            return [_in_namespace(value, namespace) for value in content]
        case str() if content.startswith("/"):  # nothing but message paths begins like this
            return namespace + content
    return content
