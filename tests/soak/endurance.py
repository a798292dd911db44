"""Many welds through the nodes as processes: `python -m tests.soak.endurance [--welds 10000]`."""

import argparse
import time
from dataclasses import dataclass, field
from pathlib import Path

from weld_force_ros.ros.node_suite import KINDS

from .field import Field, recorded, show, wait_until
from .field import field as run_field
from .second_reader import check_bag

AHEAD = 100
"""Files in the folder beyond those that are settled: the suite always has work, the folder never floods."""

_STALLED_S = 60.0
_WARM = 0.01


@dataclass
class Result:
    """What came of a run; memory in MB, by kind of node.

    Attributes:
        received: verdicts that a listener got.
        second_reader: messages of the bag, as `rosbags` reads and counts them.
    """

    welds: int = 0
    lost: int = 0
    doubled: int = 0
    received: int = 0
    restarts: int = 0
    elapsed_s: float = 0.0
    welds_per_s: float = 0.0
    longest_ms_until_on_disk: float = 0.0
    sequence_gaps: int = 0
    bag_mb: float = 0.0
    second_reader: int = 0
    memory_warm_mb: dict[str, float] = field(default_factory=dict)
    memory_end_mb: dict[str, float] = field(default_factory=dict)
    memory_most_mb: dict[str, float] = field(default_factory=dict)

    @property
    def growth_mb(self) -> dict[str, float]:
        """From the first hundredth of the run, when everything is loaded, to its end."""
        return {kind: self.memory_end_mb[kind] - warm for kind, warm in self.memory_warm_mb.items()}

    @property
    def passed(self) -> bool:
        """Whether nothing was lost or doubled and no process grew by 30 MB."""
        return not (self.lost or self.doubled or self.restarts) and max(self.growth_mb.values()) < 30


def run(welds: int, *, show: bool = False, **simulator: str) -> Result:
    """So many welds at the rate at which the suite takes them."""
    result = Result(welds=welds)
    with run_field(**simulator) as suite:
        suite.load.drop()
        assert wait_until(lambda: bool(suite.listener.settled), 60.0, suite.supervisor), "the suite does not start"
        began_s = time.monotonic()
        _feed(suite, welds, result, show=show)
        result.elapsed_s = time.monotonic() - began_s
        result.welds_per_s = (welds - 1) / result.elapsed_s
        result.memory_end_mb = _memory_mb(suite)
        diagnostics = suite.listener.diagnostics
        result.longest_ms_until_on_disk = float(diagnostics["/assessment_node"]["longest ms until on disk"])
        result.sequence_gaps = sum(int(values["sequence gaps"]) for values in diagnostics.values())
        result.received = len({v.weld_id for v in suite.listener.verdicts})
        result.restarts = sum(process.starts - 1 for process in suite.supervisor.processes.values())
        supervisor, bag = suite.supervisor, suite.bag
        for kind in KINDS:
            supervisor.processes[kind].stop(60.0)
        found = recorded(bag)
        result.lost, result.doubled = found.lost(suite.load), found.doubled
        result.bag_mb = round(sum(file.stat().st_size for file in bag.iterdir()) / 1e6, 1)
        result.second_reader = check_bag(bag).total()
    return result


def _feed(suite: Field, welds: int, result: Result, *, show: bool) -> None:
    progressed_s, done, printed_s = time.monotonic(), 0, time.monotonic()
    while done < welds and time.monotonic() - progressed_s < _STALLED_S:
        settled = len(suite.listener.settled)
        if settled > done:
            done, progressed_s = settled, time.monotonic()
        while suite.load.dropped < min(welds, done + AHEAD):
            suite.load.drop()
        if done >= _WARM * welds and not result.memory_warm_mb:
            result.memory_warm_mb = _memory_mb(suite)
        if time.monotonic() - printed_s > 5.0:
            printed_s = time.monotonic()
            now = _memory_mb(suite)
            result.memory_most_mb = {k: max(v, result.memory_most_mb.get(k, 0.0)) for k, v in now.items()}
            if show:
                print(f"{done} of {welds}; MB {now}", flush=True)
        suite.supervisor.restart_dead()
        time.sleep(0.02)


def _memory_mb(suite: Field) -> dict[str, float]:
    """Resident memory of each process, shared memory of the middleware included; pages of files are not counted."""
    return {kind: _own_mb(process.pid) for kind, process in suite.supervisor.processes.items() if process.pid}


def _own_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text().splitlines()
    sizes_kb = [int(line.split()[1]) for line in status if line.startswith(("RssAnon", "RssShmem"))]
    return round(sum(sizes_kb) / 1024, 1)


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--welds", type=int, default=10_000)
    given = parser.parse_args()
    result = run(given.welds, show=True)
    return show({**vars(result), "growth_mb": result.growth_mb}, result.passed)


if __name__ == "__main__":
    raise SystemExit(main())
