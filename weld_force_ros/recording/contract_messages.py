"""The contract messages of a recording, decoded and checked, and a count of the outcomes among them."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
from msgspec import UNSET, UnsetType

from weld_force_ros.errors import BagError, MessageError
from weld_force_ros.messages import TOPICS, Message, Rejection, Verdict, WeldProfile, decode, identity
from weld_force_ros.recording.reader import Bag
from weld_force_ros.recording.recorded import Recorded
from weld_force_ros.recording.rosbag2_format import STRING


class ContractMessage(NamedTuple):
    """A contract message, or the error that says what is wrong with it."""

    topic: str
    message: Message | BagError
    log_time_ns: int


def contract_messages(bag: Bag) -> Iterator[ContractMessage]:
    """Yield the contract messages in log order, whatever namespace they were recorded in.

    One that breaks the contract comes as a BagError in its place, so that the others are not lost.
    """
    for recorded, message in recorded_messages(bag):
        yield ContractMessage(recorded.topic, message, recorded.log_time_ns)


def recorded_messages(bag: Bag) -> Iterator[tuple[Recorded, Message | BagError]]:
    """Yield each contract message with the stored one; see `contract_messages`."""
    for recorded, kind in _stored_messages(bag, TOPICS):
        yield recorded, _contract_message(recorded, kind)


def _stored_messages(bag: Bag, kinds: Collection[type[Message]]) -> Iterator[tuple[Recorded, type[Message]]]:
    by_name = {TOPICS[kind].name: kind for kind in kinds}
    named = {topic for topic, _ in bag.statistics.counts if topic.rpartition("/")[2] in by_name}
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
class OutcomeCounts:
    """The numbers of measurements of a recording by how they ended.

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


class _MeasurementIdentity(msgspec.Struct):
    """The fields of a message that say which measurement it is about."""

    weld_id: str = ""
    profile_sha256: str = ""
    profile_id: str | UnsetType = UNSET


@dataclass
class _OutcomeCounter:
    profiles: dict[str, str] = field(default_factory=dict)
    settled: set[str] = field(default_factory=set)
    doubled: set[str] = field(default_factory=set)
    rejected_geometries: set[str] = field(default_factory=set)
    verdicts: int = 0
    rejections: int = 0

    def settle(self, measurement: str) -> None:
        if measurement in self.settled:
            self.doubled.add(measurement)
        self.settled.add(measurement)

    def count(self, kind: type[Message], entry: _MeasurementIdentity) -> None:
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
                self.rejected_geometries.add(entry.profile_sha256)

    def is_open(self, measurement: str, profile_sha256: str) -> bool:
        return measurement not in self.settled and profile_sha256 not in self.rejected_geometries


def count_outcomes(bag: Bag) -> OutcomeCounts | None:
    """Count how the measurements ended; None for a bag without profile, verdict or rejection."""
    counter = _OutcomeCounter()
    for recorded, kind in _stored_messages(bag, (WeldProfile, Verdict, Rejection)):
        try:
            entry = msgspec.json.decode(recorded.text, type=_MeasurementIdentity)
        except (BagError, msgspec.DecodeError):
            continue  # what cannot be read settles nothing
        counter.count(kind, entry)
    if not (counter.profiles or counter.verdicts or counter.rejections):
        return None
    return OutcomeCounts(
        measurements=len(counter.profiles),
        verdicts=counter.verdicts,
        rejections=counter.rejections,
        open=sum(counter.is_open(*profile) for profile in counter.profiles.items()),
        doubled=len(counter.doubled),
    )
