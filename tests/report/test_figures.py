"""The drawing of a grinding advice: what it marks, at which places."""

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.harness.reports import ground
from weld_force_ros.messages import GrindingAdvice
from weld_force_ros.report import figures


@pytest.fixture(scope="module")
def advice() -> GrindingAdvice:
    found = ground().grinding
    assert found is not None
    return found


def test_the_drawing_marks_the_spots_names_the_sides_and_draws_the_index_with_its_norm(advice: GrindingAdvice):
    rail, index, force = figures.grinding(advice).axes
    words = [text.get_text() for text in rail.texts]
    assert f"{advice.spots[0].depth_m * 1e3:.2f} mm" in words
    assert {"← falling chainage", "rising chainage →"} <= set(words)
    (band,) = (patch for patch in rail.patches if patch.get_width() > 0)
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((-400, -100))
    before, after, norm = index.lines
    # Half of every height is removed, where the rail stands up: so is half of every slope.
    assert np.max(after.get_ydata()) == pytest.approx(np.max(before.get_ydata()) / 2, rel=1e-6)
    assert set(norm.get_ydata()) == {1.0}
    assert norm.get_label() == "norm, 2.00 mrad"
    assert force.get_xlabel() == "speed, km/h"


def test_the_drawing_says_where_nobody_stated_which_way_chainage_goes(advice: GrindingAdvice):
    rail, index, _ = figures.grinding(replace(advice, chainage_direction=UNSET, gradient_norm_rad=UNSET)).axes
    assert "← x < 0 (chainage not stated)" in [text.get_text() for text in rail.texts]
    assert index.get_ylabel() == "inclination, mrad"
