"""The demo: the suite on this machine over shipped profiles dropped into its folder, or beside a simulated trolley."""

import os
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.measurement import profile_file
from weld_force_ros.recording import replay
from weld_force_ros.ros import environment
from weld_force_ros.ros.launcher import ALL_KINDS, KINDS, Kind, Suite, stop_signals

OUTCOME_WITHIN_S = 300.0
TROLLEY_LENGTH_M = 110.0
TROLLEY_RATE = 10.0
SAMPLES = 60
"""Of what is not known, behind each verdict's probabilities: enough to show them, few enough not to wait for."""


@dataclass(frozen=True)
class Demonstrated:
    """What the demo leaves: its bag, read back, and how long each weld took from file to verdict."""

    bag: Path
    recording: replay.Recording
    seconds_to_verdict: dict[str, float]
    left: int


def demonstrate(folder: Path, *, track: str, on_outcome: Callable[[str], None], trolley: bool = False) -> Demonstrated:
    """Run the whole suite over the shipped profiles, or over welds that a simulated trolley measures, and close it.

    Args:
        folder: gets `measurements/` and `bag/`; must not exist.
        track: a shipped track or a track file.
        on_outcome: told of each weld that is done, from a node's thread.
        trolley: whether a simulated trolley measures a synthetic rail, instead of files being dropped.

    Raises:
        InputError: the folder exists already or cannot be made.
        WeldForceError: a node cannot work, or not every weld got its outcome in time.
    """
    measurements, bag = folder / "measurements", folder / "bag"
    try:
        folder.mkdir(parents=True)
        measurements.mkdir()
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}", "name a new folder with --out") from None
    keep_to_itself()
    waited = _Waited(on_outcome)
    parameters: dict[Kind, dict[str, Any]] = {
        "trolley": {"length_m": TROLLEY_LENGTH_M, "rate": TROLLEY_RATE},
        "profile": {"folder": str(measurements), "rail": "left" if trolley else ""},
        "simulator": {"track": track, "uncertainty_samples": SAMPLES},
        "assessment": {"bag": str(bag)},
    }
    suite = Suite(
        ALL_KINDS if trolley else KINDS,
        parameters=parameters,
        on_verdict=lambda verdict: waited.note(verdict.weld_id),
        on_rejection=lambda rejection: waited.note(Path(rejection.source).stem),
    )
    with stop_signals() as (stop, _), suite:
        if trolley:
            expected = _await_trolley(suite, stop)
        else:
            expected = len(profile_file.shipped())
            for name, path in profile_file.shipped().items():
                waited.since_s[name] = time.monotonic()
                shutil.copyfile(path, measurements / path.name)
        _await(lambda: len(waited.seconds) >= expected, suite, stop)
        left = suite.drain()
        failure = suite.failure
    if failure is not None:
        raise failure if isinstance(failure, WeldForceError) else WeldForceError(f"a node stopped: {failure}")
    seconds = {name: waited.seconds[name] for name in waited.since_s if name in waited.seconds}
    return Demonstrated(bag, replay.open_recording(bag), seconds, left + max(0, expected - len(waited.seconds)))


@dataclass
class _Waited:
    """How long each weld took, from its file to its outcome."""

    on_outcome: Callable[[str], None]
    since_s: dict[str, float] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def note(self, name: str) -> None:
        self.seconds.setdefault(name, time.monotonic() - self.since_s.get(name, time.monotonic()))
        self.on_outcome(name)


def _await_trolley(suite: Suite, stop: threading.Event) -> int:
    """How many welds there are, once the trolley has passed them all."""
    trolley = suite.nodes["trolley"]
    _await(lambda: trolley.finished, suite, stop)
    return len(trolley.rail.welds)


def _await(condition: Callable[[], bool], suite: Suite, stop: threading.Event) -> None:
    deadline_s = time.monotonic() + OUTCOME_WITHIN_S
    while not condition() and suite.failure is None and time.monotonic() < deadline_s and not stop.wait(0.05):
        pass


def keep_to_itself() -> None:
    """Localhost, and unless the user chose one a domain of this process: two demos do not hear each other."""
    environment.stay_on_this_machine()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
