"""The track under one weld: that of the settings, with the supports that the weld's measurement states."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

from msgspec import UnsetType

from weld_force_ros.errors import InputError
from weld_force_ros.messages import SimulationSettings, SupportState, Uncertainty, WeldProfile
from weld_force_ros.physics.engines.common_poles import BAND_HZ
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.track.bending_sleeper import BendingSleeper
from weld_force_ros.physics.track.causality import acausal
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.physics.track.support import Spring
from weld_force_ros.simulation import fit_store
from weld_force_ros.simulation.fit_file import AnyFit
from weld_force_ros.simulation.sampling import Sampler
from weld_force_ros.simulation.sleeper_samples import SleeperSensitivities
from weld_force_ros.simulation.track_file import TrackDefinition

_MOST_REMEMBERED = 8  # tracks whose supports differ


@dataclass(frozen=True)
class TrackAtWeld:
    """A wheel on a track with the supports of a weld.

    Attributes:
        vehicle_track: simulates passages.
        error: computes `fit_error`: seconds for `reference` on rails by strips, more for supports that differ, and not
            every use asks for it.
        sampler: of what is uncertain; None where nothing is drawn.
    """

    vehicle_track: VehicleTrackModel | GreensFunctionModel
    error: Callable[[], float]
    sampler: Sampler | None

    @cached_property
    def fit_error(self) -> float:
        """About the relative error of the force's dynamic part that comes from representing the track in time."""
        return self.error()


class TracksAtWelds:
    """Makes tracks with the supports of welds, and keeps the last few.

    Args:
        definition: the track.
        settings: of the simulation.
        threads: that compute; one a core, if not given.
        on_fit: called with a line of text if a fit has to be made.
    """

    def __init__(
        self,
        definition: TrackDefinition,
        settings: SimulationSettings,
        *,
        threads: int | None = None,
        on_fit: Callable[[str], None] | None = None,
    ) -> None:
        self._definition, self._settings, self._threads, self._on_fit = definition, settings, threads, on_fit
        self._wheel = Wheel(
            settings.wheel_mass_kg, settings.static_load_n, settings.rolling_radius_m, settings.hertz_n_per_m15
        )
        self.usual = self._made((), sampled=True)
        self._differing = lru_cache(_MOST_REMEMBERED)(self._made)

    def at(self, profile: WeldProfile) -> TrackAtWeld:
        """Return the track under a weld, with the supports that its measurement or the settings state.

        Raises:
            InputError: supports that the track or the engine cannot have.
            NumericalError: no usable fit was found.
        """
        states = stated_support(profile, self._settings)
        return self._differing(states, sampled=True) if states else self.usual

    def supported(self, states: tuple[SupportState, ...]) -> TrackAtWeld:
        """Return the track with some supports, without samples; see `at`."""
        return self._differing(states, sampled=False)

    @cached_property
    def sleepers(self) -> SleeperSensitivities:
        """How forces change with what lies beneath single sleepers."""
        return SleeperSensitivities(self._definition, self._wheel, on_fit=self._on_fit, threads=self._threads)

    def _made(self, states: tuple[SupportState, ...], *, sampled: bool) -> TrackAtWeld:
        definition, settings, wheel, threads = self._definition, self._settings, self._wheel, self._threads
        supports = local_supports(states) if states else None
        vehicle_track: VehicleTrackModel | GreensFunctionModel
        if settings.engine == "reference":
            if supports:
                fit_store.check_local_supports(definition.track)
                _check_gaps(definition, supports)
            vehicle_track = GreensFunctionModel(definition.track, wheel, supports, threads=threads)
            error = self._acausal_error
        else:
            fit = self._fit(supports)
            vehicle_track = VehicleTrackModel(fit.model(), wheel, threads=threads)

            def error() -> float:
                if supports and settings.poles == "moving":
                    return fit_store.fitted_moving_window(definition, supports, on_fit=self._on_fit).error
                return fit.error

        return TrackAtWeld(vehicle_track, error, self._sampler(supports) if sampled else None)

    def _acausal_error(self) -> float:
        track = self._definition.track
        return acausal(track, track.spacing_m / 2, threads=self._threads).floor(self._wheel.compliance, BAND_HZ)

    def _fit(self, supports: LocalSupports | None) -> AnyFit:
        engine = self._settings.engine
        assert engine != "reference", "reference has no fit"  # noqa: S101
        if supports is None and self._settings.poles == "moving":
            return fit_store.fitted_moving(self._definition, on_fit=self._on_fit)
        if supports is None:
            return fit_store.fitted(self._definition, engine, on_fit=self._on_fit)
        if engine == "rfp":
            raise InputError(
                "engine rfp describes tracks on which all supports are alike",
                "use common-poles or reference where a weld states its support",
            )
        moving = self._settings.poles == "moving"
        return fit_store.fitted_window(self._definition, supports, moving=moving, on_fit=self._on_fit)

    def _sampler(self, supports: LocalSupports | None) -> Sampler | None:
        settings = self._settings
        if not isinstance(settings.uncertainty, Uncertainty):
            return None
        return Sampler(
            self._definition, self._wheel, settings.uncertainty, supports, moving=settings.poles == "moving",
            patch_m=settings.patch_half_length_m, on_fit=self._on_fit, threads=self._threads,
        )  # fmt: skip


def stated_support(profile: WeldProfile, settings: SimulationSettings) -> tuple[SupportState, ...]:
    """Return which supports differ at a weld: as the profile states it, else the settings; none if neither does."""
    stated = settings.support if isinstance(profile.support, UnsetType) else profile.support
    return () if isinstance(stated, UnsetType) else tuple(stated)


def local_supports(states: tuple[SupportState, ...]) -> LocalSupports:
    """Return the supports that messages state."""
    return LocalSupports.of(
        SupportChange(
            state.sleeper, state.share, state.pad_share, 0.0 if isinstance(state.gap_m, UnsetType) else state.gap_m
        )
        for state in states
    )


def _check_gaps(definition: TrackDefinition, supports: LocalSupports) -> None:
    support = definition.track.support
    springs = support.springs
    if supports.hanging and any(isinstance(mass, BendingSleeper) for mass in support.masses_kg):
        raise InputError(
            f"track {definition.track.name}: a sleeper over a gap cannot bend here",
            "use a track with half_sleeper_mass_kg, or bound it: SLEEPER=0 hangs free, SLEEPER=1 always rests",
        )
    if supports.hanging and (len(springs) != 2 or not isinstance(springs[-1], Spring) or not springs[-1].causal):
        raise InputError(
            f"track {definition.track.name}: a sleeper over a gap needs ballast with a dashpot right below it",
            "use a track of pad, sleeper and ballast with damping_kns_per_m, such as bilbao-viscous",
        )
