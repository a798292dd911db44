"""A recording computed again under other settings: which verdicts would have been others."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from msgspec.structs import replace

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.limits import load_limits
from weld_force_ros.errors import InputError, MessageError, WeldForceError
from weld_force_ros.messages import (
    AssessmentSettings,
    Engine,
    ForceMap,
    SimulationSettings,
    Verdict,
    config_sha256,
    encode,
)
from weld_force_ros.recording.replay import Recording, again
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.settings import ENGINES, parse_speeds
from weld_force_ros.simulation.simulator import Simulator

_Identity = tuple[str, str, str]


@dataclass(frozen=True)
class Change:
    """What is to be other than recorded; None stays as recorded.

    The wheel and the positions (metres after the sleeper) always stay, on a track of another span too.
    """

    track: track_file.TrackDefinition | None = None
    speeds_kmh: list[float] | None = None
    engine: Engine | None = None
    limits: AssessmentSettings | None = None

    @property
    def rolls_again(self) -> bool:
        """Whether forces change; else the recorded maps stand and only their judgement is another."""
        return not (self.track is None and self.speeds_kmh is None and self.engine is None)

    def of(self, recorded: SimulationSettings) -> SimulationSettings:
        """Recorded settings with this change.

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
        """The weld that both are about."""
        return self.recorded.weld_id

    @property
    def decision_changed(self) -> bool:
        """Whether something else would be done with the weld."""
        return self.recorded.decision != self.computed.decision

    @property
    def peak_force_change_percent(self) -> float:
        """Of the peak force that was judged, relative to the recorded one."""
        return 100 * (self.computed.peak_force_n / self.recorded.peak_force_n - 1)


@dataclass(frozen=True)
class NotComputed:
    """A weld of which nothing can be said, and why."""

    weld_id: str
    reason: str


def read_change(
    *, track: str | None = None, speeds: str | None = None, engine: str | None = None, limits: Path | None = None
) -> Change:
    """A change as the command line gives it.

    Args:
        track: a shipped track's name or the path of a track file.
        speeds: FIRST:LAST:STEP or a list, km/h.
        engine: how the track is represented in time.
        limits: a limits file.

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
    """Every recorded verdict beside the one under `change`, in log order; then what has no verdict.

    A weld that was measured several times, or simulated or judged under several settings, has a verdict for each; of
    one that was repeated the last counts. Profiles that were rejected had no verdict, and none is made up for them.

    Args:
        recording: what was recorded.
        change: what is to be other.
        on_result: called after each verdict.
        on_fit: told, in words, if a track's fit has to be made and how long that takes.

    Raises:
        InputError: `change` cannot be simulated together with what stays as recorded.
    """
    again = _Again(recording, change, on_fit)
    for verdict in judged(recording):
        try:
            yield Changed(verdict, again.verdict(verdict))
        except WeldForceError as error:
            yield NotComputed(verdict.weld_id, str(error))
        on_result()
    yield from _without_verdict(recording)


def judged(recording: Recording) -> list[Verdict]:
    """The verdicts that `what_if` computes again: one for each measurement, settings and limits."""
    return list({(_identity(verdict), verdict.limits_sha256): verdict for verdict in recording.verdicts}.values())


class _Again:
    """The suite under the change, over what was recorded."""

    def __init__(self, recording: Recording, change: Change, on_fit: Callable[[str], None] | None) -> None:
        self._recording = recording
        self._change = change
        self._on_fit = on_fit
        self._maps = {_identity(force_map): force_map for force_map in recording.force_maps}
        self._settings = {sha256: change.of(recorded) for sha256, recorded in recording.settings.items()}
        # A track that cannot be fitted is tried once, not for every weld.
        self._simulators: dict[str, Simulator | WeldForceError] = {}

    def verdict(self, recorded: Verdict) -> Verdict:
        if recorded.peak_force_n <= 0:
            raise WeldForceError("its recorded peak force is not positive")
        limits = self._change.limits or self._recording.limits.get(recorded.limits_sha256)
        if limits is None:
            raise _missing("limits")
        force_map = self._maps.get(_identity(recorded))
        if force_map is None:
            raise _missing("force map")
        return judge(self._rolled_again(force_map) if self._change.rolls_again else force_map, limits)

    def _rolled_again(self, recorded: ForceMap) -> ForceMap:
        profile = self._recording.profiles.get((recorded.weld_id, recorded.profile_sha256))
        if profile is None:
            raise _missing("profile")
        settings = self._settings.get(recorded.config_sha256)
        if settings is None:
            raise _missing("simulation settings")
        return again(recorded, profile, self._simulator(settings))

    def _simulator(self, settings: SimulationSettings) -> Simulator:
        if settings.config_sha256 not in self._simulators:
            try:
                self._simulators[settings.config_sha256] = Simulator(settings, on_fit=self._on_fit)
            except WeldForceError as error:
                self._simulators[settings.config_sha256] = error
        simulator = self._simulators[settings.config_sha256]
        if isinstance(simulator, WeldForceError):
            raise simulator
        return simulator


def _identity(message: ForceMap | Verdict) -> _Identity:
    return message.weld_id, message.profile_sha256, message.config_sha256


def _missing(what: str) -> WeldForceError:
    return WeldForceError(f"its {what} {'are' if what.endswith('s') else 'is'} not in the recording")


def _without_verdict(recording: Recording) -> Iterator[NotComputed]:
    settled = {(verdict.weld_id, verdict.profile_sha256) for verdict in recording.verdicts}
    refused = {r.profile_sha256 for r in recording.rejections if isinstance(r.profile_sha256, str)}
    for weld_id, sha256 in recording.profiles:
        if sha256 not in refused and (weld_id, sha256) not in settled:
            yield NotComputed(weld_id, "no verdict was recorded for this profile")
    for error in recording.unreadable:
        yield NotComputed("?", str(error))
