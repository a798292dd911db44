"""Two wheels on one rail: transfer responses by brute force, one wheel as by the engine, and what a second changes."""

import numpy as np
import pytest

from benchmarks import second_wheel
from weld_force_ros.physics.engines import greens_function
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.track import beam

pytestmark = pytest.mark.slow

DISTANCE_STEPS = 1800
SHAPE = "dip 0.2 mm, 200 mm"


@pytest.fixture(scope="module")
def two() -> second_wheel.TwoWheels:
    return second_wheel.TwoWheels("johansson-nielsen", 160.0)


@pytest.mark.parametrize("offset", [DISTANCE_STEPS, -DISTANCE_STEPS])
def test_responses_are_sums_of_transfer_receptances(two: second_wheel.TwoWheels, offset: int):
    """The same inverse transform of receptances taken one by one, before and after the contact passes the pulse."""
    rows, node, dt = two.responses(offset), 17, two.own.dt
    pulse_m = node * two.track.spacing_m / len(rows)
    alpha = greens_function._WINDOW / greens_function.MEMORY_S
    step = 2 * np.pi / greens_function.MEMORY_S
    omega = step * np.arange(1, int(greens_function.BAND_HZ * greens_function.MEMORY_S) + 1) - 1j * alpha
    moving, resting = two._spectrum._moving, two._spectrum._resting
    found, expected = [], []
    for lag in (3, 500, DISTANCE_STEPS - 1, DISTANCE_STEPS, 2600):
        at, source = np.array([pulse_m + (offset + lag) * two.step_m]), np.array([pulse_m])
        receptance = np.append(beam.response(resting, at, source)[0], beam.response(moving, at, source)[0])
        phase = np.exp(1j * np.append(0.0, omega.real) * lag * dt)
        expected.append((receptance * two._spectrum.pulse * phase).sum().real * np.exp(alpha * lag * dt))
        found.append(rows[node, lag])
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(rows).max())


def test_no_distance_is_the_wheels_own_response_but_for_the_velocity_jump(two: second_wheel.TwoWheels):
    np.testing.assert_allclose(two.responses(0).sum(axis=1), two.own.rows.sum(axis=1), rtol=5e-3)


def test_one_wheel_is_that_of_the_engine_and_a_second_changes_its_peak_by_a_per_cent_at_most(two):
    path = second_wheel.wheel_path(SHAPE, two.wheel.radius_m)
    alone = two.peak(path, 0.0)
    engine = GreensFunctionModel(two.track, two.wheel).peak_map(path, [160.0], [0.0]).peak_force_n[0, 0]
    assert alone == pytest.approx(engine, rel=1e-5)  # between steps, the engine takes a parabola's vertex
    ahead, behind = (two.peak(path, 0.0, steps) / alone - 1 for steps in (DISTANCE_STEPS, -DISTANCE_STEPS))
    assert 1e-4 < abs(ahead) < 1e-2
    assert 1e-4 < abs(behind) < 1e-2


def test_far_away_wheels_do_not_meet(two: second_wheel.TwoWheels):
    path = second_wheel.wheel_path(SHAPE, two.wheel.radius_m)
    assert two.peak(path, 0.0, -20 * DISTANCE_STEPS) == pytest.approx(two.peak(path, 0.0), rel=1e-4)
