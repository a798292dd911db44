"""Track sequence numbers of publishers: count gaps and recognise messages that came before."""

from typing import Annotated

import msgspec

from weld_force_ros.messages import MAX_MESSAGE_BYTES, Number, Stamp

MOST_PUBLISHERS = 1000
"""How many publishers of all topics are tracked: names come from outside, and every restart brings new ones."""


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


def read_header(data: str) -> Header | None:
    """Return the header of a message; None if not even that can be read."""
    try:
        return msgspec.json.decode(data, type=Header) if len(data) <= MAX_MESSAGE_BYTES else None
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


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
