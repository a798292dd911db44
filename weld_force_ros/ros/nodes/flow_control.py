"""Publish measurements that have no outcome yet, and limit how many are without one at once."""

import threading
import time
from collections.abc import Callable, Sequence

from weld_force_ros.messages import MAX_IDS, Inquiry, Rejection, Settled, WeldProfile
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.qos import MAX_OUTSTANDING
from weld_force_ros.ros.serialized_messages import SerializedMessage

_POLL_S = 0.02
_LEDGER_APPEARS_S = 1.0
_ANSWER_WITHIN_S = 5.0
_ASK_AGAIN_S = 3.0


class FlowControl:
    """Publishes at most `MAX_OUTSTANDING` measurements ahead of their outcomes, and only those without an outcome.

    The assessment node keeps the ledger. Where there is none, everything is sent, up to the window.

    Args:
        topics: the node's contract topics.
        ledgers: returns how many assessment nodes there are now.
        stopping: set when waiting is to be given up.
    """

    def __init__(self, topics: ContractTopics, ledgers: Callable[[], int], stopping: threading.Event) -> None:
        self._topics = topics
        self._ledgers = ledgers
        self._stopping = stopping
        self._settled: set[bytes] = set()
        self._under_way: dict[bytes, int] = {}
        self._answered: set[int] = set()
        self._changed = threading.Condition()
        self._began_s = self._last_settled_s = time.monotonic()

    @property
    def under_way(self) -> int:
        """Return how many measurements were published that have no outcome yet."""
        return len(self._under_way)

    @property
    def full(self) -> bool:
        """Return whether no more measurements may be published for now."""
        with self._changed:
            oldest = next(iter(self._under_way.values()), self._sent)
            # Nothing without an outcome may be pushed out of what the publishers keep for those who join late.
            return len(self._under_way) >= MAX_OUTSTANDING or self._sent - oldest >= 2 * MAX_OUTSTANDING - 1

    def take_settled(self, serialized: SerializedMessage) -> None:
        """Note which measurements have their outcome; called in the executor's thread."""
        incoming = self._topics.receive(Settled, serialized)
        settled = self._topics.decode_or_report(Settled, incoming)
        if settled is None or incoming.replayed:  # settled for the ledger of a recording, not for the one here
            return
        with self._changed:
            self._last_settled_s = time.monotonic()
            for profile_id in settled.profile_ids:
                self._settled.add(bytes.fromhex(profile_id))
                self._under_way.pop(bytes.fromhex(profile_id), None)
            if settled.asked_by == self._topics.instance:
                self._answered.add(settled.asked_sequence)
            self._changed.notify_all()

    def without_outcome(self, profile_ids: Sequence[str]) -> set[str]:
        """Return the measurements that neither have an outcome nor are under way, as far as a ledger answers."""
        unknown = [profile_id for profile_id in profile_ids if not self._known(profile_id)]
        for begin in range(0, len(unknown), MAX_IDS):
            self._ask(unknown[begin : begin + MAX_IDS])
        return {profile_id for profile_id in unknown if not self._known(profile_id)}

    def send(self, message: WeldProfile | Rejection) -> bool:
        """Publish a measurement or its rejection once there is room; return False if stopped before.

        Raises:
            MessageError: the message breaks the contract; nothing was published.
        """
        if not self._wait(lambda: not self.full):
            return False
        key = bytes.fromhex(str(message.profile_id))
        with self._changed:
            self._under_way[key] = self._sent
        try:
            self._topics.publish(message)
        except Exception:
            with self._changed:
                self._under_way.pop(key, None)
            raise
        return True

    def ask_again(self) -> None:
        """Ask for what is under way if no outcome came for a while: a killed assessment node may not have sent it."""
        with self._changed:
            overdue = list(self._under_way) if time.monotonic() - self._last_settled_s > _ASK_AGAIN_S else []
        if overdue and self._ledgers():
            self._topics.publish(Inquiry(profile_ids=[key.hex() for key in overdue]))

    @property
    def _sent(self) -> int:
        return self._topics.sent(WeldProfile) + self._topics.sent(Rejection)

    def _known(self, profile_id: str) -> bool:
        key = bytes.fromhex(profile_id)
        with self._changed:
            return key in self._settled or key in self._under_way

    def _ask(self, profile_ids: list[str]) -> None:
        self._wait(lambda: self._ledgers() > 0, until_s=self._began_s + _LEDGER_APPEARS_S)
        if not self._ledgers():
            return
        inquiry = Inquiry(profile_ids=profile_ids)
        self._topics.publish(inquiry)
        # Without an answer the ledger will see to it that nothing gets a second outcome.
        self._wait(lambda: inquiry.sequence in self._answered, until_s=time.monotonic() + _ANSWER_WITHIN_S)
        self._answered.discard(inquiry.sequence)

    def _wait(self, condition: Callable[[], bool], until_s: float = float("inf")) -> bool:
        while not (met := condition()) and not self._stopping.is_set() and time.monotonic() < until_s:
            with self._changed:
                self._changed.wait(_POLL_S)
        return met
