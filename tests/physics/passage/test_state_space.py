"""Dense steps against modal ones: the same oscillators written as a companion system."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lsim, lti

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.state_space import Propagation, dense_propagation, exponentials
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over

POLES = np.array([-300.0 + 1900.0j, -1500.0 + 5200.0j])
RESIDUES = np.array([-3.0e-6j, -1.0e-6j])
SCALE = 2000.0


def companion() -> tuple[np.ndarray, np.ndarray]:
    """A and c of eq. (3b), (3c) in time scaled by `SCALE`, from the poles' polynomials."""
    both, weights = np.concatenate([POLES, POLES.conj()]) / SCALE, np.concatenate([RESIDUES, RESIDUES.conj()]) / SCALE
    a = np.poly(both).real
    b = sum(w * np.poly(np.delete(both, k)) for k, w in enumerate(weights)).real
    system = np.diag(np.ones(3), 1)
    system[-1] = -a[:0:-1]
    inputs = np.zeros(4)
    for k in range(4):
        inputs[k] = b[k] - sum(a[k - j] * inputs[j] for j in range(k))
    return system, inputs


class Companion:
    spacing_m = 0.6
    spans = 1
    uniform = True
    opposite_m = 0.6

    def propagation(self, at_m: np.ndarray, dt_s: float) -> Propagation:
        system, inputs = companion()
        at_rest = -np.linalg.solve(system, inputs)
        n = len(at_m)
        return dense_propagation(
            np.repeat(system[None] * SCALE * dt_s, n, 0), np.repeat(inputs[None] * SCALE * dt_s, n, 0), at_rest
        )


@pytest.mark.parametrize("size", [1e-6, 0.3, 5.0, 60.0])
def test_exponentials_are_those_of_scipy(size):
    matrices = size * np.random.default_rng(1).standard_normal((20, 10, 10)) / 10
    np.testing.assert_allclose(
        exponentials(matrices), expm(matrices), rtol=1e-9, atol=1e-10 * np.abs(expm(matrices)).max()
    )


def test_dense_steps_follow_a_force_as_scipy_does():
    step, force = Companion().propagation(np.zeros(1), 40e-6), np.sin(np.arange(400) * 0.05) + 1.0
    state, found = step.at_rest * force[0], []
    for n, f in enumerate(force):
        if n:
            state = step.transitions[0] @ state + step.drives[0] * force[n - 1]
        found.append(step.shapes[0] @ state + step.gains[0] * f)
    system, inputs = companion()
    oscillators = lti(system * SCALE, inputs[:, None] * SCALE, np.eye(4)[:1], [[0.0]])
    rest = -np.linalg.solve(system, inputs) * force[0]
    _, expected, _ = lsim(oscillators, force, 40e-6 * np.arange(400), X0=rest)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@pytest.mark.parametrize("speed_kmh", [30.0, 120.0, 280.0])
def test_a_wheel_rolls_alike_over_dense_and_modal_states(speed_kmh):
    wheel = Wheel(600.0, 1e5, 0.45, 93.7e9)
    x = np.linspace(-0.05, 0.05, 201)
    flat = wheel_path_over(x, cosine_dip(x, 0.1, 0.9e-3), 0.45)
    modal = VehicleTrackModel(PoleModel(POLES, RESIDUES[None], np.zeros(1), 0.6), wheel).peak_map(
        flat, [speed_kmh], [0.2]
    )
    dense = VehicleTrackModel(Companion(), wheel).peak_map(flat, [speed_kmh], [0.2])
    for one, other in ((dense.peak_force_n, modal.peak_force_n), (dense.peak_x_m, modal.peak_x_m)):
        np.testing.assert_allclose(one, other, rtol=1e-8)
