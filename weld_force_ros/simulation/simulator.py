"""Simulate wheel passages over a weld under fixed settings: force maps, curves, histories."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros.errors import InputError
from weld_force_ros.messages import (
    Direction,
    ForceHistory,
    ForceMap,
    OppositeDirection,
    SimulationSettings,
    SpeedCurve,
    Uncertainty,
    UncertaintyResult,
    WeldProfile,
)
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import hanging_samples, sleeper_samples, track_file
from weld_force_ros.simulation.curve_bounds import CurveBounds, Selection
from weld_force_ros.simulation.curve_refinement import Asks, refine
from weld_force_ros.simulation.force_map_view import (
    Passages,
    RelevantMap,
    count_up_to,
    relevant_positions,
    relevant_range,
    rounded,
)
from weld_force_ros.simulation.profile_measures import profile_measures
from weld_force_ros.simulation.running import Run, directed_runs, drawn_alike, stated_running
from weld_force_ros.simulation.track_at_weld import TrackAtWeld, TracksAtWelds, stated_support
from weld_force_ros.simulation.worst_places import possibly_worst

# Messages keep what means something: 0.01 N is a ten-millionth of a wheel load, 0.1 nm far below any roughness.
_FORCE_DECIMALS = 2
_PLACE_DECIMALS = 6
_TIME_DECIMALS = 9
_DISPLACEMENT_DECIMALS = 10
_HISTORY_STEP_M = 1e-3
_PATHS_REMEMBERED = 2  # the history of a weld follows on its map


class Simulator:
    """Simulates passages under fixed settings; making one loads the track's fit and may have to compute it.

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
            on_fit: called with a line of text if a fit has to be made.
            threads: that compute; one a core, if not given.
            curves: whether maps carry a curve; without it speed advice is as fine as the map, which takes less time.

        Raises:
            InputError: settings that this version cannot simulate.
        """
        self.settings = settings
        # The text, not the name: a recording then holds all that its replay needs.
        definition = track_file.parse(settings.track_definition, settings.track)
        self._span_m = definition.track.spacing_m
        self._pad_n_per_m = definition.track.support.pad.stiffness_n_per_m
        self.tracks = TracksAtWelds(definition, settings, threads=threads, on_fit=on_fit)
        self._path_over = lru_cache(_PATHS_REMEMBERED)(self._compute_path)
        self._with_curves = curves and settings.engine == "common-poles"

    @property
    def vehicle_track(self) -> VehicleTrackModel | GreensFunctionModel:
        """Return the wheel on the track as it usually is."""
        return self.tracks.usual.vehicle_track

    def wheel_path(self, profile: WeldProfile) -> WheelPath:
        """Return the path of the wheel's centre over a profile."""
        return self._path_over(np.array(profile.x_m, float).tobytes(), np.array(profile.z_m, float).tobytes())

    def _compute_path(self, x_m: bytes, z_m: bytes) -> WheelPath:
        radius_m, patch_m = self.vehicle_track.wheel.radius_m, self.settings.patch_half_length_m
        return wheel_path_over(np.frombuffer(x_m), np.frombuffer(z_m), radius_m, patch_m)

    def force_map(
        self, profile: WeldProfile, asks: Asks | None = None, *, on_speed: Callable[[], None] = lambda: None
    ) -> ForceMap:
        """Compute the forces at every speed and position of the settings.

        Args:
            profile: the weld.
            asks: returns what the curve is to answer, at a fraction of the passages; without it the curve is simulated
                at every km/h.
            on_speed: called after each speed.

        Raises:
            NumericalError: a passage did not stay finite.
            InputError: the weld's position lies beyond the sleeper span.
        """
        self._check_position(profile)
        began, wheel_path, track = time.perf_counter(), self.wheel_path(profile), self.tracks.at(profile)
        runs, positions = self._runs(profile, track), np.array(self.settings.positions_m)
        peak_maps = track.vehicle_track.maps_of_few(
            [run.path(wheel_path) for run in runs],
            self.settings.speeds_kmh,
            np.stack([run.places(positions) for run in runs]),
            low_passed=True,
            on_speed=on_speed,
        )
        return self._force_map(profile, wheel_path, track, runs, peak_maps, began, asks)

    def force_maps(self, profiles: Sequence[WeldProfile]) -> Iterator[ForceMap]:
        """Compute `force_map` of many welds, in their order: faster than one by one, as they share the SIMD lanes.

        `elapsed_s` of each is its share of the time that all took, and what it took beside.

        Raises:
            NumericalError: a passage over one of them did not stay finite.
            InputError: the position of one of them lies beyond the sleeper span.
        """
        for profile in profiles:
            self._check_position(profile)
        began, positions = time.perf_counter(), np.array(self.settings.positions_m)
        wheel_paths = [self.wheel_path(profile) for profile in profiles]
        tracks = [self.tracks.at(profile) for profile in profiles]
        runs = [self._runs(*own) for own in zip(profiles, tracks, strict=True)]
        found: dict[int, list[PeakMap]] = {}
        for track in {id(track): track for track in tracks}.values():
            alike = [i for i, own in enumerate(tracks) if own is track]
            met = [(run, wheel_paths[i]) for i in alike for run in runs[i]]
            peak_maps = iter(
                track.vehicle_track.peak_maps(
                    [run.path(path) for run, path in met],
                    self.settings.speeds_kmh,
                    np.array([run.places(positions) for run, _ in met]),
                    low_passed=True,
                )
            )
            found |= {i: [next(peak_maps) for _ in runs[i]] for i in alike}
        share_s = (time.perf_counter() - began) / max(1, len(profiles))
        for i, (profile, wheel_path) in enumerate(zip(profiles, wheel_paths, strict=True)):
            yield self._force_map(profile, wheel_path, tracks[i], runs[i], found[i], time.perf_counter() - share_s)

    def _check_position(self, profile: WeldProfile) -> None:
        at_m = profile.weld_position_m
        if isinstance(at_m, float) and at_m > self._span_m * (1 + 1e-9):
            raise InputError(
                f"weld {profile.weld_id}: a position of {at_m:g} m lies beyond the sleeper span of {self._span_m:g} m",
                "state metres after the sleeper before the weld (30 cm is 0.3), or the track with that span",
            )

    def _runs(self, profile: WeldProfile, track: TrackAtWeld) -> list[Run]:
        return directed_runs(stated_running(profile, self.settings), track.vehicle_track.opposite_m)

    def _force_map(
        self,
        profile: WeldProfile,
        wheel_path: WheelPath,
        track: TrackAtWeld,
        runs: list[Run],
        peak_maps: list[PeakMap],
        began_s: float,
        asks: Asks | None = None,
    ) -> ForceMap:
        settings = self.settings
        columns = [self._columns(run, peak_map) for run, peak_map in zip(runs, peak_maps, strict=True)]
        force_map = ForceMap(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=settings.config_sha256,
            track=settings.track,
            engine=settings.engine,
            speeds_kmh=settings.speeds_kmh,
            positions_m=settings.positions_m,
            static_load_n=settings.static_load_n,
            span_m=self._span_m,
            model_error=round(track.fit_error, 6),
            pad_n_per_m=self._pad_n_per_m,
            vehicle=settings.vehicle,
            measures=profile_measures(profile),
            elapsed_s=0.0,
            line_speed_kmh=profile.line_speed_kmh,
            weld_position_m=profile.weld_position_m,
            chainage_m=profile.chainage_m,
            rail=profile.rail,
            running=stated_running(profile, settings),
            against=OppositeDirection(**columns[1]) if len(runs) > 1 else UNSET,
            support=list(stated_support(profile, settings)) or UNSET,
            **columns[0],
        )
        if self._with_curves:
            force_map.curve = self._curve(wheel_path, track, runs, peak_maps, force_map, asks)
        if track.sampler is not None:
            relevant, draw = relevant_range(force_map), track.sampler.geometries
            geometries = drawn_alike(profile, draw) if len(runs) > 1 else draw(profile)
            spread = track.sampler.result(np.array(profile.x_m), np.array(profile.z_m), relevant, geometries)
            force_map.spread = spread
            if track is self.tracks.usual:  # what is stated of single sleepers is known
                force_map.spread = self._of_single_sleepers(spread, track.sampler.unknown, relevant, wheel_path)
        force_map.elapsed_s = time.perf_counter() - began_s
        return force_map

    def _of_single_sleepers(
        self, spread: UncertaintyResult, unknown: Uncertainty, relevant: RelevantMap, wheel_path: WheelPath
    ) -> UncertaintyResult:
        """Return samples in which single sleepers differ and hang, where that is asked for."""
        if isinstance(unknown.sleeper_spread, float):
            sensitivities = self.tracks.sleepers.of(wheel_path, relevant)
            spread = sleeper_samples.scattered(spread, sleeper_samples.drawn(unknown), sensitivities)
        if isinstance(unknown.hanging_share, float):
            spread = self._hung(spread, unknown, relevant, wheel_path)
        return spread

    def _hung(
        self, spread: UncertaintyResult, unknown: Uncertainty, relevant: RelevantMap, wheel_path: WheelPath
    ) -> UncertaintyResult:
        """Return samples in which sleepers beside the weld hang as often as is said."""
        which = hanging_samples.drawn(unknown)
        hanging: dict[int, Passages] = {}
        for way in np.unique(which[which > 0]).tolist():
            vehicle_track = self.tracks.supported(hanging_samples.states(way)).vehicle_track
            runs = [Run(direction, vehicle_track.opposite_m) for direction in relevant.by_direction]
            peak_maps = vehicle_track.maps_of_few(
                [run.path(wheel_path) for run in runs],
                relevant.speeds_kmh,
                np.stack([run.places(relevant.positions_m) for run in runs]),
                low_passed=True,
            )
            both = Passages.stacked([self._passages(peak_map) for peak_map in peak_maps])
            hanging[way] = both.worst(axis=0).worst(axis=0)
        return hanging_samples.hung(spread, which, relevant.passages.worst(axis=0), hanging)

    def _columns(self, run: Run, peak_map: PeakMap) -> dict[str, Any]:
        """Return the columns of a direction, as messages hold them."""
        peak_x_m = run.places(peak_map.peak_x_m)
        return {
            "peak_x_m": rounded(peak_x_m, _PLACE_DECIMALS),
            **self._passages(peak_map).rounded(_FORCE_DECIMALS, _TIME_DECIMALS),
        }

    def _curve(
        self,
        wheel_path: WheelPath,
        track: TrackAtWeld,
        runs: list[Run],
        peak_maps: list[PeakMap],
        force_map: ForceMap,
        asks: Asks | None,
    ) -> SpeedCurve:
        """Return the worst over relevant positions and directions at every whole km/h and every speed of the map.

        Slower engines leave it out: speed advice is then as fine as the map.
        """
        map_kmh, positions = np.array(self.settings.speeds_kmh), np.array(self.settings.positions_m)
        relevant = relevant_positions(positions, force_map.weld_position_m, self._span_m)
        places = positions[relevant]
        between = np.setdiff1d(np.arange(np.ceil(map_kmh[0]), map_kmh[-1]), map_kmh)
        speeds = np.sort(np.concatenate([map_kmh, between]))
        nominal = Passages.beside([self._passages(peak_map).at(np.s_[:, relevant]) for peak_map in peak_maps])

        def simulate(selected: Selection) -> Passages:
            assert isinstance(track.vehicle_track, VehicleTrackModel), "engines with curves are fitted"  # noqa: S101
            found = track.vehicle_track.maps_of_few(
                [run.path(wheel_path) for run in runs],
                between,
                np.stack([run.places(places) for run in runs]),
                low_passed=True,
                selected=selected.reshape(len(between), len(runs), len(places)),
            )
            return Passages.beside([self._passages(peak_map) for peak_map in found])

        estimated: list[bool] | UnsetType = UNSET
        limits_sha256: str | UnsetType = UNSET
        if not len(between):
            passages = nominal
        elif asks is None:
            selected = possibly_worst(nominal, map_kmh, between)
            parts = [nominal, simulate(selected).only(selected)]
            passages = Passages.concatenated(parts).at(np.argsort(np.concatenate([map_kmh, between])))
        else:
            questions, bounds = asks(force_map), CurveBounds(nominal, map_kmh, speeds)
            refine(bounds, count_up_to(speeds, force_map.line_speed_kmh), questions, simulate)
            passages, limits_sha256 = bounds.expected, questions.limits_sha256
            estimated = (~bounds.is_known).tolist()
        place = passages.peak_force_n.argmax(axis=1)
        return SpeedCurve(
            speeds_kmh=speeds.tolist(),
            at_m=rounded(places[place % len(places)], _PLACE_DECIMALS),
            against=(place >= len(places)).tolist() if len(runs) > 1 else UNSET,
            estimated=estimated,
            limits_sha256=limits_sha256,
            **passages.worst(axis=1).rounded(_FORCE_DECIMALS, _TIME_DECIMALS),
        )

    def _passages(self, peak_map: PeakMap) -> Passages:
        return Passages.of_peak_map(peak_map, self.settings.static_load_n)

    def force_history(
        self,
        profile: WeldProfile,
        speed_kmh: float,
        position_m: float,
        *,
        until_m: float | None = None,
        running: Direction | UnsetType = UNSET,
    ) -> ForceHistory:
        """Compute one passage in the space domain.

        Args:
            profile: the weld.
            speed_kmh: of the passage.
            position_m: the weld's centre after the sleeper.
            until_m: where it ends, from the sleeper on, if that is more than a span behind the weld.
            running: its direction; with rising x, if unset.

        Raises:
            NumericalError: the passage did not stay finite.
        """
        vehicle_track = self.tracks.at(profile).vehicle_track
        run = directed_runs(running, vehicle_track.opposite_m)[0]
        met_m = run.place(position_m)
        end_m = 0.0 if until_m is None else run.place(until_m)
        history = vehicle_track.history(run.path(self.wheel_path(profile)), speed_kmh, met_m, until_m=end_m)
        step = max(1, round(_HISTORY_STEP_M / (history.x_m[1] - history.x_m[0])))
        every = slice(None, None, step if run.direction == "with" else -step)  # x rises in messages
        return ForceHistory(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self.settings.config_sha256,
            speed_kmh=speed_kmh,
            position_m=position_m,
            x_m=rounded(run.places(history.x_m[every]), _PLACE_DECIMALS),
            force_n=rounded(history.force_n[every], _FORCE_DECIMALS),
            wheel_m=rounded(history.wheel_m[every], _DISPLACEMENT_DECIMALS),
            rail_m=rounded(history.rail_m[every], _DISPLACEMENT_DECIMALS),
            irregularity_m=rounded(history.irregularity_m[every], _DISPLACEMENT_DECIMALS),
            running=running,
        )
