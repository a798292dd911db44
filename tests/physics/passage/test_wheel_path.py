from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from tests.harness.oracles import brute_force_trajectory
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage.wheel_path import (
    RESAMPLED_STEP_M,
    WheelPath,
    WheelPathRoller,
    averaged_over_patch,
    dilated_by_wheel,
    underside,
    wheel_path_over,
)

RADIUS_M = 0.45


@st.composite
def profiles(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Heights up to +-1 mm in whole nanometres that start and end on the rail, unevenly spaced up to 10 mm."""
    count = draw(st.integers(20, 60))
    steps = draw(st.lists(st.floats(0.5e-3, 10e-3), min_size=count - 1, max_size=count - 1))
    nanometres = draw(st.lists(st.integers(-(10**6), 10**6), min_size=count - 2, max_size=count - 2))
    x = np.concatenate([[0.0], np.cumsum(steps)])
    return x - x[-1] / 2, np.array([0, *nanometres, 0]) * 1e-9


def heights(wheel_path: WheelPath) -> tuple[np.ndarray, np.ndarray]:
    return wheel_path.start_m + RESAMPLED_STEP_M * np.arange(len(wheel_path.height_m)), wheel_path.height_m


@given(st.lists(st.floats(-2e-3, 2e-3), min_size=30, max_size=120), st.floats(0.2, 1.0))
def test_rolling_is_the_highest_rest_of_a_circle_on_the_points(surface: list[float], radius: float):
    z = np.concatenate([np.zeros(400), surface, np.zeros(400)])
    x = RESAMPLED_STEP_M * np.arange(len(z))
    exact = brute_force_trajectory(x, z, x, radius)
    np.testing.assert_allclose(dilated_by_wheel(z, RESAMPLED_STEP_M, radius), exact, atol=1e-12)


@given(profiles())
def test_wheel_never_sinks_into_the_profile_and_never_leaves_its_height(profile: tuple[np.ndarray, np.ndarray]):
    x, z = profile
    wheel_path = wheel_path_over(x, z, RADIUS_M)
    place, height = heights(wheel_path)
    assert height.max() <= z.max() + 1e-15
    assert height.min() >= z.min() - 1e-15
    assert height[0] == height[-1] == 0.0
    on_grid = [i for i in range(len(x)) if abs(x[i] / RESAMPLED_STEP_M - round(x[i] / RESAMPLED_STEP_M)) < 1e-9]
    for i in on_grid:
        assert height[np.argmin(np.abs(place - x[i]))] >= z[i] - 1e-9


@given(profiles())
def test_mirrored_profile_gives_the_mirrored_trajectory(profile: tuple[np.ndarray, np.ndarray]):
    x, z = profile
    place, height = heights(wheel_path_over(x, z, RADIUS_M))
    mirrored = wheel_path_over(-x[::-1], z[::-1], RADIUS_M)
    np.testing.assert_allclose(heights(mirrored)[0], -place[::-1], atol=1e-12)
    np.testing.assert_allclose(mirrored.height_m, height[::-1], atol=1e-15)


@pytest.mark.parametrize("width_m", [0.010, 0.020, 0.030])
def test_slot_is_bridged_to_the_depth_that_the_wheel_can_sink(width_m: float):
    x = np.arange(-80, 81) * RESAMPLED_STEP_M
    z = np.where(np.abs(x) < width_m / 2 - 1e-9, -1e-3, 0.0)
    place, height = heights(wheel_path_over(x, z, RADIUS_M))
    depth = RADIUS_M - np.sqrt(RADIUS_M**2 - (width_m / 2) ** 2)
    assert height.min() == pytest.approx(-depth, rel=1e-6)
    # On the way there the wheel pivots on the slot's near edge.
    a = 2e-3
    pivot = RADIUS_M - np.sqrt(RADIUS_M**2 - a**2)
    assert height[np.argmin(np.abs(place - (a - width_m / 2)))] == pytest.approx(-pivot, rel=1e-6)


def test_gentle_dip_is_followed_and_lifted_by_half_slope_squared_times_radius():
    length, depth = 0.5, 0.2e-3  # sharpest curvature a fiftieth of the wheel's
    x = np.arange(-500, 501) * 0.5e-3
    place, height = heights(wheel_path_over(x, cosine_dip(x, length, depth), RADIUS_M))
    profile = cosine_dip(place, length, depth)
    slope = np.where(np.abs(place) < length / 2, depth * np.pi / length * np.sin(2 * np.pi * place / length), 0.0)
    np.testing.assert_allclose(height - profile, slope**2 * RADIUS_M / 2, atol=0.05e-6)
    assert np.abs(height - profile).max() > 0.3e-6


def test_smooth_rail_stays_smooth():
    x = np.linspace(-0.5, 0.5, 201)
    wheel_path = wheel_path_over(x, np.zeros_like(x), RADIUS_M)
    np.testing.assert_array_equal(wheel_path.height_m, 0.0)
    assert wheel_path.start_m <= -0.5 < 0.5 <= wheel_path.end_m


@pytest.mark.parametrize(("first", "last"), [(0.3e-3, -0.2e-3), (0.0, 0.4e-3), (-0.4e-3, 0.0)])
def test_ends_off_the_rail_are_joined_without_a_step(first: float, last: float):
    x = np.linspace(-0.5, 0.5, 201)
    wheel_path = wheel_path_over(x, np.linspace(first, last, 201), RADIUS_M)
    place, height = heights(wheel_path)
    assert height[0] == height[-1] == 0.0
    # Over half a metre a half cosine rises at most pi/2 times its mean slope.
    steepest = 1.01 * np.pi / 2 * max(abs(first), abs(last)) / 0.5 + abs(last - first)
    assert np.abs(np.diff(height)).max() <= steepest * RESAMPLED_STEP_M
    np.testing.assert_allclose(np.interp([-0.5, 0.5], place, height), [first, last], atol=1e-6)
    joins = [note for note in wheel_path.conditioning if "joined" in note]
    assert len(joins) == (first != 0.0) + (last != 0.0)


def test_trajectory_is_zero_outside_and_its_samples_inside(dip: Callable[..., WheelPath]):
    wheel_path = dip(0.1, 0.1e-3)
    place, height = heights(wheel_path)
    np.testing.assert_allclose(wheel_path.at(place), height, atol=1e-15)
    np.testing.assert_array_equal(wheel_path.at(np.array([-1.0, wheel_path.end_m + 1e-9, 9.0])), 0.0)


def test_conditioning_names_what_was_done(dip: Callable[..., WheelPath]):
    assert dip(0.1, 0.1e-3).conditioning == (
        "resampled to 0.25 mm by shape-preserving cubics",
        "rolled over by a wheel of radius 0.45 m",
    )


@pytest.mark.parametrize("wavelength_m", [0.015, 0.03, 0.1, 0.5])
def test_patch_averages_waves_by_the_transform_of_its_weight(wavelength_m: float) -> None:
    half, step = 6.5e-3, 0.05e-3
    x = np.arange(-0.6, 0.6, step)
    k = 2 * np.pi / wavelength_m
    averaged = averaged_over_patch(np.cos(k * x), step, half)
    # The integral of (1 - (s/a)^2) cos(k s) over the patch, over that of the weight.
    u = k * half
    exact = 3 * (np.sin(u) - u * np.cos(u)) / u**3
    inside = np.abs(x) < 0.5
    assert averaged[inside] == pytest.approx(exact * np.cos(k * x[inside]), abs=2e-3)


def test_patch_keeps_level_and_slope_and_can_be_switched_off(dip: Callable[..., WheelPath]) -> None:
    x = np.linspace(-0.1, 0.1, 801)
    assert averaged_over_patch(3.0 + 2.0 * x, 0.25e-3, 7e-3)[50:-50] == pytest.approx(
        (3.0 + 2.0 * x)[50:-50], rel=1e-12
    )
    x = np.linspace(-0.05, 0.05, 201)
    z = cosine_dip(x, 0.08, 1e-4)
    assert np.array_equal(wheel_path_over(x, z, RADIUS_M).height_m, wheel_path_over(x, z, RADIUS_M, 0.0).height_m)
    averaged = wheel_path_over(x, z, RADIUS_M, 6.5e-3)
    assert 0.93 * 1e-4 < -averaged.height_m.min() < 0.99 * 1e-4
    assert averaged.height_m[[0, -1]].tolist() == [0.0, 0.0]


def test_a_wheel_bridges_a_slot_down_to_its_sagitta() -> None:
    x = np.arange(-0.1, 0.1001, 0.25e-3)
    z = np.where(np.abs(x) < 0.02 - 1e-9, -1e-3, 0.0)
    deepest = underside(x, z, RADIUS_M)
    arc = np.sqrt(RADIUS_M**2 - 0.02**2) - np.sqrt(RADIUS_M**2 - x**2)  # of the wheel on both edges, 40 mm apart
    inside = np.abs(x) < 0.019
    np.testing.assert_allclose(deepest[inside], arc[inside], atol=1.2e-5)  # edges lie within a step of 0.25 mm
    assert np.array_equal(deepest[np.abs(x) > 0.021], z[np.abs(x) > 0.021])


@given(st.lists(st.integers(-300, 300), min_size=6, max_size=6), st.floats(0.1, 0.6))
def test_the_underside_is_where_circles_that_rest_on_the_rail_reach(heights_um: list[int], radius_m: float) -> None:
    """By brute force: of every circle that rests on the rail the lowest arc; the least of these arcs at each place."""
    x = np.arange(-0.03, 0.0301, 0.5e-3)
    z = PchipInterpolator(np.linspace(-0.03, 0.03, 8), 1e-6 * np.array([0, *heights_um, 0]))(x)
    z[[0, -1]] = 0.0
    s = np.arange(-0.12, 0.12, 0.25e-3)
    fine = np.where(np.abs(s) <= 0.03, PchipInterpolator(x, z)(np.clip(s, -0.03, 0.03)), 0.0)
    gap = s[:, None] - s[None, :]
    arc = np.where(np.abs(gap) < radius_m, radius_m - np.sqrt(np.maximum(radius_m**2 - gap**2, 0.0)), np.inf)
    lowest = np.max(fine[None, :] - arc, axis=1)  # of each circle, centred over s
    reached = np.min(lowest[:, None] + arc, axis=0)
    np.testing.assert_allclose(underside(x, z, radius_m), np.interp(x, s, reached), atol=1e-6)


def test_no_circle_follows_the_rail_as_it_stands() -> None:
    x = np.linspace(-0.1, 0.1, 401)
    z = np.where(np.abs(x) < 0.01, -2e-4, 0.0)
    assert np.array_equal(underside(x, z, 0.0), z)
    path = wheel_path_over(x, z, 0.0)
    np.testing.assert_allclose(path.at(x)[5:-5], z[5:-5], atol=1e-12)
    assert path.conditioning[-1] == "followed as it stands"
    roller = WheelPathRoller(x, np.stack([z, z]), np.array([0.0, 0.45]))
    heights = roller.heights(np.array([0, 1]))
    at = roller.start_m + RESAMPLED_STEP_M * np.arange(heights.shape[1])
    np.testing.assert_allclose(heights[0], path.at(at), atol=1e-12)
    np.testing.assert_allclose(heights[1], wheel_path_over(x, z, 0.45).at(at), atol=1e-12)


@pytest.mark.parametrize("patch_m", [0.0, 6.7e-3])
def test_roller_rolls_samples_as_one_by_one(patch_m: float) -> None:
    x = np.linspace(-0.3, 0.3, 121)
    samples = np.array([cosine_dip(x, 0.3, depth) for depth in (1e-4, 2e-4, 4e-4)])
    radii = np.array([0.42, 0.45, 0.46])
    roller = WheelPathRoller(x, samples, radii, patch_m)
    rolled = roller.heights(np.arange(3))
    for z, radius, path in zip(samples, radii, rolled, strict=True):
        alone = wheel_path_over(x, z, float(radius), patch_m)
        at = roller.start_m + RESAMPLED_STEP_M * np.arange(len(path))
        assert path == pytest.approx(alone.at(at), abs=1e-9)
