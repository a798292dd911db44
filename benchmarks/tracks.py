"""Every bundled track: peak forces by common poles against the reference.

`python -m benchmarks.tracks [TRACK ...]` prints the table of docs/howto/own-track.md: three shapes, five speeds of 30
to 300 km/h, four positions in the span; half a minute a track.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file

SPEEDS_KMH = (30.0, 80.0, 150.0, 220.0, 300.0)
_STEP_M = 1e-3
_FLAT_M = 0.3
_SHAPES_M = ((-0.2e-3, 0.2), (0.2e-3, 0.12), (-40e-6, 0.048))  # height and length of a cosine


@dataclass(frozen=True)
class Accuracy:
    """How peak forces by common poles differ from the reference, per cent."""

    order: int
    fit_error: float
    rms: float
    largest: float


def accuracy(name: str, speeds_kmh: Sequence[float] = SPEEDS_KMH) -> Accuracy:
    """Compare both engines on a track, name or file."""
    definition = track_file.load(name)
    fit = fit_store.fitted_moving(definition)
    paths = [cosine(height, length, definition.wheel.radius_m) for height, length in _SHAPES_M]
    positions = definition.track.spacing_m * np.arange(4) / 4
    fast = VehicleTrackModel(fit.model(), definition.wheel)
    exact = GreensFunctionModel(definition.track, definition.wheel).peak_maps(paths, speeds_kmh, positions)
    found = [fast.peak_map(path, speeds_kmh, positions) for path in paths]
    ratio = [one.peak_force_n / other.peak_force_n - 1 for one, other in zip(found, exact, strict=True)]
    off = 100 * np.array(ratio)
    return Accuracy(fit.order, 100 * fit.error, float(np.sqrt(np.mean(off**2))), float(np.abs(off).max()))


def cosine(height_m: float, length_m: float, radius_m: float) -> WheelPath:
    x: FloatArray = np.arange(-length_m / 2 - _FLAT_M, length_m / 2 + _FLAT_M, _STEP_M)
    wave = 0.5 * height_m * (1 + np.cos(2 * np.pi * x / length_m))
    return wheel_path_over(x, np.where(np.abs(x) < length_m / 2, wave, 0.0), radius_m)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tracks", nargs="*", default=track_file.shipped())
    print("| track | layers | causal | order | fit | RMS | largest |\n|---|---|---|---|---|---|---|")
    for name in parser.parse_args().tracks:
        track, found = track_file.load(name).track, accuracy(name)
        print(
            f"| `{name}` | {len(track.support.springs)} | {'yes' if track.causal else 'no'} | {found.order} "
            f"| {found.fit_error:.2f} % | {found.rms:.2f} % | {found.largest:.2f} % |",
            flush=True,
        )


if __name__ == "__main__":
    main()
