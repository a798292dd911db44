import numpy as np
import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.peaks import (
    Branch,
    Peak,
    followed,
    hand_overs,
    jenkins_p1,
    jenkins_p2,
    local_peaks,
    p1_p2,
)

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


@pytest.mark.parametrize("step_kmh", [1.0, 2.5, 5.0])
def test_peaks_keep_their_identity_and_hand_over_where_they_are_equal(step_kmh: float):
    x = np.arange(-0.1, 0.3, 0.5e-3)
    speeds = np.arange(72.0, 131.0, step_kmh)
    branches = followed(speeds, [local_peaks(x, two_peaks(x, v), 50.0) for v in speeds])
    assert len(branches) == 2
    stays, moves = sorted(branches, key=lambda b: float(np.ptp(b.x_m)))
    assert np.ptp(stays.x_m) < 1e-3
    np.testing.assert_allclose(moves.x_m, 2e-3 * moves.speeds_kmh / 3.6, atol=1e-3)
    # Skirts of the other bump add alike to both peaks.
    assert hand_overs(branches) == pytest.approx([100.0], abs=0.5)


def test_crossing_paths_are_not_swapped():
    speeds = np.arange(50.0, 101.0, 5.0)
    peaks = [[Peak(0.050, 2.0), Peak(0.0011 * v - 0.03, 1.0)] for v in speeds]
    branches = followed(speeds, [sorted(pair, key=lambda p: p.x_m) for pair in peaks])
    assert sorted(set(b.force_n) for b in branches) == [{1.0}, {2.0}]
    assert hand_overs(branches) == []


def test_peak_out_of_reach_begins_a_branch():
    branches = followed([10.0, 20.0], [[Peak(0.0, 1.0)], [Peak(0.02, 1.0)]], gate_m=0.01)
    assert [b.x_m.tolist() for b in branches] == [[0.0], [0.02]]
    assert followed([10.0, 20.0, 30.0], [[], [Peak(0.0, 1.0)], []])[0].speeds_kmh.tolist() == [20.0]


def test_overtaking_peak_that_has_just_appeared_is_continued_by_a_line():
    old = Branch(np.array([10.0, 20.0, 30.0]), np.zeros(3), np.array([10.0, 9.0, 8.0]))
    new = Branch(np.array([30.0, 40.0]), np.ones(2), np.array([9.0, 11.0]))
    # 10 - (v - 10) / 10 = 9 + (v - 30) / 5
    assert hand_overs([old, new]) == pytest.approx([20 + 20 / 3])


def test_leader_that_vanishes_is_not_overtaken():
    old = Branch(np.array([10.0, 20.0]), np.zeros(2), np.array([10.0, 10.0]))
    low = Branch(np.array([10.0, 20.0, 30.0, 40.0]), np.ones(4), np.array([5.0, 5.0, 5.0, 5.0]))
    assert hand_overs([old, low]) == []
    assert hand_overs([]) == []


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


def test_jenkins_without_angle_is_static_and_grows_linearly_with_speed_and_angle():
    def p1(angle: float, speed: float) -> float:
        return jenkins_p1(
            STATIC_N, angle, speed, contact_stiffness_n_per_m=1.4e9, unsprung_mass_kg=600.0, effective_rail_mass_kg=24.0
        )

    def p2(angle: float, speed: float) -> float:
        return jenkins_p2(
            STATIC_N, angle, speed, unsprung_mass_kg=600.0, track_mass_kg=150.0,
            track_stiffness_n_per_m=100e6, track_damping_ns_per_m=50e3,
        )  # fmt: skip

    for force in (p1, p2):
        assert force(0.0, 100.0) == STATIC_N
        assert force(0.02, 50.0) - STATIC_N == pytest.approx(force(0.01, 100.0) - STATIC_N)
        assert force(0.02, 100.0) - STATIC_N == pytest.approx(2 * (force(0.01, 100.0) - STATIC_N))
    # An undamped mass on a massless spring, met at v0, presses with v0 sqrt(k m).
    hand = jenkins_p2(
        0.0, 0.01, 36.0, unsprung_mass_kg=400.0, track_mass_kg=0.0,
        track_stiffness_n_per_m=1e8, track_damping_ns_per_m=0.0,
    )  # fmt: skip
    assert hand == pytest.approx(0.1 * np.sqrt(1e8 * 400.0))
