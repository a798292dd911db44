"""kill -9 of each node at random moments under load: `python -m tests.soak.kills [--kills 100]` (of each node)."""

import argparse
import os
import random
import signal
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from weld_force_ros.recording import export_json, recover
from weld_force_ros.ros.node_suite import KINDS, Kind

from .field import Field, recorded, show, wait_until
from .field import field as run_field
from .second_reader import check_bag, check_export

OLDER_S = 0.25
_ALL_WITHIN_S = 300.0


@dataclass
class Result:
    """What came of a run.

    Attributes:
        kills: by kind of node.
        welds: files dropped.
        lost: files without an outcome in the bag.
        doubled: files with more than one.
        unrecorded: verdicts that a listener had `OLDER_S` before a kill, and that the bag does not hold.
        recovered: messages of the recovered bag.
        second_reader: the same as `rosbags` reads and counts them.
        exported: messages of the recovered bag's export.
        exported_second_reader: those that `mcap` reads and that keep their channel's schema.
    """

    kills: Counter[str] = field(default_factory=Counter)
    welds: int = 0
    lost: int = 0
    doubled: int = 0
    received_twice: int = 0
    unrecorded: int = 0
    recovered: int = 0
    second_reader: int = 0
    exported: int = 0
    exported_second_reader: int = 0
    recovered_lossy: bool = True
    elapsed_s: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether nothing was lost, nothing doubled, and the recovered bag is whole."""
        whole = self.recovered == self.second_reader > 0 and self.exported == self.exported_second_reader > 0
        return whole and not (self.lost or self.doubled or self.unrecorded or self.recovered_lossy)


def run(kills: int, *, welds_per_s: float = 3.0, seed: int = 1, kinds: tuple[Kind, ...] = KINDS) -> Result:
    """Kill each kind of node so often; then see what the bag holds.

    Args:
        kills: of each kind.
        welds_per_s: offered meanwhile; every tenth file cannot be used.
        seed: of the moments and the order.
        kinds: which nodes.
    """
    choice, result, began_s = random.Random(seed), Result(), time.monotonic()  # noqa: S311 - no secret
    with run_field(bad_every=10, speeds="80,160", positions="2") as suite:
        stopping = threading.Event()
        loader = threading.Thread(target=_load, args=(suite, welds_per_s, stopping), daemon=True)
        suite.load.drop()
        assert wait_until(lambda: bool(suite.listener.verdicts), 60.0, suite.supervisor), "the suite does not start"
        loader.start()
        due: set[tuple[str, int]] = set()
        while alive := [kind for kind in kinds if result.kills[kind] < kills]:
            wait_until(lambda: False, choice.uniform(0.05, 3.0), suite.supervisor)
            victim = choice.choice(alive)
            process = suite.supervisor.processes[victim]
            if process.pid is None:
                continue  # being started again
            at_s = time.monotonic()
            os.kill(process.pid, signal.SIGKILL)
            result.kills[victim] += 1
            due |= {(v.publisher, v.sequence) for v in suite.listener.verdicts if v.at_s < at_s - OLDER_S}
        stopping.set()
        loader.join()
        # A listener may miss what a killed node said last: the bag knows.
        wait_until(lambda: len(recorded(suite.bag).outcomes) >= suite.load.dropped, _ALL_WITHIN_S, suite.supervisor)
        os.kill(suite.supervisor.processes["assessment"].pid or 0, signal.SIGKILL)
        time.sleep(0.2)
        _judge(suite, due, result)
    result.elapsed_s = time.monotonic() - began_s
    return result


def _load(suite: Field, welds_per_s: float, stopping: threading.Event) -> None:
    while not stopping.wait(1 / welds_per_s):
        suite.load.drop()


def _judge(suite: Field, due: set[tuple[str, int]], result: Result) -> None:
    found = recorded(suite.bag)
    result.welds = suite.load.dropped
    result.lost, result.doubled = found.lost(suite.load), found.doubled
    result.unrecorded = len(due - found.verdicts)
    result.received_twice = sum(
        n - 1 for n in Counter((v.publisher, v.sequence) for v in suite.listener.verdicts).values()
    )
    with tempfile.TemporaryDirectory() as folder:
        target, exported = Path(folder) / "recovered", Path(folder) / "exported.mcap"
        report = recover(suite.bag, target)
        result.recovered, result.recovered_lossy = report.message_count, report.lossy
        result.second_reader = check_bag(target).total()
        result.exported = export_json(target, exported).message_count
        result.exported_second_reader = check_export(exported)


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=100, help="of each node")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    result = run(given.kills, seed=given.seed)
    return show(vars(result), result.passed)


if __name__ == "__main__":
    raise SystemExit(main())
