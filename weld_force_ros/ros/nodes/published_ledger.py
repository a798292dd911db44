"""Keep the ledger of outcomes for the other nodes: confirm outcomes, answer inquiries, send open profiles again."""

import time

from std_msgs.msg import String

from weld_force_ros.messages import TOPICS, Inquiry, Settled, Verdict, WeldProfile
from weld_force_ros.ros import qos
from weld_force_ros.ros.contract_topics import ContractTopics, Incoming
from weld_force_ros.ros.nodes.outcome_ledger import Ledger

STALLED_S = 5.0
"""After so long without any message, open measurements are sent to the simulator again."""

_LAST_MAPS_S = 2.0


class PublishedLedger:
    """The ledger of a node that publishes what it holds.

    Args:
        topics: the node's.
        ledger: the ledger, as a recording that is continued left it.
    """

    def __init__(self, topics: ContractTopics, ledger: Ledger) -> None:
        self._topics = topics
        self.ledger = ledger
        # What is recorded is not recorded a second time when it is sent again.
        self._to_simulator = topics.add_publisher(String, TOPICS[WeldProfile].name, qos.RESENT, record=lambda _: None)
        self._last_message_s = time.monotonic()

    @property
    def awaited(self) -> int:
        """Return how many force maps are probably on their way: none if no message came for a while."""
        return self.ledger.open_count if time.monotonic() - self._last_message_s < _LAST_MAPS_S else 0

    def note_message(self) -> None:
        """Note that the other nodes are at work."""
        self._last_message_s = time.monotonic()

    def settle(self, profile_id: str) -> None:
        """Confirm an outcome that is recorded and published."""
        self.ledger.settle(profile_id)
        self._topics.publish(Settled(profile_ids=[profile_id]))

    def confirm_again(self, profile_id: str) -> None:
        """Say once more that a measurement has its outcome, for who brings it again."""
        self._topics.publish(Settled(profile_ids=[profile_id]))

    def answer(self, incoming: Incoming) -> None:
        """Answer an inquiry with those of its measurements that have their outcome."""
        inquiry = self._topics.decode_or_report(Inquiry, incoming)
        if inquiry is not None:
            self._topics.publish(
                Settled(
                    profile_ids=self.ledger.settled_of(inquiry.profile_ids),
                    asked_by=inquiry.publisher,
                    asked_sequence=inquiry.sequence,
                )
            )

    def confirm_unfinished(self) -> None:
        """Publish and confirm the outcomes that an earlier process recorded but perhaps did not publish."""
        for profile_id, outcome in list(self.ledger.unfinished.items()):
            if outcome.kind is Verdict:
                self._topics.publish_recorded(outcome.kind, outcome.cdr)
            self.settle(profile_id)
        self.ledger.unfinished.clear()

    def resend_at_once(self) -> None:
        """Have the next call of `resend_if_stalled` send open profiles whatever came before."""
        self._last_message_s = float("-inf")

    def resend_if_stalled(self) -> None:
        """Send the profiles that have waited longest to the simulator again if no message came for `STALLED_S`."""
        if not self.ledger.open_count or time.monotonic() - self._last_message_s < STALLED_S:
            return
        for cdr in self.ledger.oldest_open():
            self._to_simulator.publish_recorded(cdr)
        self._last_message_s = time.monotonic()
