"""Own clients beside `weld-force up`, which is stopped and continued: `python -m tests.soak.clients [--welds 200]`.

They know rclpy with its default quality of service and the published contract alone (`examples/ros_client.py`); a
tenth of what they publish breaks the contract, each in one of several ways.
"""

import argparse
import importlib.util
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy

from weld_force_ros.recording import count_outcomes, open_bag
from weld_force_ros.ros import environment

from .field import show

ROOT = Path(__file__).parents[2]
BREAKS: tuple[dict[str, Any], ...] = (
    {"profile_sha256": "0" * 64},
    {"z_m": [0.0] * 3},
    {"weld_id": 7},
    {"schema_version": "9.0"},
    {"x_m": None},
)


@dataclass
class Result:
    """What came of a run.

    Attributes:
        welds: published by the clients.
        malformed: those of them that break the contract.
        outcomes: of the clients' own, by kind.
        wrong: welds with no outcome, or one of the wrong kind.
        measurements, open, doubled: as `bag info` counts them.
    """

    welds: int
    malformed: int
    outcomes: Counter[str]
    wrong: int
    measurements: int
    open: int
    doubled: int
    elapsed_s: float

    @property
    def passed(self) -> bool:
        """Whether each weld has its one outcome, and none is open."""
        return not (self.wrong or self.open or self.doubled) and self.measurements == self.welds


def run(welds: int) -> Result:
    """Publish so many welds one after the other, and see what the recording holds."""
    spec = importlib.util.spec_from_file_location("ros_client", ROOT / "examples" / "ros_client.py")
    assert spec is not None
    assert spec.loader is not None
    client = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(client)
    vector, outcomes, wrong = json.loads((ROOT / "examples" / "weld_profile.json").read_text()), Counter[str](), 0
    del vector["profile_sha256"]
    environment.use_own_domain()
    environment.prepare()
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="weld-force-clients-") as name:
        bag, suite = Path(name) / "bag", _start(Path(name))
        rclpy.init()
        for number in range(welds):
            if number == welds // 2:
                suite.send_signal(signal.SIGTERM)
                assert suite.wait(120.0) == 0
                suite = _start(Path(name))
            is_broken = number % 10 == 9
            break_ = BREAKS[number // 10 % len(BREAKS)] if is_broken else {}
            weld = {**vector, "weld_id": f"weld-{number}", **break_}
            node = rclpy.create_node(f"client_{number}")
            found = client.assess(node, {key: value for key, value in weld.items() if value is not None})
            node.destroy_node()
            kind = "verdict" if "decision" in found else "rejection" if "remedy" in found else "none"
            outcomes[kind] += 1
            wrong += kind != ("rejection" if is_broken else "verdict")
        rclpy.shutdown()
        suite.send_signal(signal.SIGTERM)
        assert suite.wait(120.0) == 0
        counted = count_outcomes(open_bag(bag))
    assert counted is not None
    return Result(
        welds, welds // 10, outcomes, wrong, counted.measurements, counted.open, counted.doubled,
        time.monotonic() - began_s,
    )  # fmt: skip


def _start(folder: Path) -> "subprocess.Popen[bytes]":
    (folder / "measurements").mkdir(exist_ok=True)
    options = ["--speeds", "80,160", "--positions", "2", "--uncertainty-samples", "0"]
    places = ["--folder", str(folder / "measurements"), "--bag", str(folder / "bag")]
    command = [sys.executable, "-m", "weld_force_ros.cli", "up", *places, *options]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--welds", type=int, default=200)
    result = run(parser.parse_args().welds)
    return show(vars(result), result.passed)


if __name__ == "__main__":
    raise SystemExit(main())
