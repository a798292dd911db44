"""Peak forces over speed and position of a weld, and their features."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.analysis.speed_curve import CurveFeatures, SurfaceFeatures, surface_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.studies.passage_curves import SIGNIFICANT, features
from weld_force_ros.studies.study_context import BILBAO, WELDS, Profile, StudyContext

SPEEDS_KMH = (20.0, 300.0, 5.0)
_LEVEL = 0.02  # of the greatest height: what lies lower is not yet ramp
_CREST = 0.5  # of the greatest height: a lower top does not end the ramp


@dataclass(frozen=True)
class WeldMap:
    """Peaks over one weld; arrays over speed and position are (n_speed, n_position).

    `profile` holds positions from the weld's centre and heights, m, (n,) each.
    """

    name: str
    profile: Profile
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
        """Return the location of the peaks from the weld's centre, m."""
        return np.asarray(self.peak_map.peak_x_m - self.positions_m)

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


def weld_maps(context: StudyContext, welds: Mapping[str, Profile]) -> list[WeldMap]:
    """Compute maps of welds, of which names and profiles are given, on the paper's track."""
    speeds, positions = context.speeds(*SPEEDS_KMH), context.positions(BILBAO)
    vehicle_track = context.vehicle_track(BILBAO)
    wheel_paths = [wheel_path_over(*profile, vehicle_track.wheel.radius_m) for profile in welds.values()]
    peak_maps = vehicle_track.peak_maps(wheel_paths, speeds, positions)
    span_m, static_n = vehicle_track.model.spacing_m, vehicle_track.wheel.static_load_n
    return [
        WeldMap(name, profile, speeds, positions, span_m, static_n, peak_map)
        for (name, profile), peak_map in zip(welds.items(), peak_maps, strict=True)
    ]


def upward_ramp(profile: Profile) -> tuple[float, float]:
    """Return where a weld's first rise begins and where it ends at a crest, m; NaN if it never rises."""
    x, z = profile
    highest_m = float(z.max())
    tops = np.flatnonzero((z[1:-1] > z[:-2]) & (z[1:-1] >= z[2:]) & (z[1:-1] >= _CREST * highest_m)) + 1
    if highest_m <= 0 or not len(tops):
        return np.nan, np.nan
    below = np.flatnonzero(z[: tops[0]] <= _LEVEL * highest_m)
    return float(x[below[-1] if len(below) else 0]), float(x[tops[0]])


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
