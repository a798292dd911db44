"""Geometries that a measurement allows."""

import msgspec
import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from benchmarks.noise import SHAPES, measured, true
from weld_force_ros.measurement.profile_file import parse_profile, shipped_profile
from weld_force_ros.messages import FormError, WeldProfile
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


def with_form_error(weld: WeldProfile, deviation_m: float, length_m: float, **noise: object) -> WeldProfile:
    error = FormError(deviation_m=deviation_m, length_m=length_m)
    return replace(weld, noise=replace(weld.noise, form_error=error, **noise))


@pytest.mark.parametrize("length_m", [0.25, 0.5, 2.0])
def test_a_form_error_spreads_as_a_gaussian_process_that_is_levelled_at_both_ends(length_m: float) -> None:
    """Less the mean of both ends: s^2 (1 + (1 + c(L)) / 2 - 2 c(L/2)) in the middle, c(d) = exp(-(d/l)^2)."""
    weld, deviation_m = with_form_error(measured(DIP, 5e-3, 1e-5, 1), 2e-5, length_m, noise_m=0.0), 2e-5
    off = sampled_geometries(weld, 4000, 1) - np.array(weld.z_m)
    assert np.abs(off[:, [0, -1]]).max() < 1e-15
    span_m = weld.x_m[-1] - weld.x_m[0]
    correlation = np.exp(-((np.array([span_m, span_m / 2]) / length_m) ** 2))
    expected_m = deviation_m * np.sqrt(1 + (1 + correlation[0]) / 2 - 2 * correlation[1])
    assert off[:, len(weld.x_m) // 2].std() == pytest.approx(expected_m, rel=0.05)


def test_a_form_error_counts_beside_the_noise_whose_draws_stay_what_they_are() -> None:
    weld = measured(DIP, 5e-3, 1e-5, 2)
    alone, hardly = sampled_geometries(weld, 8, 3), sampled_geometries(with_form_error(weld, 1e-15, 0.5), 8, 3)
    assert hardly == pytest.approx(alone, abs=1e-13)
    by_noise, by_both = standard_deviation(weld), standard_deviation(with_form_error(weld, 3e-5, 0.5))
    middle = len(weld.x_m) // 2
    assert by_both[middle] > 2 * by_noise[middle]
