"""Interpolation within a span, against scipy's Lagrange polynomials through the nodes it names."""

import numpy as np
import pytest
from scipy.interpolate import lagrange

from weld_force_ros.physics.engines.cubic_weights import cubic_weights


@pytest.mark.parametrize("last", [3, 5, 30])
def test_values_are_those_of_the_cubic_through_the_nodes_about_each_place(last: int):
    place = np.linspace(0.0, last, 4 * last + 3)
    nodes, weights = cubic_weights(place, last)
    values = np.sin(1.3 * np.arange(last + 1))
    for at, own, shares in zip(place, nodes, weights, strict=True):
        near = np.clip(np.floor(at) - 1, 0, last - 3) + np.arange(4)
        assert own.tolist() == near.tolist()
        assert shares @ values[own] == pytest.approx(lagrange(near - at, values[own])(0.0), abs=1e-12)
