"""How fast the nodes are: from a file to its verdict, one weld at a time and many at a steady rate.

`python -m benchmarks.nodes` prints the most that they do, and what part of it takes how long, by thread.
"""

import gc
import os
import re
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.study import POSITIONS, SPEEDS
from weld_force_ros.assessment.judge import asks_of, deciding_history, judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import WeldForceError
from weld_force_ros.measurement import profile_file
from weld_force_ros.messages import ForceMap, Rejection, Verdict, decode, encode, profile_sha256
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.simulation.settings import DEFAULT_UNCERTAINTY_SAMPLES, parse_speeds, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

_PASSAGES = len(parse_speeds(SPEEDS)) * POSITIONS
_WELD = "weld-1-dip"
_DEEPER = 1e-4
_FLOOD = 150
_STALLED_S = 60.0


def latencies(files: int = 20) -> dict[str, Any]:
    """Time from a file's appearance to its published verdict, nodes warm, one file at a time; empty without ROS.

    Raises:
        WeldForceError: a weld got no verdict.
    """
    try:
        with _nodes(files + 1) as nodes:
            for file in nodes.files:
                nodes.judge_alone(file)
    except ImportError:
        return {}
    waited_s = nodes.waited_s[1:]  # the first compiles and loads
    return {
        "file_to_verdict_s_p50": float(np.percentile(waited_s, 50)),
        "file_to_verdict_s_p95": float(np.percentile(waited_s, 95)),
        "file_to_verdict_passages": _PASSAGES,
    }


def sustained(seconds: float = 60.0, welds_per_s: float = 5.0) -> dict[str, Any]:
    """Welds at a steady rate through the whole suite, recording; then many at once, for the most it can do.

    Without Monte-Carlo samples, as in earlier versions; the most with those of the default settings stands beside.

    A weld is lost if its verdict was not published, or does not stand in the recording exactly once. Empty without ROS.

    Args:
        seconds: for how long files are offered.
        welds_per_s: how many, evenly in time.

    Raises:
        WeldForceError: a weld was rejected, or the nodes stopped working.
    """
    try:
        steady = _run(round(seconds * welds_per_s), 1 / welds_per_s)
        flood = _run(_FLOOD, 0.0)
        sampled = _run(max(3, _FLOOD // 3), 0.0, DEFAULT_UNCERTAINTY_SAMPLES)
    except ImportError:
        return {}
    return {
        "sustained_welds_per_s": steady.welds / steady.elapsed_s,
        "sustained_offered_per_s": steady.offered_per_s,
        "sustained_s": steady.elapsed_s,
        "sustained_welds": steady.welds,
        "sustained_lost": steady.lost + flood.lost + sampled.lost,
        "sustained_file_to_verdict_s_p95": steady.waited_s_p95,
        "sustained_queue_longest": steady.queue_longest,
        "sustained_most_welds_per_s": flood.verdicts_per_s,
        "sustained_most_welds_per_s_with_intervals": sampled.verdicts_per_s,
    }


@dataclass(frozen=True)
class _Run:
    """What became of the welds of one run; `elapsed_s` is from the first file to the last verdict.

    Attributes:
        thread_s: processor time of each thread of the nodes from the first file to the last verdict, by its name.
        closing_s: processor time for what is left after the last verdict: to drain the nodes and close the recording.
    """

    welds: int
    lost: int
    elapsed_s: float
    offered_per_s: float
    verdicts_per_s: float
    waited_s_p95: float
    queue_longest: int
    thread_s: dict[str, float]
    closing_s: float


def _run(welds: int, interval_s: float, samples: int = 0) -> _Run:
    with _nodes(welds + 1, samples) as nodes:
        nodes.judge_alone(nodes.files[0])
        before_ns = _thread_ns()
        began = time.perf_counter()
        for number, file in enumerate(nodes.files[1:]):
            time.sleep(max(0.0, began + number * interval_s - time.perf_counter()))
            nodes.offer(file)
        nodes.wait_for_verdicts(welds + 1)
        used_ns = _thread_ns() - before_ns
        finished_s = time.process_time()
    offered, judged = list(nodes.offered_s.values())[1:], list(nodes.judged_s.values())[1:]
    if len(judged) < 2:
        raise WeldForceError(f"{len(judged)} of {welds} welds were judged; look at the nodes' log")
    return _Run(
        welds=welds,
        lost=len(nodes.lost),
        elapsed_s=judged[-1] - offered[0],
        offered_per_s=_rate_per_s(offered),
        verdicts_per_s=_rate_per_s(judged),
        waited_s_p95=float(np.percentile(nodes.waited_s[1:], 95)),
        queue_longest=nodes.queue_longest,
        thread_s={name: 1e-9 * count for name, count in used_ns.most_common()},
        closing_s=nodes.closed_s - finished_s,
    )


def _thread_ns() -> Counter[str]:
    """Return the processor time of the process's threads so far in ns, by name without number: a pool's are one."""
    names = {thread.native_id: thread.name for thread in threading.enumerate()}
    found: Counter[str] = Counter()
    for thread in Path("/proc/self/task").iterdir():
        try:
            name = names.get(int(thread.name)) or (thread / "comm").read_text()
            run_ns = int((thread / "schedstat").read_text().split()[0])
        except OSError:  # it has ended
            continue
        found["middleware" if name.startswith("dds.") else re.sub(r"[-_]\d.*", "", name).strip()] += run_ns
    return found


def _rate_per_s(times_s: list[float]) -> float:
    return (len(times_s) - 1) / (times_s[-1] - times_s[0])


class _Nodes:
    """The suite's files and verdicts: when each weld was offered, and when it was judged."""

    def __init__(self, folder: Path, welds: int) -> None:
        self.bag = folder / "bag"
        self.measurements = folder / "measurements"
        self.measurements.mkdir()
        self.files = _weld_files(folder / "prepared", welds)
        self.offered_s: dict[str, float] = {}
        self.judged_s: dict[str, float] = {}
        self.queue_longest = 0
        self.lost: set[str] = set()
        self.closed_s = 0.0
        self._refused: str | None = None
        self._changed = threading.Condition()

    @property
    def waited_s(self) -> list[float]:
        """From file to verdict, in order of the files."""
        return [self.judged_s[weld] - at for weld, at in self.offered_s.items() if weld in self.judged_s]

    def judge_alone(self, file: Path) -> None:
        """Offer one weld when no other is under way."""
        self.offer(file)
        self.wait_for_verdicts(len(self.offered_s))
        if file.stem not in self.judged_s:
            raise WeldForceError(f"no verdict on {file.name} within {_STALLED_S:g} s; look at the nodes' log")

    def offer(self, file: Path) -> None:
        self.offered_s[file.stem] = time.perf_counter()
        file.rename(self.measurements / file.name)
        self.queue_longest = max(self.queue_longest, len(self.offered_s) - len(self.judged_s))

    def wait_for_verdicts(self, count: int) -> None:
        """Until there are so many verdicts, or none has come for long."""
        with self._changed:
            while len(self.judged_s) < count and self._refused is None and self._changed.wait(_STALLED_S):
                pass
        if self._refused is not None:
            raise WeldForceError(self._refused)

    def note_verdict(self, verdict: Verdict) -> None:
        with self._changed:
            self.judged_s[verdict.weld_id] = time.perf_counter()
            self._changed.notify()

    def note_rejection(self, rejection: Rejection) -> None:
        with self._changed:
            self._refused = f"{rejection.source} was rejected: {rejection.reason}"
            self._changed.notify()

    def look_for_lost(self) -> None:
        """Compare what was offered with what was judged and recorded."""
        recorded = Counter(verdict.weld_id for verdict in open_recording(self.bag).verdicts)
        self.lost = {weld for weld in self.offered_s if weld not in self.judged_s or recorded[weld] != 1}


@contextmanager
def _nodes(welds: int, samples: int = 0) -> Iterator[_Nodes]:
    """Run the suite, recording; then drain and close it, and read its recording.

    Raises:
        ImportError: there is no ROS.
        WeldForceError: a node cannot work, or does not finish.
    """
    from weld_force_ros.ros.environment import use_own_domain
    from weld_force_ros.ros.node_suite import NodeSuite

    use_own_domain()
    with tempfile.TemporaryDirectory() as folder:
        nodes = _Nodes(Path(folder), welds)
        with NodeSuite(
            parameters={
                "profile": {"folder": str(nodes.measurements)},
                "simulator": {"speeds": SPEEDS, "uncertainty_samples": samples},
                "assessment": {"bag": str(nodes.bag)},
            },
            ros_args=["--ros-args", "--log-level", "warn"],
            on_verdict=nodes.note_verdict,
            on_rejection=nodes.note_rejection,
        ) as suite:
            gc.freeze()  # as their launcher does
            yield nodes
            gc.unfreeze()
            left, failure = suite.drain(), suite.failure
        if failure is not None:
            raise WeldForceError(f"a node stopped: {failure}")
        if left:
            raise WeldForceError(f"{left} messages were left after draining")
        nodes.closed_s = time.process_time()
        nodes.look_for_lost()


def _weld_files(folder: Path, count: int) -> list[Path]:
    """Measurement files of distinct welds: the same dip, each a little deeper."""
    folder.mkdir()
    dip = profile_file.read_profile(profile_file.find(_WELD))
    files = []
    for number in range(count):
        heights_m = [height * (1 + _DEEPER * number) for height in dip.z_m]
        weld = msgspec.structs.replace(
            dip, weld_id=f"weld-{number}", z_m=heights_m, profile_sha256=profile_sha256(dip.x_m, heights_m)
        )
        files.append(folder / f"{weld.weld_id}.csv")
        profile_file.write_profile(weld, files[-1])
    return files


def processor_seconds(welds: int = 60) -> dict[str, float]:
    """Return seconds of processor time a weld, of all threads: what two cores can do at most is two over each.

    Without the first of each, which computes tables.

    Args:
        welds: each part is of a third of them.
    """
    settings, limits = simulation_settings(speeds_kmh=parse_speeds(SPEEDS), positions=POSITIONS), load_limits()
    simulator, plain = Simulator(settings), Simulator(settings, curves=False)
    model = plain.vehicle_track
    if not isinstance(model, VehicleTrackModel):
        raise TypeError("the engine is not compiled")
    with tempfile.TemporaryDirectory() as folder:
        files = [file.read_bytes() for file in _weld_files(Path(folder) / "prepared", welds // 3)]
    profiles = [profile_file.parse_profile(file, _WELD) for file in files]
    paths, positions = [plain.wheel_path(profile) for profile in profiles], np.array(settings.positions_m)
    met = [path for own in paths for path in (own, own.mirrored)]
    force_maps = [simulator.force_map(profile, asks_of(limits)) for profile in profiles]  # and tables

    def compiled() -> None:
        for _ in model.peak_maps(met, settings.speeds_kmh, positions, low_passed=True):
            pass

    parts: dict[str, Callable[[], object]] = {
        "measurement file, read": lambda: [profile_file.parse_profile(file, _WELD) for file in files],
        "passages of the map, compiled": compiled,
        "map": lambda: [plain.force_map(profile) for profile in profiles],
        "map and curve of every km/h": lambda: [simulator.force_map(profile) for profile in profiles],
        "map and curve": lambda: [simulator.force_map(profile, asks_of(limits)) for profile in profiles],
        "JSON of the map, written and read": lambda: [decode(ForceMap, encode(one)) for one in force_maps],
        "verdict": lambda: [judge(one, limits) for one in force_maps],
        "history": lambda: [
            deciding_history(profile, simulator, one, limits) for profile, one in zip(profiles, force_maps, strict=True)
        ],
    }
    gc.freeze()  # as the launcher of nodes does
    found = {}
    for name, work in parts.items():
        work()
        began_s = time.process_time()
        work()
        found[name] = (time.process_time() - began_s) / len(profiles)
    return found


def main() -> None:
    """Print how many welds a second the nodes judge at most, and where the time goes."""
    print(f"{_PASSAGES} passages in each of two directions, with curve, without samples; {os.cpu_count()} cores;")
    print("ms of processor time a weld, and welds a second on two cores that do nothing else")
    for name, each_s in processor_seconds().items():
        print(f"{name:40}{1e3 * each_s:8.1f}{2 / each_s:8.0f}")
    flood = _run(_FLOOD, 0.0)
    each_s = sum(flood.thread_s.values()) / flood.welds
    print(f"{'nodes, from file to verdict':40}{1e3 * each_s:8.1f}{2 / each_s:8.0f}; here {flood.verdicts_per_s:.1f}")
    for name, seconds in flood.thread_s.items():
        if (each_ms := 1e3 * seconds / flood.welds) >= 0.1:
            print(f"  thread {name:31}{each_ms:8.1f}")
    print(f"{'closing the recording':40}{1e3 * flood.closing_s / flood.welds:8.1f}")


if __name__ == "__main__":
    main()
