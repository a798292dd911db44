"""Geometries that a measurement allows."""

import msgspec
import numpy as np
import pytest
from msgspec import UNSET

from benchmarks.noise import SHAPES, measured, true
from weld_force_ros.measurement.profile_file import parse_profile, shipped_profile
from weld_force_ros.simulation.measured_geometry import sampled_geometries, standard_deviation

DIP = SHAPES["dip 0.2 mm over 250 mm"]


def test_samples_lie_about_the_estimate_level_at_both_ends_and_spread_with_the_noise() -> None:
    spread = []
    for noise_m in (3e-6, 2e-5):
        weld = measured(DIP, 5e-3, noise_m, 1)
        drawn = sampled_geometries(weld, 24, 1)
        assert drawn is not None
        assert drawn.shape == (24, len(weld.x_m))
        assert drawn[:, [0, -1]] == pytest.approx(np.array([[weld.z_m[0], weld.z_m[-1]]] * 24), abs=1e-12)
        deviation = standard_deviation(weld)
        assert deviation is not None
        off = np.abs(drawn.mean(axis=0) - np.array(weld.z_m))
        assert np.mean(off) < np.mean(deviation)
        spread.append(float(np.mean(drawn.std(axis=0))))
        # The true geometry lies within the band at nearly all places.
        off = np.interp(weld.x_m, true(DIP).x_m, true(DIP).z_m) - np.array(weld.z_m)
        off -= np.interp(weld.x_m, np.array(weld.x_m)[[0, -1]], off[[0, -1]])
        assert np.mean(np.abs(off) < 3 * deviation + 1e-6) > 0.9
    assert spread[1] > 2 * spread[0]


def test_samples_are_the_same_for_the_same_seed_after_a_round_trip_of_the_message() -> None:
    weld = measured(DIP, 5e-3, 1e-5, 2)
    again = msgspec.json.decode(msgspec.json.encode(weld), type=type(weld))
    first, second = sampled_geometries(weld, 8, 3), sampled_geometries(again, 8, 3)
    assert np.array_equal(first, second)
    assert not np.array_equal(first, sampled_geometries(weld, 8, 4))


def test_an_exact_shape_has_no_spread_and_of_an_unknown_one_nothing_is_said() -> None:
    exact = shipped_profile("weld-1-dip")
    assert np.array_equal(sampled_geometries(exact, 3, 1), np.tile(exact.z_m, (3, 1)))
    assert standard_deviation(exact) is None
    assert sampled_geometries(msgspec.structs.replace(exact, noise=UNSET), 3, 1) is None


def test_stated_noise_and_a_wrong_sample_are_those_of_the_posterior() -> None:
    rows = [(mm, float(DIP(np.array([mm * 1e-3]))[0] * 1e3)) for mm in range(-600, 601, 5)]
    rows[60] = (rows[60][0], 3.0)
    text = "# x_unit: mm\n# z_unit: mm\n# z_positive: up\n# noise: 5e-6\nx,z\n"
    weld = parse_profile(text + "".join(f"{x},{z:.3f}\n" for x, z in rows), "w.csv")
    assert weld.noise.stated
    assert weld.noise.noise_m == pytest.approx(5e-6, rel=0.15)
    assert weld.noise.outliers_m == [pytest.approx(-0.3)]
    drawn = sampled_geometries(weld, 8, 1)
    assert drawn is not None
    assert np.abs(drawn).max() < 0.25e-3
