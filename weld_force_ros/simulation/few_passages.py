"""Simulate of every sample only what can be the worst, and what follows from that.

Three things keep it few. At each position a sample passes at eight speeds near the nominal worst (`worst_speeds`).
Stiffness acts smoothly: samples are simulated with the nearest of a few levels of support and contact, and corrected by
the response of the nominal geometry between the levels, of which there are more where contact is lost: that is less
smooth. Forces below 120 and 20 Hz hardly vary with the geometry: they
are simulated at two places, and the ratio to the nominal map is carried from there to the others.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.messages import Uncertainty
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.lane_tables import AT_ONCE, LaneTables, Places, places_over
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPathRoller
from weld_force_ros.physics.threads import executor, thread_count
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.uncertainty import Draws
from weld_force_ros.simulation.worst_speeds import dynamic_parts, near_worst

_IMPACT = ("peak_force_n", "min_force_n", "contact_loss_s")
_LOW_PASSED = ("p2_force_n", "force_20hz_n")
# Deviations of logarithms.
_SUPPORT = (-1.6, 0.0, 1.6)
_SUPPORT_OF_IMPACTS = (-1.6, -0.8, 0.0, 0.8, 1.6)
_HERTZ = (-0.8, 0.8)


def support_levels(unknown: Uncertainty, *, contact_lost: bool = True) -> FloatArray:
    """Return the factors on the supports' stiffness that are simulated; fewer where no contact is lost."""
    return _factors(unknown.support_spread, _SUPPORT_OF_IMPACTS if contact_lost else _SUPPORT)


def _factors(spread: float, deviations: Sequence[float]) -> FloatArray:
    return np.asarray(np.exp(spread * np.array(deviations if spread else (0.0,))))


class _Levels:
    """Samples among the levels of stiffness, each pair of which has its tables.

    Attributes:
        support: (n_support,), factors.
        hertz: (n_hertz,), factors.
        nearest: (n_sample,), number of the pair that a sample is simulated with.
        response: (n_sample, n_pair), weights of all pairs' values in that at a sample's own stiffness.
    """

    def __init__(self, support: FloatArray, hertz: FloatArray, draws: Draws) -> None:
        self.support, self.hertz = support, hertz
        own = ((self.support, draws.support_factor), (self.hertz, draws.hertz_factor))
        nearest_support, nearest_hertz = (_nearest(levels, factors) for levels, factors in own)
        self.nearest = nearest_support * len(self.hertz) + nearest_hertz
        weights = [_between(np.log(levels), np.log(factors)) for levels, factors in own]
        self.response = np.einsum("is,ih->ish", *weights).reshape(len(self.nearest), -1)

    @property
    def pairs(self) -> list[tuple[float, float]]:
        """Factors of support and contact of every pair."""
        return list(product(self.support.tolist(), self.hertz.tolist()))

    def at_own(self, name: str, found: FloatArray, nominal: FloatArray) -> FloatArray:
        """Return values (n_sample, n) at each sample's own stiffness, from those found with its nearest pair.

        Forces are multiplied by the nominal geometry's ratio, what can be zero is moved by its difference.

        Args:
            name: of the column.
            found: (n_sample, n).
            nominal: (n_pair, n), of the nominal geometry.
        """
        there, here = self.response @ nominal, nominal[self.nearest]
        if name == "min_force_n":
            return np.asarray(np.maximum(0.0, found + there - here))
        if name == "contact_loss_s":
            return np.where(found > 0, np.maximum(0.0, found + there - here), 0.0)
        return np.asarray(found * there / here)


@dataclass(frozen=True)
class _Choice:
    """Positions at which columns are simulated, each at its speeds.

    Attributes:
        names: of the columns.
        positions: (n,), indices.
        speeds: (n, a multiple of `AT_ONCE`), indices.
    """

    names: Sequence[str]
    positions: NDArray[np.intp]
    speeds: NDArray[np.intp]

    @classmethod
    def of(cls, nominal: Passages, names: Sequence[str], positions: NDArray[np.intp], count: int) -> "_Choice":
        """Choose the speeds near the nominal worst."""
        parts = dynamic_parts(nominal.at(np.s_[:, positions]), names)
        return cls(names, positions, near_worst(parts, count))

    @property
    def blocks(self) -> NDArray[np.intp]:
        """Speeds as `LaneTables.peaks` takes them, (n_place, AT_ONCE)."""
        return self.speeds.reshape(-1, AT_ONCE)

    @property
    def places(self) -> NDArray[np.intp]:
        """Positions as `LaneTables.peaks` takes them, (n_place,)."""
        return np.repeat(self.positions, self.speeds.shape[1] // AT_ONCE)

    def worst(self, peak_map: PeakMap, static_load_n: float) -> dict[str, FloatArray]:
        """Return the worst over speeds, by name, (n_sample, n)."""
        worst = Passages.of_peak_map(peak_map, static_load_n)
        by_place = worst.reshaped((-1, len(self.positions), self.speeds.shape[1])).worst(axis=2)
        return {name: by_place.columns[name] for name in self.names}


class FewPassages:
    """Simulates samples where they can be the worst; tables are kept from weld to weld.

    Args:
        models: the track by factor of its supports, of `support_levels`.
        wheel: the nominal one.
        unknown: whose spreads give the levels.
        draws: the samples.
        threads: that compute; one a core, if None.
        patch_m: half length of the contact patch that heights are averaged over; 0: none.
        contact_lost: whether more levels are simulated, for geometries over which the wheel loses contact.
    """

    def __init__(
        self,
        models: Mapping[float, StateModel],
        wheel: Wheel,
        unknown: Uncertainty,
        draws: Draws,
        threads: int | None,
        patch_m: float = 0.0,
        *,
        contact_lost: bool,
    ) -> None:
        self._wheel, self._draws, self._threads, self._patch_m = wheel, draws, thread_count(threads), patch_m
        support = support_levels(unknown, contact_lost=contact_lost)
        self._levels = _Levels(support, _factors(unknown.hertz_spread, _HERTZ), draws)
        self._solvers = [
            SteadyStateSolver(models[support], replace(wheel, hertz_n_per_m15=wheel.hertz_n_per_m15 * hertz))
            for support, hertz in self._levels.pairs
        ]
        self._tables: tuple[FloatArray, list[LaneTables]] = np.empty(0), []

    @property
    def size_bytes(self) -> int:
        """What the tables take of memory."""
        return sum(tables.size_bytes for tables in self._tables[1])

    def serves(self, speeds_kmh: FloatArray) -> bool:
        """Return whether the longest step is short enough at all speeds."""
        solver = self._solvers[0]
        return all(solver.coarsest_stride(speed) == solver.longest_stride for speed in speeds_kmh.tolist())

    def worst(
        self, x_m: FloatArray, z_m: FloatArray, samples_m: FloatArray, positions_m: FloatArray,
        speeds_kmh: FloatArray, nominal: Passages,
    ) -> Passages:  # fmt: skip
        """Return the worst over speeds of every sample at every position, (n_sample, n_position).

        Args:
            x_m: (n,), increasing.
            z_m: (n,), the nominal geometry.
            samples_m: (n_sample, n).
            positions_m: (n_position,).
            speeds_kmh: (n_speed,), increasing.
            nominal: (n_speed, n_position), of the nominal geometry, wheel and track.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        choices = [_impact(nominal), _low_passed(nominal, positions_m, self._solvers[0].model.spacing_m)]
        geometries = np.concatenate([samples_m, z_m[None]])
        radii = np.append(self._draws.wheel_radius_m, self._wheel.radius_m)
        with executor(self._threads) as pool:
            tables = self._tables_at(speeds_kmh, pool)
            start_m, paths_m = self._rolled(x_m, geometries, radii, pool)
            places = [
                places_over(self._solvers[0], paths_m, start_m, RESAMPLED_STEP_M, positions_m[choice.places])
                for choice in choices
            ]
            found = list(pool.map(partial(self._simulated, choices, places), range(len(tables)), tables))
        columns: dict[str, FloatArray] = {}
        for number, choice in enumerate(choices):
            columns |= self._gathered(choice, [of_pair[number] for of_pair in found])
        low = choices[1]
        for name in low.names:
            columns[name] = _carried(columns[name], nominal.columns[name], low, positions_m, self._span_m)
        return Passages(nominal.static_load_n, **columns)

    @property
    def _span_m(self) -> float:
        return self._solvers[0].model.spacing_m

    def _tables_at(self, speeds_kmh: FloatArray, pool: Executor) -> list[LaneTables]:
        """Return every pair's tables: those at hand if these speeds are their first ones."""
        known_kmh, tables = self._tables
        if not np.array_equal(known_kmh[: len(speeds_kmh)], speeds_kmh):
            tables = list(pool.map(partial(LaneTables, speeds_kmh=speeds_kmh), self._solvers))
            self._tables = speeds_kmh, tables
        return tables

    def _rolled(
        self, x_m: FloatArray, geometries_m: FloatArray, radii_m: FloatArray, pool: Executor
    ) -> tuple[float, FloatArray]:
        """Return where the wheel's paths begin, and their heights (n_geometry, n_height)."""
        rolled = WheelPathRoller(x_m, geometries_m, radii_m, self._patch_m)
        parts = np.array_split(np.arange(len(radii_m)), self._threads)
        return rolled.start_m, np.concatenate(list(pool.map(rolled.heights, parts)))

    def _simulated(
        self, choices: Sequence[_Choice], places: Sequence[Places], pair: int, tables: LaneTables
    ) -> list[dict[str, FloatArray]]:
        """Return for each choice the worst over speeds of a pair's samples, and of the nominal geometry as the last."""
        rows = np.append(np.flatnonzero(self._levels.nearest == pair), len(self._levels.nearest))
        return [
            choice.worst(
                tables.peaks(own.of(rows), choice.blocks, low_passed=choice.names == _LOW_PASSED),
                self._wheel.static_load_n,
            )
            for choice, own in zip(choices, places, strict=True)
        ]

    def _gathered(self, choice: _Choice, by_pair: Sequence[Mapping[str, FloatArray]]) -> dict[str, FloatArray]:
        """Return columns (n_sample, n) in the samples' order and at their own stiffness."""
        order = np.argsort(self._levels.nearest, kind="stable")
        columns = {}
        for name in choice.names:
            found = np.empty((len(order), len(choice.positions)))
            found[order] = np.concatenate([of_pair[name][:-1] for of_pair in by_pair])
            columns[name] = self._levels.at_own(name, found, np.stack([of_pair[name][-1] for of_pair in by_pair]))
        return columns


def _impact(nominal: Passages) -> _Choice:
    """Choose for what the unfiltered force decides; more speeds where contact is lost, which jumps about."""
    positions = np.arange(nominal.peak_force_n.shape[1])
    return _Choice.of(nominal, _IMPACT, positions, 4 * AT_ONCE if np.any(nominal.contact_loss_s > 0) else AT_ONCE)


def _low_passed(nominal: Passages, positions_m: FloatArray, span_m: float) -> _Choice:
    """Choose for low-passed forces: the position of the worst, and the one that is half a span from there."""
    at = int(nominal.columns["p2_force_n"].max(axis=0).argmax())
    opposite = int(np.cos(2 * np.pi * (positions_m - positions_m[at]) / span_m).argmin())
    return _Choice.of(nominal, _LOW_PASSED, np.unique([at, opposite]), AT_ONCE)


def _carried(
    found: FloatArray, nominal: FloatArray, choice: _Choice, positions_m: FloatArray, span_m: float
) -> FloatArray:
    """Return values (n_sample, n_position) whose ratio to the nominal worst is a mean and a wave over the span."""
    known = nominal[choice.speeds, choice.positions[:, None]].max(axis=1)
    phases = 2 * np.pi * (positions_m - positions_m[choice.positions[0]]) / span_m
    waves = np.stack([np.ones_like(phases), np.cos(phases)], axis=1)
    carried = (found / known) @ (waves @ np.linalg.pinv(waves[choice.positions])).T
    return np.asarray(nominal.max(axis=0) * carried)


def _nearest(levels: FloatArray, factors: FloatArray) -> NDArray[np.intp]:
    return np.asarray(np.abs(np.log(factors)[:, None] - np.log(levels)).argmin(axis=1))


def _between(knots: FloatArray, at: FloatArray) -> FloatArray:
    """Return weights (n, n_knot) of values at knots: the parabola through the three nearest, a line through two."""
    weights = np.zeros((len(at), len(knots)))
    order = min(3, len(knots))
    first = np.clip(np.abs(at[:, None] - knots).argmin(axis=1) - 1, 0, len(knots) - order)
    rows = np.arange(len(at))
    for i in range(order):
        weight = np.ones(len(at))
        for other in range(order):
            if other != i:
                weight *= (at - knots[first + other]) / (knots[first + i] - knots[first + other])
        weights[rows, first + i] = weight
    return weights
