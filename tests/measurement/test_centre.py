"""Where the weld lies in a record that does not say so."""

import numpy as np
import pytest

from weld_force_ros.measurement.centre import chosen_centre, levelled
from weld_force_ros.measurement.profile_file import parse_profile


def dip(x_m: np.ndarray, at_m: float) -> np.ndarray:
    return np.where(np.abs(x_m - at_m) <= 0.15, -2e-4 * (1 + np.cos(2 * np.pi * (x_m - at_m) / 0.3)), 0.0)


def test_record_about_its_own_zero_is_centred_there() -> None:
    x_m = np.arange(-0.3, 0.7001, 0.005)
    assert chosen_centre(x_m, dip(x_m, 0.1)) == (0.0, "the record's own zero")


@pytest.mark.parametrize("at_m", [0.5, 0.51, 0.489])
def test_weld_near_the_middle_is_in_the_middle(at_m: float) -> None:
    x_m = np.arange(0.0, 1.0001, 0.005)
    centre, how = chosen_centre(x_m, dip(x_m, at_m))
    assert (centre, how) == (pytest.approx(0.5), "the middle of the range")


@pytest.mark.parametrize("at_m", [0.172, 0.6, 2.0, 2.719])
def test_weld_elsewhere_is_found(at_m: float) -> None:
    x_m = np.arange(0.0, 2.8801, 0.005)
    noise_m = np.random.default_rng(1).normal(0, 1e-6, len(x_m))
    centre, how = chosen_centre(x_m, dip(x_m, at_m) + noise_m)
    assert centre == pytest.approx(at_m, abs=0.01)
    assert how == "the defect, as no centre is stated"


def test_level_rail_is_centred_in_the_middle() -> None:
    x_m = np.arange(2.0, 3.0001, 0.005)
    assert chosen_centre(x_m, 0 * x_m) == (pytest.approx(2.5), "the middle of the range")


def test_levelling_takes_the_line_between_the_ends() -> None:
    x_m = np.array([0.0, 0.2, 1.0])
    assert levelled(x_m, np.array([1.0, 5.0, 3.0])) == pytest.approx([0.0, 3.6, 0.0])


@pytest.mark.parametrize(
    ("stated", "origin"), [("", "the defect, as no centre is stated"), ("# centre: 650\n", "as stated")]
)
def test_file_is_centred_on_the_weld_and_says_how(stated: str, origin: str) -> None:
    x_mm = np.arange(0, 2001, 5)
    rows = "".join(f"{x},{1e3 * z:.3f}\n" for x, z in zip(x_mm, dip(x_mm / 1e3, 0.65), strict=True))
    profile = parse_profile(f"# x_unit: mm\n# z_unit: mm\n# z_positive: up\n{stated}x,z\n{rows}", "a")
    assert f"centred on x = 0.65 m, {origin}" in profile.conditioning
    assert profile.x_m[int(np.argmin(profile.z_m))] == pytest.approx(0.0, abs=1e-3)


def test_a_zero_far_from_any_defect_is_not_taken_for_the_weld() -> None:
    x = np.arange(-400, 1001) * 1e-3
    z = np.where(np.abs(x - 0.6) < 0.15, -1e-4 * (1 + np.cos(2 * np.pi * (x - 0.6) / 0.3)), 0.0)
    centre_m, origin = chosen_centre(x, z)
    assert centre_m == pytest.approx(0.6, abs=2e-3)
    assert "defect" in origin
