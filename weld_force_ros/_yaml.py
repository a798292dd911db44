"""Read small YAML files of plain content as the type they are declared to hold."""

from importlib.resources.abc import Traversable
from typing import TypeVar

import msgspec
import yaml

MAX_BYTES = 65_536
"""The size a file may have."""
_MAX_DEPTH = 8
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # that of libyaml where PyYAML was built with it

T = TypeVar("T")


def read(path: Traversable) -> bytes:
    """Return the content of a YAML file, of which no more than `MAX_BYTES` are read.

    Raises:
        OSError, ValueError: not readable, or too large.
    """
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError(f"over {MAX_BYTES} bytes")
    return data


def decode(data: bytes, kind: type[T]) -> T:
    """Read plain YAML as `kind`: no anchors, aliases or tags, and no deep nesting.

    Those can make a small file grow without bound or overflow the C stack of the full parser, and none is needed here.

    Raises:
        ValueError, msgspec.DecodeError: not plain YAML, or not of that kind.
    """
    depth = 0
    try:
        for event in yaml.parse(data, Loader=_LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            line = event.start_mark.line + 1 if event.start_mark else 1
            if isinstance(event, yaml.NodeEvent) and (event.anchor or getattr(event, "tag", None)):
                raise ValueError(f"line {line}: anchors, aliases and tags are not read")
            if depth > _MAX_DEPTH:
                raise ValueError(f"line {line}: nested deeper than {_MAX_DEPTH} levels")
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None
    return msgspec.yaml.decode(data, type=kind)
