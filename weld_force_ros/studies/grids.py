"""Grids of shapes, speeds and positions, simulated by the reference and then by any engine.

Wheel flats are cosine dips, as deep and long as in reality: the 0.9 mm flat of the 2018 paper is 100 mm long, which is
1.757 times the chord sqrt(8 R d) of a fresh flat. The flats of 1 and 2 mm (its Fig. 8, after Pieringer, whose exact
form the paper does not give) are taken to be rounded likewise: 105 and 149 mm.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import NumericalError
from weld_force_ros.measurement import profile_file
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies.peak_comparison import ComparedPassage
from weld_force_ros.studies.reference_peaks import ReferencePeaks

_RADIUS_M = 0.45
_ROUNDING = 0.100 / np.sqrt(8 * _RADIUS_M * 0.9e-3)
_SAMPLE_M = 0.5e-3

# Length and depth of cosine dips that are not among the shipped profiles; a negative depth makes a protrusion.
COSINES_M = {
    "wheel-flat-1mm": (_ROUNDING * np.sqrt(8 * _RADIUS_M * 1e-3), 1e-3),
    "wheel-flat-2mm": (_ROUNDING * np.sqrt(8 * _RADIUS_M * 2e-3), 2e-3),
    "protrusion-0.3mm": (0.100, -0.3e-3),
    "long-dip-0.2mm": (1.0, 0.2e-3),
}


class GridEvaluator(Protocol):
    """A model of wheel and track that computes peak forces, by any engine."""

    def peak_map(self, wheel_path: WheelPath, speeds_kmh: ArrayLike, positions_m: ArrayLike) -> PeakMap:
        """Return peaks as `weld_force_ros.physics.passage.passage.VehicleTrackModel.peak_map` does."""


@dataclass(frozen=True)
class Grid:
    """Every shape at every speed and position, on one track."""

    track: str
    shapes: tuple[str, ...]
    speeds_kmh: tuple[float, ...]
    position_count: int


@dataclass(frozen=True)
class ReferenceGrid:
    """A grid and what the reference says about it: peak forces in N, (n_shape, n_speed, n_position)."""

    grid: Grid
    definition: TrackDefinition
    wheel_paths: list[WheelPath]
    positions_m: FloatArray
    peak_n: FloatArray

    def compared(self, engine: str, vehicle_track: GridEvaluator) -> list[ComparedPassage]:
        """Simulate the grid by another engine and return each passage beside the reference's; NaN where it fails."""
        passages = []
        speeds, positions = self.grid.speeds_kmh, self.positions_m.tolist()
        for shape, wheel_path, reference in zip(self.grid.shapes, self.wheel_paths, self.peak_n, strict=True):
            peak_n = peaks(vehicle_track, wheel_path, speeds, self.positions_m)
            passages += [
                ComparedPassage(
                    self.grid.track, engine, shape, speed, position, float(reference[i, j]), float(peak_n[i, j])
                )
                for i, speed in enumerate(speeds)
                for j, position in enumerate(positions)
            ]
        return passages


def peaks(
    vehicle_track: GridEvaluator, wheel_path: WheelPath, speeds_kmh: Sequence[float], positions_m: FloatArray
) -> FloatArray:
    """Return peak forces over one shape, N, (n_speed, n_position); NaN at speeds at which the engine fails."""
    try:
        return vehicle_track.peak_map(wheel_path, speeds_kmh, positions_m).peak_force_n
    except NumericalError:
        if len(speeds_kmh) == 1:
            return np.full((1, len(positions_m)), np.nan)
        return np.concatenate([peaks(vehicle_track, wheel_path, [speed], positions_m) for speed in speeds_kmh])


def with_reference(grid: Grid, reference_peaks: ReferencePeaks, on_speed: Callable[[], object]) -> ReferenceGrid:
    """Return the reference's peak forces on a grid, computed or read from `reference_peaks`."""
    definition = track_file.load(grid.track)
    wheel_paths = [wheel_path(shape, definition) for shape in grid.shapes]
    positions = np.arange(grid.position_count) * definition.track.spacing_m / grid.position_count
    peaks = []
    for speed in grid.speeds_kmh:
        peaks.append(reference_peaks.at_speed(definition, wheel_paths, speed, positions)[:, 0])
        on_speed()
    return ReferenceGrid(grid, definition, wheel_paths, positions, np.stack(peaks, axis=1))


def wheel_path(shape: str, definition: TrackDefinition) -> WheelPath:
    """Return the wheel centre's path over a shape of `COSINES_M` or a shipped profile.

    Raises:
        InputError: there is no such shape.
    """
    if shape in COSINES_M:
        return wheel_path_over(*sampled_cosine(*COSINES_M[shape]), definition.wheel.radius_m)
    profile = profile_file.read_profile(profile_file.find(shape))
    return wheel_path_over(np.array(profile.x_m), np.array(profile.z_m), definition.wheel.radius_m)


def sampled_cosine(length_m: float, depth_m: float) -> tuple[FloatArray, FloatArray]:
    """Return positions and heights of a cosine dip, m, each (n,)."""
    x = np.linspace(-length_m / 2, length_m / 2, round(length_m / _SAMPLE_M) + 1)
    return x, cosine_dip(x, length_m, depth_m)
