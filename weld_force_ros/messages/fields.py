"""Declare the fields that messages share: names, units, bounds, and the header of every message."""

import hashlib
import itertools
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import UNSET, Meta, UnsetType

T = TypeVar("T")

SCHEMA_VERSION = "1.6"
MAX_MESSAGE_BYTES = 16 * 2**20
MAX_SAMPLES = 50_000
MAX_SPEEDS = 1_000
MAX_POSITIONS = 1_000
MAX_CELLS = 200_000
MAX_TEXT = 65_536
MAX_IDS = 1_000
MAX_SAMPLED = 10_000
MAX_VEHICLES = 20  # over one weld
MIN_PROFILE_SAMPLES = 20
MAX_PROFILE_SPACING_M = 0.010
MAX_MEASURED_SPACING_M = 0.035  # bridged gaps included
MAX_PROFILE_AMPLITUDE_M = 0.010
MAX_PROFILE_LENGTH_M = 5.0
SHA256_PATTERN = r"^[0-9a-f]{64}(?!\n)$"  # to Python, $ alone is also before a last line break
VERSION_PATTERN = r"^[0-9]{1,9}\.[0-9]{1,9}(?!\n)$"
Name = Annotated[str, Meta(min_length=1, max_length=200)]
Text = Annotated[str, Meta(max_length=MAX_TEXT)]
Sha256 = Annotated[str, Meta(pattern=SHA256_PATTERN, description="SHA-256, lower-case hexadecimal")]
Number = Annotated[int, Meta(ge=0, lt=2**53)]
Metres = Annotated[float, Meta(description="m", ge=-1e3, le=1e3)]
ChainageM = Annotated[float, Meta(description="m", ge=-1e8, le=1e8)]
SpeedKmh = Annotated[float, Meta(description="km/h", gt=0.0, le=1000.0)]
ForceN = Annotated[float, Meta(description="N")]
Seconds = Annotated[float, Meta(description="s", ge=0.0)]
Samples = Annotated[list[float], Meta(min_length=MIN_PROFILE_SAMPLES, max_length=MAX_SAMPLES)]
Cells = Annotated[list[Annotated[float, Meta(ge=-1e12, le=1e12)]], Meta(min_length=1, max_length=MAX_CELLS)]
SpeedAxis = Annotated[list[SpeedKmh], Meta(min_length=1, max_length=MAX_SPEEDS)]
PositionAxis = Annotated[list[Metres], Meta(min_length=1, max_length=MAX_POSITIONS)]
Decision = Annotated[
    Literal["accept", "grind", "reject", "undecided"],
    Meta(
        extra_json_schema={"type": "string"},
        description="undecided: the input cannot support a decision; the reason says what is missing",
    ),
]
GeometryKind = Annotated[Literal["dip", "protrusion"], Meta(extra_json_schema={"type": "string"})]
CurveClass = Annotated[
    Literal["rises", "hollow"],
    Meta(extra_json_schema={"type": "string"}, description="hollow: somewhere less speed means more force"),
]
UnknownPosition = Annotated[Literal["undecided", "worst"], Meta(extra_json_schema={"type": "string"})]
Engine = Annotated[Literal["common-poles", "rfp", "reference"], Meta(extra_json_schema={"type": "string"})]
IrregularityKind = Annotated[Literal["weld", "joint", "squat"], Meta(extra_json_schema={"type": "string"})]
Running = Annotated[
    Literal["with", "against", "both"],
    Meta(
        extra_json_schema={"type": "string"},
        description="in which direction trains run over the weld: with, the one in which x rises; against; or both",
    ),
]
Direction = Annotated[
    Literal["with", "against"],
    Meta(extra_json_schema={"type": "string"}, description="of a passage: with, the one in which x rises; or against"),
]
ChainageDirection = Annotated[
    Literal["with", "against"],
    Meta(extra_json_schema={"type": "string"}, description="with: chainage rises with x; against: it falls as x rises"),
]
LengthUnit = Annotated[Literal["m", "cm", "mm", "um"], Meta(extra_json_schema={"type": "string"})]
UpOrDown = Annotated[Literal["up", "down"], Meta(extra_json_schema={"type": "string"})]
ProfileId = Annotated[
    str,
    Meta(pattern=SHA256_PATTERN, description="identity of one measurement, which ends in one verdict or rejection"),
]
ProfileIds = Annotated[list[ProfileId], Meta(max_length=MAX_IDS)]
Batch = Annotated[list[float], Meta(min_length=1, max_length=MAX_SAMPLES)]


class Stamp(msgspec.Struct, kw_only=True, frozen=True):
    """Time since the epoch, in the form of builtin_interfaces/Time."""

    sec: Annotated[int, Meta(ge=-(2**31), lt=2**31)] = 0
    nanosec: Annotated[int, Meta(ge=0, lt=10**9)] = 0


class Message(msgspec.Struct, kw_only=True):
    """The header of every message; `sequence` counts up by one per publisher and topic, so that a gap is a loss.

    `publisher` is a node's full name and a token of its start: DDS tells a Python subscriber not who sent a message.
    """

    schema_version: Annotated[str, Meta(pattern=VERSION_PATTERN)] = SCHEMA_VERSION
    publisher: Annotated[str, Meta(max_length=300)] = ""
    sequence: Number = 0
    stamp: Stamp = Stamp()

    def problem(self) -> str | None:
        """Return why the message is invalid beyond its schema, or None."""
        return None


def wrong_length(of: msgspec.Struct, names: Sequence[str], count: int, where: str = "") -> str | None:
    """Return which of the named columns has not `count` values, in words that begin with `where`, or None."""
    for name in names:
        column = getattr(of, name)
        if column is not UNSET and len(column) != count:
            return f"{where}{name} has {len(column)} values, the axes make {count}"
    return None


def increasing(values: Sequence[float]) -> bool:
    """Return whether each value is larger than the one before it."""
    return all(a < b for a, b in itertools.pairwise(values))


def content_without_header(message: Message, *without: str) -> dict[str, Any]:
    """Return a message's own fields, without the header and those named."""
    builtins: dict[str, Any] = msgspec.to_builtins(message)
    return {k: v for k, v in builtins.items() if k not in (*Message.__struct_fields__, *without)}


def json_sha256(content: object) -> str:
    """Return the SHA-256 of the JSON of `content`, its keys sorted."""
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def known(value: T | UnsetType) -> T | None:
    """Return a field's value, or None where it is absent."""
    return None if isinstance(value, UnsetType) else value
