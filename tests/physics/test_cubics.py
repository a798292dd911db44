"""Cubics through samples are those of `scipy.interpolate`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PchipInterpolator

from weld_force_ros.physics.cubics import monotone_cubics, periodic_spline, spline

RANDOM = np.random.default_rng(30)
UNEVEN = np.cumsum(RANDOM.uniform(0.1, 1.0, 40))
BEYOND = np.concatenate([UNEVEN, np.linspace(UNEVEN[0] - 0.3, UNEVEN[-1] + 0.3, 400)])


def shapes(count: int) -> list[np.ndarray]:
    real = RANDOM.standard_normal((count, 3))
    return [real[:, 0], real, real + 1j * RANDOM.standard_normal((count, 3)), np.round(real[:, 1])]


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
@pytest.mark.parametrize("kind", range(4))
def test_a_spline_is_that_of_scipy(count: int, kind: int):
    knots, samples = UNEVEN[:count], shapes(count)[kind]
    ours, oracle = spline(knots, samples), CubicSpline(knots, samples)
    at = np.clip(BEYOND, None, knots[-1] + 0.3)
    np.testing.assert_allclose(ours.coefficients, oracle.c, rtol=1e-14, atol=1e-14 * np.abs(oracle.c).max())
    np.testing.assert_allclose(ours(at), oracle(at), rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(ours.slope(at), oracle(at, 1), rtol=1e-14, atol=1e-13)


@pytest.mark.parametrize("count", [4, 5, 40])
@pytest.mark.parametrize("kind", range(3))
def test_a_periodic_spline_is_that_of_scipy(count: int, kind: int):
    knots, samples = UNEVEN[:count], shapes(count)[kind]
    samples[-1] = samples[0]
    at = np.linspace(knots[0], knots[-1], 300)
    ours, oracle = periodic_spline(knots, samples), CubicSpline(knots, samples, bc_type="periodic")
    np.testing.assert_allclose(ours(at), oracle(at), rtol=1e-14, atol=1e-14)


@given(st.lists(st.integers(-3, 3), min_size=2, max_size=30))
def test_cubics_that_make_no_peak_are_those_of_scipy(heights: list[int]):
    """Whole numbers: level stretches and turns, which random samples do not have."""
    knots, samples = UNEVEN[: len(heights)], np.array(heights, dtype=float)
    at = np.linspace(knots[0], knots[-1], 300)
    oracle = PchipInterpolator(knots, samples)
    np.testing.assert_allclose(monotone_cubics(knots, samples)(at), oracle(at), rtol=1e-14, atol=1e-14)
    between = monotone_cubics(knots, samples)(at)
    assert samples.min() - 1e-12 <= between.min()
    assert between.max() <= samples.max() + 1e-12


def test_splines_repeat_a_cubic_and_monotone_cubics_a_line():
    cubic = 0.3 * UNEVEN**3 - UNEVEN**2 + 2
    np.testing.assert_allclose(spline(UNEVEN, cubic)(BEYOND), 0.3 * BEYOND**3 - BEYOND**2 + 2, rtol=1e-12)
    np.testing.assert_allclose(monotone_cubics(UNEVEN, 3 * UNEVEN - 1)(BEYOND), 3 * BEYOND - 1, rtol=1e-12)
