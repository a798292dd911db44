"""Decide what of a recording is played: options of the user, and the channels and extent of the recording."""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from weld_force_ros.errors import BagError, InputError
from weld_force_ros.recording import Bag, MessageDefinition, Recorded

MIN_RATE, MAX_RATE = 0.1, 100.0

_CLOCK_END_NS = 2**31 * 10**9

Channel = tuple[str, MessageDefinition]
"""A topic and the definition of its messages."""


@dataclass(frozen=True)
class PlaybackOptions:
    """Options for playing a recording.

    Attributes:
        rate: recorded seconds per second, 0.1 to 100.
        start_offset_s: where to start, in s after the recording's first message.
        loop: whether to start again at the end, until stopped.
        topics: only these; None for all.
        clock: whether to publish `/clock`.

    Raises:
        InputError: a rate or an offset out of range.
    """

    rate: float = 1.0
    start_offset_s: float = 0.0
    loop: bool = False
    topics: tuple[str, ...] | None = None
    clock: bool = True

    def __post_init__(self) -> None:
        if not MIN_RATE <= self.rate <= MAX_RATE:
            raise InputError(f"rate {self.rate:g} is out of range", f"give {MIN_RATE:g} to {MAX_RATE:g}")
        if not 0 <= self.start_offset_s < math.inf:
            raise InputError(f"start offset {self.start_offset_s:g} s is out of range", "give seconds from 0 on")


@dataclass
class ChannelSize:
    """Number of messages on a channel and size of the largest."""

    message_count: int = 0
    largest_bytes: int = 0


class PlaybackPlan:
    """A recording that is to be played; reads it through once.

    Attributes:
        start_ns: log time of the first message of all.
        end_ns: log time of the last.
        timeline: the times between, without gaps, which are not played.
        channels: size of each channel.
        topics: names of the topics that are to be played.

    Raises:
        BagError: nothing in it, or times that ROS cannot express.
        InputError: a topic that is not in it, or a start behind its end.
    """

    def __init__(self, bag: Bag, options: PlaybackOptions) -> None:
        self._bag = bag
        self.timeline = bag.statistics.timeline
        self.channels: dict[Channel, ChannelSize] = defaultdict(ChannelSize)
        times: list[int] = []
        for message in bag.messages():
            size = self.channels[message.topic, message.definition]
            size.message_count += 1
            size.largest_bytes = max(size.largest_bytes, len(message.data))
            times = [times[0] if times else message.log_time_ns, message.log_time_ns]
        if not times:
            raise BagError(f"{bag.path} holds no message", "there is nothing to play")
        self.start_ns, self.end_ns = times
        if self.end_ns >= _CLOCK_END_NS:
            raise BagError(f"{bag.path} has log times after the year 2038", "ROS cannot express them; record it again")
        if options.start_offset_s > self.duration_s:
            raise InputError(
                f"start offset {options.start_offset_s:g} s lies behind the end of {bag.path}",
                f"give at most {self.duration_s:g} s",
            )
        self.topics = self._chosen(options.topics)

    @property
    def duration_s(self) -> float:
        """Return the time from the first message to the last without gaps, in s."""
        return self.timeline.duration_ns * 1e-9

    def messages(self) -> Iterator[Recorded]:
        """Return the messages of the chosen topics in log order."""
        return self._bag.messages(self.topics)

    def _chosen(self, wanted: tuple[str, ...] | None) -> set[str]:
        recorded = {topic for topic, _ in self.channels}
        if wanted is None:
            return recorded
        chosen = {"/" + topic.lstrip("/") for topic in wanted}
        if unknown := sorted(chosen - recorded):
            raise InputError(
                f"{self._bag.path} has no topic {unknown[0]}", f"choose from {', '.join(sorted(recorded))}"
            )
        return chosen
