"""Simulate of every sample only what can be the worst, and what follows from that.

Three things keep it few. At each position a sample passes at eight speeds near the nominal worst (`worst_speeds`), of
two directions in those in which it can be the worst there. Stiffness acts smoothly: samples are simulated with the
nearest of a few levels of support and contact, and corrected by the response of the nominal geometry between the
levels, of which there are more where contact is lost: that is less smooth. Forces below 120 and 20 Hz hardly vary with
the geometry: they are simulated at two places, and the ratio to the nominal map is carried from there to the others.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.messages import Direction, Uncertainty
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.lane_tables import LaneTables
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.sample_passages import AT_ONCE, MetPaths, Places, places_over, sample_peaks
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.steady_state import SteadyStateSolver
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPathRoller
from weld_force_ros.physics.threads import executor, thread_count
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.running import Run
from weld_force_ros.simulation.uncertainty import Draws
from weld_force_ros.simulation.worst_speeds import MARGIN, dynamic_parts, near_worst

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
    """Positions in a direction at which columns are simulated, each at its speeds.

    Attributes:
        names: of the columns.
        positions: (n,), indices; those of a second direction follow on those of the first.
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
        """Speeds as `sample_peaks` takes them, (n_place, AT_ONCE)."""
        return self.speeds.reshape(-1, AT_ONCE)

    @property
    def places(self) -> NDArray[np.intp]:
        """Positions as `sample_peaks` takes them, (n_place,)."""
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
        speeds_kmh: FloatArray, nominal: Mapping[Direction, Passages],
    ) -> Passages:  # fmt: skip
        """Return the worst over speeds of every sample at every position, (n_sample, n_position).

        Args:
            x_m: (n,), increasing.
            z_m: (n,), the nominal geometry.
            samples_m: (n_sample, n).
            positions_m: (n_position,).
            speeds_kmh: (n_speed,), increasing.
            nominal: (n_speed, n_position), of the nominal geometry, wheel and track, in each direction.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        beside = Passages.beside(list(nominal.values()))
        by_p2 = _by_p2(beside)
        choices = [*_impacts(beside, len(positions_m)), _low_passed(beside, by_p2, positions_m, self._span_m)]
        runs = [Run(direction, self._solvers[0].model.opposite_m) for direction in nominal]
        geometries = np.concatenate([samples_m, z_m[None]])
        radii = np.append(self._draws.wheel_radius_m, self._wheel.radius_m)
        with executor(self._threads) as pool:
            tables = self._tables_at(speeds_kmh)
            start_m, paths_m = self._rolled(x_m, geometries, radii, pool)
            places = [self._places(choice, runs, paths_m, start_m, positions_m) for choice in choices]
            found = list(pool.map(partial(self._simulated, choices, places), range(len(tables)), tables))
        *impacts, low = choices
        *by_impact, by_low = zip(*found, strict=True)
        gathered = [self._gathered(choice, own) for choice, own in zip(impacts, by_impact, strict=True)]
        places_of_impacts = np.concatenate([choice.positions for choice in impacts])
        columns = {
            name: _worst_by_position(
                name, np.concatenate([own[name] for own in gathered], axis=1), places_of_impacts, len(positions_m)
            )
            for name in _IMPACT
        }
        for name, values in self._gathered(low, by_low).items():
            phases = 2 * np.pi * (positions_m - positions_m[by_p2[-1] % len(positions_m)]) / self._span_m
            columns[name] = _carried(values, beside.columns[name], low, phases)
        return Passages(beside.static_load_n, **columns)

    def _places(
        self, choice: _Choice, runs: Sequence[Run], paths_m: FloatArray, start_m: float, positions_m: FloatArray
    ) -> Places:
        """Return the places of a choice, those of each direction over the paths as they are met."""
        end_m, directions = start_m + RESAMPLED_STEP_M * (paths_m.shape[1] - 1), list[MetPaths]()
        for number, run in enumerate(runs):
            own = choice.places[choice.places // len(positions_m) == number] % len(positions_m)
            if len(own) == 0:
                continue
            met, first_m = (paths_m, start_m) if run.direction == "with" else (paths_m[:, ::-1], -end_m)
            directions.append(MetPaths(np.ascontiguousarray(met), first_m, run.places(positions_m[own])))
        return places_over(self._solvers[0], RESAMPLED_STEP_M, directions)

    @property
    def _span_m(self) -> float:
        return self._solvers[0].model.spacing_m

    def _tables_at(self, speeds_kmh: FloatArray) -> list[LaneTables]:
        """Return every pair's tables: those at hand if these speeds are their first ones."""
        known_kmh, tables = self._tables
        if not np.array_equal(known_kmh[: len(speeds_kmh)], speeds_kmh):
            tables = [LaneTables(solver, speeds_kmh, solver.longest_stride) for solver in self._solvers]
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
                sample_peaks(tables, own, rows, choice.blocks, low_passed=choice.names == _LOW_PASSED),
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


def _impacts(nominal: Passages, count: int) -> list[_Choice]:
    """Choose for what the unfiltered force decides; more speeds where contact is lost, which jumps about.

    Of `count` positions each in the directions in which a sample can be the worst.
    """
    matters = np.zeros((nominal.peak_force_n.shape[1] // count, count), dtype=bool)
    for name, part in zip(_IMPACT, dynamic_parts(nominal, _IMPACT), strict=True):
        worst = part.max(axis=0).reshape(matters.shape)
        most = worst.max(axis=0)
        # Where no contact is lost in either direction, that says nothing about them.
        matters |= (worst >= (1 - MARGIN) * most) & ((most > 0) | (name == "peak_force_n"))
    lost = matters.ravel() & np.any(nominal.contact_loss_s > 0, axis=0)
    chosen = ((np.flatnonzero(matters.ravel() & ~lost), AT_ONCE), (np.flatnonzero(lost), 4 * AT_ONCE))
    return [_Choice.of(nominal, _IMPACT, positions, speeds) for positions, speeds in chosen if len(positions)]


def _by_p2(nominal: Passages) -> NDArray[np.intp]:
    """Return places by P2 force, the worst last; of equals by the peak, so that mirror images have theirs mirrored."""
    return np.lexsort([nominal.peak_force_n.max(axis=0), nominal.columns["p2_force_n"].max(axis=0)])


def _low_passed(nominal: Passages, by_p2: NDArray[np.intp], positions_m: FloatArray, span_m: float) -> _Choice:
    """Choose for low-passed forces: position and direction of the worst, and those half a span from there."""
    count, at = len(positions_m), int(by_p2[-1])
    from_there = np.cos(2 * np.pi * (positions_m - positions_m[at % count]) / span_m)
    farthest = by_p2[from_there[by_p2 % count] < from_there.min() + 1e-9]
    return _Choice.of(nominal, _LOW_PASSED, np.unique([at, farthest[-1]]), AT_ONCE)


def _worst_by_position(name: str, found: FloatArray, places: NDArray[np.intp], count: int) -> FloatArray:
    """Return the worst (n_sample, count) over the directions that were simulated at each position."""
    worst, no_worse = (np.minimum, np.inf) if name == "min_force_n" else (np.maximum, -np.inf)
    result = np.full((len(found), count), no_worse)
    for place, values in zip((places % count).tolist(), found.T, strict=True):
        result[:, place] = worst(result[:, place], values)
    return result


def _carried(found: FloatArray, nominal: FloatArray, choice: _Choice, phases: FloatArray) -> FloatArray:
    """Return values (n_sample, n_position) whose ratio to the nominal worst is a mean and a wave over the span.

    Args:
        found: (n_sample, n), of the choice's places.
        nominal: (n_speed, n_place).
        choice: of speeds and places.
        phases: (n_position,), of the wave.
    """
    known = nominal[choice.speeds, choice.positions[:, None]].max(axis=1)
    waves = np.stack([np.ones_like(phases), np.cos(phases)], axis=1)
    carried = (found / known) @ (waves @ np.linalg.pinv(waves[choice.positions % len(phases)])).T
    return np.asarray(nominal.max(axis=0).reshape(-1, len(phases)).max(axis=0) * carried)


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
