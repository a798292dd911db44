"""The one composition: profile -> force map -> verdict. Nodes, command line, replay and campaign all call it."""

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from weld_force_ros.messages import (
    ForceHistory,
    ForceMap,
    ProfileMeasures,
    SimulationSettings,
    SpeedCurve,
    Uncertainty,
    UncertaintyResult,
    WeldProfile,
)
from weld_force_ros.physics.analysis.geometry import classify, largest_gradient, straightedge_gap
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.common_poles import BAND_HZ
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.physics.track.causality import acausal
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.force_map_view import relevant_positions, relevant_range
from weld_force_ros.simulation.sampling import Sampler

# Messages keep what means something: 0.01 N is a ten-millionth of a wheel load, 0.1 nm far below any roughness.
_FORCE_DECIMALS = 2
_PLACE_DECIMALS = 6
_TIME_DECIMALS = 9
_DISPLACEMENT_DECIMALS = 10
_HISTORY_STEP_M = 1e-3


class Simulator:
    """Force maps and histories under fixed settings; making one loads the track's fit and may have to compute it.

    One simulator may be used from several threads.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        *,
        on_fit: Callable[[str], None] | None = None,
        threads: int | None = None,
        curves: bool = True,
    ) -> None:
        """Load the fit that `settings` ask for.

        Args:
            settings: what is simulated.
            on_fit: told, in words, if a fit has to be made.
            threads: of a fitted engine; one a core, if not given.
            curves: whether maps carry a curve; without it advice on speed is as fine as the map, which is sooner done.

        Raises:
            InputError: settings that this version cannot simulate.
        """
        self.settings = settings
        # The text, not the name: a recording then holds all that its replay needs.
        definition = track_file.parse(settings.track_definition, settings.track)
        wheel = Wheel(settings.wheel_mass_kg, settings.static_load_n, settings.wheel_radius_m, settings.hertz_n_per_m15)
        self._span_m = definition.track.spacing_m
        self.vehicle_track: VehicleTrackModel | GreensFunctionModel
        if settings.engine == "reference":
            self.vehicle_track = GreensFunctionModel(definition.track, wheel)
            self._model_error = acausal(definition.track, self._span_m / 2).floor(wheel.compliance, BAND_HZ)
        else:
            fit = fit_store.fitted(definition, settings.engine, on_fit=on_fit)
            self.vehicle_track = VehicleTrackModel(fit.model(), wheel, threads=threads)
            self._model_error = fit.error
        self._with_curves = curves and settings.engine == "common-poles"
        self._sampler: Sampler | None = None
        if isinstance(settings.uncertainty, Uncertainty):
            self._sampler = Sampler(definition, wheel, settings.uncertainty, on_fit=on_fit)

    def wheel_path(self, profile: WeldProfile) -> WheelPath:
        """The wheel centre's trajectory over a profile."""
        return wheel_path_over(np.array(profile.x_m), np.array(profile.z_m), self.vehicle_track.wheel.radius_m)

    def force_map(self, profile: WeldProfile, *, on_speed: Callable[[], None] = lambda: None) -> ForceMap:
        """Peak force at every speed and position of the settings; `on_speed` is called after each speed.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        began, settings, wheel_path = time.perf_counter(), self.settings, self.wheel_path(profile)
        peak_map = self.vehicle_track.peak_map(
            wheel_path, settings.speeds_kmh, settings.positions_m, low_passed=True, on_speed=on_speed
        )
        return self._mapped(profile, wheel_path, peak_map, began)

    def force_maps(self, profiles: Sequence[WeldProfile]) -> Iterator[ForceMap]:
        """`force_map` of many welds, in their order, sooner done than one by one as they fill the kernel's lanes.

        Raises:
            NumericalError: a passage over one of them did not stay finite.
        """
        began, settings = time.perf_counter(), self.settings
        wheel_paths = [self.wheel_path(profile) for profile in profiles]
        peak_maps = self.vehicle_track.peak_maps(
            wheel_paths, settings.speeds_kmh, settings.positions_m, low_passed=True
        )
        for profile, wheel_path, peak_map in zip(profiles, wheel_paths, peak_maps, strict=True):
            yield self._mapped(profile, wheel_path, peak_map, began)
            began = time.perf_counter()

    def _mapped(self, profile: WeldProfile, wheel_path: WheelPath, peak_map: PeakMap, began: float) -> ForceMap:
        settings, (below_120hz, below_20hz) = self.settings, _low_passed(peak_map)
        force_map = ForceMap(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=settings.config_sha256,
            track=settings.track,
            engine=settings.engine,
            speeds_kmh=settings.speeds_kmh,
            positions_m=settings.positions_m,
            peak_force_n=_rounded(peak_map.peak_force_n, _FORCE_DECIMALS),
            peak_x_m=_rounded(peak_map.peak_x_m, _PLACE_DECIMALS),
            min_force_n=_rounded(peak_map.min_force_n, _FORCE_DECIMALS),
            contact_loss_s=_rounded(peak_map.contact_loss_s, _TIME_DECIMALS),
            p2_force_n=_rounded(below_120hz, _FORCE_DECIMALS),
            force_20hz_n=_rounded(below_20hz, _FORCE_DECIMALS),
            static_load_n=settings.static_load_n,
            span_m=self._span_m,
            model_error=round(self._model_error, 6),
            measures=profile_measures(profile),
            elapsed_s=0.0,
            line_speed_kmh=profile.line_speed_kmh,
            weld_position_m=profile.weld_position_m,
            chainage_m=profile.chainage_m,
            rail=profile.rail,
        )
        return changed(
            force_map,
            curve=self._curve(wheel_path, peak_map, profile.weld_position_m),
            spread=self._spread(profile, force_map),
            elapsed_s=time.perf_counter() - began,
        )

    def _curve(
        self, wheel_path: WheelPath, mapped: PeakMap, weld_position_m: float | UnsetType
    ) -> SpeedCurve | UnsetType:
        """The worst over the positions that count at every whole km/h and every speed of the map.

        Slower engines leave it out: advice on speed is then as fine as the map.
        """
        if not self._with_curves:
            return UNSET
        speeds, positions = np.array(self.settings.speeds_kmh), np.array(self.settings.positions_m)
        counted = relevant_positions(positions, weld_position_m, self._span_m)
        between = np.setdiff1d(np.arange(np.ceil(speeds[0]), speeds[-1]), speeds)
        worst = [_worst_positions(mapped, counted, positions)]
        if len(between):
            rolled = self.vehicle_track.peak_map(wheel_path, between, positions[counted], low_passed=True)
            worst.append(_worst_positions(rolled, np.arange(len(counted)), positions[counted]))
        all_speeds = np.concatenate([speeds, between])
        order = np.argsort(all_speeds)
        peak, least, loss, at, below_120hz, below_20hz = np.concatenate(worst, axis=1)[:, order]
        return SpeedCurve(
            speeds_kmh=all_speeds[order].tolist(),
            peak_force_n=_rounded(peak, _FORCE_DECIMALS),
            min_force_n=_rounded(least, _FORCE_DECIMALS),
            contact_loss_s=_rounded(loss, _TIME_DECIMALS),
            at_m=_rounded(at, _PLACE_DECIMALS),
            p2_force_n=_rounded(below_120hz, _FORCE_DECIMALS),
            force_20hz_n=_rounded(below_20hz, _FORCE_DECIMALS),
        )

    def _spread(self, profile: WeldProfile, force_map: ForceMap) -> UncertaintyResult | UnsetType:
        if self._sampler is None:
            return UNSET
        judged = relevant_range(force_map)
        return self._sampler.spread(np.array(profile.x_m), np.array(profile.z_m), judged.speeds_kmh, judged.positions_m)

    def force_history(
        self, profile: WeldProfile, speed_kmh: float, position_m: float, *, until_m: float = 0.0
    ) -> ForceHistory:
        """One passage in the space domain, a span before and after the weld, or to `until_m` if that is later."""
        history = self.vehicle_track.history(self.wheel_path(profile), speed_kmh, position_m, until_m=until_m)
        every = slice(None, None, max(1, round(_HISTORY_STEP_M / (history.x_m[1] - history.x_m[0]))))
        return ForceHistory(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self.settings.config_sha256,
            speed_kmh=speed_kmh,
            position_m=position_m,
            x_m=_rounded(history.x_m[every], _PLACE_DECIMALS),
            force_n=_rounded(history.force_n[every], _FORCE_DECIMALS),
            wheel_m=_rounded(history.wheel_m[every], _DISPLACEMENT_DECIMALS),
            rail_m=_rounded(history.rail_m[every], _DISPLACEMENT_DECIMALS),
            irregularity_m=_rounded(history.irregularity_m[every], _DISPLACEMENT_DECIMALS),
        )


def profile_measures(profile: WeldProfile) -> ProfileMeasures:
    """What a profile's geometry says by itself."""
    x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
    geometry = classify(x_m, z_m)
    return ProfileMeasures(
        kind=geometry.kind,
        dip_m=geometry.dip_m,
        protrusion_m=geometry.protrusion_m,
        gradient_rad=largest_gradient(x_m, z_m),
        straightedge_m=straightedge_gap(x_m, z_m),
        spacing_m=float(np.diff(x_m).max()),
    )


def _low_passed(peak_map: PeakMap) -> FloatArray:
    if peak_map.low_passed_n is None:
        raise ValueError("low-passed forces were not asked for")
    return peak_map.low_passed_n


def _worst_positions(peak_map: PeakMap, counted: NDArray[np.intp], positions_m: FloatArray) -> FloatArray:
    """The worst over the positions that count, (6, n_speed): the columns of a curve in their order."""
    peak = peak_map.peak_force_n[:, counted]
    return np.stack(
        [
            peak.max(axis=1),
            peak_map.min_force_n[:, counted].min(axis=1),
            peak_map.contact_loss_s[:, counted].max(axis=1),
            positions_m[counted][peak.argmax(axis=1)],
            *_low_passed(peak_map)[:, :, counted].max(axis=2),
        ]
    )


def _rounded(values: FloatArray, decimals: int) -> list[float]:
    rounded: list[float] = np.round(values, decimals).ravel().tolist()
    return rounded
