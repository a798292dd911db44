"""A recording played: onto a sink of paper to the microsecond, and onto a real graph beside a second reader."""

import os
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import rclpy
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from tests.harness.bag_forms import remade
from tests.harness.ros import DEADLINE_S, Outcomes, Probe, wait_until
from weld_force_ros.cli.main import main
from weld_force_ros.errors import BagError, InputError
from weld_force_ros.recording import STRING, Recorded, offered_qos, string_cdr
from weld_force_ros.ros import qos, type_definitions
from weld_force_ros.ros.playback import CLOCK_PERIOD_S, PlaybackClock, play, play_messages
from weld_force_ros.ros.playback_plan import PlaybackOptions
from weld_force_ros.ros.playback_qos import playback_qos
from weld_force_ros.ros.playback_sink import CLOCK_TOPIC

DEMO = Path(__file__).parents[2] / "bags" / "demo"
START_NS = 1_700_000_000_000_000_000
MS = 1_000_000
LATCHED, LIVE = offered_qos(latched=True), offered_qos(depth=10)
EVERY_TICK = QoSProfile(depth=10_000)


@dataclass
class Channel:
    """A topic to be written: (milliseconds after the start, bytes) of each message."""

    topic: str
    messages: list[tuple[float, bytes]]
    qos: str = LATCHED
    type_name: str = STRING.name
    type_hash: str = STRING.type_hash
    encoding: str = "cdr"


def write(path: Path, *channels: Channel, start_ns: int = START_NS) -> Path:
    """A recording by the format's own library, messages in log order, those of one time in the order of channels."""
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start(profile="ros2")
        laid = []
        for channel in channels:
            schema = writer.register_schema(channel.type_name, "ros2msg", STRING.text.encode())
            metadata = {"offered_qos_profiles": channel.qos, "topic_type_hash": channel.type_hash}
            number = writer.register_channel(channel.topic, channel.encoding, schema, metadata)
            laid += [(start_ns + round(at_ms * MS), number, data) for at_ms, data in channel.messages]
        for log_time_ns, number, data in sorted(laid, key=lambda one: one[0]):
            writer.add_message(number, log_time_ns, data, log_time_ns)
        writer.finish()
    return path


def texts(prefix: str, *times_ms: float) -> list[tuple[float, bytes]]:
    return [(at_ms, string_cdr(f"{prefix}{i}")) for i, at_ms in enumerate(times_ms)]


class SimulatedTime:
    """A clock that passes only while somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def now(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_s += max(seconds, 1e-7)  # a float so large has no smaller step worth the name


class SimulatedSink:
    """Writes down what is played when; each message takes `sending_s`."""

    def __init__(self, time: SimulatedTime, sending_s: float = 0.0) -> None:
        self._time, self._sending_s = time, sending_s
        self.times: list[tuple[float, int]] = []
        self.sent: list[tuple[float, Recorded]] = []
        self.on_send: Callable[[], None] = lambda: None

    def set_time(self, recorded_ns: int) -> None:
        self.times.append((self._time.now_s, recorded_ns))

    def is_latched(self, message: Recorded) -> bool:
        return message.topic == "/latched"

    def send(self, message: Recorded) -> None:
        self.sent.append((self._time.now_s, message))
        self._time.now_s += self._sending_s
        self.on_send()


def recorded(*at: tuple[str, int]) -> list[Recorded]:
    return [Recorded(topic, STRING, b"", START_NS + ns, START_NS + ns) for topic, ns in at]


def played_in_simulated_time(
    messages: list[Recorded], offset_ns: int = 0, rate: float = 1.0, sending_s: float = 0.0
) -> tuple[SimulatedSink, SimulatedTime]:
    time = SimulatedTime()
    sink = SimulatedSink(time, sending_s)
    play_messages(messages, START_NS + offset_ns, sink, PlaybackClock(rate, time.now, time.sleep), threading.Event())
    return sink, time


RECORDINGS = st.lists(st.tuples(st.sampled_from(["/latched", "/live"]), st.integers(0, 3_000_000_000)), max_size=20)


@given(RECORDINGS, st.integers(0, 2_000_000_000), st.floats(0.1, 100.0))
def test_each_message_is_played_at_its_time_and_latched_ones_before_the_start_at_once(
    at: list[tuple[str, int]], offset_ns: int, rate: float
) -> None:
    messages = recorded(*sorted(at, key=lambda one: one[1]))
    sink, _ = played_in_simulated_time(messages, offset_ns, rate)
    due = [m for m in messages if m.log_time_ns >= START_NS + offset_ns or m.topic == "/latched"]
    assert [message for _, message in sink.sent] == due
    for at_s, message in sink.sent:
        after_start_s = (message.log_time_ns - START_NS - offset_ns) * 1e-9
        assert at_s == pytest.approx(max(0.0, after_start_s) / rate, abs=1e-5)


@given(RECORDINGS, st.integers(0, 2_000_000_000), st.floats(0.1, 100.0), st.floats(0.0, 0.3))
def test_time_is_set_from_the_start_on_steadily_and_never_goes_back(
    at: list[tuple[str, int]], offset_ns: int, rate: float, sending_s: float
) -> None:
    messages = recorded(*sorted(at, key=lambda one: one[1]))
    sink, _ = played_in_simulated_time(messages, offset_ns, rate, sending_s)
    assert sink.times[0] == (0.0, START_NS + offset_ns)
    assert all(before <= after for (_, before), (_, after) in pairwise(sink.times))
    time_ns = {ns for _, ns in sink.times}
    assert all(m.log_time_ns in time_ns for _, m in sink.sent if m.log_time_ns >= START_NS + offset_ns)
    if sending_s == 0.0:
        assert all(after - before <= CLOCK_PERIOD_S + 1e-6 for (before, _), (after, _) in pairwise(sink.times))


def test_a_slow_sink_gets_every_message_late_and_time_waits_for_it() -> None:
    messages = recorded(*(("/live", i * 10 * MS) for i in range(20)), ("/live", 5_000 * MS))
    sink, _ = played_in_simulated_time(messages, sending_s=0.1)
    assert [message for _, message in sink.sent] == messages
    # 20 messages of 0.1 s each fill 2 s; what comes later is in time again.
    assert sink.sent[-2][0] == pytest.approx(1.9)
    assert sink.sent[-1][0] == pytest.approx(5.0)
    for at_s, time_ns in sink.times:
        unsent = [m.log_time_ns for sent_s, m in sink.sent if sent_s > at_s]
        assert all(time_ns <= ns for ns in unsent)


def test_a_gap_of_years_is_skipped() -> None:
    years_ns = 57 * 365 * 86_400 * 10**9
    messages = recorded(("/live", 0), ("/live", 2_000 * MS), ("/live", years_ns), ("/live", years_ns + 1_000 * MS))
    sink, time = played_in_simulated_time(messages)
    assert [at_s for at_s, _ in sink.sent] == pytest.approx([0.0, 2.0, 2.0, 3.0])
    assert time.now_s == pytest.approx(3.0)
    sink, _ = played_in_simulated_time(messages, offset_ns=1_000 * MS, rate=2.0)
    assert [at_s for at_s, _ in sink.sent] == pytest.approx([0.5, 0.5, 1.0])


def test_stopping_leaves_out_the_rest() -> None:
    time, stop = SimulatedTime(), threading.Event()
    sink = SimulatedSink(time)
    sink.on_send = lambda: stop.set() if len(sink.sent) == 3 else None
    play_messages(
        recorded(*(("/live", i) for i in range(9))), START_NS, sink, PlaybackClock(1.0, time.now, time.sleep), stop
    )
    assert len(sink.sent) == 3


FAST = PlaybackOptions(rate=100.0)


def played(path: Path, options: PlaybackOptions = FAST) -> tuple[int, list[str]]:
    """How many messages were sent, and what was said; every topic has its subscriber in these tests."""
    said: list[str] = []
    return play(path, options, stop=threading.Event(), report=said.append, discovery_s=DEADLINE_S), said


class Listener(Probe):
    """Collects bytes as they arrive, and the times at which a timer of one second of simulated time fires."""

    def listen(self, topic: str, message_type: type = String, profile: QoSProfile = qos.STREAM) -> Outcomes:
        collected = Outcomes()
        self._node.create_subscription(message_type, topic, collected, profile, raw=True)
        return collected

    def timer(self) -> Outcomes:
        fired = Outcomes()
        simulated = [Parameter("use_sim_time", value=True)]
        self._timed = rclpy.create_node("timed", context=self._context, parameter_overrides=simulated)
        self._timed.create_timer(1.0, lambda: fired(self._timed.get_clock().now().nanoseconds))
        self._executor.add_node(self._timed)
        return fired

    def has_subscriber(self, topic: str) -> bool:
        return self._node.count_subscribers(topic) > 0

    def publishers(self, topic: str) -> list[QoSProfile]:
        wait_until(lambda: self._node.get_publishers_info_by_topic(topic))
        return [publisher.qos_profile for publisher in self._node.get_publishers_info_by_topic(topic)]


@pytest.fixture
def listener(domain_id: int) -> Iterator[Listener]:
    with Listener(domain_id) as node:
        yield node


def texts_of(messages: list[bytes]) -> list[str]:
    return [deserialize_message(data, String).data for data in messages]


def nanoseconds(data: bytes) -> int:
    clock = deserialize_message(data, Clock).clock
    return clock.sec * 10**9 + clock.nanosec


@contextmanager
def playing(path: Path, options: PlaybackOptions, discovery_s: float = 0.0) -> Iterator[Outcomes]:
    """A player on a thread of its own, stopped at the end; collects the times in the recording."""
    stop, times = threading.Event(), Outcomes()
    arguments: dict[str, Any] = {"stop": stop, "discovery_s": discovery_s}
    thread = threading.Thread(target=lambda: play(path, options, on_time=lambda at_s, _: times(at_s), **arguments))
    thread.start()
    try:
        yield times
    finally:
        stop.set()
        thread.join(DEADLINE_S)
    assert not thread.is_alive()


def listening_to_the_demo(listener: Listener) -> tuple[dict[str, list[bytes]], dict[str, Outcomes]]:
    """The bytes of the demo's bag by topic, and what is received on its topics from now on."""
    expected: dict[str, list[bytes]] = defaultdict(list)
    collected: dict[str, Outcomes] = {}
    with AnyReader([DEMO]) as reader:
        for connection, _, data in reader.messages():
            expected[connection.topic].append(bytes(data))
            if connection.topic not in collected:
                package, name = connection.msgtype.split("/msg/")
                message_type = getattr(import_module(f"{package}.msg"), name)
                collected[connection.topic] = listener.listen(connection.topic, message_type)
    return expected, collected


@pytest.mark.parametrize("form", ["mcap message zstd", "sqlite3 file zstd", "frames lz4", "schemas empty"])
def test_recording_of_others_is_played_byte_for_byte(listener: Listener, tmp_path: Path, form: str) -> None:
    expected, collected = listening_to_the_demo(listener)
    count = sum(map(len, expected.values()))
    assert played(remade(DEMO, form, tmp_path / "bag")) == (count, [])
    for topic, messages in expected.items():
        assert collected[topic].wait(len(messages)) == messages


def test_two_runs_of_the_demos_bag_each_deliver_every_byte_in_order(listener: Listener) -> None:
    expected, collected = listening_to_the_demo(listener)
    count = sum(map(len, expected.values()))
    assert [played(DEMO), played(DEMO)] == [(count, []), (count, [])]
    for topic, messages in expected.items():
        assert collected[topic].wait(2 * len(messages)) == messages * 2


def test_with_an_offset_latched_messages_before_it_come_and_live_ones_do_not(
    listener: Listener, tmp_path: Path
) -> None:
    path = write(
        tmp_path / "bag.mcap",
        Channel("/map", texts("map", 0, 1, 2, 3, 900)),
        Channel("/live", texts("live", 0, 500, 900, 901), LIVE),
    )
    maps, live = listener.listen("/map"), listener.listen("/live")
    assert played(path, PlaybackOptions(rate=10.0, start_offset_s=0.9)) == (7, [])
    assert texts_of(maps.wait(5)) == ["map0", "map1", "map2", "map3", "map4"]
    assert texts_of(live.wait(2)) == ["live2", "live3"]


def test_late_joiner_gets_what_was_latched(listener: Listener, tmp_path: Path) -> None:
    path = write(tmp_path / "bag.mcap", Channel("/map", texts("map", 0, 1)), Channel("/live", texts("live", 9e6), LIVE))
    with playing(path, PlaybackOptions(start_offset_s=1.0)) as times:
        times.wait(2)  # so all before the offset is sent
        assert texts_of(listener.listen("/map", profile=qos.CONTRACT).wait(2)) == ["map0", "map1"]


def test_loop_sends_everything_again_in_the_same_order_until_stopped(listener: Listener, tmp_path: Path) -> None:
    path = write(
        tmp_path / "bag.mcap",
        Channel("/map", texts("map", 0, 10, 20)),
        Channel("/live", texts("live", 0, 10, 20, 30), LIVE),
    )
    maps, live = listener.listen("/map"), listener.listen("/live")
    clock = listener.listen(CLOCK_TOPIC, Clock, EVERY_TICK)
    with playing(path, PlaybackOptions(loop=True, start_offset_s=0.005), DEADLINE_S):
        assert texts_of(maps.wait(7)[:7]) == ["map0", "map1", "map2"] * 2 + ["map0"]
        assert texts_of(live.wait(7)[:7]) == ["live1", "live2", "live3"] * 2 + ["live1"]
        clock.wait(2, lambda data: nanoseconds(data) == START_NS + 30 * MS)
    times = [nanoseconds(data) for data in clock.messages]
    # It goes back from the end to the start, and nowhere else.
    turns = {(before, after) for before, after in pairwise(times) if after <= before}
    assert turns == {(START_NS + 30 * MS, START_NS + 5 * MS)}


def test_clock_starts_where_playing_does_and_drives_the_timers_of_others(listener: Listener, tmp_path: Path) -> None:
    path = write(tmp_path / "bag.mcap", Channel("/live", texts("live", 0, 5000, 10_000), LIVE))
    clock, fired = listener.listen(CLOCK_TOPIC, Clock, EVERY_TICK), listener.timer()
    live = listener.listen("/live")
    assert played(path, PlaybackOptions(rate=20.0, start_offset_s=4.0)) == (2, [])
    assert texts_of(live.wait(2)) == ["live1", "live2"]
    clock.wait(1, lambda data: nanoseconds(data) == START_NS + 10_000 * MS)
    times = [nanoseconds(data) - START_NS for data in clock.messages]
    assert times == sorted(times)
    assert times[0] == 4000 * MS
    assert 5000 * MS in times
    assert len(fired.wait(3)) <= 7  # of the 6 s played
    assert all(4000 * MS <= ns - START_NS <= 10_000 * MS for ns in fired.messages)


SLOW_READER = """
import sys
from std_msgs.msg import String
from test_playback import Listener, texts_of
from weld_force_ros.ros import qos
with Listener(int(sys.argv[1])) as listener:
    print(*(text.split()[0] for text in texts_of(listener.listen("/map", profile=qos.CONTRACT).wait(300))))
"""


@pytest.mark.slow
def test_nothing_is_pushed_out_before_a_subscriber_has_it(domain_id: int, tmp_path: Path) -> None:
    """All due at once, far more than the publisher keeps, to another process: within one nothing is ever late."""
    filling = "x" * 200_000
    path = write(tmp_path / "bag.mcap", Channel("/map", [(0, string_cdr(f"{i} {filling}")) for i in range(300)]))
    assert playback_qos([LATCHED], 200_000).depth < 300 / 1.5
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    command = [sys.executable, "-c", SLOW_READER, str(domain_id)]
    with Listener(domain_id) as listener, subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as reader:
        try:
            wait_until(lambda: listener.has_subscriber("/map"))
            assert played(path) == (300, [])
            out, _ = reader.communicate(timeout=DEADLINE_S)
        finally:
            reader.kill()
    assert out.split() == [str(i).encode() for i in range(300)]


def test_topics_are_offered_as_they_were_recorded(listener: Listener, tmp_path: Path) -> None:
    numbers = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 2\n"  # as before Jazzy
    path = write(
        tmp_path / "bag.mcap",
        Channel("/latched", texts("a", 0)),
        Channel("/best_effort", texts("b", 0, 9e6), numbers),
        Channel("/unknown", texts("c", 0), "{not yaml"),
    )
    with playing(path, PlaybackOptions()):
        found = {topic: listener.publishers(topic)[0] for topic in ("/latched", "/best_effort", "/unknown")}
    assert {topic: (profile.reliability, profile.durability) for topic, profile in found.items()} == {
        "/latched": (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
        "/best_effort": (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
        "/unknown": (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
    }


def test_several_publishers_of_a_topic_are_played_by_the_strongest() -> None:
    weak = LIVE.replace("reliable", "best_effort")
    profile = playback_qos([weak, offered_qos(depth=3, latched=True), offered_qos(depth=5, latched=True)], 100)
    assert (profile.reliability, profile.durability, profile.depth) == (
        ReliabilityPolicy.RELIABLE,
        DurabilityPolicy.TRANSIENT_LOCAL,
        5,
    )


@given(st.integers(1, 64 * 2**20), st.one_of(st.none(), st.integers(1, 10**6)))
def test_what_a_publisher_holds_is_bounded(largest_bytes: int, depth: int | None) -> None:
    profile = playback_qos([offered_qos(depth=depth, latched=True)], largest_bytes)
    assert profile.depth == 1 or profile.depth * largest_bytes <= 32 * 2**20
    assert 1 <= profile.depth <= min(depth or 1000, 1000)


PLAIN = "- history: keep_all\n  reliability: reliable\n"


@pytest.mark.parametrize("text", ["", "{not yaml", "3", "- 3", "- {}", "[]", PLAIN, PLAIN + "  deadline: {sec: x}\n"])
def test_quality_of_service_that_cannot_be_read_is_reliable(text: str) -> None:
    profile = playback_qos([text], 100)
    assert (profile.reliability, profile.durability) == (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)


def test_what_cannot_be_played_is_said_once_and_the_rest_played(listener: Listener, tmp_path: Path) -> None:
    stamps = [(at_ms, serialize_message(Clock())) for at_ms in (0, 1)]
    clock_hash = type_definitions.type_hash("rosgraph_msgs/Clock")
    path = write(
        tmp_path / "bag.mcap",
        Channel("/good", texts("good", 0, 1)),
        Channel("/unknown", texts("a", 0, 1), type_name="acme_msgs/msg/Anvil"),
        Channel("/module", texts("b", 0, 1), type_name="antigravity/msg/Up"),
        Channel("/missing", texts("c", 0, 1), type_name="std_msgs/msg/Anvil"),
        Channel("/other", texts("d", 0, 1), type_hash="RIHS01_" + "0" * 64),
        Channel("/json", [(0, b"{}")], encoding="json"),
        Channel("/no name", texts("e", 0, 1)),
        Channel("/good", [(0, b"")], LIVE, "rosgraph_msgs/msg/Clock", clock_hash),
        Channel(CLOCK_TOPIC, stamps, LIVE, "rosgraph_msgs/msg/Clock", clock_hash),
    )
    good = listener.listen("/good")
    sent, said = played(path)
    assert (sent, texts_of(good.wait(2))) == (2, ["good0", "good1"])
    assert sorted(line.split("'")[1] for line in said) == [
        "/clock", "/good", "/json", "/missing", "/module", "/no name", "/other", "/unknown",
    ]  # fmt: skip
    assert "antigravity" not in sys.modules


def test_without_a_clock_of_its_own_the_recorded_one_is_played(listener: Listener, tmp_path: Path) -> None:
    stamps = [(at_ms, serialize_message(Clock())) for at_ms in (0, 5)]
    clock_hash = type_definitions.type_hash("rosgraph_msgs/Clock")
    path = write(tmp_path / "bag.mcap", Channel(CLOCK_TOPIC, stamps, LIVE, "rosgraph_msgs/msg/Clock", clock_hash))
    clock = listener.listen(CLOCK_TOPIC, Clock, EVERY_TICK)
    assert played(path, PlaybackOptions(clock=False)) == (2, [])
    assert clock.wait(2) == [data for _, data in stamps]


def test_chosen_topics_only(listener: Listener, tmp_path: Path) -> None:
    path = write(tmp_path / "bag.mcap", *(Channel(f"/{name}", texts(name, 0, 1)) for name in "abc"))
    collected = {name: listener.listen(f"/{name}") for name in "abc"}
    assert played(path, PlaybackOptions(topics=("a", "/c"))) == (4, [])
    assert [texts_of(collected[name].wait(2)) for name in "ac"] == [["a0", "a1"], ["c0", "c1"]]
    assert collected["b"].messages == []


def test_topics_that_nobody_listens_to_are_said_and_played(domain_id: int, tmp_path: Path) -> None:
    path = write(tmp_path / "bag.mcap", Channel("/a", texts("a", 0)), Channel("/b", texts("b", 0), LIVE))
    said: list[str] = []
    assert play(path, FAST, stop=threading.Event(), report=said.append, discovery_s=0.0) == 2
    assert said == ["nobody subscribes yet to /a, /b; playing all the same"]


def test_cut_recording_is_played_up_to_the_cut(listener: Listener, tmp_path: Path) -> None:
    path = write(tmp_path / "bag.mcap", Channel("/map", texts("map", *range(9))))
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(string_cdr("map6")) + 4])
    maps = listener.listen("/map")
    sent, (said,) = played(path)
    assert (sent, texts_of(maps.wait(6))) == (6, [f"map{i}" for i in range(6)])
    assert said.startswith(f"{path}: ")
    assert said.endswith("playing what is there")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (PlaybackOptions(start_offset_s=1e6), "behind the end"),
        (PlaybackOptions(topics=("elsewhere",)), "no topic /elsewhere"),
    ],
)
def test_what_the_recording_does_not_have_is_refused(options: PlaybackOptions, word: str) -> None:
    with pytest.raises(InputError, match=word):
        played(DEMO, options)


@pytest.mark.parametrize(
    "options", [{"rate": 0.05}, {"rate": 101.0}, {"rate": float("nan")}, {"start_offset_s": -1.0},
                {"start_offset_s": float("inf")}],
)  # fmt: skip
def test_option_out_of_range_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(InputError, match="out of range"):
        PlaybackOptions(**options)  # type: ignore[arg-type]


def test_recordings_without_anything_to_play_are_refused(domain_id: int, tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no message"):
        played(write(tmp_path / "empty.mcap", Channel("/a", [])))
    with pytest.raises(BagError, match="2038"):
        played(write(tmp_path / "late.mcap", Channel("/a", texts("a", 0)), start_ns=2**31 * 10**9))
    with pytest.raises(BagError, match="nothing"):
        played(write(tmp_path / "foreign.mcap", Channel("/a", texts("a", 0), type_name="acme_msgs/msg/Anvil")))


@contextmanager
def replay_command(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "weld_force_ros.cli", "replay", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
def test_signal_ends_the_command_cleanly(listener: Listener, tmp_path: Path) -> None:
    path = write(tmp_path / "bag.mcap", Channel("/map", texts("map", 0, 1)))
    maps = listener.listen("/map")
    with replay_command(str(path), "--publish", "--loop") as process:
        maps.wait(4)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0
    assert "messages played, then stopped" in out
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--publish", "--verify"], "--verify and --publish exclude each other"),
        (["--rate", "2"], "add --publish"),
        (["--loop"], "add --publish"),
        (["--no-clock"], "add --publish"),
        (["--start-offset", "1"], "--start-offset"),
        (["--publish", "--track", "bilbao"], "add --what-if"),
        (["--publish", "--json", "-"], "leave out --json"),
        (["--publish", "--rate", "1000"], "0.1 to 100"),
    ],
)
def test_options_that_make_no_sense_are_one_line(
    capfd: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert main(["replay", str(DEMO), *arguments]) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert words in err


def test_file_that_is_no_recording_is_one_line(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "bag.mcap").write_bytes(b"nothing of the kind")
    assert main(["replay", str(tmp_path / "bag.mcap"), "--publish"]) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "not an MCAP file" in err
