"""Propagate what is uncertain to a weld's forces: Monte-Carlo samples, simulated by the fast engine."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.messages import Uncertainty, UncertaintyResult, WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.batch import USE_SIMD
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.threads import executor
from weld_force_ros.physics.track.local_support import LocalSupports
from weld_force_ros.simulation import fit_store
from weld_force_ros.simulation.few_passages import FewPassages, support_levels
from weld_force_ros.simulation.fit_file import PolesFit
from weld_force_ros.simulation.force_map_view import Passages, RelevantMap, rounded
from weld_force_ros.simulation.measured_geometry import sampled_geometries
from weld_force_ros.simulation.profile_measures import sampled_measures
from weld_force_ros.simulation.running import Run
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.simulation.uncertainty import Draws, draw, noisy

TOLERANCE = 2e-2  # as estimated; in truth under 0.1 % of the peak, 0.6 % over a flat: far below what samples differ by
_FORCE_DECIMALS = 1
_TIME_DECIMALS = 6
_RADIUS_DECIMALS = 9


class Sampler:
    """Simulates samples of what is uncertain, always by common poles: a fit of another track takes a second.

    Args:
        definition: the nominal track; samples with other supports are fitted once and kept in the user's cache.
        wheel: the nominal wheel.
        unknown: what is drawn, and how often.
        supports: those that differ from the track's.
        moving: whether their fits have the signs that a moving load finds.
        patch_m: half length of the contact patch that heights are averaged over; 0: none.
        on_fit: called with a line of text if a fit has to be made.
        threads: that compute; one a core, if not given.
    """

    def __init__(
        self,
        definition: TrackDefinition,
        wheel: Wheel,
        unknown: Uncertainty,
        supports: LocalSupports | None = None,
        *,
        moving: bool = False,
        patch_m: float = 0.0,
        on_fit: Callable[[str], None] | None = None,
        threads: int | None = None,
    ) -> None:
        self.unknown = unknown
        self._wheel = wheel
        self._patch_m = patch_m
        self._threads = threads
        self._draws = draw(unknown)
        self._rolling_m = self._draws.wheel_radius_m if wheel.radius_m else np.zeros(unknown.samples)
        few = unknown.design == "quasi-random" and USE_SIMD
        factors = support_levels(unknown) if few else np.unique(self._draws.support_factor)
        self._models: dict[float, StateModel] = {
            factor: _fitted(supported(definition, factor), supports, moving, on_fit).model()
            for factor in factors.tolist()
        }
        self._few: dict[bool, FewPassages] = {}
        if few:
            for lost in (False, True):
                rolled = replace(self._draws, wheel_radius_m=self._rolling_m)
                self._few[lost] = FewPassages(self._models, wheel, unknown, rolled, threads, patch_m, contact_lost=lost)

    def geometries(self, profile: WeldProfile) -> FloatArray:
        """Return what a weld's measurement allows, (n_sample, n); with noise where nothing is known of it."""
        drawn = sampled_geometries(profile, self.unknown.samples, self.unknown.seed)
        return self._noisy(np.array(profile.x_m), np.array(profile.z_m)) if drawn is None else drawn

    def _noisy(self, x_m: FloatArray, z_m: FloatArray) -> FloatArray:
        return np.stack([noisy(x_m, z_m, self.unknown, seed) for seed in self._draws.noise_seed.tolist()])

    def result(
        self,
        x_m: FloatArray,
        z_m: FloatArray,
        relevant: RelevantMap,
        geometries: FloatArray | None = None,
    ) -> UncertaintyResult:
        """Return the worst over speeds of every sample at every position.

        Args:
            x_m: (n,), increasing.
            z_m: (n,), positive up.
            relevant: of the nominal map: its speeds and positions count.
            geometries: heights of the samples, (n_sample, n); measurement noise is drawn if not given.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        profiles = self._noisy(x_m, z_m) if geometries is None else geometries
        speeds_kmh, positions_m = relevant.speeds_kmh, relevant.positions_m
        few = self._few.get(bool(np.any(relevant.passages.contact_loss_s > 0)))
        if few is not None and few.serves(speeds_kmh):
            worst = few.worst(x_m, z_m, profiles, positions_m, speeds_kmh, relevant.by_direction)
        else:
            opposite_m = next(iter(self._models.values())).opposite_m
            runs = [Run(direction, opposite_m) for direction in relevant.by_direction]
            parts = [self._everywhere(x_m, profiles, speeds_kmh, positions_m, run) for run in runs]
            worst = Passages.stacked(parts).worst(axis=0)
        with executor(self._threads) as pool:
            of_geometry = sampled_measures(x_m, profiles, relevant.force_map.measures, pool)
        draws = self._draws
        return UncertaintyResult(
            positions_m=positions_m.tolist(),
            support_factor=draws.support_factor.tolist(),
            hertz_factor=draws.hertz_factor.tolist(),
            wheel_radius_m=rounded(draws.wheel_radius_m, _RADIUS_DECIMALS),
            **of_geometry,
            **worst.rounded(_FORCE_DECIMALS, _TIME_DECIMALS),
        )

    def _everywhere(
        self, x_m: FloatArray, profiles: FloatArray, speeds_kmh: FloatArray, positions_m: FloatArray, run: Run
    ) -> Passages:
        """Return the worst of every sample by passages at every speed and position, (n_sample, n_position)."""
        met_m = run.places(positions_m)
        draws = self._draws
        worst: dict[int, Passages] = {}
        for support, hertz, samples in _samples_by_stiffness(draws):
            # Made anew for every weld: the tables of all would not fit into a small machine's memory.
            vehicle_track = VehicleTrackModel(
                self._models[support],
                replace(self._wheel, hertz_n_per_m15=self._wheel.hertz_n_per_m15 * hertz),
                threads=self._threads,
            )
            wheel_paths = [
                run.path(wheel_path_over(x_m, profiles[i], self._rolling_m[i], self._patch_m)) for i in samples
            ]
            # The first on all threads: it makes the tables that the others use, a thread each.
            first = vehicle_track.peak_map(wheel_paths[0], speeds_kmh, met_m, low_passed=True, tolerance=TOLERANCE)
            rest = vehicle_track.peak_maps(wheel_paths[1:], speeds_kmh, met_m, low_passed=True, tolerance=TOLERANCE)
            for i, peak_map in zip(samples.tolist(), chain([first], rest), strict=True):
                worst[i] = Passages.of_peak_map(peak_map, self._wheel.static_load_n).worst(axis=0)
        return Passages.stacked([worst[i] for i in range(self.unknown.samples)])


def _fitted(
    definition: TrackDefinition,
    supports: LocalSupports | None,
    moving: bool,
    on_fit: Callable[[str], None] | None,
) -> PolesFit:
    if supports is None:
        return fit_store.fitted(definition, on_fit=on_fit)
    return fit_store.fitted_window(definition, supports, moving=moving, on_fit=on_fit)


def _samples_by_stiffness(draws: Draws) -> Iterator[tuple[float, float, NDArray[np.intp]]]:
    """Yield factors of support and contact with the samples that share them, and so the tables of both."""
    factors = np.column_stack([draws.support_factor, draws.hertz_factor])
    distinct, which = np.unique(factors, axis=0, return_inverse=True)
    for number, (support, hertz) in enumerate(distinct.tolist()):
        yield support, hertz, np.flatnonzero(which == number)


def supported(definition: TrackDefinition, factor: float) -> TrackDefinition:
    """Return the track with the stiffness of every spring below its rail multiplied by a factor; dashpots stay."""
    if factor == 1.0:
        return definition

    track = definition.track
    name = f"{track.name}, supports x {factor:.2f}"
    return replace(definition, track=replace(track, name=name, support=track.support.stiffer(factor)))
