"""The list of spots and their sides, and the shapes that a hand grinder may leave, worked by hand."""

import numpy as np
import pytest
from msgspec import UNSET

from weld_force_ros.assessment.grinding_search import Removal
from weld_force_ros.assessment.grinding_spots import by_hand, ends_in_words, grinding_spots, side_in_words

X = np.linspace(-0.4, 0.4, 9)  # every 100 mm
UM = 1e-6


def removal(*depths_um: float) -> Removal:
    return Removal(X, np.full(9, 500 * UM), np.array(depths_um) * UM, np.zeros(1), np.zeros(1))


TWO = removal(0, 40, 60, 0, 4, 0, 0, 90, 10)


def test_each_piece_is_a_spot_and_what_is_not_notable_is_none():
    """4 um at 0 are no spot; the others run over 100 mm each."""
    first, second = grinding_spots(TWO)
    assert (first.from_m, first.to_m, first.depth_m, first.deepest_m) == pytest.approx((-0.3, -0.2, 60 * UM, -0.2))
    assert (second.from_m, second.to_m, second.depth_m, second.deepest_m) == pytest.approx((0.3, 0.4, 90 * UM, 0.3))
    assert grinding_spots(removal(*[0.0] * 9)) == []


def test_of_a_removal_that_is_shallow_throughout_the_deeper_half_is_the_spot():
    (spot,) = grinding_spots(removal(0, 0, 1, 3, 2, 0, 0, 0, 0))
    assert (spot.from_m, spot.to_m) == pytest.approx((-0.1, 0.0))


@pytest.mark.parametrize(
    ("chainage", "first", "second"),
    [
        ("with", "against rising chainage", "towards rising chainage"),
        ("against", "towards rising chainage", "against rising chainage"),
        (UNSET, "x < 0; chainage not stated", "x > 0; chainage not stated"),
    ],
)
def test_sides_are_named_by_chainage_where_its_direction_is_known(chainage, first: str, second: str):
    spots = grinding_spots(TWO, chainage)
    assert [side_in_words(spot) for spot in spots] == [first, second]
    falling, rising = ends_in_words(chainage)
    if chainage is not UNSET:
        assert [falling, rising] == [spot.side for spot in spots]
        assert {spot.side for spot in spots} == {"rising chainage", "falling chainage"}
    else:
        assert [spot.side for spot in spots] == [UNSET, UNSET]


def test_a_spot_across_the_centre_lies_on_both_sides():
    (spot,) = grinding_spots(removal(0, 0, 0, 50, 50, 50, 0, 0, 0), "with")
    assert (spot.side, side_in_words(spot)) == ("both", "on both sides")


def test_by_hand_the_depth_is_off_by_the_margin_and_never_less_than_nothing():
    """A spot from -300 to 100 mm, deepest in its middle; the margin is 30 um."""
    planned = removal(0, 10, 50, 80, 50, 10, 0, 0, 0)
    deeper, shallower, *tilted = [(planned.z_m - z) / UM for _, z in by_hand(planned, 30 * UM)]
    assert sorted([deeper.sum(), shallower.sum()]) == pytest.approx([200 - 110, 200 + 110])
    assert sorted([deeper.tolist(), shallower.tolist()])[0] == pytest.approx([0, 0, 20, 50, 20, 0, 0, 0, 0])
    assert sorted([deeper.tolist(), shallower.tolist()])[1] == pytest.approx([0, 20, 80, 110, 80, 20, 0, 0, 0])
    # One wave across the spot: too deep by all of the margin at its first quarter, too shallow at its third.
    assert sorted(t[2] for t in tilted) == pytest.approx([20, 80])
    assert sorted(t[4] for t in tilted) == pytest.approx([20, 80])
    assert all(t[2] + t[4] == pytest.approx(100) for t in tilted)
