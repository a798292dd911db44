"""What passages of one speed share, and the extremes of the force on smooth rail near supports that differ."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.steady_state import SteadyState, SteadyStateSolver

TRANSIENT_WINDOW_S = 0.0125
RUN_OUT_S = 0.3
NEGLIGIBLE = 2e-4  # of the static load: a transient that is not waited for
_NEGLIGIBLE_IN_WINDOW = 1e-3  # where smooth rail near a support that differs is the peak


@dataclass(frozen=True)
class SpeedTables:
    """A speed, with the window through which a transient has to have decayed and the longest run-out, in steps."""

    steady_state: SteadyState
    window: int
    run_out: int


def speed_tables(solver: SteadyStateSolver, stride: int, speed_kmh: float) -> SpeedTables:
    """Compute the tables of a speed.

    Raises:
        NumericalError: the force on smooth rail does not settle.
    """
    window = solver.steps(stride, TRANSIENT_WINDOW_S * speed_kmh / 3.6)
    run_out = solver.steps(stride, max(solver.model.spacing_m, RUN_OUT_S * speed_kmh / 3.6))
    return SpeedTables(solver.steady_state(speed_kmh, stride), window, run_out)


def negligible_n(solver: SteadyStateSolver) -> float:
    """Return the transient that is not waited for."""
    share = NEGLIGIBLE if solver.model.uniform else _NEGLIGIBLE_IN_WINDOW
    return share * solver.wheel.static_load_n


class SmoothExtremes(NamedTuple):
    """Extremes of the force on smooth rail about the weld, met with rising x and against, each (n_speed, 2).

    Where all supports are alike they come in every span, and a passage has seen them. Where a few differ, the rail near
    them is part of what is asked for, whether or not the passage over the weld itself came to it.

    Attributes:
        highest_n: greatest force.
        highest_at: its place, in steps from sleeper 0 of the track.
        lowest_n: least force.
    """

    highest_n: FloatArray
    highest_at: FloatArray
    lowest_n: FloatArray

    @classmethod
    def of(cls, solver: SteadyStateSolver, stride: int, smooth_n: FloatArray) -> "SmoothExtremes":
        """Return those of forces (n_speed, n_grid)."""
        half = smooth_n.shape[1] // 4  # of a window; the period is two
        origins = [0, _image(solver) // stride]
        near = np.stack([smooth_n[:, (origin + np.arange(-half, half)) % smooth_n.shape[1]] for origin in origins])
        at = near.argmax(axis=2) - half + np.array(origins)[:, None]
        return cls(near.max(axis=2).T, at.T.astype(np.float64), near.min(axis=2).T)

    def add_to(
        self,
        found: FloatArray,
        solver: SteadyStateSolver,
        stride: int,
        speeds: NDArray[np.intp],
        starts: NDArray[np.int64],
    ) -> None:
        """Put these where they are beyond the results (n, n_column) of passages at `speeds` (n,) from `starts` (n,)."""
        image = _image(solver)
        against = (np.abs(starts - image) < np.abs(starts)).astype(np.intp)
        highest, at, lowest = (values[speeds, against] for values in self)
        found[:, 1] = np.where(highest > found[:, 0], at - starts / stride, found[:, 1])
        found[:, 0] = np.maximum(found[:, 0], highest)
        found[:, 2] = np.minimum(found[:, 2], lowest)


def _image(solver: SteadyStateSolver) -> int:
    """Return the grid point of sleeper 0 of the mirror image."""
    return round((solver.model.opposite_m - solver.model.spacing_m) / solver.grid_m)
