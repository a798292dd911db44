import numpy as np
import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.peaks import local_peaks, p1_p2

STATIC_N = 100e3


def bump(x: np.ndarray, centre: float, width: float, height: float) -> np.ndarray:
    return height * np.exp(-(((x - centre) / width) ** 2))


def two_peaks(x: np.ndarray, speed_kmh: float) -> np.ndarray:
    """One peak that stays with the weld and grows, one that lags 2 ms and shrinks; equal at 100 km/h."""
    lag = 2e-3 * speed_kmh / 3.6
    return (
        STATIC_N
        + bump(x, 0.02, 0.008, 10e3 + 100 * (speed_kmh - 100))
        + bump(x, lag, 0.008, 10e3 - 60 * (speed_kmh - 100))
    )


@pytest.mark.parametrize("step_m", [1e-3, 0.4e-3])
def test_peaks_are_found_between_samples(step_m: float):
    x = np.arange(-0.1, 0.2, step_m)
    peaks = local_peaks(x, STATIC_N + bump(x, 0.0113, 0.01, 5e3) + bump(x, 0.0937, 0.01, 3e3), 500.0)
    assert [p.x_m for p in peaks] == pytest.approx([0.0113, 0.0937], abs=2e-5)
    assert [p.force_n for p in peaks] == pytest.approx([STATIC_N + 5e3, STATIC_N + 3e3], abs=3.0)


def test_peaks_of_the_mirrored_history_are_mirrored():
    x = np.linspace(-0.2, 0.2, 801)
    force = two_peaks(x, 130.0)
    there = local_peaks(x, force, 100.0)
    back = local_peaks(-x[::-1], force[::-1], 100.0)
    assert [p.x_m for p in back] == pytest.approx([-p.x_m for p in reversed(there)], abs=1e-9)


def test_wiggles_below_the_prominence_are_no_peaks():
    x = np.linspace(0.0, 0.1, 1001)
    force = STATIC_N + bump(x, 0.05, 0.02, 5e3) + 20 * np.sin(2 * np.pi * x / 0.004)
    assert len(local_peaks(x, force, 200.0)) == 1
    assert len(local_peaks(x, force, 1.0)) > 1


def test_p1_and_p2_of_a_short_and_a_long_pulse():
    time = np.arange(0.0, 0.2, 2e-5)
    force = STATIC_N + bump(time, 0.0507, 0.3e-3, 30e3) + bump(time, 0.058, 5e-3, 40e3)
    found = p1_p2(time, force, 0.05)
    assert found.p1_s == pytest.approx(0.0507, abs=1e-4)
    assert found.p1_n == pytest.approx(STATIC_N + 30e3 + bump(np.array(0.0507), 0.058, 5e-3, 40e3), rel=0.005)
    assert found.p2_s == pytest.approx(0.058, abs=5e-4)
    assert found.p2_n == pytest.approx(STATIC_N + 40e3, rel=0.03)


def test_p2_is_never_before_p1():
    time = np.arange(0.0, 0.2, 2e-5)
    found = p1_p2(time, STATIC_N + bump(time, 0.052, 0.3e-3, 9e3) + bump(time, 0.03, 12e-3, 40e3), 0.05)
    assert found.p1_s <= found.p2_s <= 0.07


def test_history_too_short_for_p2_or_without_p1_is_refused():
    time = np.arange(0.0, 0.1, 1e-4)
    with pytest.raises(InputError, match="20 ms"):
        p1_p2(time, np.full_like(time, STATIC_N), 0.09)
    with pytest.raises(InputError, match="no force peak"):
        p1_p2(time, STATIC_N + 1e3 * time, 0.05)
