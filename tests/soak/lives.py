"""The suite's whole life ended again and again, then the same line again: `python -m tests.soak.lives [--each 20]`.

The supervisor of `weld-force up --processes` gets SIGHUP, as of a closed terminal, or kill -9, at random moments under
load. The next life begins at once, while the nodes of the last one may still be at work.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from weld_force_ros.recording import count_outcomes, open_bag
from weld_force_ros.ros.environment import use_own_domain

from .field import Listener, Load, recorded, show

_STARTS_WITHIN_S = 150.0
_ALL_WITHIN_S = 300.0


@dataclass
class Result:
    """What came of a run.

    Attributes:
        lives: how often the supervisor was ended, by each signal.
        went_on: how often the same line then went on to outcomes.
        welds: files dropped; every tenth cannot be used.
        lost: files without an outcome in the recording.
        doubled: files with more than one.
        open: measurements without outcome, as `bag info` counts them.
        left_over: processes that outlived their supervisor to the end of the run.
    """

    lives: int = 0
    went_on: int = 0
    welds: int = 0
    lost: int = 0
    doubled: int = 0
    open: int = 0
    left_over: int = 0
    elapsed_s: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether each life went on, nothing was lost and nothing doubled."""
        return self.went_on == self.lives + 1 and not (self.lost or self.doubled or self.open or self.left_over)


def run(each: int, *, welds_per_s: float = 1.0, seed: int = 1) -> Result:
    """End the supervisor by each signal so often; then see what the recording holds."""
    choice, result, began_s = random.Random(seed), Result(), time.monotonic()  # noqa: S311 - no secret
    signals = [signal.SIGHUP, signal.SIGKILL] * each
    choice.shuffle(signals)
    use_own_domain()
    with tempfile.TemporaryDirectory(prefix="weld-force-lives-") as name, Listener() as listener:
        folder, stopping = Path(name), threading.Event()
        load, bag = Load(folder, bad_every=10), folder / "bag"
        loader = threading.Thread(target=_load, args=(load, welds_per_s, stopping), daemon=True)
        loader.start()
        ended: list[subprocess.Popen[bytes]] = []
        for how in [*signals, signal.SIGTERM]:
            before = len(listener.settled)
            supervisor = _start(load.folder, bag)
            ended.append(supervisor)
            result.went_on += _wait(partial(_more_settled, listener, before), supervisor, _STARTS_WITHIN_S)
            if how is signal.SIGTERM:
                stopping.set()
                loader.join()
                _wait(lambda: len(recorded(bag).outcomes) >= load.dropped, supervisor, _ALL_WITHIN_S)
            else:
                time.sleep(choice.uniform(0.0, 2.0))
                result.lives += 1
            supervisor.send_signal(how)
        for supervisor in ended:
            supervisor.wait(120.0)
        result.left_over = _left_over()
        _judge(load, bag, result)
    result.elapsed_s = time.monotonic() - began_s
    return result


def _start(folder: Path, bag: Path) -> "subprocess.Popen[bytes]":
    options = ["--speeds", "80,160", "--positions", "2", "--uncertainty-samples", "0", "--processes"]
    command = [sys.executable, "-m", "weld_force_ros.cli", "up", "--folder", str(folder), "--bag", str(bag), *options]
    with (bag.parent / "log").open("ab") as log:
        return subprocess.Popen(command, stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True)


def _more_settled(listener: Listener, before: int) -> bool:
    return len(listener.settled) > before


def _load(load: Load, welds_per_s: float, stopping: threading.Event) -> None:
    while not stopping.wait(1 / welds_per_s):
        load.drop()


def _wait(condition: Callable[[], bool], supervisor: "subprocess.Popen[bytes]", within_s: float) -> bool:
    deadline_s = time.monotonic() + within_s
    while not (met := condition()) and time.monotonic() < deadline_s and supervisor.poll() is None:
        time.sleep(0.2)
    return met


def _left_over() -> int:
    """Return how many node processes of this run's domain there still are."""
    found = 0
    for process in Path("/proc").glob("[0-9]*"):
        try:
            environment, command = (process / "environ").read_bytes(), (process / "cmdline").read_bytes()
        except OSError:
            continue
        domain = f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}\0".encode()
        found += b"--supervised" in command and domain in environment
    return found


def _judge(load: Load, bag: Path, result: Result) -> None:
    found, counted = recorded(bag), count_outcomes(open_bag(bag))
    assert counted is not None
    result.welds, result.open = load.dropped, counted.open
    result.lost, result.doubled = found.lost(load), found.doubled


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--each", type=int, default=20, help="lives that end by SIGHUP, and as many by kill -9")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    result = run(given.each, seed=given.seed)
    return show(vars(result), result.passed)


if __name__ == "__main__":
    raise SystemExit(main())
