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
        decisive = bounds.deciding({name: _middles(speeds) for name, speeds in asked.items()})
        selected = _filled(decisive, bounds.possible(asked), np.any(list(asked.values()), axis=0))
        bounds.add(selected, simulate(selected[~bounds.on_map]))


def _middles(speeds: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return of each run of speeds the middle one, which tells most of the others."""
    edges = np.flatnonzero(np.diff(speeds, prepend=False, append=False))
    middles = np.zeros_like(speeds)
    middles[(edges[::2] + edges[1::2] - 1) // 2] = True
    return middles


def _filled(decisive: Selection, possible: Selection, asked: NDArray[np.bool_]) -> Selection:
    """Add what takes no longer, as a place's speeds are simulated side by side, and is likely to be needed next.

    Args:
        decisive: (n_speed, n_place), what is simulated in any case.
        possible: (n_speed, n_place), what can be the worst: at speeds that are asked for first, the nearest first.
        asked: (n,), which of the first speeds are asked for.
    """
    places = np.flatnonzero(decisive.any(axis=0))
    chosen, count = decisive[:, places], len(decisive)
    rows, never = np.arange(count)[:, None], 4 * count
    before = np.maximum.accumulate(np.where(chosen, rows, -count), axis=0)
    after = np.minimum.accumulate(np.where(chosen, rows, 2 * count)[::-1], axis=0)[::-1]
    rank = np.minimum(rows - before, after - rows)
    rank[: len(asked)][asked] -= count
    rank = np.where(chosen, -never, np.where(possible[:, places], rank, never))
    octets = -(-np.count_nonzero(chosen, axis=0) // SPEEDS)
    nearest = np.argsort(rank, axis=0, kind="stable")
    taken = (rows < SPEEDS * octets) & (np.take_along_axis(rank, nearest, axis=0) < never)
    np.put_along_axis(chosen, nearest, taken, axis=0)
    filled = np.zeros_like(decisive)
    filled[:, places] = chosen
    return filled
