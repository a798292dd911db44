"""Bound the worst over places at speeds between those of a map, from the map and from what was simulated since.

Between speeds that were simulated, force at a place is near the cubic through two of them on either side: as near as
the fourth differences of the map say, those of the place and those of all places on average. From a curve that the map
resolves the cubic is off by 3/128 of a fourth difference, beside a kink by up to 3/8 of the largest. But the largest of
several peaks of a history is their maximum, whose kinks, where another peak becomes the largest, turn upwards: there
the curve lies below the cubic. Above it lie ripples that the map does not resolve. What rings on at a frequency f over
a distance d (1 kHz, where the sleepers' spacing is a half wave) passes through f d / v cycles, so that a ripple is the
wider, by v^2 in speed, the faster the passage. Margins of forces are therefore lessened upwards from `_RESOLVED_KMH`
on, and not widened upwards at low speeds. Least force, which stays at none once contact is lost, has the same margin
upwards as downwards.

What counts is that the worst over places lies within bounds. Of 348 welds on fourteen tracks (seeds 101 and 103 to 105,
a fifth of them three times as deep or read every 20 mm) none needed more than 0.77 of the margin upwards of peak and P2
force, 0.9 of that of least force, from the map alone. Margins downwards were chosen on fifty welds of seed 101, where
half of both shares is too little, and widened at the ends and at low speeds by what fifty of seed 2026 showed. All are
tested on other seeds and a measured weld (`tests/simulation/test_curve_bounds.py`, `python -m benchmarks.speed_advice
--seed 4711`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.worst_places import FARTHEST_KMH
from weld_force_ros.simulation.worst_speeds import dynamic_parts

OF_PLACE, OF_ALL = 0.2, 0.2
"""Margin midway between a map's speeds: shares of the largest fourth difference near them, of a place and of all."""
_AROUND = 2  # intervals of the map on either side whose fourth differences count
_AT_ONCE = 0.25  # of its margin: a place that is the worst by so much of it is simulated in the same round
_RESOLVED_KMH = 150.0  # from here on the margin upwards goes with the inverse speed,
_LEAST_ABOVE = 0.6  # down to so much of it
_AT_ENDS = 2.0  # times the margin, where the cubic has one speed on one side and three on the other
_OF_SPEED = 0.125  # distance of a map's speeds, as a share of the speed, from which on the margin grows with it
_LEAST = 1e-4  # of the static load, of a margin: steps of other lengths make as much of a difference
_LOSS_S = 3e-5  # of a margin of contact loss, which is counted in steps

Selection = NDArray[np.bool_]


@dataclass(frozen=True)
class WorstBetween:
    """The worst over places at each speed, (n_speed,): as mild and as severe as it can be, and as it is expected.

    Where mildest and severest of a column agree, it was simulated.
    """

    mildest: Passages
    severest: Passages
    expected: Passages

    def up_to(self, count: int) -> "WorstBetween":
        """Return the first so many speeds."""
        return WorstBetween(*(one.at(slice(count)) for one in (self.mildest, self.severest, self.expected)))


class CurveBounds:
    """What is known of every speed and place, closer with every passage.

    Attributes:
        speeds_kmh: (n_speed,), increasing, those of the map among them.
        simulated: (n_speed, n_place), which passages are known.
        on_map: (n_speed,), which speeds are those of the map.
    """

    def __init__(self, nominal: Passages, map_kmh: FloatArray, speeds_kmh: FloatArray) -> None:
        """Bound by what a map shows.

        Args:
            nominal: (n_map_speed, n_place), of the map.
            map_kmh: (n_map_speed,), increasing.
            speeds_kmh: (n_speed,), increasing, those of the map among them.
        """
        self._load_n, self._names, self.speeds_kmh = nominal.static_load_n, list(nominal.columns), speeds_kmh
        parts = np.stack(dynamic_parts(nominal, self._names))
        rows = np.searchsorted(speeds_kmh, map_kmh)
        interval = np.clip(np.searchsorted(map_kmh, speeds_kmh, side="right") - 1, 0, max(0, len(map_kmh) - 2))
        self._apart_kmh = np.append(np.diff(map_kmh), 1.0)[interval]
        self.simulated: Selection = np.zeros((len(speeds_kmh), parts.shape[2]), dtype=np.bool_)
        self.simulated[rows] = True
        self.on_map = self.simulated[:, 0].copy()
        self._scale = _scale(parts)[:, interval]
        # In memory speeds follow each other: the worst over places is then taken of many speeds at a time.
        self._expected = np.zeros((len(self._names), parts.shape[2], len(speeds_kmh))).swapaxes(1, 2)
        self._expected[:, rows] = parts
        self._low, self._high = self._expected.copy(order="K"), self._expected.copy(order="K")
        self._bound(*np.nonzero(~self.simulated))

    @property
    def unbounded(self) -> NDArray[np.bool_]:
        """At which speeds (n_speed,) the map tells nothing."""
        far = self._apart_kmh > FARTHEST_KMH * (1 + 1e-9)
        return np.asarray(~self.on_map & (far | (np.count_nonzero(self.on_map) < 5)))

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """At which speeds (n_speed,) the worst of every column was simulated."""
        return np.asarray((self._low.max(axis=2) == self._high.max(axis=2)).all(axis=0))

    @property
    def worst(self) -> WorstBetween:
        """The worst over places at every speed."""
        low, high, expected = (parts.max(axis=2) for parts in (self._low, self._high, self._expected))
        return WorstBetween(*map(self._passages, (low, high, expected)))

    @property
    def expected(self) -> Passages:
        """All passages (n_speed, n_place), as they are known or expected."""
        return self._passages(self._expected)

    def deciding(self, open_speeds: Mapping[str, NDArray[np.bool_]]) -> Selection:
        """Return the passages to simulate next for columns at speeds (n_speed,): where the worst may be."""
        selected = np.zeros_like(self.simulated)
        for name, rows in ((name, np.flatnonzero(mask)) for name, mask in open_speeds.items()):
            column = self._names.index(name)
            high, expected = self._high[column, rows], self._expected[column, rows]
            can = (high >= self._low[column, rows].max(axis=1, keepdims=True)) & ~self.simulated[rows]
            likely = expected + _AT_ONCE * (high - expected) >= expected.max(axis=1, keepdims=True)
            selected[rows] |= can & (likely | (high >= high.max(axis=1, keepdims=True)))
        return selected

    def possible(self, names: Iterable[str]) -> Selection:
        """Return the passages that were not simulated and can be the worst of a column at their speed."""
        columns = [self._names.index(name) for name in names]
        can = self._high[columns] >= self._low[columns].max(axis=2, keepdims=True)
        return np.asarray(can.any(axis=0) & ~self.simulated)

    def add(self, selected: Selection, found: Passages) -> None:
        """Take in what was simulated.

        Args:
            selected: (n_speed, n_place), of which none is on the map.
            found: (n_between, n_place), at the speeds that are not on the map, where selected.
        """
        self.simulated |= selected
        parts = np.stack(dynamic_parts(found, self._names))[:, selected[~self.on_map]]
        for values in (self._expected, self._low, self._high):
            values[:, selected] = parts
        self._bound(*np.nonzero(self._between_the_same(selected) & ~self.simulated))

    def _between_the_same(self, selected: Selection) -> Selection:
        """Return the passages (n_speed, n_place) that lie between the same speeds of the map as one selected."""
        number = np.cumsum(self.on_map)
        touched = np.zeros((number[-1] + 1, selected.shape[1]), dtype=np.bool_)
        rows, places = np.nonzero(selected)
        touched[number[rows], places] = True
        return np.asarray(touched[number])

    def _bound(self, rows: NDArray[np.intp], places: NDArray[np.intp]) -> None:
        """Bound passages that were not simulated by what was at the same places."""
        if not len(rows) or np.count_nonzero(self.on_map) < 4:
            return
        around = _neighbours(self.simulated, rows, places)
        at = self.speeds_kmh[around]
        weights = _lagrange(at, self.speeds_kmh[rows])
        expected = sum(weights[k] * self._expected[:, around[k], places] for k in range(4))
        gap_kmh = at[2] - at[1]
        share = (self.speeds_kmh[rows] - at[1]) / gap_kmh
        near = gap_kmh / self._apart_kmh[rows] * 4 * share * (1 - share)
        at_end = (around[0] > around[1]) | (around[3] < around[2])
        near *= np.where(at_end, _AT_ENDS, 1.0)
        margin, least = near * self._scale[:, rows, places], self._least[:, None]
        slow = np.maximum(1.0, self._apart_kmh[rows] / (_OF_SPEED * self.speeds_kmh[rows]))
        resolved = np.clip(_RESOLVED_KMH / self.speeds_kmh[rows], _LEAST_ABOVE, 1.0)
        low, high = expected - slow * margin - least, expected + resolved * margin + least
        unloading, loss = self._names.index("min_force_n"), self._names.index("contact_loss_s")
        high[[unloading, loss]] = (expected + slow * margin + least)[[unloading, loss]]
        high[unloading] = np.minimum(high[unloading], self._load_n)
        high[loss] = np.where(high[unloading] < self._load_n, 0.0, np.maximum(high[loss], _LOSS_S))
        low[loss] = np.maximum(low[loss], 0.0)
        low = np.minimum(low, high)
        self._low[:, rows, places], self._high[:, rows, places] = low, high
        self._expected[:, rows, places] = np.clip(expected, low, high)

    @property
    def _least(self) -> FloatArray:
        return np.array([_LOSS_S if name == "contact_loss_s" else _LEAST * self._load_n for name in self._names])

    def _passages(self, parts: FloatArray) -> Passages:
        """Return what parts beyond rest (n_column, ...) are in the units of messages."""
        columns: dict[str, FloatArray | None] = {"p2_force_n": None, "force_20hz_n": None}
        for name, part in zip(self._names, parts, strict=True):
            sign, rest = (-1.0, self._load_n) if name == "min_force_n" else (1.0, self._load_n)
            columns[name] = part if name == "contact_loss_s" else rest + sign * part
        return Passages(self._load_n, **columns)  # type: ignore[arg-type]


def _scale(parts: FloatArray) -> FloatArray:
    """Return by how much a cubic can miss between a map's speeds, (n_column, n_map_speed, n_place)."""
    count = parts.shape[1]
    if count < 5:
        return np.full_like(parts, np.inf)
    fourth = np.pad(np.abs(np.diff(parts, 4, axis=1)), ((0, 0), (2, 2), (0, 0)), mode="edge")
    padded = np.pad(fourth, ((0, 0), (_AROUND, _AROUND + 1), (0, 0)), mode="edge")
    largest = np.max([padded[:, k : k + count] for k in range(2 * _AROUND + 2)], axis=0)
    return np.asarray(OF_PLACE * largest + OF_ALL * largest.mean(axis=2, keepdims=True))


def _neighbours(known: Selection, rows: NDArray[np.intp], places: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the four speeds nearest to some (n,) that are known at their places (n,), two on either side, (4, n).

    At the ends a third on the other side stands in for one that is missing. Each place has four or more.
    """
    count, every = len(known), np.arange(len(known))[:, None]
    up_to = np.full((count + 1, known.shape[1]), -1)  # at row + 1: the last known up to that row
    np.maximum.accumulate(np.where(known, every, -1), axis=0, out=up_to[1:])
    from_on = np.full((count + 2, known.shape[1]), count)  # at row: the first known from that row on
    np.minimum.accumulate(np.where(known, every, count)[::-1], axis=0, out=from_on[count - 1 :: -1])

    def previous(row: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.asarray(up_to[row, places])

    def following(row: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.asarray(from_on[row + 1, places])

    before, after = previous(rows), following(rows)
    first, last = previous(before), following(after)
    return np.stack([
        np.where(first >= 0, first, following(last)),
        before,
        after,
        np.where(last < count, last, previous(first)),
    ])  # fmt: skip


def _lagrange(at: FloatArray, x: FloatArray) -> FloatArray:
    """Return the weights (4, n) of values at four places (4, n) in the cubic's value at x."""
    weights = np.ones_like(at)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (x - at[j]) / (at[i] - at[j])
    return weights
