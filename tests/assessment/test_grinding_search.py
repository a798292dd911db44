"""What is taken off keeps its bounds, and is the least by problems whose answer another method gives."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.optimize import linprog

from weld_force_ros.assessment.grinding_search import Grinder, Profile, Removal, closed, least_removal, splines
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.shapes import cosine_dip

X = np.linspace(-0.3, 0.3, 301)
GRINDER = Grinder(reach_m=0.1)


def no_higher_than(height_m: float):
    """Excess of a limit on the greatest height: linear in the profile, a constraint for each place."""

    def excess(profiles: Sequence[Profile]) -> np.ndarray:
        return np.array([(np.interp(X, *profile) - height_m) / 0.1e-3 for profile in profiles])

    return excess


def bump(height_m: float = 0.2e-3, length_m: float = 0.3) -> np.ndarray:
    return cosine_dip(X, length_m, -height_m)


def least_by_linear_programming(z: np.ndarray, height_m: float, grinder: Grinder, removal: Removal) -> float:
    """The least area of the same splines that leaves nothing higher, in one linear program."""
    knots_m = grinder.band_limit_m / (4 / 3)
    basis = splines(removal.x_m, removal.x_m[0], removal.x_m[-1], knots_m)
    heights = np.interp(removal.x_m, X, z, left=0.0, right=0.0)
    solved = linprog(
        trapezoid(basis, removal.x_m, axis=0),
        A_ub=-basis,
        b_ub=height_m - heights,
        bounds=[(0.0, grinder.most_m)] * basis.shape[1],
        method="highs",
    )
    assert solved.success
    return float(solved.fun)


@pytest.mark.parametrize("height_um", [150.0, 100.0, 40.0])
def test_removal_is_the_least_where_a_linear_program_knows_it(height_um: float):
    z = bump()
    found = least_removal(X, z, no_higher_than(height_um * 1e-6), GRINDER)
    assert found.reached
    assert found.removed_m2 == pytest.approx(least_by_linear_programming(z, height_um * 1e-6, GRINDER, found), rel=0.03)


@settings(max_examples=10, deadline=None)
@given(
    height_um=st.floats(60.0, 300.0),
    length_m=st.floats(0.12, 0.4),
    kept=st.floats(0.2, 0.9),
    band_m=st.sampled_from([0.08, 0.1, 0.2]),
)
def test_what_is_taken_off_keeps_its_bounds(height_um: float, length_m: float, kept: float, band_m: float):
    grinder = Grinder(band_limit_m=band_m, reach_m=0.2)
    z = bump(height_um * 1e-6, length_m)
    found = least_removal(X, z, no_higher_than(kept * height_um * 1e-6), grinder)
    assert found.reached
    assert found.removal_m.min() >= 0.0
    assert found.removal_m.max() <= grinder.most_m + 1e-12
    touched = found.x_m[found.removal_m > 0]
    assert touched.min() >= X[0] - grinder.reach_m
    assert touched.max() <= X[-1] + grinder.reach_m
    assert energy_above(found, 1 / band_m) < 1e-3


def energy_above(removal: Removal, per_m: float) -> float:
    """Share of a removal's energy at waves shorter than 1 / `per_m`."""
    even = np.arange(removal.x_m[0], removal.x_m[-1], 1e-3)
    power = np.abs(np.fft.rfft(np.interp(even, removal.x_m, removal.removal_m), 8 * len(even))) ** 2
    return float(power[np.fft.rfftfreq(8 * len(even), 1e-3) > per_m].sum() / power.sum())


def test_hollows_are_no_sharper_than_the_stone():
    """A circle of the stone's radius, lowered by hand, touches every place that was ground."""
    grinder = Grinder(band_limit_m=0.05, stone_radius_m=4.0, reach_m=0.1)
    z = bump(0.3e-3, 0.25)
    found = least_removal(X, z, no_higher_than(0.05e-3), grinder)
    x, ground = found.x_m, found.ground_m
    assert found.reached
    offset = np.linspace(-0.05, 0.05, 801)
    circle = 4.0 - np.sqrt(4.0**2 - offset**2)
    for centre in x[found.removal_m > 1e-5]:
        # Of all circles through the place, one at least lies nowhere below the surface.
        gaps = []
        for shift in np.linspace(-0.04, 0.04, 81):
            at = centre + offset - shift
            arc = np.interp(centre, x, ground) + circle - np.interp(shift, offset, circle)
            gaps.append(np.min(arc - np.interp(at, x, ground)))
        assert max(gaps) > -1e-6


@given(radius_m=st.floats(0.1, 5.0), depth_um=st.floats(1.0, 200.0), length_m=st.floats(0.02, 0.3))
@settings(deadline=None, max_examples=30)
def test_closing_fills_only_what_the_stone_cannot_reach(radius_m: float, depth_um: float, length_m: float):
    z = cosine_dip(X, length_m, depth_um * 1e-6)
    filled = closed(X, z, radius_m)
    assert np.all(filled >= z)
    sharpest = 2 * np.pi**2 * depth_um * 1e-6 / length_m**2  # curvature of the cosine at its bottom
    if sharpest < 0.8 / radius_m:
        np.testing.assert_allclose(filled, z, atol=1e-6)
    if sharpest > 3 / radius_m:
        assert filled.min() > z.min() + 0.05 * depth_um * 1e-6


def test_within_limits_nothing_is_removed():
    found = least_removal(X, bump(), no_higher_than(0.25e-3), GRINDER)
    assert found.reached
    assert not found.removal_m.any()


def test_looser_limits_never_remove_more():
    areas = [least_removal(X, bump(), no_higher_than(h * 1e-6), GRINDER).removed_m2 for h in (40, 80, 120, 160, 199)]
    assert areas == sorted(areas, reverse=True)


def test_what_cannot_be_reached_is_said():
    shallow = Grinder(most_m=0.05e-3, reach_m=0.1)
    found = least_removal(X, bump(), no_higher_than(0.05e-3), shallow)
    assert not found.reached
    assert found.removal_m.max() <= 0.05e-3 + 1e-12


def test_search_is_the_same_every_time():
    one, same = (least_removal(X, bump(), no_higher_than(0.1e-3), GRINDER) for _ in range(2))
    np.testing.assert_array_equal(one.removal_m, same.removal_m)


@pytest.mark.parametrize("wrong", [{"band_limit_m": 0.0}, {"stone_radius_m": -1.0}, {"most_m": np.nan}])
def test_grinders_that_cannot_be_are_refused(wrong: dict[str, float]):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Grinder(**wrong)
