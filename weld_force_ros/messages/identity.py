"""Identify measurements: one rule for the nodes, for the ledger that is continued and for what counts a recording."""

import hashlib
from collections.abc import Callable
from typing import Annotated, Protocol

import msgspec
from msgspec import UNSET, UnsetType

from weld_force_ros.errors import MessageError
from weld_force_ros.messages.codec import decode, encodable
from weld_force_ros.messages.fields import MAX_MESSAGE_BYTES, Message, Number, ProfileId, Stamp, json_sha256
from weld_force_ros.messages.profile import WeldProfile
from weld_force_ros.messages.topics import TOPICS


class Header(msgspec.Struct):
    """The fields that are read of a message even if the rest of it is broken."""

    publisher: Annotated[str, msgspec.Meta(max_length=300)] = ""
    sequence: Number = 0
    stamp: msgspec.Raw = msgspec.Raw()

    @property
    def stamped_ns(self) -> int:
        """Return when the message was stamped, in ns since the epoch; 0 if it does not say."""
        try:
            stamp = msgspec.json.decode(self.stamp, type=Stamp)
        except msgspec.DecodeError:
            return 0
        return stamp.sec * 10**9 + stamp.nanosec


class Measured(msgspec.Struct):
    """The fields that say which measurement a message is about."""

    weld_id: str = ""
    profile_sha256: str = ""
    profile_id: ProfileId | UnsetType = UNSET


class _About(Protocol):
    weld_id: str
    profile_sha256: str
    profile_id: str | UnsetType


def read_header(text: str) -> Header | None:
    """Return the header of a message; None if not even that can be read."""
    try:
        return msgspec.json.decode(text, type=Header) if len(text) <= MAX_MESSAGE_BYTES else None
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


def describe(kind: type[Message], header: Header | None) -> str:
    """Return what to call a message in a Rejection: its topic and, if known, its number and who sent it."""
    topic = TOPICS[kind].name
    if header is None or not header.publisher:
        return f"{topic} message"
    return f"{topic} message {header.sequence} of {header.publisher}"


def measurement_id(source: str, content_sha256: str) -> str:
    """Return the identity of one measurement: of where it came from (a file's name) and of its content."""
    return json_sha256([source, content_sha256])


def identity(message: _About) -> str:
    """Return which measurement a message is about; without a name, one geometry of one weld is one measurement."""
    if isinstance(message.profile_id, str):
        return message.profile_id
    return json_sha256([message.weld_id, message.profile_sha256])


def text_identity(source: str, text: str) -> str:
    """Return the identity of an input that could not be used, which has no other than its source and its text."""
    return measurement_id(encodable(source), hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest())


def stated_identity(text: str, is_taken: Callable[[str], bool]) -> str:
    """Return the measurement of a recorded `weld_profile` message as far as its fields state it, without validation.

    Of those that stay without an outcome, a few among thousands, `profile_identity` then tells whether that is so.

    Args:
        text: its JSON, valid or not.
        is_taken: returns whether a profile without outcome has this identity already; then this one is validated.
    """
    try:
        stated = msgspec.json.decode(text, type=Measured)
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return profile_identity(text)
    named = isinstance(stated.profile_id, str) or stated.profile_sha256
    return identity(stated) if named and not is_taken(identity(stated)) else profile_identity(text)


def profile_identity(text: str) -> str:
    """Return the measurement of a `weld_profile` message: what breaks the contract has the identity of its Rejection.

    Args:
        text: its JSON, valid or not.
    """
    try:
        return identity(decode(WeldProfile, text))
    except MessageError:
        return text_identity(describe(WeldProfile, read_header(text)), text)
