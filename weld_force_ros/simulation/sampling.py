"""What the unknown does to a weld's passages: samples of it, rolled by the fast engine."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.messages import Uncertainty, UncertaintyResult
from weld_force_ros.physics.analysis.geometry import largest_gradient, straightedge_gap
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.track.beam import Spring
from weld_force_ros.simulation import fit_store
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.simulation.uncertainty import Draws, draw, noisy

_TOLERANCE = 2e-2  # as estimated; in truth under 0.1 % of the peak, 0.6 % over a flat: far below what samples differ by
_FORCE_DECIMALS = 1
_TIME_DECIMALS = 6
_GEOMETRY_DECIMALS = 9


class Sampler:
    """Rolls samples of the unknown; always by common poles, whose fits of softer and stiffer tracks take a second each.

    Args:
        definition: the nominal track; samples with other supports are fitted once and kept in the user's cache.
        wheel: the nominal wheel.
        unknown: what is drawn, and how often.
        on_fit: told, in words, if a fit has to be made.
    """

    def __init__(
        self,
        definition: TrackDefinition,
        wheel: Wheel,
        unknown: Uncertainty,
        *,
        on_fit: Callable[[str], None] | None = None,
    ) -> None:
        self._wheel = wheel
        self._unknown = unknown
        self._draws = draw(unknown)
        self._models: dict[float, StateModel] = {
            factor: fit_store.fitted(_supported(definition, factor), on_fit=on_fit).model()
            for factor in np.unique(self._draws.support_factor).tolist()
        }

    def spread(
        self, x_m: FloatArray, z_m: FloatArray, speeds_kmh: FloatArray, positions_m: FloatArray
    ) -> UncertaintyResult:
        """The worst over speeds of every sample at every position.

        Args:
            x_m: (n,), increasing.
            z_m: (n,), positive up.
            speeds_kmh: (n_speed,), up to the line's.
            positions_m: (n_position,), those that count.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        draws, count = self._draws, self._unknown.samples
        profiles = [noisy(x_m, z_m, self._unknown, seed) for seed in draws.noise_seed.tolist()]
        worst = np.empty((5, count, len(positions_m)))
        for support, hertz, samples in _companies(draws):
            # Made anew for every weld: the tables of all would not fit into a small machine's memory.
            vehicle_track = VehicleTrackModel(
                self._models[support], replace(self._wheel, hertz_n_per_m15=self._wheel.hertz_n_per_m15 * hertz)
            )
            wheel_paths = [wheel_path_over(x_m, profiles[i], draws.wheel_radius_m[i]) for i in samples]
            # The first on all threads: it makes the tables that the others use, a thread each.
            first = vehicle_track.peak_map(
                wheel_paths[0], speeds_kmh, positions_m, low_passed=True, tolerance=_TOLERANCE
            )
            rest = vehicle_track.peak_maps(
                wheel_paths[1:], speeds_kmh, positions_m, low_passed=True, tolerance=_TOLERANCE
            )
            for i, peak_map in zip(samples, chain([first], rest), strict=True):
                worst[:, i] = _worst(peak_map)
        peak, least, loss, p2, below_20hz = worst
        return UncertaintyResult(
            positions_m=positions_m.tolist(),
            peak_force_n=_listed(peak, _FORCE_DECIMALS),
            min_force_n=_listed(least, _FORCE_DECIMALS),
            contact_loss_s=_listed(loss, _TIME_DECIMALS),
            p2_force_n=_listed(p2, _FORCE_DECIMALS),
            force_20hz_n=_listed(below_20hz, _FORCE_DECIMALS),
            gradient_rad=_listed(np.array([largest_gradient(x_m, z) for z in profiles]), _GEOMETRY_DECIMALS),
            straightedge_m=_listed(np.array([straightedge_gap(x_m, z) for z in profiles]), _GEOMETRY_DECIMALS),
            support_factor=draws.support_factor.tolist(),
            hertz_factor=draws.hertz_factor.tolist(),
            wheel_radius_m=_listed(draws.wheel_radius_m, _GEOMETRY_DECIMALS),
        )


def _companies(draws: Draws) -> Iterator[tuple[float, float, NDArray[np.intp]]]:
    """Samples that share a track and a contact, and so the tables of both."""
    levels = np.column_stack([draws.support_factor, draws.hertz_factor])
    pairs, company = np.unique(levels, axis=0, return_inverse=True)
    for number, (support, hertz) in enumerate(pairs.tolist()):
        yield support, hertz, np.flatnonzero(company == number)


def _worst(peak_map: PeakMap) -> FloatArray:
    """(5, n_position): peak, least force, contact loss, and both low-passed forces, over all speeds."""
    assert peak_map.low_passed_n is not None  # noqa: S101 - asked for
    return np.stack(
        [
            peak_map.peak_force_n.max(axis=0),
            peak_map.min_force_n.min(axis=0),
            peak_map.contact_loss_s.max(axis=0),
            *peak_map.low_passed_n.max(axis=1),
        ]
    )


def _supported(definition: TrackDefinition, factor: float) -> TrackDefinition:
    """The track on supports that are stiffer by a factor, pad and ballast alike; their damping stays."""
    if factor == 1.0:
        return definition

    def stiffer(spring: Spring) -> Spring:
        return replace(spring, stiffness_n_per_m=spring.stiffness_n_per_m * factor)

    track = definition.track
    return replace(
        definition,
        track=replace(
            track,
            name=f"{track.name}, supports x {factor:.2f}",
            pad=stiffer(track.pad),
            ballast=stiffer(track.ballast),
        ),
    )


def _listed(values: FloatArray, decimals: int) -> list[float]:
    listed: list[float] = np.round(values, decimals).ravel().tolist()
    return listed
