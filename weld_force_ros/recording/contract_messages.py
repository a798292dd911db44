"""The suite's own messages in a recording: read after the contract, and the outcomes among them counted."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
from msgspec import UNSET, UnsetType

from weld_force_ros.errors import BagError, MessageError
from weld_force_ros.messages import TOPICS, Message, Rejection, Verdict, WeldProfile, decode, identity
from weld_force_ros.recording.mcap_reader import Recorded
from weld_force_ros.recording.reader import Bag
from weld_force_ros.recording.rosbag2_format import STRING


class ContractMessage(NamedTuple):
    """A message of the suite, or what is wrong with it."""

    topic: str
    message: Message | BagError
    log_time_ns: int


def contract_messages(bag: Bag) -> Iterator[ContractMessage]:
    """The suite's messages in log order, whatever namespace they were recorded in.

    One that breaks the contract comes as a BagError in its place, so that the others are not lost.
    """
    for recorded, message in recorded_messages(bag):
        yield ContractMessage(recorded.topic, message, recorded.log_time_ns)


def recorded_messages(bag: Bag) -> Iterator[tuple[Recorded, Message | BagError]]:
    """As `contract_messages`, each with what it was recorded as."""
    for recorded, kind in _of_suite(bag, TOPICS):
        yield recorded, _contract_message(recorded, kind)


def _of_suite(bag: Bag, kinds: Collection[type[Message]]) -> Iterator[tuple[Recorded, type[Message]]]:
    by_name = {TOPICS[kind].name: kind for kind in kinds}
    named = {topic for topic, _ in bag.tally.counts if topic.rpartition("/")[2] in by_name}
    for recorded in bag.messages(named):
        if recorded.definition.name == STRING.name:
            yield recorded, by_name[recorded.topic.rpartition("/")[2]]


def _contract_message(recorded: Recorded, kind: type[Message]) -> Message | BagError:
    try:
        return decode(kind, recorded.text)
    except MessageError as error:
        return recorded.problem(error.reason, error.remedy)
    except BagError as error:
        return error


@dataclass(frozen=True)
class Outcomes:
    """How the measurements of a recording ended.

    Attributes:
        measurements: profiles, each counted once however often it was recorded.
        verdicts: recorded verdicts.
        rejections: recorded rejections, of measurements and of files that were none.
        open: profiles with neither.
        doubled: measurements with more than one outcome.
    """

    measurements: int
    verdicts: int
    rejections: int
    open: int
    doubled: int


class _Entry(msgspec.Struct):
    """What of a message tells which measurement it is about."""

    weld_id: str = ""
    profile_sha256: str = ""
    profile_id: str | UnsetType = UNSET


@dataclass
class _Account:
    profiles: dict[str, str] = field(default_factory=dict)
    settled: set[str] = field(default_factory=set)
    doubled: set[str] = field(default_factory=set)
    refused_geometries: set[str] = field(default_factory=set)
    verdicts: int = 0
    rejections: int = 0

    def settle(self, measurement: str) -> None:
        if measurement in self.settled:
            self.doubled.add(measurement)
        self.settled.add(measurement)

    def enter(self, kind: type[Message], entry: _Entry) -> None:
        if kind is WeldProfile:
            self.profiles[identity(entry)] = entry.profile_sha256
        elif kind is Verdict:
            self.verdicts += 1
            self.settle(identity(entry))
        else:
            self.rejections += 1
            if isinstance(entry.profile_id, str):
                self.settle(entry.profile_id)
            else:
                self.refused_geometries.add(entry.profile_sha256)

    def is_open(self, measurement: str, profile_sha256: str) -> bool:
        return measurement not in self.settled and profile_sha256 not in self.refused_geometries


def outcomes(bag: Bag) -> Outcomes | None:
    """Count what became of the measurements; None for a bag without profile, verdict or rejection."""
    account = _Account()
    for recorded, kind in _of_suite(bag, (WeldProfile, Verdict, Rejection)):
        try:
            entry = msgspec.json.decode(recorded.text, type=_Entry)
        except (BagError, msgspec.DecodeError):
            continue  # what cannot be read settles nothing
        account.enter(kind, entry)
    if not (account.profiles or account.verdicts or account.rejections):
        return None
    return Outcomes(
        measurements=len(account.profiles),
        verdicts=account.verdicts,
        rejections=account.rejections,
        open=sum(account.is_open(*profile) for profile in account.profiles.items()),
        doubled=len(account.doubled),
    )
