"""A day in the field, compressed: the suite as processes, welds dropped into its folder, somebody listening."""

import os
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from weld_force_ros.measurement import profile_file
from weld_force_ros.messages import TOPICS, Settled, Verdict, profile_sha256
from weld_force_ros.recording import stored
from weld_force_ros.ros import environment, qos
from weld_force_ros.ros.diagnostics import TOPIC as DIAGNOSTICS_TOPIC
from weld_force_ros.ros.environment import use_own_domain
from weld_force_ros.ros.supervisor import Supervisor

BAD_FILE = "# x_unit: mm\nx,z\n0,nonsense\n"


class ReceivedVerdict(NamedTuple):
    """A verdict that the listener received; `at_s` on the monotonic clock."""

    weld_id: str
    publisher: str
    sequence: int
    at_s: float


class Listener:
    """A foreign node that collects verdicts, what is settled and the diagnostics of the nodes."""

    def __init__(self) -> None:
        self.verdicts: list[ReceivedVerdict] = []
        self.settled: set[str] = set()
        self.diagnostics: dict[str, dict[str, str]] = {}
        self._context = rclpy.Context()

    def __enter__(self) -> "Listener":
        environment.prepare()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("listener", context=self._context)
        for kind, take in ((Verdict, self._take_verdict), (Settled, self._take_settled)):
            self._node.create_subscription(String, TOPICS[kind].name, take, qos.CONTRACT)
        self._node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, self._take_diagnostics, qos.DIAGNOSTICS)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._thread.join(5.0)
        self._node.destroy_node()
        self._context.try_shutdown()

    def _take_verdict(self, message: Any) -> None:
        verdict = msgspec.json.decode(message.data, type=Verdict)
        self.verdicts.append(ReceivedVerdict(verdict.weld_id, verdict.publisher, verdict.sequence, time.monotonic()))

    def _take_diagnostics(self, array: Any) -> None:
        for status in array.status:
            self.diagnostics[status.name] = {value.key: value.value for value in status.values}

    def _take_settled(self, message: Any) -> None:
        self.settled.update(msgspec.json.decode(message.data, type=Settled).profile_ids)


class Load:
    """Measurement files of distinct welds, renamed into the folder; every `bad_every`-th cannot be used."""

    def __init__(self, folder: Path, bad_every: int = 0) -> None:
        self.folder = folder / "measurements"
        self.folder.mkdir()
        self.dropped = 0
        self._prepared = folder / "prepared.csv"
        self._bad_every = bad_every
        self._dip = profile_file.read_profile(profile_file.find("weld-1-dip"))

    def drop(self) -> None:
        """One more file."""
        number = self.dropped
        if self._bad_every and number % self._bad_every == self._bad_every - 1:
            self._prepared.write_text(f"# {number}\n{BAD_FILE}")
        else:
            heights_m = [height * (1 + 2e-5 * number) for height in self._dip.z_m]
            sha256 = profile_sha256(self._dip.x_m, heights_m)
            weld = msgspec.structs.replace(self._dip, weld_id=f"weld-{number}", z_m=heights_m, profile_sha256=sha256)
            profile_file.write_profile(weld, self._prepared)
        self._prepared.rename(self.folder / f"{number:06}.csv")
        self.dropped += 1

    @property
    def usable(self) -> set[str]:
        """The welds of all files that can be used."""
        bad = self._bad_every
        return {f"weld-{n}" for n in range(self.dropped) if not bad or n % bad != bad - 1}


class Field(NamedTuple):
    """What a run has to do with."""

    load: Load
    bag: Path
    listener: Listener
    supervisor: Supervisor


@contextmanager
def field(*, bad_every: int = 0, **simulator: Any) -> Iterator[Field]:
    """The suite as processes over an empty folder, with a listener; on this machine alone."""
    use_own_domain()
    with tempfile.TemporaryDirectory(prefix="weld-force-soak-") as name:
        os.environ.setdefault("ROS_LOG_DIR", name)
        folder = Path(name)
        load, bag = Load(folder, bad_every), folder / "bag"
        supervisor = Supervisor(
            {
                "profile": {"folder": str(load.folder), "settle_s": 0.0, "unfinished_s": 0.5},
                "simulator": {"uncertainty_samples": 0, **simulator},
                "assessment": {"bag": str(bag), "split_mb": 64.0},
            },
            ["--ros-args", "--log-level", "fatal"],
        )
        with Listener() as listener, supervisor:
            yield Field(load, bag, listener, supervisor)


def wait_until(condition: Callable[[], bool], within_s: float, supervisor: Supervisor) -> bool:
    """Whether a condition is met in time; the nodes are looked after meanwhile."""
    deadline_s = time.monotonic() + within_s
    while not (met := condition()) and time.monotonic() < deadline_s:
        supervisor.restart_dead()
        time.sleep(0.05)
    return met


class Recorded(NamedTuple):
    """What a bag holds: outcomes by measurement, usable welds judged, and every verdict's publisher and sequence."""

    outcomes: Counter[str]
    judged: set[str]
    verdicts: set[tuple[str, int]]

    @property
    def doubled(self) -> int:
        """Outcomes beyond the first of each measurement."""
        return sum(count - 1 for count in self.outcomes.values())

    def lost(self, load: Load) -> int:
        """Files without an outcome, usable and bad ones."""
        bad, rejected = load.dropped - len(load.usable), len(self.outcomes) - len(self.judged)
        return len(load.usable - self.judged) + max(0, bad - rejected)


class _Line(msgspec.Struct):
    weld_id: str = ""
    profile_id: str = ""
    publisher: str = ""
    sequence: int = 0


def recorded(bag: Path) -> Recorded:
    """Count the outcomes in a bag."""
    found = Recorded(Counter(), set(), set())
    for message in stored(bag):
        topic = message.topic.rpartition("/")[2]
        if topic not in ("verdict", "rejection"):
            continue
        line = msgspec.json.decode(message.content.data, type=_Line)
        found.outcomes[line.profile_id] += 1
        if topic == "verdict":
            found.judged.add(line.weld_id)
            found.verdicts.add((line.publisher, line.sequence))
    return found


def show(result: Mapping[str, Any], passed: bool) -> int:
    """Print a run's result, a line a figure, and return the exit code."""
    for name, value in result.items():
        print(f"{name:16} {dict(value) if isinstance(value, Counter) else value}")
    print("passed" if passed else "FAILED")
    return 0 if passed else 1
