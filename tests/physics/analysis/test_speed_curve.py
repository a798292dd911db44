import itertools
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import find_peaks

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.speed_curve import curve_features, kinks, surface_features


def hollow_curve(speeds: np.ndarray) -> np.ndarray:
    """A cubic with its maximum at 60 km/h, its minimum at 120, and the maximum's force again at 150."""
    return 100e3 + 0.1 * ((speeds**3 - 150**3) / 3 - 90 * (speeds**2 - 150**2) + 7200 * (speeds - 150))


def test_line_is_monotonic_and_linear():
    speeds = np.array([20.0, 35.0, 60.0, 110.0, 300.0])
    found = curve_features(speeds, 100e3 + 80 * speeds)
    assert found.monotonic
    assert found.maxima == found.minima == found.hollows == []
    assert found.linearity == pytest.approx(1.0)
    assert found.rise_n_per_kmh == pytest.approx(80.0)


def test_constant_is_a_line():
    found = curve_features([20.0, 30.0, 40.0], [1e5, 1e5, 1e5])
    assert (found.monotonic, found.linearity, found.maxima) == (True, 1.0, [])
    assert found.rise_n_per_kmh == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("step_kmh", [1.0, 4.0, 7.0])
def test_hollow_of_a_cubic(step_kmh: float):
    speeds = np.arange(20.0, 190.0, step_kmh)
    found = curve_features(speeds, hollow_curve(speeds))
    assert not found.monotonic
    (top,), (bottom,), (hollow,) = found.maxima, found.minima, found.hollows
    assert top.speed_kmh == pytest.approx(60.0, abs=0.6)
    assert bottom.speed_kmh == pytest.approx(120.0, abs=0.6)
    assert [hollow.from_kmh, hollow.lowest_kmh, hollow.to_kmh] == pytest.approx([60.0, 120.0, 150.0], abs=0.6)
    assert hollow.depth_n == pytest.approx(0.1 * 60**3 / 6, rel=0.01)


def test_hollow_lasts_to_the_last_speed_if_the_force_does_not_come_back():
    speeds = np.arange(20.0, 131.0, 2.0)
    (hollow,) = curve_features(speeds, hollow_curve(speeds)).hollows
    assert hollow.to_kmh == 130.0
    falling = curve_features(speeds, 2e5 - 100 * speeds)
    assert not falling.monotonic
    assert falling.maxima == []
    assert falling.hollows[0].from_kmh == 20.0
    assert falling.hollows[0].depth_n == pytest.approx(11e3)


def test_maximum_inside_a_hollow_begins_no_second_one():
    speeds = np.arange(20.0, 101.0, 10.0)
    found = curve_features(speeds, [10.0, 20.0, 30.0, 15.0, 22.0, 12.0, 25.0, 40.0, 50.0])
    assert len(found.maxima) == 2
    assert len(found.hollows) == 1
    # 30 over 12, the lowest before 40; 22 over 15, before 30, which is higher than 12, before 25. Upside down alike.
    assert [maximum.prominence_n for maximum in found.maxima] == [18.0, 7.0]
    assert [minimum.prominence_n for minimum in found.minima] == [7.0, 18.0]


@given(st.lists(st.integers(0, 9), min_size=3, max_size=30), st.randoms(use_true_random=False))
def test_a_prominence_is_that_of_walking_down_to_either_side(heights: list[int], chance: random.Random):
    """To the last bit, on speeds however far apart."""
    speeds = np.cumsum([chance.uniform(0.5, 9.0) for _ in heights])
    force = 1e5 + 1e3 / 3 * np.array(heights, dtype=float)
    for maximum in curve_features(speeds, force).maxima:
        summit = int(np.argmin(np.abs(speeds - maximum.speed_kmh)))
        sides = (force[summit::-1], force[summit:])
        lowest = [min(itertools.takewhile(force[summit].__ge__, side)) for side in sides]
        assert maximum.prominence_n == force[summit] - max(lowest)


def test_falls_and_wiggles_within_the_tolerance_do_not_count():
    speeds = np.arange(20.0, 200.0, 1.0)
    wavy = 100e3 + 100 * speeds + 300 * np.sin(2 * np.pi * speeds / 12)
    assert not curve_features(speeds, wavy, tolerance=0.001).monotonic
    calm = curve_features(speeds, wavy, prominence=0.05, tolerance=0.05)
    assert calm.monotonic
    assert calm.maxima == []


@pytest.mark.parametrize(
    "bad", [([10.0, 20.0], [1.0, 2.0]), ([10.0, 10.0, 20.0], [1.0, 2.0, 3.0]), ([1.0, 2.0, 3.0], [1.0])]
)
def test_what_is_no_curve_is_refused(bad: tuple[list[float], list[float]]):
    with pytest.raises(InputError, match="no curve"):
        curve_features(*bad)


@pytest.mark.parametrize("step_kmh", [1.0, 3.0, 5.0])
def test_kinks_are_where_the_larger_of_three_branches_changes(step_kmh: float):
    speeds = np.arange(20.0, 200.0, step_kmh)
    branches = np.stack(
        [1e5 + 10 * speeds, 1e5 + 60 * speeds - 50 * 73.3, 1e5 + 180 * speeds - 50 * 73.3 - 120 * 131.7]
    )
    places = np.stack([0.02 + 0 * speeds, 1.5e-3 * speeds / 3.6, 0.01 + 0 * speeds])
    leading = np.argmax(branches, axis=0)
    peak, place = branches.max(axis=0), np.choose(leading, places)
    assert kinks(speeds, peak, place) == pytest.approx([73.3, 131.7], abs=1e-6)
    assert kinks(speeds, peak, -place) == pytest.approx([73.3, 131.7], abs=1e-6)


def test_peak_that_moves_with_speed_is_not_handed_over():
    speeds = np.arange(20.0, 300.0, 5.0)
    lagging = 9e-3 * speeds / 3.6  # 12.5 mm a step
    assert kinks(speeds, hollow_curve(speeds), lagging) == []


def test_surface_hollow_best_and_worst_position_and_sensitivity():
    speeds = np.arange(20.0, 190.0, 5.0)
    positions = np.array([0.0, 0.1, 0.2, 0.4])
    rising = 80e3 + 300 * speeds
    force = np.stack([rising + 5e3, hollow_curve(speeds), rising, rising + 1e3], axis=1)
    found = surface_features(speeds, positions, force, 0.6, between_kmh=(150.0, 185.0))
    # 0.1 m stands for the span from 0.05 to 0.15 m.
    assert found.hollow_share == pytest.approx(0.1 / 0.6)
    assert found.hollow.any(axis=0).tolist() == [False, True, False, False]
    in_hollow = speeds[found.hollow[:, 1]]
    assert (in_hollow.min(), in_hollow.max()) == (65.0, 145.0)
    assert (found.best_by_mean_m, found.worst_by_mean_m) == (0.1, 0.0)
    assert (found.best_by_maximum_m, found.worst_by_maximum_m) == (0.1, 0.0)
    np.testing.assert_allclose(found.sensitivity, (force.max(axis=1) - force.min(axis=1)) / force.mean(axis=1))


def test_surface_that_goes_round_the_span_twice_or_has_no_speed_in_range_is_refused():
    force = np.ones((3, 2))
    with pytest.raises(InputError, match="within one span"):
        surface_features([10.0, 20.0, 30.0], [0.0, 0.6], force, 0.6)
    with pytest.raises(InputError, match="no speed from"):
        surface_features([10.0, 20.0, 30.0], [0.0, 0.3], force, 0.6, between_kmh=(40.0, 50.0))


def test_jump_of_place_without_an_upward_angle_is_no_hand_over():
    speeds = np.arange(20.0, 190.0, 5.0)
    place = np.where(speeds < 62.0, 0.0, 0.05)
    assert kinks(speeds, hollow_curve(speeds), place) == []


def test_peak_that_leads_at_one_speed_only_is_handed_over_half_way():
    speeds = np.arange(20.0, 70.0, 10.0)
    force = np.array([1.0, 1.1, 1.2, 1.3, 1.4])
    place = np.array([0.0, 0.0, 0.1, 0.0, 0.0])
    assert kinks(speeds, force, place) == [35.0, 45.0]


def test_a_level_curve_has_no_features_however_it_is_rounded():
    speeds = np.arange(20.0, 120.0, 5.0)
    rounded = 1e5 + 1e-10 * np.sin(speeds)
    found = curve_features(speeds, rounded)
    assert (found.maxima, found.minima, found.hollows, found.monotonic) == ([], [], [], True)


@given(st.lists(st.integers(0, 6), min_size=3, max_size=40), st.floats(0.01, 0.9))
def test_maxima_are_those_of_scipy_level_ones_among_them(levels: list[int], share: float):
    force_n = np.array(levels, dtype=float)
    speeds_kmh = np.arange(len(levels), dtype=float)
    found = curve_features(speeds_kmh, force_n, prominence=share).maxima
    extent = float(np.ptp(force_n))
    at, properties = find_peaks(force_n, prominence=share * extent) if extent else ([], {"prominences": []})
    assert [one.prominence_n for one in found] == list(properties["prominences"])
    np.testing.assert_allclose([one.speed_kmh for one in found], at, atol=0.5)
