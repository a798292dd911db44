"""Samples rolled by the suite are those that rolling each by itself gives, and a verdict's probabilities follow."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from msgspec import UNSET

from tests.harness.limits import by_value
from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.probability import PLACE, RADIUS, REST
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.messages import (
    SimulationSettings,
    Uncertainty,
    UncertaintyResult,
    WeldProfile,
    config_sha256,
    encode,
    profile_sha256,
)
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPathRoller, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.force_map_view import Passages, relevant_range
from weld_force_ros.simulation.sampling import TOLERANCE, Sampler, supported
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.uncertainty import draw, noisy
from weld_force_ros.simulation.worst_speeds import near_worst

SPEEDS, POSITIONS = [60.0, 110.0, 160.0], [0.0, 0.2, 0.4]


def profile(depth_m: float = 0.2e-3, **known: float) -> WeldProfile:
    x = np.linspace(-0.15, 0.15, 151)
    z = cosine_dip(x, 0.25, depth_m)
    sha = profile_sha256(x.tolist(), z.tolist())
    return WeldProfile(weld_id="by hand", source="test", x_m=x.tolist(), z_m=z.tolist(), profile_sha256=sha, **known)


def settings(samples: int, track: str = "bilbao-viscous", **changes: float) -> SimulationSettings:
    """Samples at every speed and position, under a point contact."""
    unknown = msgspec.structs.replace(load_uncertainty(samples), design=UNSET, **changes)
    return simulation_settings(
        track=track, speeds_kmh=SPEEDS, positions=POSITIONS, uncertainty=unknown, contact_patch="off", running="with"
    )


@pytest.mark.slow
def test_samples_are_what_rolling_each_by_itself_gives():
    """Brute force: a track fitted, a wheel made and every passage rolled in full for each sample."""
    chosen = settings(8)
    known = profile(line_speed_kmh=120.0)
    spread = Simulator(chosen).force_map(known).spread
    assert isinstance(spread, UncertaintyResult)
    draws, definition = draw(chosen.uncertainty), track_file.load("bilbao-viscous")
    x, z = np.array(known.x_m), np.array(known.z_m)
    for i in range(8):
        track = definition.track
        springs = tuple(
            replace(spring, stiffness_n_per_m=spring.stiffness_n_per_m * float(draws.support_factor[i]))
            for spring in track.support.springs
        )
        stiffer = replace(definition, track=replace(track, support=replace(track.support, springs=springs)))
        wheel = replace(
            definition.wheel, hertz_n_per_m15=definition.wheel.hertz_n_per_m15 * float(draws.hertz_factor[i])
        )
        vehicle_track = VehicleTrackModel(fit_store.fitted(stiffer).model(), wheel)
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
    beyond = np.mean(np.array(force_map.spread.peak_force_n) > peak.limit)
    assert peak.exceeding == pytest.approx(beyond, abs=0.15)  # the model's own uncertainty counts as well
    by_count = judge(force_map, by_value())
    peak = next(c for c in by_count.criteria if c.name == "peak_force")
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
    plain = simulation_settings(track="bilbao-viscous", speeds_kmh=SPEEDS, positions=POSITIONS, running="with")
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


MANY_SPEEDS = np.arange(70.0, 160.0, 5.0).tolist()


@pytest.mark.parametrize(
    ("shape", "support_spread"),
    [
        ("weld-1-dip", 0.0),
        ("wheel-flat-0.9mm", 0.0),
        pytest.param("weld-1-dip", 0.2, marks=pytest.mark.slow),
        pytest.param("wheel-flat-0.9mm", 0.2, marks=pytest.mark.slow),
    ],
)
def test_samples_where_they_can_be_the_worst_agree_with_every_speed_and_position(shape: str, support_spread: float):
    # Every sample with supports of its own is a track to be fitted.
    unknown = msgspec.structs.replace(load_uncertainty(5), design="quasi-random", support_spread=support_spread)
    chosen = simulation_settings(
        track="bilbao-viscous",
        speeds_kmh=MANY_SPEEDS,
        positions=POSITIONS,
        uncertainty=unknown,
        contact_patch="off",
        running="with",
    )
    known = msgspec.structs.replace(shipped_profile(shape), noise=UNSET)  # so that noise is drawn
    spread = Simulator(chosen).force_map(known).spread
    again = Simulator(chosen, threads=1).force_map(known).spread
    assert spread == again
    few = Passages.of_message(spread, chosen.static_load_n, (unknown.samples, 3))
    every = brute_force(unknown, known)
    for name, values in few.columns.items():
        # Contact loss is counted in steps, of which a millisecond has some twenty.
        scale = {"min_force_n": chosen.static_load_n, "contact_loss_s": 2e-3}.get(name, every.columns[name].mean())
        ends, expected = (np.quantile(v, (0.05, 0.95)) for v in (values, every.columns[name]))
        np.testing.assert_allclose(ends, expected, atol=(0.03 if name == "contact_loss_s" else 0.01) * scale)


def test_samples_of_a_wheel_that_does_not_roll_follow_the_rail_as_it_stands():
    """Few and every passage against brute force, over a flat whose bottom no circle of 0.45 m reaches."""
    spread_none = {"design": "quasi-random", "support_spread": 0.0, "hertz_spread": 0.0}
    known = msgspec.structs.replace(shipped_profile("cosine-dip-48mm"), noise=UNSET)
    x, z = np.array(known.x_m), 8 * np.array(known.z_m)
    sharp = msgspec.structs.replace(known, z_m=z.tolist(), profile_sha256=profile_sha256(x.tolist(), z.tolist()))
    found = {}
    for design in ("quasi-random", UNSET):
        unknown = msgspec.structs.replace(load_uncertainty(4), **{**spread_none, "design": design})
        chosen = simulation_settings(
            track="bilbao-viscous", speeds_kmh=MANY_SPEEDS, positions=POSITIONS, uncertainty=unknown,
            contact_patch="off", rolling="none", running="with",
        )  # fmt: skip
        force_map = Simulator(chosen).force_map(sharp)
        found[design] = np.array(force_map.spread.peak_force_n).reshape(4, 3)
        draws, definition = draw(unknown), track_file.load("bilbao-viscous")
        model = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
        exact = [
            model.peak_map(wheel_path_over(x, noisy(x, z, unknown, int(seed)), 0.0), MANY_SPEEDS, POSITIONS)
            .peak_force_n.max(axis=0)
            for seed in draws.noise_seed
        ]  # fmt: skip
        np.testing.assert_allclose(found[design], exact, rtol=0.01)
        assert np.ptp(force_map.spread.wheel_radius_m) > 0.01  # drawn, to no effect
    rolled = simulation_settings(
        track="bilbao-viscous", speeds_kmh=MANY_SPEEDS, positions=POSITIONS, contact_patch="off"
    )
    assert max(force_map.peak_force_n) > 1.05 * max(Simulator(rolled).force_map(sharp).peak_force_n)


def brute_force(unknown: Uncertainty, known: WeldProfile) -> Passages:
    """Return the worst over all speeds of every sample, each on its own track."""
    draws, definition, worst = draw(unknown), track_file.load("bilbao-viscous"), []
    x, z = np.array(known.x_m), np.array(known.z_m)
    for i in range(unknown.samples):
        model = fit_store.fitted(supported(definition, float(draws.support_factor[i]))).model()
        hertz = definition.wheel.hertz_n_per_m15 * float(draws.hertz_factor[i])
        path = wheel_path_over(x, noisy(x, z, unknown, int(draws.noise_seed[i])), float(draws.wheel_radius_m[i]))
        peak_map = VehicleTrackModel(model, replace(definition.wheel, hertz_n_per_m15=hertz)).peak_map(
            path, MANY_SPEEDS, POSITIONS, low_passed=True, tolerance=TOLERANCE
        )
        worst.append(Passages.of_peak_map(peak_map, definition.wheel.static_load_n).worst(axis=0))
    return Passages.stacked(worst)


def test_geometries_can_come_from_elsewhere():
    unknown = msgspec.structs.replace(load_uncertainty(4), design="quasi-random", support_spread=0.0)
    chosen = simulation_settings(
        track="bilbao-viscous",
        speeds_kmh=SPEEDS,
        positions=POSITIONS,
        uncertainty=unknown,
        contact_patch="off",
        running="with",
    )
    known, simulator = profile(), Simulator(chosen)
    x, z = np.array(known.x_m), np.array(known.z_m)
    relevant = relevant_range(simulator.force_map(known))
    definition = track_file.load("bilbao-viscous")
    sampler = Sampler(definition, definition.wheel, unknown)
    drawn = [noisy(x, z, unknown, seed) for seed in draw(unknown).noise_seed.tolist()]
    by_default = sampler.result(x, z, relevant)
    assert sampler.result(x, z, relevant, np.stack(drawn)) == by_default
    deeper = sampler.result(x, z, relevant, np.stack([1.5 * row for row in drawn]))
    assert min(deeper.peak_force_n) > min(by_default.peak_force_n)


def test_quasi_random_samples_fill_every_quantity():
    draws = draw(msgspec.structs.replace(load_uncertainty(32), design="quasi-random"))
    for values in (np.log(draws.support_factor) / 0.2, np.log(draws.hertz_factor) / 0.1):
        assert np.mean(values) == pytest.approx(0.0, abs=1e-9)
        assert np.std(values) == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(np.diff(np.sort(draws.wheel_radius_m)), 0.04 / 32)


@pytest.mark.parametrize("end_m", [0.0, 1e-5])  # without and with a ramp
def test_rolling_many_samples_gives_what_rolling_each_gives(end_m: float):
    known = profile()
    x, unknown = np.array(known.x_m), load_uncertainty(5)
    samples = np.stack([noisy(x, np.array(known.z_m), unknown, seed) for seed in range(5)])
    samples[:, -1] = end_m
    radii = np.linspace(0.42, 0.46, 5)
    roller = WheelPathRoller(x, samples, radii)
    for heights, sample, radius in zip(roller.heights(np.arange(5)), samples, radii, strict=True):
        alone = wheel_path_over(x, sample, radius)
        first = round((alone.start_m - roller.start_m) / RESAMPLED_STEP_M)
        inside = slice(first, first + len(alone.height_m))
        np.testing.assert_allclose(heights[inside], alone.height_m, atol=1e-15)
        assert not np.any(np.delete(heights, inside))


def test_speeds_near_the_worst_hold_the_worst_and_the_next_best():
    part = np.zeros((20, 2))
    part[:, 0] = np.arange(20)
    part[4, 1] = 1.0
    assert near_worst([part], 4)[0].tolist() == [16, 17, 18, 19]
    assert 4 in near_worst([part], 4)[1]
    level = near_worst([np.ones((20, 1)) + 1e-3 * part[:, :1]], 4)[0].tolist()
    assert (level[0], level[-1]) == (0, 19)  # all are near: spread evenly
    assert near_worst([part[:2]], 4)[0].tolist() == [0, 1, 1, 1]
