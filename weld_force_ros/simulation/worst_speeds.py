"""Choose the speeds at which a sample can be the worst, from the nominal map.

What is uncertain moves the force at one speed much as at the next, so that a sample's worst is near the nominal one:
measured over the bundled welds, eight speeds at each position, those within `MARGIN` of the worst, give the ends of
90 % intervals within 1 % of what all forty-eight give (`python -m benchmarks.uncertainty`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages

MARGIN = 0.15
"""Share of the dynamic part of the worst that a speed may lack and still count."""


def dynamic_parts(nominal: Passages, names: Sequence[str]) -> list[FloatArray]:
    """Return of each column what it departs from rest by, (n_speed, n_position): the larger the worse."""
    load_n, columns = nominal.static_load_n, nominal.columns
    rest = {"min_force_n": load_n, "contact_loss_s": 0.0}
    signs = {"min_force_n": -1.0}
    return [np.asarray(signs.get(name, 1.0) * (columns[name] - rest.get(name, load_n))) for name in names]


def near_worst(parts: Sequence[FloatArray], count: int, margin: float = MARGIN) -> NDArray[np.intp]:
    """Return indices of `count` speeds for each position, (n_position, count), increasing.

    Those within the margin of any criterion's worst at that position, every n-th where they are too many and always
    the worst itself; the next best where they are too few.

    Args:
        parts: of each criterion, (n_speed, n_position), the larger the worse; one without a positive value is ignored.
        count: of speeds; where there are fewer, the last is repeated.
        margin: share of the worst that a speed may lack.
    """
    worst = [part.max(axis=0) for part in parts]
    lacking = np.min(
        [
            np.where(most > 0, (most - part) / np.where(most > 0, most, 1.0), np.inf)
            for part, most in zip(parts, worst, strict=True)
        ],
        axis=0,
    )
    return np.stack([_thinned(column, count, margin) for column in lacking.T])


def _thinned(lacking: FloatArray, count: int, margin: float) -> NDArray[np.intp]:
    near = np.flatnonzero(lacking <= margin)
    if len(near) <= count:
        chosen = np.sort(np.argsort(lacking, kind="stable")[:count])
        return np.pad(chosen, (0, count - len(chosen)), mode="edge")
    chosen = near[np.rint(np.linspace(0, len(near) - 1, count)).astype(np.intp)]
    for speed in np.setdiff1d(np.flatnonzero(lacking <= 0), chosen):
        chosen[np.abs(chosen - speed).argmin()] = speed
    return np.sort(chosen)
