"""Play a recording on a live ROS graph: every message as it was stored, in log order, at its time or late.

`play_messages` decides what is played when, and knows no ROS; `play` gives it a sink of real publishers.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from weld_force_ros.errors import InputError
from weld_force_ros.recording import GAP_NS, Recorded, gap_in_words, open_bag
from weld_force_ros.ros import environment
from weld_force_ros.ros.playback_plan import PlaybackOptions, PlaybackPlan
from weld_force_ros.ros.playback_sink import RosSink

CLOCK_PERIOD_S = 1 / 40
DISCOVERY_S = 3.0


class PlaybackClock:
    """Time in the recording, which passes at `rate`.

    Args:
        rate: recorded seconds per second.
        now: returns monotonic seconds.
        sleep: waits so many seconds, or less if playing is stopped.
    """

    def __init__(self, rate: float, now: Callable[[], float], sleep: Callable[[float], object]) -> None:
        self._rate, self._now, self.sleep = rate, now, sleep
        self.set(0)

    def set(self, recorded_ns: int) -> None:
        """Set the time in the recording."""
        self._set_s, self._origin_ns = self._now(), recorded_ns

    def recorded_ns(self) -> int:
        """Return the time in the recording."""
        return self._origin_ns + round((self._now() - self._set_s) * self._rate * 1e9)

    def seconds_until(self, recorded_ns: int) -> float:
        """Return how many seconds it takes until then; negative if it is over."""
        return (recorded_ns - self._origin_ns) * 1e-9 / self._rate - (self._now() - self._set_s)


class MessageSink(Protocol):
    """Takes the messages of a recording as they are played."""

    def set_time(self, recorded_ns: int) -> None:
        """Take note of the time in the recording."""

    def is_latched(self, message: Recorded) -> bool:
        """Return whether those who join late want this message, too."""

    def send(self, message: Recorded) -> None:
        """Play a message."""


def play_messages(
    messages: Iterable[Recorded], start_ns: int, sink: MessageSink, clock: PlaybackClock, stop: threading.Event
) -> None:
    """Play messages once: first, at once, the latched ones before the start, then each at its time or late.

    After a gap, more than a day without a message, the next one comes at once.

    The sink gets the time before each message, and at least every `CLOCK_PERIOD_S` between; it never goes back.

    Args:
        messages: the messages, in log order.
        start_ns: where in the recording to start.
        sink: takes them.
        clock: time in the recording.
        stop: set to end early.
    """
    sink.set_time(start_ns)
    clock.set(start_ns)
    before_ns = start_ns
    for message in messages:
        if stop.is_set():
            return
        if message.log_time_ns < start_ns:
            if sink.is_latched(message):
                sink.send(message)
            clock.set(start_ns)  # however long it took
            continue
        if message.log_time_ns - before_ns > GAP_NS:
            clock.set(message.log_time_ns)
        before_ns = message.log_time_ns
        while (left_s := clock.seconds_until(message.log_time_ns)) > 0:
            clock.sleep(min(left_s, CLOCK_PERIOD_S))
            if stop.is_set():
                return
            sink.set_time(min(clock.recorded_ns(), message.log_time_ns))
        sink.set_time(message.log_time_ns)
        sink.send(message)


def play(
    path: Path,
    options: PlaybackOptions,
    *,
    stop: threading.Event,
    report: Callable[[str], None] = lambda _: None,
    on_time: Callable[[float, float], None] = lambda at_s, duration_s: None,
    domain_id: int | None = None,
    discovery_s: float = DISCOVERY_S,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] | None = None,
) -> int:
    """Play a recording on the ROS graph of this machine, or of the discovery range the user chose.

    Every reliable subscriber gets every message: before one that it lacks is pushed out of a publisher's history, the
    publisher waits for it, up to the bound of `serialized_messages.RecordedPublisher`.

    Args:
        path: a bag folder or one of its files; a cut one is played up to the cut.
        options: what of it to play, and how fast.
        stop: set by another thread or a signal to end cleanly.
        report: called with one line for what is not played and why, and for topics without a subscriber at the start.
        on_time: called with the time in the recording and its length, both in seconds.
        domain_id: ROS domain; `ROS_DOMAIN_ID` if absent.
        discovery_s: how long to wait, at most, until each topic has a subscriber.
        now: returns monotonic seconds.
        sleep: waits so many seconds; default: until `stop` is set.

    Returns:
        How many messages were published.

    Raises:
        BagError: not a readable bag, or nothing in it that can be played.
        InputError: a topic or a start that it does not have; ROS does not start.
    """
    bag = open_bag(path)
    if bag.damage:
        report(f"{path}: {bag.damage}; playing what is there")
    plan = PlaybackPlan(bag, options)
    clock = PlaybackClock(options.rate, now, sleep or stop.wait)
    for gap in plan.timeline.gaps:
        report(gap_in_words(gap))
    start_ns = plan.timeline.log_time_ns(round(options.start_offset_s * 1e9))
    with _node(domain_id) as node:
        sink = RosSink(node, plan, options, report, on_time)
        sink.await_subscribers(discovery_s, stop)
        sink.report_live_publishers()
        while not stop.is_set():
            play_messages(plan.messages(), start_ns, sink, clock, stop)
            if not options.loop:
                break
            clock.sleep(CLOCK_PERIOD_S)  # a recording of one moment would otherwise be played without pause
        sink.await_acknowledgement()
        sink.report_live_publishers()  # those that were not discovered before
    return sink.sent


@contextmanager
def _node(domain_id: int | None) -> Iterator[Node]:
    environment.prepare()
    environment.check_message_extensions()
    environment.stay_on_this_machine()
    context = rclpy.Context()
    try:
        rclpy.init(context=context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy has no common class for what it refuses
        raise InputError(f"ROS does not start: {' '.join(str(error).split())}", "check the ROS environment") from None
    try:
        no_services: dict[str, Any] = {"enable_rosout": False, "start_parameter_services": False}
        node = rclpy.create_node("weld_force_playback", context=context, use_global_arguments=False, **no_services)
        try:
            yield node
        finally:
            node.destroy_node()
    finally:
        context.try_shutdown()
