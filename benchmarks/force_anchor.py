"""What a weld that just meets the geometric norm does in force: `python -m benchmarks.force_anchor`.

Cosine dips and rises of 100 to 800 mm, each as deep as a quality index of 1 allows on a line of a speed, at every speed
up to that and 15 positions in the span. The bundled force limits are anchored there (`data/limits/force.yaml`).
"""

import numpy as np

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.analysis.geometry import NORM_MRAD, largest_inclination
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.lowpass import BETWEEN_RESONANCES_HZ, CUTOFFS_HZ
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file, vehicle_file
from weld_force_ros.simulation.track_file import TrackDefinition

LINES_KMH = (80.0, 120.0, 160.0, 200.0, 250.0, 300.0)
LENGTHS_M = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
POSITIONS = 15


def main() -> None:
    """Print, a line of a wheel on a track, what shapes at a quality index of 1 reach on lines of each speed."""
    print(
        f"{'track, wheel':34} {'km/h':>5} {'peak - Q0, kN: mean':>20} {'largest':>8} {'P2 - Q0':>8} {'unloading':>10}"
    )
    for name in track_file.shipped():
        definition = track_file.load(name)
        _print(f"{name}, its own", definition, definition.wheel)
    definition = track_file.load("bilbao-viscous")
    for name in vehicle_file.bundled():
        _print(f"bilbao-viscous, {name}", definition, vehicle_file.load(name).on(definition.wheel))


def _print(what: str, definition: TrackDefinition, wheel: Wheel) -> None:
    model = VehicleTrackModel(fit_store.fitted(definition).model(), wheel)
    positions = np.arange(POSITIONS) * definition.track.spacing_m / POSITIONS
    for line_kmh in LINES_KMH:
        speeds = np.arange(20.0, line_kmh + 1, 10.0)
        maps = model.peak_maps(_at_the_norm(line_kmh, wheel), speeds, positions, low_passed=True)
        kept = [(one.peak_force_n.max(), one.low_passed_n[_P2].max(), one.min_force_n.min()) for one in maps]
        peaks, p2, least = np.array(kept).T
        over = (np.array([peaks.mean(), peaks.max(), p2.max()]) - wheel.static_load_n) / 1e3
        print(
            f"{what:34} {line_kmh:5.0f} {over[0]:20.0f} {over[1]:8.0f} {over[2]:8.0f} "
            f"{1 - least.min() / wheel.static_load_n:10.2f}"
        )


_P2 = CUTOFFS_HZ.index(BETWEEN_RESONANCES_HZ)


def _at_the_norm(line_kmh: float, wheel: Wheel) -> list[WheelPath]:
    """Return dips and rises of every length whose quality index is 1."""
    norm_rad = float(np.interp(line_kmh, *zip(*NORM_MRAD, strict=True))) * 1e-3
    x = np.linspace(-0.5, 0.5, 1001)
    shapes = [np.where(np.abs(x) <= length / 2, cosine_dip(x, length, 1e-3), 0.0) for length in LENGTHS_M]
    return [
        wheel_path_over(x, sign * _scaled(x, shape, norm_rad), wheel.radius_m) for shape in shapes for sign in (1, -1)
    ]


def _scaled(x_m: FloatArray, shape: FloatArray, norm_rad: float) -> FloatArray:
    return shape * norm_rad / largest_inclination(x_m, shape)


if __name__ == "__main__":
    main()
