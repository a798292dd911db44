"""Track sequence numbers of publishers: count gaps and recognise messages that came before."""

from weld_force_ros.messages import Header

MOST_PUBLISHERS = 1000
"""How many publishers of all topics are tracked: names come from outside, and every restart brings new ones."""


class SequenceTracker:
    """Counts the messages that were missed since the first one of each topic and publisher arrived.

    What was sent before is no loss: who joins late gets as much of it as the publisher keeps.
    """

    def __init__(self) -> None:
        self._next: dict[tuple[str, str], int] = {}
        self.missed = 0

    def note(self, topic: str, header: Header) -> bool:
        """Account for a message and return whether it had come before, as latched ones do after a restart."""
        expected = self._next.get((topic, header.publisher), header.sequence)
        self.missed += max(0, header.sequence - expected)
        # A publisher without a name that counts from 0 again was restarted.
        restarted = header.sequence == 0 and not header.publisher
        self._expect(topic, header.publisher, 1 if restarted else max(expected, header.sequence + 1))
        return bool(header.publisher) and header.sequence < expected

    def resume(self, topic: str, header: Header) -> None:
        """Account for a message that an earlier process of this node received."""
        expected = self.next_expected(topic, header.publisher)
        self._expect(topic, header.publisher, max(expected, header.sequence + 1))

    def next_expected(self, topic: str, publisher: str) -> int:
        """Return the sequence number that is expected next."""
        return self._next.get((topic, publisher), 0)

    def _expect(self, topic: str, publisher: str, sequence: int) -> None:
        self._next.pop((topic, publisher), None)
        self._next[topic, publisher] = sequence
        if len(self._next) > MOST_PUBLISHERS:  # the one that was silent for longest
            del self._next[next(iter(self._next))]
