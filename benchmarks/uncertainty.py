"""Samples simulated where they can be the worst, against every speed and position: `python -m benchmarks.uncertainty`.

Brute force takes each sample's own track, which is fitted once (a second each) and kept in the user's cache.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace as with_fields

from benchmarks.timing import interleaved
from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.messages import SimulationSettings, Uncertainty, UncertaintyResult, WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.force_map_view import COLUMNS, Passages
from weld_force_ros.simulation.sampling import TOLERANCE, supported
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.uncertainty import draw, noisy

SPEEDS_KMH = np.linspace(20.0, 255.0, 48).tolist()
POSITIONS = 15
_LEAST_LOSS_S = 1e-3  # that a difference of contact loss is relative to


def main() -> None:
    """Print times and differences, a line a weld."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--skip-brute-force", action="store_true")
    arguments = parser.parse_args()
    stated = load_uncertainty(arguments.samples)
    if stated is None:
        parser.error("--samples is 0")
    unknown = with_fields(stated, design="quasi-random")
    settings = simulation_settings(speeds_kmh=SPEEDS_KMH, positions=POSITIONS, uncertainty=unknown, running="with")
    # The bundled shapes are exact: without that statement their samples differ by noise, as measured ones do.
    profiles = [with_fields(read_profile(find(name)), noise=UNSET) for name in shipped()]
    _print_times(settings, profiles)
    if not arguments.skip_brute_force:
        _print_differences(settings, unknown, profiles)


def _print_times(settings: SimulationSettings, profiles: list[WeldProfile]) -> None:
    limits = load_limits()
    plain = Simulator(simulation_settings(speeds_kmh=SPEEDS_KMH, positions=POSITIONS, running="with"))
    sampled = Simulator(settings)
    print("milliseconds from profile to verdict, median of 5: map and curve; with samples; what they add")
    for profile in profiles:
        kinds = {
            name: lambda simulator=simulator, profile=profile: judge(simulator.force_map(profile), limits)
            for name, simulator in (("plain", plain), ("sampled", sampled))
        }
        times = {name: 1e3 * float(np.median(values)) for name, values in interleaved(kinds, 5).items()}
        added = times["sampled"] - times["plain"]
        print(f"{profile.weld_id:32} {times['plain']:6.0f} {times['sampled']:6.0f} {added:6.0f}")


def _print_differences(settings: SimulationSettings, unknown: Uncertainty, profiles: list[WeldProfile]) -> None:
    brute = _brute_force(settings, unknown, profiles)
    sampled = Simulator(settings)
    print(
        "largest difference from brute force at 5 and 95 %, of all positions and of each sample's worst one, in per"
        " cent: of the force; least force: of the static load; contact loss: of itself, at least of 1 ms"
    )
    print(f"{'':32} " + " ".join(f"{name:>14}" for name in COLUMNS))
    for profile in profiles:
        spread = sampled.force_map(profile).spread
        if not isinstance(spread, UncertaintyResult):
            raise TypeError("the map has no samples")
        shape = (unknown.samples, len(settings.positions_m))
        few = Passages.of_message(spread, settings.static_load_n, shape)
        every = brute[profile.weld_id]
        found = [_difference(name, few.columns[name], every.columns[name], settings.static_load_n) for name in COLUMNS]
        print(f"{profile.weld_id:32} " + " ".join(f"{100 * value:14.2f}" for value in found))


def _brute_force(
    settings: SimulationSettings, unknown: Uncertainty, profiles: list[WeldProfile]
) -> Mapping[str, Passages]:
    """Return the worst over all speeds of every sample at every position, by weld."""
    definition, draws = track_file.parse(settings.track_definition, settings.track), draw(unknown)
    parts: dict[str, list[Passages]] = {profile.weld_id: [] for profile in profiles}
    for i in range(unknown.samples):
        fit = fit_store.fitted(supported(definition, float(draws.support_factor[i])))
        hertz = definition.wheel.hertz_n_per_m15 * float(draws.hertz_factor[i])
        vehicle_track = VehicleTrackModel(fit.model(), replace(definition.wheel, hertz_n_per_m15=hertz))
        for profile in profiles:
            x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
            heights = noisy(x_m, z_m, unknown, int(draws.noise_seed[i]))
            peak_map = vehicle_track.peak_map(
                wheel_path_over(x_m, heights, float(draws.wheel_radius_m[i]), settings.patch_half_length_m),
                settings.speeds_kmh,
                settings.positions_m,
                low_passed=True,
                tolerance=TOLERANCE,
            )
            parts[profile.weld_id].append(Passages.of_peak_map(peak_map, settings.static_load_n).worst(axis=0))
    return {name: Passages.stacked(samples) for name, samples in parts.items()}


def _difference(name: str, few: FloatArray, every: FloatArray, static_load_n: float) -> float:
    ends_few, ends_every = _ends(name, few), _ends(name, every)
    scale = {
        "min_force_n": np.full(4, static_load_n),
        "contact_loss_s": np.maximum(ends_every, _LEAST_LOSS_S),
    }.get(name, ends_every)
    return float(np.max(np.abs(ends_few - ends_every) / scale))


def _ends(name: str, values: FloatArray) -> FloatArray:
    worst = values.min(axis=1) if name == "min_force_n" else values.max(axis=1)
    return np.concatenate([np.quantile(values, (0.05, 0.95)), np.quantile(worst, (0.05, 0.95))])


if __name__ == "__main__":
    main()
