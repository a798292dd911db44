import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.measurement.shapes import REFERENCE_SHAPES, STRAIGHTEDGE_LENGTH_M, cosine_dip
from weld_force_ros.physics.analysis.geometry import classify, quality_index

PAPER = {
    "weld-1-dip": "dip",
    "weld-2-rise-between-shrinkages": "dip",
    "weld-3-long-ground-dip": "dip",
    "weld-4-steep-ramp": "protrusion",
    "weld-5-ramp-protrusion": "protrusion",
    "cosine-dip-48mm": "dip",
    "cosine-dip-96mm": "dip",
    "cosine-rise-48mm": "protrusion",
    "wheel-flat-0.9mm": "dip",
}


@pytest.mark.parametrize("name", REFERENCE_SHAPES)
def test_shipped_shapes_are_of_the_papers_class_in_either_direction(name: str):
    profile = read_profile(find(name))
    x, z = np.array(profile.x_m), np.array(profile.z_m)
    found = classify(x, z)
    assert found.kind == PAPER[name]
    assert classify(-x[::-1], z[::-1]) == found


@pytest.mark.parametrize("step_m", [0.5e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("name", [name for name in REFERENCE_SHAPES if name.startswith("weld")])
def test_class_does_not_depend_on_sampling(name: str, step_m: float):
    x = np.arange(0.0, STRAIGHTEDGE_LENGTH_M + step_m / 2, step_m)
    found = classify(x, REFERENCE_SHAPES[name](x))
    assert found.kind == PAPER[name]
    fine = np.linspace(0.0, STRAIGHTEDGE_LENGTH_M, 4001)
    exact = classify(fine, REFERENCE_SHAPES[name](fine))
    assert (found.dip_m, found.protrusion_m) == pytest.approx((exact.dip_m, exact.protrusion_m), abs=3e-6)


def test_heights_are_relative_to_their_surroundings():
    x = np.arange(7.0)
    on_a_plateau = classify(x, [0.0, 5.0, 5.0, 4.0, 5.0, 5.0, 0.0])
    assert (on_a_plateau.kind, on_a_plateau.dip_m, on_a_plateau.protrusion_m) == ("protrusion", 1.0, 5.0)
    between = classify(x, [0.0, 2.0, -3.0, -3.0, -3.0, 1.0, 0.0])
    assert (between.kind, between.dip_m, between.protrusion_m) == ("dip", 4.0, 2.0)
    beside = classify(x, [0.0, 0.0, -1.0, 0.0, 2.0, 0.0, 0.0])
    assert (beside.kind, beside.ratio) == ("dip", 2.0)  # twice as high is not yet much higher
    assert classify(x, np.zeros(7)).ratio == 0.0


@given(st.lists(st.integers(-1000, 1000), min_size=2, max_size=40))
def test_dip_of_the_inverted_weld_is_its_protrusion(heights: list[int]):
    z = np.array(heights) * 1e-6
    x = np.arange(len(z)) * 1e-3
    upright, inverted = classify(x, z), classify(x, -z)
    assert (inverted.dip_m, inverted.protrusion_m) == (upright.protrusion_m, upright.dip_m)
    assert max(upright.dip_m, upright.protrusion_m) >= np.abs(z).max()


def test_gradient_of_a_ramp_is_its_slope_and_the_norm_that_of_the_speed():
    x = np.arange(0.0, 1.0005, 1e-3)
    z = np.interp(x, [0.2, 0.4, 0.8], [0.0, 0.4e-3, 0.0])
    found = quality_index(x, z, 40.0)
    assert found.gradient_rad == pytest.approx(2e-3)
    assert found.norm_rad == pytest.approx(3.2e-3)
    assert found.index == pytest.approx(2 / 3.2)
    assert not found.verified
    assert quality_index(x, z, 170.0).norm_rad == pytest.approx(2.1e-3)
    assert quality_index(x, z, 350.0).norm_rad == pytest.approx(1.0e-3)
    assert quality_index(x, z, 100.0, norm_mrad=[(100.0, 0.5)]).index == pytest.approx(4.0)


def test_index_is_linear_and_does_not_depend_on_direction_sampling_or_sign():
    def gradient(step_m: float, depth_m: float) -> float:
        x = np.arange(-0.5, 0.5 + step_m / 2, step_m)
        return quality_index(x, cosine_dip(x, 0.2, depth_m), 80.0).gradient_rad

    assert gradient(1e-3, 0.4e-3) == pytest.approx(2 * gradient(1e-3, 0.2e-3))
    assert gradient(5e-3, 0.2e-3) == pytest.approx(gradient(0.5e-3, 0.2e-3), rel=0.01)
    assert gradient(1e-3, -0.2e-3) == pytest.approx(gradient(1e-3, 0.2e-3))
    # A moving average of five samples, 25 mm, takes little from 0.2 m: pi depth / length, by its sinc.
    sinc = np.sin(5 * np.pi * 5e-3 / 0.2) / (5 * np.sin(np.pi * 5e-3 / 0.2))
    assert gradient(0.5e-3, 0.2e-3) == pytest.approx(np.pi * 0.2e-3 / 0.2 * sinc, rel=0.01)
    x = np.linspace(0.0, 1.0, 1001)
    z = REFERENCE_SHAPES["weld-4-steep-ramp"](x)
    mirrored = quality_index(-x[::-1], z[::-1], 80.0).index
    assert mirrored == pytest.approx(quality_index(x, z, 80.0).index, rel=1e-3)


def test_what_is_no_profile_is_refused():
    with pytest.raises(InputError, match="no profile"):
        classify([0.0, 0.0], [1.0, 2.0])
    with pytest.raises(InputError, match="no profile"):
        quality_index([0.0, 1.0], [1.0], 80.0)
