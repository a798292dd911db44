"""Run the demo: the nodes on this machine over bundled profiles, or over what a simulated trolley measures."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from weld_force_ros.errors import InputError, WeldForceError, os_errors_as
from weld_force_ros.measurement import profile_file
from weld_force_ros.measurement.shapes import REFERENCE_SHAPES
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.ros import environment
from weld_force_ros.ros.launcher import stop_signals
from weld_force_ros.ros.node_suite import ALL_KINDS, KINDS, Kind, NodeSuite
from weld_force_ros.ros.nodes.trolley_node import LINE_SPEED_KMH

OUTCOME_WITHIN_S = 300.0
LIMITS = "force,banenor-531"
NO_WELD = "wheel-flat-0.9mm"
"""A bundled profile that is a vehicle's defect, for studies."""
TROLLEY_LENGTH_M = 110.0
TROLLEY_RATE = 10.0
SAMPLES = 60
"""Monte-Carlo samples behind each verdict's probabilities: enough to show them, few enough not to wait for."""


@dataclass(frozen=True)
class DemoResult:
    """The demo's bag, read back, how long each weld took from file to verdict, and how many messages were left."""

    bag: Path
    recording: Recording
    seconds_to_verdict: dict[str, float]
    left: int


def demo_profiles() -> dict[str, Path]:
    """Return the files of the bundled welds that are drawn by a formula, by name."""
    return {name: profile_file.shipped()[name] for name in sorted(REFERENCE_SHAPES) if name != NO_WELD}


def run_demo(folder: Path, *, track: str, on_outcome: Callable[[str], None], trolley: bool = False) -> DemoResult:
    """Run all nodes over the bundled profiles, or over welds that a simulated trolley measures, and close them.

    Args:
        folder: gets `measurements/` and `bag/`; must not exist.
        track: a bundled track or a track file.
        on_outcome: called with the name of each weld that is done, in a node's thread.
        trolley: whether a simulated trolley measures a synthetic rail, instead of files being dropped.

    Raises:
        InputError: the folder exists already or cannot be made.
        WeldForceError: a node cannot work, or not every weld got its outcome in time.
    """
    measurements, bag = folder / "measurements", folder / "bag"
    with os_errors_as(InputError, folder, "name a new folder with --out"):
        folder.mkdir(parents=True)
        measurements.mkdir()
    environment.use_own_domain()
    times = _OutcomeTimes(on_outcome)
    parameters: dict[Kind, dict[str, Any]] = {
        "trolley": {"length_m": TROLLEY_LENGTH_M, "rate": TROLLEY_RATE},
        "profile": {"folder": str(measurements), "rail": "left" if trolley else ""},
        "simulator": {"track": track, "uncertainty_samples": SAMPLES},
        "assessment": {"bag": str(bag), "limits": LIMITS},
    }
    suite = NodeSuite(
        ALL_KINDS if trolley else KINDS,
        parameters=parameters,
        on_verdict=lambda verdict: times.note(verdict.weld_id),
        on_rejection=lambda rejection: times.note(Path(rejection.source).stem),
    )
    with stop_signals() as (stop, _), suite:
        if trolley:
            simulated = suite.nodes["trolley"]
            _await(lambda: simulated.finished, suite, stop)
            expected = len(simulated.rail.welds)
        else:
            expected = len(demo_profiles())
            for name, path in demo_profiles().items():
                stated = f"# line_speed_kmh: {LINE_SPEED_KMH:g}\n{path.read_text(encoding='utf-8')}"
                times.since_s[name] = time.monotonic()
                (measurements / path.name).write_text(stated, encoding="utf-8")
        _await(lambda: len(times.seconds) >= expected, suite, stop)
        left = suite.drain()
        failure = suite.failure
    if failure is not None:
        raise failure if isinstance(failure, WeldForceError) else WeldForceError(f"a node stopped: {failure}")
    seconds = {name: times.seconds[name] for name in times.since_s if name in times.seconds}
    return DemoResult(bag, open_recording(bag), seconds, left + max(0, expected - len(times.seconds)))


@dataclass
class _OutcomeTimes:
    """The time that each weld took from its file to its outcome."""

    on_outcome: Callable[[str], None]
    since_s: dict[str, float] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def note(self, name: str) -> None:
        self.seconds.setdefault(name, time.monotonic() - self.since_s.get(name, time.monotonic()))
        self.on_outcome(name)


def _await(condition: Callable[[], bool], suite: NodeSuite, stop: threading.Event) -> None:
    deadline_s = time.monotonic() + OUTCOME_WITHIN_S
    while not condition() and suite.failure is None and time.monotonic() < deadline_s and not stop.wait(0.05):
        pass
