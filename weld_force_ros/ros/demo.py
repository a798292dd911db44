"""The demo: the three nodes on this machine, the shipped profiles dropped into the watched folder."""

import os
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from weld_force_ros import profiles, replay
from weld_force_ros.contract import Rejection, Verdict
from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.ros import environment
from weld_force_ros.ros.run import Suite, stop_signals

OUTCOME_WITHIN_S = 300.0


@dataclass(frozen=True)
class Demonstrated:
    """What the demo leaves: its bag, read back, and how long each weld took from file to verdict."""

    bag: Path
    recording: replay.Recording
    seconds_to_verdict: dict[str, float]
    left: int


def demonstrate(folder: Path, *, track: str, on_outcome: Callable[[str], None]) -> Demonstrated:
    """Run the whole suite over the shipped profiles and close it.

    Args:
        folder: gets `measurements/` and `bag/`; must not exist.
        track: a shipped track or a track file.
        on_outcome: told of each weld that is done, from a node's thread.

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
    shipped = profiles.shipped()
    dropped: dict[str, float] = {}
    waited: dict[str, float] = {}
    done = threading.Event()

    def settle(name: str) -> None:
        waited.setdefault(name, time.monotonic() - dropped.get(name, time.monotonic()))
        on_outcome(name)
        if len(waited) == len(shipped):
            done.set()

    def judged(verdict: Verdict) -> None:
        settle(verdict.weld_id)

    def refused(rejection: Rejection) -> None:
        settle(Path(rejection.source).stem)

    with (
        stop_signals() as (stop, _),
        Suite(
            parameters={
                "profile": {"folder": str(measurements)},
                "simulator": {"track": track},
                "assessment": {"bag": str(bag)},
            },
            on_verdict=judged,
            on_rejection=refused,
        ) as suite,
    ):
        for name, path in shipped.items():
            dropped[name] = time.monotonic()
            shutil.copyfile(path, measurements / path.name)
        deadline = time.monotonic() + OUTCOME_WITHIN_S
        while not done.wait(0.1) and not stop.is_set() and suite.failure is None and time.monotonic() < deadline:
            pass
        left = suite.drain()
        failure = suite.failure
    if failure is not None:
        raise failure if isinstance(failure, WeldForceError) else WeldForceError(f"a node stopped: {failure}")
    return Demonstrated(bag, replay.read(bag), waited, left + len(shipped) - len(waited))


def keep_to_itself() -> None:
    """Localhost, and unless the user chose one a domain of this process: two demos do not hear each other."""
    environment.stay_on_this_machine()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
