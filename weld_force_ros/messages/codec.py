"""Read and write the JSON of messages, with every check that their types cannot make."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from weld_force_ros.errors import MessageError
from weld_force_ros.messages.fields import MAX_MESSAGE_BYTES, SCHEMA_VERSION, VERSION_PATTERN, Message

_LONGEST_REASON = 300
M = TypeVar("M", bound=Message)


class _Version(msgspec.Struct):
    schema_version: Annotated[str, Meta(pattern=VERSION_PATTERN)]


def encode(message: Message) -> bytes:
    """Return the JSON of a message that keeps the contract.

    Raises:
        MessageError: a value that the contract forbids (a NaN, unequal lengths, a bound exceeded).
    """
    try:
        data = msgspec.json.encode(message)
    except UnicodeError as error:
        raise MessageError(f"{type(message).__name__}: {error}", "give text that UTF-8 can hold") from None
    decode(type(message), data)
    return data


def decode(kind: type[M], data: bytes | str) -> M:
    """Read and validate one message.

    Raises:
        MessageError: not JSON, another major version, or against the contract.
    """
    name = kind.__name__
    # A lone surrogate is no text that JSON could hold: as bytes it is refused like any other damage.
    raw = data.encode(errors="surrogatepass") if isinstance(data, str) else data
    if len(raw) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{name}: {len(raw)} bytes", f"send at most {MAX_MESSAGE_BYTES}")
    try:
        version = msgspec.json.decode(raw, type=_Version).schema_version
        if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
            raise MessageError(
                f"{name}: schema version {version} is unknown here",
                f"send version {SCHEMA_VERSION} or update this node",
            )
        message = msgspec.json.decode(raw, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"{name}: {legible(str(error))}", f"send JSON after msgs_json/{name}.json") from None
    problem = _not_finite(message) or message.problem()
    if problem:
        raise MessageError(f"{name}: {problem}", f"send JSON after msgs_json/{name}.json")
    return message


def legible(reason: str) -> str:
    """Return a parser's message, which may hold any part of the input, as one short printable line."""
    line = " ".join("".join(c if c.isprintable() else " " for c in reason).split())
    return line if len(line) <= _LONGEST_REASON else line[:_LONGEST_REASON] + "…"


def encodable(text: str) -> str:
    """Return text that UTF-8 can hold: half a surrogate pair, from a file name of unknown encoding, becomes a `?`."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _not_finite(message: msgspec.Struct) -> str | None:
    for field in message.__struct_fields__:
        value = getattr(message, field)
        values = value if isinstance(value, list) else [value]
        if _are_finite(values):
            continue
        if any(isinstance(v, float) and not math.isfinite(v) for v in values):
            return f"{field} holds a number that is not finite"
        for item in values:
            if isinstance(item, msgspec.Struct) and (problem := _not_finite(item)):
                return f"{field}: {problem}"
    return None


def _are_finite(values: Sequence[Any]) -> bool:
    """Return whether values are numbers with a finite sum, which only finite ones have; columns are long."""
    try:
        return math.isfinite(sum(values))
    except (TypeError, OverflowError):
        return False
