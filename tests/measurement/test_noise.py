"""What is said of a measurement's noise and of the samples that were set aside."""

import re

import numpy as np
import pytest

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement import noise
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.messages import WeldProfile

X_M = np.arange(0.0, 1.0001, 0.005)
DIP_M = np.where(np.abs(X_M - 0.5) <= 0.125, -1e-4 * (1 + np.cos(2 * np.pi * (X_M - 0.5) / 0.25)), 0.0)


def noisy(noise_m: float = 5e-6, seed: int = 1) -> np.ndarray:
    return DIP_M + np.random.default_rng(seed).normal(0, noise_m, len(X_M))


def read(z_m: np.ndarray, header: str = "", digits: int = 1) -> WeldProfile:
    rows = "".join(f"{1e3 * x:.0f},{1e6 * z:.{digits}f}\n" for x, z in zip(X_M, z_m, strict=True))
    return parse_profile(f"# x_unit: mm\n# z_unit: um\n# z_positive: up\n{header}x,z\n{rows}", "w.csv")


def test_noise_is_named_and_how_it_is_known() -> None:
    found = noise.estimate(X_M, noisy())
    assert found.notes == [
        f"measurement noise of {found.noise_m * 1e6:.2g} um (estimated) taken out by an adaptive spline"
    ]
    assert "um (as stated) taken out" in noise.estimate(X_M, noisy(), noise_m=5e-6).notes[0]
    assert len(found.outliers_m) == 0


def test_wrong_samples_are_named_with_place_and_error() -> None:
    z_m = noisy(1e-6)
    z_m[[40, 150]] += 1e-3, -5e-4
    found = noise.estimate(X_M, z_m)
    np.testing.assert_allclose(found.outliers_m, [0.2, 0.75])
    assert re.match(r"2 wrong samples set aside: \+.* um at x = 200 mm .*, -.* um at x = 750 mm", found.notes[0])


def test_record_of_wrong_samples_is_refused() -> None:
    z_m = DIP_M[60:141].copy()
    z_m[4:-1:16] += 3e-3
    with pytest.raises(ProfileError, match="5 of 81 heights fit no rail; measure again"):
        noise.estimate(X_M[60:141], z_m)


def test_profile_carries_samples_estimate_and_noise() -> None:
    z_m = noisy(10e-6)
    z_m[40] += 1e-3
    profile = read(z_m)
    assert profile.noise.noise_m == pytest.approx(10e-6, rel=0.2)
    assert profile.noise.resolution_m == pytest.approx(1e-7)
    assert profile.noise.outliers_m == pytest.approx([-0.3])
    assert len(profile.measured_x_m) == len(profile.measured_z_m) == len(X_M)
    assert profile.measured_z_m[40] > 9e-4
    true_m = np.interp(np.array(profile.x_m) + 0.5, X_M, DIP_M)
    assert np.std(np.array(profile.z_m) - true_m) < 5e-6


def test_noise_none_takes_the_samples_as_they_are() -> None:
    z_m = np.round(noisy(10e-6), 7)
    profile = read(z_m, "# noise: none\n# detrend: none\n")
    np.testing.assert_allclose(profile.z_m, z_m, atol=1e-12)
    assert (profile.noise.method, profile.noise.noise_m) == ("none", 0.0)


def test_stated_noise_is_used() -> None:
    profile = read(noisy(10e-6), "# noise: 20e-6\n")
    assert profile.noise.noise_m == pytest.approx(20e-6, rel=0.1)
    assert "(as stated)" in " | ".join(profile.conditioning)


@pytest.mark.parametrize(("digits", "resolution_m"), [(2, 1e-8), (0, 1e-6), (-1, 1e-5)])
def test_resolution_is_read_from_the_digits(digits: int, resolution_m: float) -> None:
    z_m = np.round(noisy(10e-6), 5) if digits < 0 else noisy(10e-6)
    assert read(z_m, digits=max(digits, 0)).noise.resolution_m == pytest.approx(resolution_m)


def test_same_file_gives_the_same_profile() -> None:
    assert read(noisy()).profile_sha256 == read(noisy()).profile_sha256


@pytest.mark.parametrize("off_m", [3e-3, 1e-3, 3e-4])
def test_several_wrong_samples_do_not_pass_for_noise(off_m: float) -> None:
    z_m = noisy(1e-6)
    z_m[4:-1:20] += off_m
    found = noise.estimate(X_M, z_m)
    np.testing.assert_allclose(found.outliers_m, X_M[4:-1:20])
    assert found.noise_m < 2e-6


def test_heights_that_only_scatter_are_refused() -> None:
    with pytest.raises(ProfileError, match=r"heights scatter by \d+ um about any rail"):
        noise.estimate(X_M, noisy(200e-6))
