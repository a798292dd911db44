"""Peak forces over speed and position of a weld, and their features."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.analysis.speed_curve import CurveFeatures, SurfaceFeatures, surface_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.studies.passage_curves import SIGNIFICANT, features
from weld_force_ros.studies.study_context import BILBAO, WELDS, StudyContext

SPEEDS_KMH = (20.0, 300.0, 5.0)
_STRAIGHTEDGE_CENTRE_M = 0.5


@dataclass(frozen=True)
class WeldMap:
    """Peaks over one weld; arrays over speed and position are (n_speed, n_position)."""

    name: str
    speeds_kmh: FloatArray
    positions_m: FloatArray
    span_m: float
    static_n: float
    peak_map: PeakMap

    @property
    def file_name(self) -> str:
        """Return the weld's name, or `own-weld`, since a user's weld may have a name that no file can have."""
        return self.name if self.name in WELDS else "own-weld"

    @property
    def force_n(self) -> FloatArray:
        """Return the peak forces."""
        return self.peak_map.peak_force_n

    @cached_property
    def curves(self) -> list[CurveFeatures]:
        """Return the curve's features at each position."""
        return [features(self.speeds_kmh, force) for force in self.force_n.T]

    @cached_property
    def shape(self) -> SurfaceFeatures:
        """Return local minima over speed, best and worst positions."""
        return surface_features(self.speeds_kmh, self.positions_m, self.force_n, self.span_m, tolerance=SIGNIFICANT)

    @property
    def peak_location_m(self) -> FloatArray:
        """Return the location of the peaks from the straightedge's start, m."""
        return np.asarray(self.peak_map.peak_x_m - self.positions_m + _STRAIGHTEDGE_CENTRE_M)

    def between(self, first_kmh: float, last_kmh: float) -> FloatArray:
        """Return the mean force over a range of speeds, (n_position,)."""
        return np.asarray(self.force_n[within(self.speeds_kmh, first_kmh, last_kmh)].mean(axis=0))

    def relative_at(self, position_m: float, first_kmh: float, last_kmh: float) -> float:
        """Return the mean force at the nearest position over that of all, in a range of speeds."""
        mean = self.between(first_kmh, last_kmh)
        return float(mean[np.argmin(np.abs(self.positions_m - position_m))] / mean.mean())

    def position_spread(self) -> float:
        """Return the range of the force over positions relative to the mean dynamic force, median over speeds."""
        force = self.force_n[self.speeds_kmh >= 50]
        return float(np.median(np.ptp(force, axis=1) / (force.mean(axis=1) - self.static_n)))


def within(values: FloatArray, first: float, last: float) -> NDArray[np.bool_]:
    """Return a mask of the values within a range, ends included."""
    return np.asarray((values >= first - 1e-9) & (values <= last + 1e-9))


def weld_maps(context: StudyContext, names: Sequence[str], scale: float = 1.0) -> list[WeldMap]:
    """Compute maps of welds on the paper's track, heights times `scale`."""
    speeds, positions, vehicle_track = (
        context.speeds(*SPEEDS_KMH),
        context.positions(BILBAO),
        context.vehicle_track(BILBAO),
    )
    profiles = [context.weld(name) for name in names]
    wheel_paths = [
        wheel_path_over(np.array(p.x_m), scale * np.array(p.z_m), vehicle_track.wheel.radius_m) for p in profiles
    ]
    peak_maps = vehicle_track.peak_maps(wheel_paths, speeds, positions)
    span_m, static_n = vehicle_track.model.spacing_m, vehicle_track.wheel.static_load_n
    return [
        WeldMap(name, speeds, positions, span_m, static_n, peak_map)
        for name, peak_map in zip(names, peak_maps, strict=True)
    ]


def plateau_width(speeds_kmh: FloatArray, force_n: FloatArray, tolerance_n: float) -> float:
    """Return the width of the widest speed interval over which the force does not rise by more than a tolerance.

    It begins at a given speed; its end lies between two where the force is linear.
    """
    widths = []
    for k, speed in enumerate(speeds_kmh):
        bound = force_n[k] + tolerance_n
        above = np.flatnonzero(force_n[k:] > bound)
        end = speeds_kmh[-1]
        if len(above):
            rise = slice(k + above[0] - 1, k + above[0] + 1)
            end = np.interp(bound, force_n[rise], speeds_kmh[rise])
        widths.append(float(end - speed))
    return max(widths)
