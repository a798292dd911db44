import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq

from weld_force_ros.physics.passage._contact import contact_force
from weld_force_ros.physics.passage.state_space import first_order_hold


def powers_of_ten(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most).map(lambda exponent: 10.0**exponent)


@given(free=powers_of_ten(-12, -1), compliance=powers_of_ten(-15, -5), hertz=powers_of_ten(8, 13))
@settings(max_examples=300)
def test_contact_force_is_the_root(free: float, compliance: float, hertz: float):
    # Solved for the indentation, in units of the free one.
    share = brentq(lambda v: 1 - v - compliance / free * hertz * (free * v) ** 1.5, 0.0, 1.0, xtol=1e-300, rtol=1e-14)
    assert contact_force(free, compliance, hertz) == pytest.approx(hertz * (free * share) ** 1.5, rel=1e-9)


@given(free=powers_of_ten(-12, -1))
def test_contact_without_compliance_is_the_hertz_law(free: float):
    assert contact_force(free, 0.0, 93.7e9) == pytest.approx(93.7e9 * free**1.5, rel=1e-12)


@given(gap=st.floats(-1.0, 0.0))
def test_separated_bodies_do_not_pull(gap: float):
    assert contact_force(gap, 1e-9, 93.7e9) == 0.0


@given(size=powers_of_ten(-7, 0.7), angle=st.floats(np.pi / 2, np.pi), dt=powers_of_ten(-6, -4))
def test_first_order_hold_is_the_matrix_exponential(size: float, angle: float, dt: float):
    pole = size / dt * np.exp(1j * angle)
    # q' = p q + f with f's slope as a third state
    step = expm(np.array([[pole * dt, dt, 0], [0, 0, dt], [0, 0, 0]]))
    new = step[0, 2] / dt
    old = step[0, 1] - new
    found = [part[0] for part in first_order_hold(np.array([pole]), dt)]
    np.testing.assert_allclose(found, [step[0, 0], old, new], rtol=1e-9)


PASSAGES = """
import json, sys
import numpy as np
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation import fit_store, track_file
definition = track_file.load("bilbao")
model = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
x = np.linspace(-0.05, 0.05, 201)
flat = wheel_path_over(x, cosine_dip(x, 0.1, 0.9e-3), 0.45)
peak_map = model.peak_map(flat, [200.0], [0.1], low_passed=True)
history = model.history(flat, 200.0, 0.1)
json.dump([peak_map.peak_force_n.tolist(), peak_map.peak_x_m.tolist(), peak_map.min_force_n.tolist(),
           peak_map.contact_loss_s.tolist(), peak_map.low_passed_n.tolist(), history.force_n.tolist(),
           history.rail_m.tolist()], sys.stdout)
"""


def passages(**environment: str) -> list[np.ndarray]:
    done = subprocess.run(
        [sys.executable, "-c", PASSAGES], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    return [np.array(values) for values in json.loads(done.stdout)]


@pytest.mark.slow
def test_compiled_kernel_equals_its_own_python():
    compiled, interpreted = passages(), passages(NUMBA_DISABLE_JIT="1")
    assert compiled[3][0, 0] > 0.0  # the flat at 200 km/h loses contact
    for fast, plain in zip(compiled, interpreted, strict=True):
        np.testing.assert_allclose(fast, plain, rtol=1e-7, atol=1e-7 * np.abs(plain).max())
