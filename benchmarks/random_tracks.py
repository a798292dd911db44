"""Thirty random causal tracks: peak forces by common poles against the reference, and what the fit's error says of it.

`python -m benchmarks.random_tracks [--first N] [--count N]` prints a line a track: four shapes, six speeds of 30 to
300 km/h, four positions in the span. A minute or two a track.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.tracks import cosine
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track.support import Spring
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.track_file import TrackDefinition

COUNT = 30
SPEEDS_KMH = (30.0, 84.0, 138.0, 192.0, 246.0, 300.0)
_SHAPES_M = ((-0.2e-3, 0.2), (0.2e-3, 0.12), (-40e-6, 0.048), (-0.4e-3, 0.8))  # height and length of a cosine
_RAILS = ("60E1", "54E1", "49E1", "136RE", "CHN60")
_SEED = 21


@cache
def random_tracks() -> tuple[TrackDefinition, ...]:
    """Return the tracks, all drawn from one seed: stiffness, damping and mass evenly in their logarithms."""
    rng = np.random.default_rng(_SEED)

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def text(number: int) -> str:
        return f"""
            name: random {number}
            rail: {{section: {_RAILS[number % len(_RAILS)]}}}
            supports:
              kind: periodic
              spacing_m: {rng.uniform(0.5, 0.8):.4f}
              pad: {{stiffness_kn_per_mm: {between(30, 1500):.4g}, damping_kns_per_m: {between(3, 60):.4g}}}
              half_sleeper_mass_kg: {between(40, 180):.4g}
              ballast: {{stiffness_kn_per_mm: {between(20, 500):.4g}, damping_kns_per_m: {between(20, 200):.4g}}}
            wheel: {{mass_kg: 600, static_load_kn: 100, radius_m: 0.45, hertz_gn_per_m15: 93.7}}
            """

    return tuple(track_file.parse(text(number), f"random {number}") for number in range(COUNT))


@dataclass(frozen=True)
class Peaks:
    """Peak forces over a track, each (n_shape, n_speed, n_position), N; by the reference and by a model."""

    reference_n: FloatArray
    found_n: FloatArray
    static_n: float

    @property
    def off_percent(self) -> FloatArray:
        """Return how far peaks are off, per cent of the reference."""
        return 100 * (self.found_n / self.reference_n - 1)

    @property
    def dynamic_percent(self) -> float:
        """Return the RMS of the difference over the RMS of the dynamic part, per cent."""
        difference, dynamic = self.found_n - self.reference_n, self.reference_n - self.static_n
        return float(100 * np.sqrt(np.mean(difference**2) / np.mean(dynamic**2)))


def reference_peaks(definition: TrackDefinition, speeds_kmh: Sequence[float] = SPEEDS_KMH) -> FloatArray:
    """Return peak forces by the reference, (n_shape, n_speed, n_position), N."""
    exact = GreensFunctionModel(definition.track, definition.wheel)
    maps = exact.peak_maps(_paths(definition), speeds_kmh, _positions(definition))
    return np.stack([one.peak_force_n for one in maps])


def peaks_by(model: StateModel, definition: TrackDefinition, speeds_kmh: Sequence[float] = SPEEDS_KMH) -> FloatArray:
    """Return peak forces by a fitted track, as `reference_peaks`."""
    fast = VehicleTrackModel(model, definition.wheel)
    maps = [fast.peak_map(path, speeds_kmh, _positions(definition)) for path in _paths(definition)]
    return np.stack([one.peak_force_n for one in maps])


def _paths(definition: TrackDefinition) -> list[WheelPath]:
    return [cosine(height, length, definition.wheel.radius_m) for height, length in _SHAPES_M]


def _positions(definition: TrackDefinition) -> FloatArray:
    return definition.track.spacing_m * np.arange(4) / 4


def line(definition: TrackDefinition, reference_n: FloatArray) -> str:
    """Return a track's line of the table."""
    fit, usual = fit_store.fitted_moving(definition), fit_store.fitted(definition)
    static_n, track = definition.wheel.static_load_n, definition.track
    found = Peaks(reference_n, peaks_by(fit.model(), definition), static_n)
    before = Peaks(reference_n, peaks_by(usual.model(), definition), static_n).off_percent
    off, springs = found.off_percent, [spring for spring in track.support.springs if isinstance(spring, Spring)]
    pad, ballast = (f"{one.stiffness_n_per_m / 1e6:.0f}, {one.damping_ns_per_m / 1e3:.1f}" for one in springs)
    return (
        f"| {track.name} | {track.spacing_m:.2f} | {pad} | {ballast} "
        f"| {_rms(before):.2f} / {np.abs(before).max():.2f} | {fit.order} | {_rms(off):.2f} / {np.abs(off).max():.2f} "
        f"| {found.dynamic_percent:.2f} | {100 * fit.error:.2f} | {100 * fit.error / found.dynamic_percent:.1f} |"
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, help="number of the first track")
    parser.add_argument("--count", type=int, default=COUNT, help="how many tracks")
    given = parser.parse_args()
    print(
        "| track | spacing m | pad kN/mm, kNs/m | ballast kN/mm, kNs/m | fitted at rest: RMS / largest % | order "
        "| RMS / largest % | of the dynamic part % | fit error % | over it |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    for definition in random_tracks()[given.first : given.first + given.count]:
        print(line(definition, reference_peaks(definition)), flush=True)


if __name__ == "__main__":
    main()
