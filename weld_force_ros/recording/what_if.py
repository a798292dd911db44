"""Compute a recording again under other settings, and compare the verdicts."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import cast

from msgspec.structs import replace

from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError, MessageError, WeldForceError
from weld_force_ros.messages import (
    AssessmentSettings,
    Engine,
    SimulationSettings,
    Verdict,
    config_sha256,
    encode,
)
from weld_force_ros.recording.recomputation import Recomputation, missing
from weld_force_ros.recording.recording import Recording, judged_together, simulation_key
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.settings import ENGINES, parse_speeds, poles_of


@dataclass(frozen=True)
class Change:
    """Settings and limits that replace the recorded ones; None stays as recorded.

    The wheel and the positions (metres after the sleeper) always stay, on a track of another span too.
    """

    track: track_file.TrackDefinition | None = None
    speeds_kmh: list[float] | None = None
    engine: Engine | None = None
    limits: AssessmentSettings | None = None

    @property
    def changes_forces(self) -> bool:
        """Return whether forces change; else the recorded maps stand and are judged by other limits."""
        return not (self.track is None and self.speeds_kmh is None and self.engine is None)

    def apply_to(self, recorded: SimulationSettings) -> SimulationSettings:
        """Return recorded settings with this change.

        Raises:
            InputError: together they cannot be simulated.
        """
        changed = replace(
            recorded,
            track=self.track.track.name if self.track else recorded.track,
            track_definition=self.track.text if self.track else recorded.track_definition,
            speeds_kmh=self.speeds_kmh or recorded.speeds_kmh,
            engine=self.engine or recorded.engine,
        )
        if self.track or self.engine:
            definition = self.track or track_file.parse(recorded.track_definition, recorded.track)
            changed.poles = poles_of(definition, changed.engine)
        changed.config_sha256 = config_sha256(changed)
        try:
            encode(changed)
        except MessageError as error:
            raise InputError(error.reason, "change the speeds: positions stay as recorded") from None
        return changed


@dataclass(frozen=True)
class Changed:
    """A recorded verdict beside the one under other settings."""

    recorded: Verdict
    computed: Verdict

    @property
    def weld_id(self) -> str:
        """Return the weld that both verdicts are about."""
        return self.recorded.weld_id

    @property
    def decision_changed(self) -> bool:
        """Return whether something else would be done with the weld."""
        return self.recorded.decision != self.computed.decision

    @property
    def peak_force_change_percent(self) -> float:
        """Return how much the judged peak force changes, relative to the recorded one."""
        return 100 * (self.computed.peak_force_n / self.recorded.peak_force_n - 1)


@dataclass(frozen=True)
class NotComputed:
    """A weld whose verdict cannot be computed again, and why."""

    weld_id: str
    reason: str


def read_change(
    *, track: str | None = None, speeds: str | None = None, engine: str | None = None, limits: str | None = None
) -> Change:
    """Return the change that a command line states.

    Args:
        track: a shipped track's name or the path of a track file.
        speeds: FIRST:LAST:STEP or a list, km/h.
        engine: how the track is represented in time.
        limits: rule books, as `weld_force_ros.assessment.rule_books.load_limits` takes them.

    Raises:
        InputError: nothing is given, or something that cannot be used.
    """
    if track is None and speeds is None and engine is None and limits is None:
        raise InputError("--what-if: nothing is to be other", "give --track, --speeds, --engine or --limits")
    if engine is not None and engine not in ENGINES:
        raise InputError(f"engine {engine!r} is not available", f"use {', '.join(ENGINES)}")
    return Change(
        track=None if track is None else track_file.load(track),
        speeds_kmh=None if speeds is None else parse_speeds(speeds),
        engine=cast(Engine | None, engine),
        limits=None if limits is None else load_limits(limits),
    )


def what_if(
    recording: Recording,
    change: Change,
    *,
    on_result: Callable[[], None] = lambda: None,
    on_fit: Callable[[str], None] | None = None,
) -> Iterator[Changed | NotComputed]:
    """Yield every recorded verdict beside the one under `change`, in log order; then what has no verdict.

    A weld that was measured several times, or simulated or judged under several settings, has a verdict for each; of
    one that was repeated the last counts. Profiles that were rejected had no verdict, and none is made up for them.

    Args:
        recording: what was recorded.
        change: what is to be other.
        on_result: called after each verdict.
        on_fit: called with a sentence if a track's fit has to be made and how long that takes.

    Raises:
        InputError: `change` cannot be simulated together with what stays as recorded.
    """
    groups = {simulation_key(one): group for group in judged_together(recording.force_maps) for one in group}
    settings = {sha256: change.apply_to(recorded) for sha256, recorded in recording.settings.items()}
    again = Recomputation(recording, settings=settings, limits=change.limits, on_fit=on_fit)

    def changed(recorded: Verdict) -> Verdict:
        if recorded.peak_force_n <= 0:
            raise WeldForceError("its recorded peak force is not positive")
        if not change.limits and recorded.limits_sha256 not in recording.limits:
            raise missing("limits")  # found before anything is simulated
        force_maps = groups.get(simulation_key(recorded))
        if force_maps is None:
            raise missing("force map")
        if change.changes_forces:
            force_maps = [again.force_map(force_map) for force_map in force_maps]
        elif change.limits:
            force_maps = [again.answering(force_map) for force_map in force_maps]
        return again.verdict(recorded, force_maps)

    for verdict in latest_verdicts(recording):
        try:
            yield Changed(verdict, changed(verdict))
        except WeldForceError as error:
            yield NotComputed(verdict.weld_id, str(error))
        on_result()
    for weld_id in recording.welds_without_outcome():
        yield NotComputed(weld_id, "no verdict was recorded for this profile")
    for unreadable in recording.unreadable:
        yield NotComputed("?", str(unreadable))


def latest_verdicts(recording: Recording) -> list[Verdict]:
    """Return the verdicts that `what_if` computes again: the last of each measurement, settings and limits."""
    return list({(simulation_key(verdict), verdict.limits_sha256): verdict for verdict in recording.verdicts}.values())
