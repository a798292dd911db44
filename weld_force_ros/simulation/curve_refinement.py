"""Simulate of a force-speed curve what its questions ask for, until bounds answer them all."""

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.messages import ForceMap
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage._simd import SPEEDS
from weld_force_ros.simulation.curve_bounds import CurveBounds, Selection, WorstBetween
from weld_force_ros.simulation.force_map_view import Passages


class CurveQuestions(Protocol):
    """What a curve is to answer as if every km/h had been simulated."""

    @property
    def limits_sha256(self) -> str:
        """Return the identity of the limits that the questions are of."""

    def open_speeds(self, speeds_kmh: FloatArray, worst: WorstBetween) -> Mapping[str, NDArray[np.bool_]]:
        """Return by column at which speeds (n_speed,) it is to be simulated; nothing where all is answered."""


Asks = Callable[[ForceMap], CurveQuestions]
"""Returns the questions about a weld, from its force map without a curve."""


def refine(
    bounds: CurveBounds, count: int, questions: CurveQuestions, simulate: Callable[[Selection], Passages]
) -> None:
    """Simulate passages until every question is answered.

    Args:
        bounds: of a curve, closer afterwards.
        count: of speeds that the questions are about, from the lowest on.
        questions: that are asked.
        simulate: returns passages (n_between, n_place) at the speeds between those of the map; what is not selected is
            not looked at.
    """
    if bounds.unbounded.any():
        everywhere = np.repeat(bounds.unbounded[:, None], bounds.simulated.shape[1], axis=1)
        bounds.add(everywhere, simulate(everywhere[~bounds.on_map]))
    while asked := questions.open_speeds(bounds.speeds_kmh[:count], bounds.worst.up_to(count)):
        selected = _with_neighbours(bounds.deciding(asked), bounds.simulated)
        bounds.add(selected, simulate(selected[~bounds.on_map]))


def _with_neighbours(selected: Selection, simulated: Selection) -> Selection:
    """Add what takes no longer, as it is simulated side by side: at the same places the speeds that are nearest."""
    rows, far = np.arange(len(selected))[:, None], 2 * len(selected)
    before = np.maximum.accumulate(np.where(selected, rows, -far), axis=0)
    after = np.minimum.accumulate(np.where(selected, rows, far)[::-1], axis=0)[::-1]
    apart = np.where(simulated, far, np.minimum(rows - before, after - rows))
    nearest = np.argsort(np.argsort(apart, axis=0, kind="stable"), axis=0)
    filled = SPEEDS * -(-np.count_nonzero(selected, axis=0) // SPEEDS)
    return np.asarray((nearest < filled) & (apart < far))
