"""Who sent what: gaps in sequence numbers, and messages that came before."""

from collections import defaultdict
from collections.abc import Hashable
from typing import Annotated

import msgspec

from weld_force_ros.contract import MAX_MESSAGE_BYTES


class Header(msgspec.Struct):
    """What is read of a message that may be broken otherwise."""

    publisher: str = ""
    sequence: Annotated[int, msgspec.Meta(ge=0)] = 0


def header_of(data: str) -> Header | None:
    """The header of a message; None if not even that can be read."""
    try:
        return msgspec.json.decode(data, type=Header) if len(data) <= MAX_MESSAGE_BYTES else None
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


class GapCounter:
    """Counts the messages that were missed, by topic and publisher."""

    def __init__(self) -> None:
        self._next: dict[tuple[str, str], int] = defaultdict(int)
        self.missed = 0

    def note(self, topic: str, header: Header) -> None:
        """Account for a message that arrived."""
        key = (topic, header.publisher)
        self.missed += max(0, header.sequence - self._next[key])
        # A publisher without a name that counts from 0 again was restarted.
        self._next[key] = 1 if header.sequence == 0 else max(self._next[key], header.sequence + 1)

    def next_from(self, topic: str, publisher: str) -> int:
        """The sequence number that is expected next."""
        return self._next.get((topic, publisher), 0)


class Repeats:
    """Tells a message that another publisher, since restarted, had already sent from a new one.

    Latched topics repeat themselves after a restart under a new publisher name. A publisher may well send the same
    content twice and mean it, so the number of times counts: content is new if its publisher has now sent it more
    often than any other had.
    """

    def __init__(self) -> None:
        self._sent: dict[Hashable, dict[str, set[int]]] = defaultdict(lambda: defaultdict(set))

    def is_new(self, content: Hashable, publisher: str, sequence: int) -> bool:
        """Whether to act on a message; the answer for the same message is yes only once."""
        by_publisher = self._sent[content]
        most = max(map(len, by_publisher.values()), default=0)
        by_publisher[publisher].add(sequence)
        return len(by_publisher[publisher]) > most
