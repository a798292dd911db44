"""Keep which measurements were accepted and which have their one outcome, and read that back from a bag."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import msgspec
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from weld_force_ros.errors import BagError
from weld_force_ros.messages import (
    TOPICS,
    ForceMap,
    Measured,
    Message,
    ProfileIds,
    Rejection,
    Settled,
    Verdict,
    WeldProfile,
    identity,
    profile_identity,
    stated_identity,
)
from weld_force_ros.recording import STRING, Recorded, stored

RESEND_BATCH = 16
"""How many measurements are sent again at once."""

_KINDS = {topic.name: topic.type for topic in TOPICS.values()}


class RecordedOutcome(NamedTuple):
    """A serialised outcome, kept until it is no longer needed."""

    kind: type[Message]
    cdr: bytes


class Ledger:
    """Measurements by their identity: accepted and open, or settled by a verdict or a rejection.

    Of an open one it keeps the force maps, until those of all vehicles are there.

    Attributes:
        unfinished: outcomes that a killed process recorded, but perhaps did not publish.
        waiting_maps: force maps that it recorded without their verdict, serialised, in the order recorded.
    """

    def __init__(self) -> None:
        self.unfinished: dict[str, RecordedOutcome] = {}
        self.waiting_maps: dict[str, list[bytes]] = {}
        self._settled: set[bytes] = set()
        self._profiles: set[bytes] = set()
        self._open: dict[str, bytes] = {}
        self._gathered: dict[str, dict[str, ForceMap]] = {}

    @property
    def open_count(self) -> int:
        """Return how many accepted measurements have no outcome."""
        return len(self._open)

    @property
    def settled_count(self) -> int:
        """Return how many measurements have their outcome."""
        return len(self._settled)

    def accept(self, profile_id: str, cdr: bytes) -> None:
        """Note that a profile is there, and keep it until it has its outcome."""
        self._profiles.add(bytes.fromhex(profile_id))
        if not self.is_settled(profile_id):
            self._open[profile_id] = cdr

    def is_settled(self, profile_id: str) -> bool:
        """Return whether a measurement has its verdict or rejection."""
        return bytes.fromhex(profile_id) in self._settled

    def has_profile(self, profile_id: str) -> bool:
        """Return whether a measurement's profile is there; its outcome may come before it."""
        return bytes.fromhex(profile_id) in self._profiles

    def is_open(self, profile_id: str) -> bool:
        """Return whether a measurement was accepted and has no outcome."""
        return profile_id in self._open

    def settle(self, profile_id: str) -> None:
        """Note that a measurement has its outcome."""
        self._settled.add(bytes.fromhex(profile_id))
        self._open.pop(profile_id, None)
        self.waiting_maps.pop(profile_id, None)
        self._gathered.pop(profile_id, None)

    def gather(self, force_map: ForceMap) -> list[ForceMap]:
        """Keep a force map until those of all vehicles over the weld are there; then return all, before that none."""
        maps = self._gathered.setdefault(identity(force_map), {})
        maps[force_map.config_sha256] = force_map
        configs = force_map.configs_judged
        return [maps[config] for config in configs] if maps.keys() >= set(configs) else []

    def settled_of(self, profile_ids: Iterable[str]) -> list[str]:
        """Return those of the measurements that have their outcome."""
        return [profile_id for profile_id in profile_ids if self.is_settled(profile_id)]

    def identify_open(self, identity_of: Callable[[bytes], str]) -> None:
        """Put what is open under the identity that `identity_of` returns of a profile; drop what has its outcome."""
        entered, self._open = self._open, {}
        self._profiles -= {bytes.fromhex(profile_id) for profile_id in entered}
        for cdr in entered.values():
            self.accept(identity_of(cdr), cdr)

    def oldest_open(self) -> list[bytes]:
        """Return the profiles that have waited longest, serialised; the next call returns others first."""
        oldest = list(self._open.items())[:RESEND_BATCH]
        for profile_id, cdr in oldest:
            del self._open[profile_id]
            self._open[profile_id] = cdr
        return [cdr for _, cdr in oldest]


class _Entry(Measured):
    profile_ids: ProfileIds = msgspec.field(default_factory=list)
    asked_by: str = ""


def read_ledger(bag: Path, note: Callable[[type[Message], str], None]) -> Ledger:
    """Read the ledger of a recording that is to be continued.

    Args:
        bag: its folder, in whatever state a killed process left it.
        note: called with type and text of each recorded contract message.

    Raises:
        BagError: the folder cannot be read.
    """
    ledger = Ledger()
    for recorded in stored(bag):
        kind = _KINDS.get(recorded.topic.rpartition("/")[2])
        if kind is None or recorded.definition.name != STRING.name:
            continue
        try:
            text = recorded.text
            entry = msgspec.json.decode(text, type=_Entry)
        except BagError:
            continue
        except msgspec.DecodeError:
            entry = None  # what cannot be read settles nothing
        if entry is not None:
            note(kind, text)
        if kind is WeldProfile:
            ledger.accept(stated_identity(text, ledger.is_open), recorded.data)
        elif entry is not None:
            _enter(ledger, kind, recorded, entry)
    ledger.identify_open(lambda cdr: profile_identity(deserialize_message(cdr, String).data))
    return ledger


def _enter(ledger: Ledger, kind: type[Message], recorded: Recorded, entry: _Entry) -> None:
    if kind is Settled and not entry.asked_by:
        for profile_id in entry.profile_ids:
            ledger.settle(profile_id)
            ledger.unfinished.pop(profile_id, None)
    elif kind is ForceMap and not ledger.is_settled(identity(entry)):
        ledger.waiting_maps.setdefault(identity(entry), []).append(recorded.data)
    elif kind is Verdict or (kind is Rejection and isinstance(entry.profile_id, str)):
        ledger.settle(identity(entry))
        ledger.unfinished[identity(entry)] = RecordedOutcome(kind, recorded.data)
