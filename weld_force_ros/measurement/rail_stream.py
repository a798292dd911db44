"""Keep a measuring trolley's samples of a rail's running surface as they come in, and cut windows out of them.

Ordinary irregularities of such a stream are handled so:

- A trolley reverses and passes a place again: the newest sample of a millimetre counts, and older ones left standing
  close between newer ones are dropped. Batches overlap: a sample sent again unchanged changes nothing.
- Samples come out of order by up to `JITTER_SAMPLES`: each counts where its chainage says.
- Heights or chainages that are not numbers: left out, and counted in `RailStream.unusable`.
- Gaps: bridged by a straight line up to `LARGEST_GAP_M`, refused where longer.

Samples are taken one by one, so that how they were split into batches cannot matter.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.shapes import STRAIGHTEDGE_LENGTH_M
from weld_force_ros.physics.arrays import FloatArray

STEP_M = 1e-3
KEPT_M = 30.0
LARGEST_GAP_M = 10e-3
JITTER_SAMPLES = 10

_FURTHEST_M = 1e8  # chainages beyond it are no chainages
_REACH = round(LARGEST_GAP_M / STEP_M / 2)  # on either side of a sample: dropping it leaves no longer gap
_ROUNDING_M = 1e-7  # by which ends and gaps may miss their bounds
_NEVER = -1


@dataclass(frozen=True)
class Window:
    """The rail about a place, as a straightedge of the window's length reads it.

    Attributes:
        chainage_m: of the window's centre.
        x_m: (n,) from the centre, `STEP_M` apart.
        z_m: (n,) heights, positive up, zero at both ends.
        conditioning: what was done to the samples, in words.
    """

    chainage_m: float
    x_m: FloatArray
    z_m: FloatArray
    conditioning: tuple[str, ...]


@dataclass(frozen=True)
class Missing:
    """Says why a window cannot be cut.

    Attributes:
        reason: what is missing, and where.
        remedy: what to do about it.
        awaited: whether it lies beyond all that was ever measured, so that it may come as the trolley goes on.
    """

    reason: str
    remedy: str
    awaited: bool


@dataclass(frozen=True)
class Stretch:
    """Rail measured without a gap: chainages on the grid of `STEP_M` and heights as measured, each (n,)."""

    chainage_m: FloatArray
    height_m: FloatArray


@dataclass(frozen=True)
class _Samples:
    chainage_m: FloatArray
    height_m: FloatArray
    dropped: int


class RailStream:
    """Keeps the newest sample of every millimetre, for `KEPT_M` of rail up to where the trolley is."""

    def __init__(self) -> None:
        slots = round(KEPT_M / STEP_M)
        self.unusable = 0
        self._cell = np.zeros(slots, dtype=np.int64)
        self._arrival = np.full(slots, _NEVER, dtype=np.int64)
        self._chainage_m = np.zeros(slots)
        self._height_m = np.zeros(slots)
        self._arrived = 0
        self._newest = 0
        self._extent_m = (np.inf, -np.inf)

    def push(self, chainage_m: ArrayLike, height_m: ArrayLike) -> None:
        """Take a batch of samples in the order measured, each (n,); heights positive up.

        Raises:
            InputError: shapes that differ or are not (n,); nothing of the batch was taken.
        """
        chainages, heights = np.asarray(chainage_m, dtype=np.float64), np.asarray(height_m, dtype=np.float64)
        if chainages.shape != heights.shape or chainages.ndim != 1:
            raise InputError(
                f"a batch holds chainages of shape {chainages.shape} and heights of shape {heights.shape}",
                "send one height for every chainage",
            )
        for chainage, height in zip(chainages.tolist(), heights.tolist(), strict=True):
            self._push_sample(chainage, height)

    def _push_sample(self, chainage_m: float, height_m: float) -> None:
        if not (abs(chainage_m) <= _FURTHEST_M and abs(height_m) < np.inf):
            self.unusable += 1
            return
        cell = round(chainage_m / STEP_M)
        slot = cell % len(self._cell)
        sent_again = self._chainage_m[slot] == chainage_m and self._height_m[slot] == height_m
        if sent_again and self._arrival[slot] != _NEVER:
            return
        self._cell[slot], self._arrival[slot], self._newest = cell, self._arrived, cell
        self._chainage_m[slot], self._height_m[slot] = chainage_m, height_m
        self._arrived += 1
        self._extent_m = (min(self._extent_m[0], chainage_m), max(self._extent_m[1], chainage_m))

    def window(self, centre_m: float, length_m: float = STRAIGHTEDGE_LENGTH_M) -> Window | Missing:
        """Return the rail about a place, resampled and levelled; or what is missing of it.

        Raises:
            InputError: a centre that is no chainage, or a length that is not between 20 steps and what is kept.
        """
        if not (abs(centre_m) <= _FURTHEST_M and 20 * STEP_M <= length_m <= KEPT_M):
            raise InputError(
                f"a window of {length_m:g} m at {centre_m:g} m cannot be cut",
                f"ask for {20 * STEP_M:g} to {KEPT_M:g} m",
            )
        steps = round(length_m / STEP_M)
        x = STEP_M * (np.arange(steps + 1) - steps / 2)
        first_m, last_m = centre_m + x[0], centre_m + x[-1]
        samples = self._between(first_m, last_m)
        missing = self._missing(samples.chainage_m, first_m, last_m)
        if missing:
            return missing
        z = np.interp(centre_m + x, samples.chainage_m, samples.height_m)
        widest_mm = 1e3 * float(np.diff(samples.chainage_m).max())
        notes = [f"resampled to {STEP_M * 1e3:g} mm by straight lines, the longest over {widest_mm:.3g} mm"]
        if samples.dropped:
            notes.append(f"{samples.dropped} samples dropped where a newer pass went over them")
        notes.append("straight line between the ends removed")
        return Window(centre_m, x, z - np.interp(x, x[[0, -1]], z[[0, -1]]), tuple(notes))

    def stretches(self) -> list[Stretch]:
        """Return the rail that is kept, in order of chainage, divided at gaps longer than `LARGEST_GAP_M`."""
        slots = np.flatnonzero((self._arrival != _NEVER) & self._is_kept(self._cell))
        slots = slots[np.argsort(self._chainage_m[slots])]
        gaps = np.flatnonzero(np.diff(self._chainage_m[slots]) > LARGEST_GAP_M + _ROUNDING_M)
        parts = [part for part in np.split(self._cell[slots], gaps + 1) if len(part)]
        return [_on_grid(self._in_cells(int(part[0]), int(part[-1]))) for part in parts]

    def _between(self, first_m: float, last_m: float) -> _Samples:
        """Return the samples from the last one at or before `first_m` to the first one at or after `last_m`, if any."""
        kept = self._in_cells(round(first_m / STEP_M) - 2 * _REACH, round(last_m / STEP_M) + 2 * _REACH)
        begin = max(int(np.searchsorted(kept.chainage_m, first_m + _ROUNDING_M)) - 1, 0)
        end = int(np.searchsorted(kept.chainage_m, last_m - _ROUNDING_M)) + 1
        return _Samples(kept.chainage_m[begin:end], kept.height_m[begin:end], kept.dropped)

    def _in_cells(self, first: int, last: int) -> _Samples:
        """Return the samples of consecutive cells, without those that a newer pass went over."""
        cells = np.arange(first, last + 1)
        slots = cells % len(self._cell)
        arrival = np.where((self._cell[slots] == cells) & self._is_kept(cells), self._arrival[slots], _NEVER)
        outdated = (arrival != _NEVER) & _is_outdated(arrival)
        current = slots[(arrival != _NEVER) & ~outdated]
        return _Samples(self._chainage_m[current], self._height_m[current], int(outdated.sum()))

    def _is_kept(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether cells lie within `KEPT_M` of the newest one: of rail farther away only remnants are left."""
        kept: NDArray[np.bool_] = np.abs(cells - self._newest) < len(self._cell)
        return kept

    def _missing(self, chainages_m: FloatArray, first_m: float, last_m: float) -> Missing | None:
        """Return the first gap between two places that is too long to be bridged, or leaves an end uncovered."""
        begins = np.any(chainages_m <= first_m + _ROUNDING_M)
        ends = np.any(chainages_m >= last_m - _ROUNDING_M)
        places = np.concatenate([[] if begins else [-np.inf], chainages_m, [] if ends else [np.inf]])
        gaps = np.flatnonzero(np.diff(places) > LARGEST_GAP_M + _ROUNDING_M)
        if not len(gaps):
            return None
        begin_m, end_m = max(float(places[gaps[0]]), first_m), min(float(places[gaps[0] + 1]), last_m)
        return Missing(
            f"no samples from {begin_m:.3f} to {end_m:.3f} m",
            f"measure there; a window needs both its ends and bridges {LARGEST_GAP_M * 1e3:g} mm at most",
            awaited=begin_m < self._extent_m[0] or end_m > self._extent_m[1],
        )


def _is_outdated(arrival: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether newer samples lie on both sides, near enough to leave no gap, later than jitter explains."""
    around = np.pad(arrival, _REACH, constant_values=_NEVER)
    newest = sliding_window_view(around, _REACH).max(axis=1)
    later: NDArray[np.bool_] = np.minimum(newest[: len(arrival)], newest[-len(arrival) :]) > arrival + JITTER_SAMPLES
    return later


def _on_grid(samples: _Samples) -> Stretch:
    first = np.ceil(samples.chainage_m[0] / STEP_M - 1e-6)
    last = np.floor(samples.chainage_m[-1] / STEP_M + 1e-6)
    grid = STEP_M * np.arange(first, last + 1)
    return Stretch(grid, np.interp(grid, samples.chainage_m, samples.height_m))
