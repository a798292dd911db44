"""Features of passages and force-speed curves that several studies use."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from weld_force_ros.physics.analysis.peaks import Peak, local_peaks
from weld_force_ros.physics.analysis.speed_curve import CurveFeatures, Hollow, curve_features, kinks
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.studies.study_context import StudyContext

SIGNIFICANT = 0.02  # of a curve's largest less smallest force: what counts as an extremum
_BESIDE_M = (-0.050, 0.200)


def features(speeds_kmh: FloatArray, force_n: FloatArray) -> CurveFeatures:
    """Return the curve's significant extrema."""
    return curve_features(speeds_kmh, force_n, prominence=SIGNIFICANT, tolerance=SIGNIFICANT)


def first_maximum(curve: CurveFeatures) -> tuple[float, float]:
    """Return speed in km/h and force in N of the first local maximum; NaN without one."""
    return (curve.maxima[0].speed_kmh, curve.maxima[0].force_n) if curve.maxima else (np.nan, np.nan)


def kinks_kmh(speeds_kmh: FloatArray, peak_map: PeakMap) -> list[float]:
    """Return the speeds of the kinks of the curve at the peak map's first position."""
    return kinks(speeds_kmh, peak_map.peak_force_n[:, 0], peak_map.peak_x_m[:, 0])


def first_kinks_kmh(speeds_kmh: FloatArray, peak_map: PeakMap) -> tuple[float, float]:
    """Return the speeds of the first two kinks; NaN where there is none."""
    first, second, *_ = [*kinks_kmh(speeds_kmh, peak_map), np.nan, np.nan]
    return float(first), float(second)


def minimum_after_maximum(curve: CurveFeatures) -> Hollow | None:
    """Return the first local minimum whose fall begins no earlier than at the first local maximum."""
    speed_kmh = first_maximum(curve)[0]
    # Both are vertices of the same parabola unless a plateau separates them.
    return next((minimum for minimum in curve.hollows if minimum.from_kmh >= speed_kmh - 1e-6), None)


def split_peaks(history: History, static_n: float, around_m: float) -> list[Peak]:
    """Return the peaks of a passage from 50 mm before to 200 mm after a location, in the order of their location."""
    prominence_n = SIGNIFICANT * (float(history.force_n.max()) - static_n)
    first_m, last_m = (around_m + offset for offset in _BESIDE_M)
    return [p for p in local_peaks(history.x_m, history.force_n, prominence_n) if first_m <= p.x_m <= last_m]


def two_highest(peaks: list[Peak]) -> tuple[Peak, Peak]:
    """Return the two highest peaks in the order of their location; NaN if there are fewer."""
    if len(peaks) < 2:
        return Peak(np.nan, np.nan), Peak(np.nan, np.nan)
    first, second = sorted(sorted(peaks, key=lambda p: -p.force_n)[:2], key=lambda p: p.x_m)
    return first, second


@dataclass(frozen=True)
class SmoothRailPassage:
    """The passage at one speed over a track without a weld, at any distance from a sleeper."""

    context: StudyContext
    track: str
    speed_kmh: float

    @cached_property
    def _span(self) -> History:
        return self.context.smooth_rail(self.track, self.speed_kmh, 2)

    def force_n(self, x_m: FloatArray) -> FloatArray:
        """Return the contact force, N, at distances from a sleeper."""
        return self._at(x_m, self._span.force_n)

    def wheel_m(self, x_m: FloatArray) -> FloatArray:
        """Return the wheel's displacement, m, positive up, at distances from a sleeper."""
        return self._at(x_m, self._span.wheel_m)

    def rail_m(self, x_m: FloatArray) -> FloatArray:
        """Return the rail's displacement, m, positive up, under the wheel at distances from a sleeper."""
        return self._at(x_m, self._span.rail_m)

    def _at(self, x_m: FloatArray, values: FloatArray) -> FloatArray:
        spacing_m = self.context.track(self.track).track.spacing_m
        return np.interp(np.mod(x_m, spacing_m), self._span.x_m, values)
