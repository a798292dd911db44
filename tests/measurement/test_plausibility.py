"""What no rail weld can have is refused before it is judged; what one can have is not."""

import numpy as np
import pytest

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.plausibility import check_estimate, check_measured

X_M = np.arange(-0.6, 0.6001, 0.005)
DIP_M = np.where(np.abs(X_M) <= 0.15, -2e-4 * (1 + np.cos(2 * np.pi * X_M / 0.3)), 0.0)
UNITS = {"x_unit": "mm", "z_unit": "um"}


def dip(depth_m: float, length_m: float, at_m: float = 0.0) -> np.ndarray:
    x_m = X_M - at_m
    return np.where(np.abs(x_m) <= length_m / 2, -depth_m / 2 * (1 + np.cos(2 * np.pi * x_m / length_m)), 0.0)


@pytest.mark.parametrize(
    "z_m",
    [DIP_M, -DIP_M, 0.5 * DIP_M, DIP_M + 0.019 * X_M, DIP_M + 1.0, DIP_M / 100, np.where(X_M > 0, 1e-4, 0.0)],
    ids=["dip", "rise", "half", "tilted", "high", "4 um", "step"],
)
def test_measured_welds_pass(z_m: np.ndarray) -> None:
    check_measured(X_M, z_m, **UNITS)


def test_one_wrong_sample_makes_no_slope() -> None:
    z_m = DIP_M.copy()
    z_m[0], z_m[100] = 5e-3, 5e-3
    check_measured(X_M, z_m, **UNITS)


@pytest.mark.parametrize(
    ("x_m", "z_m", "says"),
    [
        (X_M / 10, DIP_M, r"the record is 120 mm long.*check x_unit \(stated: mm\)"),
        (X_M, 0 * X_M, "all heights are equal; check that the probe moved"),
        (X_M, 0.021 * X_M + DIP_M, r"heights climb 21 mm in a metre.*check z_unit \(stated: um\)"),
        (X_M, DIP_M - 0.5 * X_M, "heights climb 500 mm in a metre"),
        (X_M, DIP_M / 1000, "heights span 0.4 um, no rail is so even; check z_unit"),
    ],
    ids=["short", "dead probe", "steep", "very steep", "mm called um"],
)
def test_what_cannot_be_is_refused(x_m: np.ndarray, z_m: np.ndarray, says: str) -> None:
    with pytest.raises(ProfileError, match=says):
        check_measured(x_m, z_m, **UNITS)


@pytest.mark.parametrize(("depth_m", "length_m"), [(4e-4, 0.3), (0.9e-3, 0.1), (-2e-4, 0.25), (4e-3, 0.4)])
def test_estimated_welds_pass(depth_m: float, length_m: float) -> None:
    check_estimate(X_M, dip(depth_m, length_m), **UNITS)


def test_flank_steeper_than_a_wheel_can_touch_is_refused() -> None:
    with pytest.raises(ProfileError, match=r"heights change by .* steeper than a wheel can touch"):
        check_estimate(X_M, dip(5e-3, 0.05), **UNITS)


@pytest.mark.parametrize(("at_m", "word"), [(0.55, "ends"), (-0.55, "begins"), (0.6, "ends")])
def test_record_that_stops_in_the_weld_is_refused(at_m: float, word: str) -> None:
    with pytest.raises(ProfileError, match=f"the record {word} within the weld.*perhaps the file is not complete"):
        check_estimate(X_M, dip(4e-4, 0.3, at_m), **UNITS)
