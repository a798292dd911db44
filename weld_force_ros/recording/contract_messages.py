"""The contract messages of a recording, decoded and checked, and a count of the outcomes among them."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from weld_force_ros.errors import BagError, MessageError
from weld_force_ros.messages import (
    TOPICS,
    Measured,
    Message,
    Rejection,
    Verdict,
    WeldProfile,
    decode,
    identity,
    profile_identity,
    stated_identity,
)
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
        measurements: profiles, each counted once however often it was recorded, valid or not.
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


@dataclass
class _OutcomeCounter:
    measured: set[str] = field(default_factory=set)
    settled: set[str] = field(default_factory=set)
    doubled: set[str] = field(default_factory=set)
    without_outcome: dict[str, str] = field(default_factory=dict)
    verdicts: int = 0
    rejections: int = 0

    def accept(self, text: str) -> None:
        self._accept(stated_identity(text, self.without_outcome.__contains__), text)

    def settle(self, kind: type[Message], text: str) -> None:
        try:
            entry = msgspec.json.decode(text, type=Measured)
        except msgspec.DecodeError:
            return  # what cannot be read settles nothing
        self.verdicts += kind is Verdict
        self.rejections += kind is Rejection
        if kind is Rejection and not isinstance(entry.profile_id, str):
            return
        measurement = identity(entry)
        if measurement in self.settled:
            self.doubled.add(measurement)
        self.settled.add(measurement)
        self.without_outcome.pop(measurement, None)

    def counts(self) -> OutcomeCounts:
        entered, self.without_outcome = self.without_outcome, {}
        self.measured -= entered.keys()
        for text in entered.values():
            self._accept(profile_identity(text), text)
        return OutcomeCounts(
            measurements=len(self.measured),
            verdicts=self.verdicts,
            rejections=self.rejections,
            open=len(self.without_outcome),
            doubled=len(self.doubled),
        )

    def _accept(self, measurement: str, text: str) -> None:
        self.measured.add(measurement)
        if measurement not in self.settled:
            self.without_outcome[measurement] = text


def count_outcomes(bag: Bag) -> OutcomeCounts | None:
    """Count how the measurements ended; None for a bag without profile, verdict or rejection."""
    counter = _OutcomeCounter()
    for recorded, kind in _stored_messages(bag, (WeldProfile, Verdict, Rejection)):
        try:
            text = recorded.text
        except BagError:
            continue
        if kind is WeldProfile:
            counter.accept(text)
        else:
            counter.settle(kind, text)
    found = counter.counts()
    return found if found.measurements or found.verdicts or found.rejections else None
