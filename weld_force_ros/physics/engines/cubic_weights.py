"""Cubic interpolation within one span, where the rail's slope has no kink."""

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray


def cubic_weights(place: FloatArray, last: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the four of the nodes 0 to `last` about each place, in steps of nodes, and their Lagrange weights.

    Args:
        place: (n,), from 0 to `last`, which is at least 3.
        last: the node at the span's end.

    Returns:
        (n, 4) each.
    """
    first = np.clip(np.floor(place).astype(np.int64) - 1, 0, last - 3)
    nodes = first[:, None] + np.arange(4)
    weights = np.ones((len(place), 4))
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[:, i] *= (place - nodes[:, j]) / (nodes[:, i] - nodes[:, j])
    return nodes, weights
