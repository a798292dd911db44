"""Samples rolled by the suite are those that rolling each by itself gives, and a verdict's probabilities follow."""

from dataclasses import replace
from functools import lru_cache

import msgspec
import numpy as np
import pytest

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.limits import load_limits
from weld_force_ros.assessment.probability import PLACE, RADIUS, REST
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.messages import (
    SimulationSettings,
    UncertaintyResult,
    WeldProfile,
    config_sha256,
    encode,
    profile_sha256,
)
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.uncertainty import draw, noisy

SPEEDS, POSITIONS = [60.0, 110.0, 160.0], [0.0, 0.2, 0.4]


def profile(depth_m: float = 0.2e-3, **known: float) -> WeldProfile:
    x = np.linspace(-0.15, 0.15, 151)
    z = cosine_dip(x, 0.25, depth_m)
    sha = profile_sha256(x.tolist(), z.tolist())
    return WeldProfile(weld_id="by hand", source="test", x_m=x.tolist(), z_m=z.tolist(), profile_sha256=sha, **known)


def settings(samples: int, track: str = "bilbao-viscous", **changes: float) -> SimulationSettings:
    unknown = msgspec.structs.replace(load_uncertainty(samples), **changes)
    return simulation_settings(track=track, speeds_kmh=SPEEDS, positions=POSITIONS, uncertainty=unknown)


@pytest.mark.slow
def test_samples_are_what_rolling_each_by_itself_gives():
    """Brute force: a track fitted, a wheel made and every passage rolled in full for each sample."""
    chosen = settings(8)
    known = profile(line_speed_kmh=120.0)
    spread = Simulator(chosen).force_map(known).spread
    assert isinstance(spread, UncertaintyResult)
    draws, definition = draw(chosen.uncertainty), track_file.load("bilbao-viscous")
    x, z = np.array(known.x_m), np.array(known.z_m)
    fitted = lru_cache(fit_store.make_poles)  # the same supports give the same fit
    for i in range(8):
        track = definition.track
        pad, ballast = (
            replace(layer, stiffness_n_per_m=layer.stiffness_n_per_m * float(draws.support_factor[i]))
            for layer in (track.pad, track.ballast)
        )
        stiffer = replace(definition, track=replace(track, pad=pad, ballast=ballast))
        wheel = replace(
            definition.wheel, hertz_n_per_m15=definition.wheel.hertz_n_per_m15 * float(draws.hertz_factor[i])
        )
        vehicle_track = VehicleTrackModel(fitted(stiffer).model(), wheel)
        height = noisy(x, z, chosen.uncertainty, int(draws.noise_seed[i]))
        wheel_path = wheel_path_over(x, height, float(draws.wheel_radius_m[i]))
        for column, at_m in enumerate(POSITIONS):
            forces = [
                vehicle_track.history(wheel_path, speed, at_m).force_n for speed in SPEEDS[:2]
            ]  # the line's 120 km/h
            place = 3 * i + column
            assert spread.peak_force_n[place] == pytest.approx(max(f.max() for f in forces), rel=3e-3)
            assert spread.min_force_n[place] == pytest.approx(min(f.min() for f in forces), abs=1e3)


def test_verdict_carries_probabilities_that_count_samples():
    force_map = Simulator(settings(40)).force_map(profile())
    verdict = judge(force_map, load_limits())
    encode(verdict)
    assert verdict.samples == 40
    peak = next(c for c in verdict.criteria if c.name == "peak_force")
    assert peak.exceeding == np.mean(np.array(force_map.spread.peak_force_n) > peak.limit)
    assert all(c.exceeding_reject <= c.exceeding for c in verdict.criteria)


def test_known_position_is_no_unknown_and_what_does_not_spread_drives_nothing():
    quiet = {"noise_m": 0.0, "support_spread": 0.0, "hertz_spread": 0.0}
    only_radius = Simulator(settings(20, **quiet)).force_map(profile(weld_position_m=0.2))
    assert only_radius.spread.positions_m == [0.2]
    peak = judge(only_radius, load_limits()).criteria[0]
    assert peak.driver in (RADIUS, REST)  # over a smooth dip the radius hardly matters
    only_place = Simulator(settings(20, **quiet, radius_low_m=0.45, radius_high_m=0.45)).force_map(profile())
    peaks = np.array(only_place.spread.peak_force_n).reshape(20, 3)
    np.testing.assert_array_equal(peaks, np.broadcast_to(peaks[0], peaks.shape))
    assert judge(only_place, load_limits()).criteria[0].driver == PLACE


def test_uncertainty_is_part_of_the_settings_identity():
    one, other = settings(20), settings(20, noise_m=1e-6)
    plain = simulation_settings(track="bilbao-viscous", speeds_kmh=SPEEDS, positions=POSITIONS)
    assert len({one.config_sha256, other.config_sha256, plain.config_sha256}) == 3
    assert config_sha256(one) == one.config_sha256


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("noise_m: 1.0", "noise_m"),
        ("noise: 1.0e-6", "noise is unknown"),
        ("[1]", "object"),
        ("seed: -1", "seed"),
    ],
)
def test_files_of_the_unknown_that_cannot_be_used_are_refused(text: str, complaint: str, tmp_path):
    path = tmp_path / "unknown.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        load_uncertainty(10, path)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="samples"):
        load_uncertainty(1)
    assert load_uncertainty(0, path) is None
