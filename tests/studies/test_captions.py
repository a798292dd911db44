"""Conditions that the words on the paper's welds set on shapes: met by those drawn by hand from the same words."""

import numpy as np
import pytest

from weld_force_ros.measurement import profile_file
from weld_force_ros.studies.captions import contradictions
from weld_force_ros.studies.study_context import Profile

DRAWN = {
    "weld-1": "weld-1-dip",
    "weld-2": "weld-2-rise-between-shrinkages",
    "weld-3": "weld-3-long-ground-dip",
    "weld-4": "weld-4-steep-ramp",
    "weld-5": "weld-5-ramp-protrusion",
}


def drawn(weld: str) -> Profile:
    profile = profile_file.read_profile(profile_file.find(DRAWN[weld]))
    return np.array(profile.x_m) - 0.5 * (profile.x_m[0] + profile.x_m[-1]), np.array(profile.z_m)


@pytest.mark.parametrize("weld", DRAWN)
def test_a_shape_drawn_from_the_words_contradicts_none(weld):
    assert contradictions(weld, drawn(weld)) == 0


@pytest.mark.parametrize("weld", DRAWN)
def test_a_shape_upside_down_contradicts_some(weld):
    x, z = drawn(weld)
    assert contradictions(weld, (x, -z)) >= 1


@pytest.mark.parametrize("weld", ["weld-2", "weld-4"])
def test_run_over_from_the_other_side_it_is_another_weld(weld):
    x, z = drawn(weld)
    assert contradictions(weld, (x, z[::-1])) >= 1


@pytest.mark.parametrize(
    ("weld", "other"), [("weld-1", "weld-4"), ("weld-3", "weld-1"), ("weld-4", "weld-1"), ("weld-5", "weld-2")]
)
def test_the_shape_of_another_weld_contradicts_some(weld, other):
    assert contradictions(weld, drawn(other)) >= 1


@pytest.mark.parametrize("weld", DRAWN)
def test_level_rail_is_no_weld(weld):
    x, z = drawn(weld)
    assert contradictions(weld, (x, 0.0 * z)) >= 1
