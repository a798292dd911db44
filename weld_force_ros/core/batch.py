"""Speeds that roll together: their tables, made once, and passages over a weld at all of them.

Where states come in pairs of common poles, sixteen speeds at two positions advance side by side in vector registers;
dense transitions, and code that is not compiled, roll one passage after the other.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from weld_force_ros.core import _kernel
from weld_force_ros.core._vector import LANES, SPEEDS
from weld_force_ros.core.rolling import Roller
from weld_force_ros.core.track import Real
from weld_force_ros.core.weld import Trajectory

ECHO_S = 0.0125
RUN_OUT_S = 0.3
NEGLIGIBLE = 2e-4  # of the static load: an echo that is not waited for
# Lanes exist in compiled code only.
SIDE_BY_SIDE = not numba.config.DISABLE_JIT

Columns = NDArray[np.intp]
Steps = NDArray[np.int64]


@dataclass(frozen=True)
class Approaches:
    """A weld at several positions, in steps of a stride.

    Attributes:
        starts: (n_position,), points of the grid, ones that every stride meets, where the passages begin.
        ends: (n_position,), steps from there until the weld is behind.
        irregularity_m: (n_position, n), step by step from the start: the paper's r, positive down.
    """

    starts: Steps
    ends: Steps
    irregularity_m: Real


def approaches(roller: Roller, trajectory: Trajectory, positions_m: Real, stride: int) -> Approaches:
    """Where the passages over a weld at `positions_m` (n_position,) begin and end, and what they roll over."""
    first_m, last_m = trajectory.uneven_m
    starts = np.array([roller.start(position + first_m) for position in positions_m])
    step_m = stride * roller.grid_m
    ends = np.ceil((positions_m + last_m - starts * roller.grid_m) / step_m).astype(np.int64)
    along = starts[:, None] + stride * np.arange(ends.max() + 1)
    return Approaches(starts, ends, -trajectory.at(along * roller.grid_m - positions_m[:, None]))


class Batch:
    """Up to `SPEEDS` speeds of one stride."""

    def __init__(self, roller: Roller, speeds_kmh: Real, stride: int) -> None:
        """Make the tables.

        Raises:
            NumericalError: the force on smooth rail does not settle at a speed.
        """
        self._roller, self.stride, self.count = roller, stride, len(speeds_kmh)
        self._negligible_n = NEGLIGIBLE * roller.wheel.static_load_n
        rollings = [roller.rolling(float(speed), stride) for speed in speeds_kmh]
        windows = [roller.steps(stride, ECHO_S * speed / 3.6) for speed in speeds_kmh]
        run_outs = [roller.steps(stride, max(roller.model.spacing_m, RUN_OUT_S * speed / 3.6)) for speed in speeds_kmh]
        self._side_by_side = SIDE_BY_SIDE and len(rollings[0].step.transitions) == 0
        if self._side_by_side:
            self._drives = rollings[0].step.drives
            self._decay = _lanes([r.step.decay for r in rollings])
            self._turn = _lanes([r.step.turn for r in rollings])
            self._dts = _lanes([np.array(r.dt_s) for r in rollings])
            self._windows, self._run_outs = (_lanes([np.array(n) for n in steps]) for steps in (windows, run_outs))
            self._smooth = _filled([r.smooth_n for r in rollings])
            self._gains = _filled([r.step.gains for r in rollings])
            self._states = _filled([r.states for r in rollings])
        else:
            self._alone = list(zip(rollings, windows, run_outs, strict=True))

    def peaks(self, weld: Approaches, columns: Columns) -> Real:
        """Every speed at some of the positions.

        Returns:
            (n_speed, n_column, 6): peak force, its place in steps from the start, least force, time without contact,
            largest second difference of the force, steps rolled. NaN where a passage did not stay finite.
        """
        return (self._peaks_in_lanes if self._side_by_side else self._peaks_alone)(weld, columns)

    def _peaks_in_lanes(self, weld: Approaches, columns: Columns) -> Real:
        pairs = np.concatenate([columns, columns[len(columns) - len(columns) % 2 :]]).reshape(-1, 2)
        starts = weld.starts[pairs]
        at = starts // self._roller.longest_stride % len(self._states)
        # (n_pair, 2, n_state + 3, SPEEDS), then a lane for each of the two positions and each speed
        beginnings = self._states[at].transpose(0, 2, 1, 3).reshape(len(pairs), -1, LANES)
        found = np.empty((len(pairs), 2, SPEEDS, 6))
        _kernel.peaks_in_lanes(
            beginnings, self._decay, self._turn, self._drives, self._gains, starts // self.stride, weld.ends[pairs],
            self._windows, self._run_outs, self._smooth, self._negligible_n, weld.irregularity_m[pairs],
            self._roller.physics, self._dts, found.reshape(len(pairs), LANES, 6),
        )  # fmt: skip
        return found.reshape(-1, SPEEDS, 6)[: len(columns), : self.count].transpose(1, 0, 2)

    def _peaks_alone(self, weld: Approaches, columns: Columns) -> Real:
        starts = weld.starts[columns]
        results = np.empty((self.count, len(columns), 6))
        for (rolling, window, run_out), result in zip(self._alone, results, strict=True):
            step = rolling.step
            beginnings = np.stack([self._roller.beginning(rolling, start) for start in starts])
            _kernel.peaks_at_speed(
                beginnings, step.decay, step.transitions, step.drives, step.shapes, step.gains, starts // self.stride,
                weld.ends[columns], window, run_out, rolling.smooth_n, self._negligible_n,
                weld.irregularity_m[columns], self._roller.physics, rolling.dt_s, result,
            )  # fmt: skip
        return results


def _filled(arrays: list[Real]) -> Real:
    """Speeds along a last axis of `SPEEDS`; the last one fills what is left."""
    return np.stack(arrays + arrays[-1:] * (SPEEDS - len(arrays)), axis=-1)


def _lanes(arrays: list[Real]) -> Real:
    """Each speed twice, once for either position of a pair, along a last axis of `LANES`."""
    return np.tile(_filled(arrays), 2)
