"""What a weld that just meets the geometric norm does in force: `python -m benchmarks.force_anchor`.

Cosine dips and rises of 100 to 800 mm, each as deep as a quality index of 1 allows on a line of a speed, at every speed
up to that and 15 positions in the span. The bundled force limits are anchored there (`data/limits/force.yaml`).
"""

import numpy as np

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.analysis.geometry import NORM_MRAD, largest_inclination
from weld_force_ros.physics.passage.lowpass import CUTOFFS_HZ
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation import fit_store, track_file

LINES_KMH = (80.0, 120.0, 160.0, 200.0, 250.0, 300.0)
LENGTHS_M = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
POSITIONS = 15


def main() -> None:
    """Print, a line of a track and a line speed, what shapes at a quality index of 1 reach relative to the load."""
    print(f"{'track':20} {'km/h':>5} {'peak/Q0: mean':>14} {'largest':>8} {'P2/Q0':>7} {'unloading':>10}")
    for name in track_file.shipped():
        definition = track_file.load(name)
        model = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
        positions = np.arange(POSITIONS) * definition.track.spacing_m / POSITIONS
        for line_kmh in LINES_KMH:
            norm_rad = float(np.interp(line_kmh, *zip(*NORM_MRAD, strict=True))) * 1e-3
            speeds = np.arange(20.0, line_kmh + 1, 10.0)
            paths = []
            for length in LENGTHS_M:
                x = np.linspace(-0.5, 0.5, 1001)
                shape = np.where(np.abs(x) <= length / 2, cosine_dip(x, length, 1e-3), 0.0)
                for sign in (1, -1):
                    z = sign * shape * norm_rad / largest_inclination(x, shape)
                    paths.append(wheel_path_over(x, z, definition.wheel.radius_m))
            load_n = definition.wheel.static_load_n
            maps = list(model.peak_maps(paths, speeds, positions, low_passed=True))
            peaks = np.array([one.peak_force_n.max() for one in maps]) / load_n
            p2 = np.array([one.low_passed_n[CUTOFFS_HZ.index(120.0)].max() for one in maps]) / load_n
            least = 1 - np.array([one.min_force_n.min() for one in maps]) / load_n
            print(
                f"{name:20} {line_kmh:5.0f} {peaks.mean():14.2f} {peaks.max():8.2f} {p2.max():7.2f} {least.max():10.2f}"
            )


if __name__ == "__main__":
    main()
