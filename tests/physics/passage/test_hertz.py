"""Hertz' contact against closed forms, an integral over the ellipse, and the paper's constant."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ellipe, ellipk

from weld_force_ros.physics.passage import hertz
from weld_force_ros.physics.passage.hertz import ContactRadii

MODULUS_PA = 210e9 / (2 * (1 - 0.3**2))
LOAD_N = 83_385.0


def test_equal_radii_touch_in_a_circle() -> None:
    # a^3 = 3 P R / (4 E*), P = 4/3 E* sqrt(R) d^1.5 (Johnson, Contact Mechanics, 1985, eq. 4.22 and 4.23).
    circle_m = (0.75 * LOAD_N * 0.3 / MODULUS_PA) ** (1 / 3)
    assert ContactRadii(0.3, 0.3).half_length_m(LOAD_N) == pytest.approx(circle_m, rel=1e-6)
    assert ContactRadii(0.3, 0.3001).half_length_m(LOAD_N) == pytest.approx(circle_m, rel=1e-3)
    assert ContactRadii(0.3, 0.3).hertz_n_per_m15 == pytest.approx(4 / 3 * MODULUS_PA * np.sqrt(0.3), rel=1e-9)
    assert ContactRadii(0.3, 0.3001).hertz_n_per_m15 == pytest.approx(4 / 3 * MODULUS_PA * np.sqrt(0.3), rel=1e-3)
    # A tread and a crown that together are as curved across as the wheel is along: a sphere on a plane.
    assert ContactRadii(0.4, 0.2, -0.4).hertz_n_per_m15 == pytest.approx(4 / 3 * MODULUS_PA * np.sqrt(0.4), rel=1e-9)


def test_half_length_grows_with_wheel_and_load_and_falls_with_the_crown() -> None:
    larger = ContactRadii(0.46)
    assert 6e-3 < larger.half_length_m(LOAD_N) < 7e-3
    assert ContactRadii(0.46, 0.5).half_length_m(LOAD_N) < ContactRadii(0.46, 0.2).half_length_m(LOAD_N)
    assert larger.half_length_m(8 * LOAD_N) == pytest.approx(2 * larger.half_length_m(LOAD_N), rel=1e-9)


def test_the_papers_constant_is_that_of_a_wheel_of_45_cm_on_a_new_head() -> None:
    assert ContactRadii(0.45, 0.3).hertz_n_per_m15 < 93.7e9 < ContactRadii(0.46, 0.3).hertz_n_per_m15


@given(st.floats(0.2, 1.0), st.floats(0.05, 2.0), st.floats(0.5, 20.0))
def test_approach_is_what_the_pressure_on_the_ellipse_makes(wheel_m: float, crown_m: float, tread_m: float) -> None:
    """Displacement at the middle under Hertz' pressure: the integral of pressure over distance, by 1 / (pi E*)."""
    radii = ContactRadii(wheel_m, crown_m, tread_m)
    along_m = radii.half_length_m(LOAD_N)
    across_m = ContactRadii(1 / (1 / crown_m + 1 / tread_m), wheel_m).half_length_m(LOAD_N)  # turned by 90 degrees
    peak_pa = 1.5 * LOAD_N / (np.pi * along_m * across_m)
    # Along a ray at an angle the pressure is a quarter of an ellipse: its integral is pi / 4 of the ray's length.
    rays = quad(lambda t: 1 / np.hypot(np.cos(t) / along_m, np.sin(t) / across_m), 0, 2 * np.pi, limit=200)[0]
    approach_m = peak_pa * np.pi / 4 * rays / (np.pi * MODULUS_PA)
    assert radii.hertz_n_per_m15 == pytest.approx(LOAD_N / approach_m**1.5, rel=1e-5)


def test_a_tread_as_hollow_as_the_crown_is_round_touches_along_a_line() -> None:
    assert ContactRadii(0.45, 0.3, -0.32).touch_in_a_point
    assert not ContactRadii(0.45, 0.3, -0.3).touch_in_a_point
    assert not ContactRadii(0.45, 0.3, 0.0).touch_in_a_point
    worn = [ContactRadii(0.45, 0.3, tread_m).hertz_n_per_m15 for tread_m in (np.inf, -1.0, -0.4)]
    assert worn == sorted(worn)


def test_elliptic_integrals_are_those_of_scipy():
    ratios = np.linspace(0.02, 0.999, 50)
    ours = np.array([hertz._elliptic_integrals(ratio) for ratio in ratios.tolist()]).T
    np.testing.assert_allclose(ours, [ellipk(1 - ratios**2), ellipe(1 - ratios**2)], rtol=1e-12)
