"""Choose the places at which the worst between two speeds of a map can be, from the map.

Force varies with speed by resonances that are wider than a few km/h, so that between neighbouring speeds of the map it
is near the line between them: as near as what the map bends there. What cannot be the worst of any column even
so is not simulated. Checked against simulating everything by `tests/simulation/test_worst_places.py`.
"""

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.worst_speeds import dynamic_parts

FARTHEST_KMH = 5.0
"""Distance of neighbouring speeds from which on a map does not tell what is between them."""

_OF_BEND = 0.75


def possibly_worst(nominal: Passages, speeds_kmh: FloatArray, between_kmh: FloatArray) -> NDArray[np.bool_]:
    """Return at which places the worst can be, (n_between, n_place).

    Args:
        nominal: (n_speed, n_place), of the map.
        speeds_kmh: (n_speed,), of the map, increasing.
        between_kmh: (n_between,), speeds inside the map's.
    """
    below = np.searchsorted(speeds_kmh, between_kmh, side="right") - 1
    apart_kmh = speeds_kmh[below + 1] - speeds_kmh[below]
    share = ((between_kmh - speeds_kmh[below]) / apart_kmh)[:, None]
    possible = np.repeat((apart_kmh > FARTHEST_KMH * (1 + 1e-9))[:, None], nominal.peak_force_n.shape[1], axis=1)
    for part in dynamic_parts(nominal, list(nominal.columns)):
        line = part[below] * (1 - share) + part[below + 1] * share
        margin = _OF_BEND * np.maximum(_bend(part)[below], _bend(part)[below + 1])[:, None]
        most = line.max(axis=1, keepdims=True)
        possible |= (most > 0) & (line >= most - 2 * margin)
    return possible


def _bend(part: FloatArray) -> FloatArray:
    """Return the second difference at each speed, the mean over places, (n_speed,); at the ends the next one's."""
    if len(part) < 3:
        return np.full(len(part), np.inf)
    return np.pad(np.abs(np.diff(part, 2, axis=0)).mean(axis=1), 1, mode="edge")
