"""Force maps and verdicts of a recording computed again, under the recorded settings or changed ones."""

from collections.abc import Callable, Mapping, Sequence

from msgspec import UnsetType
from msgspec.structs import replace

from weld_force_ros.assessment.judge import asks_of, judge_vehicles
from weld_force_ros.errors import WeldForceError
from weld_force_ros.messages import AssessmentSettings, ForceMap, SimulationSettings, Verdict
from weld_force_ros.recording.recording import Recording
from weld_force_ros.simulation.simulator import Simulator


class Recomputation:
    """Simulates and judges again what was recorded, with one simulator for each of the settings."""

    def __init__(
        self,
        recording: Recording,
        *,
        settings: Mapping[str, SimulationSettings] | None = None,
        limits: AssessmentSettings | None = None,
        on_fit: Callable[[str], None] | None = None,
    ) -> None:
        """Prepare to compute a recording again.

        Args:
            recording: what was recorded.
            settings: to simulate with, by the recorded `config_sha256`; default: as recorded.
            limits: to judge all maps by; default: each verdict's own, as recorded.
            on_fit: called with a sentence if a track's fit has to be made and how long that takes.
        """
        self._recording = recording
        self._settings = recording.settings if settings is None else settings
        self._limits = limits
        self._on_fit = on_fit
        # A track that cannot be fitted is tried once, not for every weld.
        self._simulators: dict[str, Simulator | WeldForceError] = {}

    def force_map(self, recorded: ForceMap) -> ForceMap:
        """Return a recorded map simulated again.

        Place, line speed, running direction and support are those of the map, whatever was stated of the weld since.

        Raises:
            WeldForceError: the profile or the settings were not recorded, or cannot be simulated.
        """
        profile = self._recording.profiles.get((recorded.weld_id, recorded.profile_sha256))
        if profile is None:
            raise missing("profile")
        settings = self._settings.get(recorded.config_sha256)
        if settings is None:
            raise missing("simulation settings")
        stated = replace(
            profile,
            line_speed_kmh=recorded.line_speed_kmh,
            weld_position_m=recorded.weld_position_m,
            chainage_m=recorded.chainage_m,
            rail=recorded.rail,
            running=recorded.running,
            support=[] if isinstance(recorded.support, UnsetType) else recorded.support,
        )
        asked = self._limits or self._recording.limits.get(_asked_sha256(recorded))
        computed = self._simulator(settings).force_map(stated, None if asked is None else asks_of(asked))
        return replace(computed, judged_together=recorded.judged_together)

    def answering(self, recorded: ForceMap) -> ForceMap:
        """Return a recorded map with a curve that answers for the limits given for all.

        Where its speeds were chosen for other limits, the curve is simulated again.

        Raises:
            WeldForceError: the profile or the settings were not recorded, or cannot be simulated.
        """
        asked = _asked_sha256(recorded)
        if self._limits is None or asked in ("", self._limits.limits_sha256):
            return recorded
        return replace(recorded, curve=self.force_map(recorded).curve)

    def verdict(self, recorded: Verdict, force_maps: Sequence[ForceMap]) -> Verdict:
        """Return the verdict on a weld's maps by the limits of a recorded verdict, or by those given for all.

        Raises:
            WeldForceError: the limits were not recorded, or cannot be applied.
        """
        limits = self._limits or self._recording.limits.get(recorded.limits_sha256)
        if limits is None:
            raise missing("limits")
        return judge_vehicles(force_maps, limits)

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


def _asked_sha256(force_map: ForceMap) -> str:
    """Return the limits for which the speeds of a map's curve were chosen; empty if they were not."""
    curve = force_map.curve
    return "" if isinstance(curve, UnsetType) or isinstance(curve.limits_sha256, UnsetType) else curve.limits_sha256


def missing(what: str) -> WeldForceError:
    """Return the error that something a weld needs was not recorded."""
    return WeldForceError(f"its {what} {'are' if what.endswith('s') else 'is'} not in the recording")
