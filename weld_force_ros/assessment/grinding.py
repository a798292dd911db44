"""Advise on grinding: search the minimum removal with the simulator in the loop, then check it on the exact track.

The search considers some of the speeds and positions. Its result is checked at all of them, and by the `reference`
engine where forces come nearest to their limits; a limit that is exceeded there is tightened by as much, and the search
continues from where it was.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace as changed
from numpy.typing import NDArray
from scipy.special import ndtri

from weld_force_ros import SOFTWARE
from weld_force_ros.assessment.criteria import (
    AT_REST,
    EDGE_CRITERIA,
    FORCE_CRITERIA,
    GEOMETRY_CRITERIA,
    gradient_norm_rad,
)
from weld_force_ros.assessment.decision import model_deviation
from weld_force_ros.assessment.grinding_search import Grinder, Profile, Removal, least_removal
from weld_force_ros.assessment.judge import judge_relevant
from weld_force_ros.assessment.limits import applies, decides, levels
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceMap,
    GrindingAdvice,
    Limit,
    ProfileMeasures,
    SimulationSettings,
    Verdict,
    WeldProfile,
    config_sha256,
    known,
    profile_sha256,
)
from weld_force_ros.physics.analysis.geometry import (
    STRAIGHTEDGE_M,
    largest_gradient,
    largest_inclination,
    largest_step,
    straightedge_gap,
    straightedge_readings,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.threads import executor
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.force_map_view import Passages, RelevantMap, relevant_range
from weld_force_ros.simulation.running import Run, directed_runs
from weld_force_ros.simulation.simulator import Simulator

MOST_ROUNDS = 8
MOST_CHECKS = 3
_SPEEDS, _POSITIONS = 12, 4  # that the search begins with
_FAR = 0.15  # of a limit: grinding is not expected to bring a force that much nearer to it
_LOW_PASSED = ("p2_force", "force_20hz")
_REFERENCE_SPEEDS, _REFERENCE_POSITIONS = 3, 3
_APART_KMH = 15.0  # speeds nearer to each other say the same
_SPARE = 1e-3  # of a limit that is left
_KEPT = 0.005  # of the static load: the least force where contact must not be lost
_LOST_S = 1e-3  # without contact are as bad as a static load missing
_NOTABLE_M = 5e-6  # of a removal: where it is said to begin and end
_DECIMALS = 10


Indices: TypeAlias = NDArray[np.int64]
Axes: TypeAlias = tuple[Indices, Indices]


@dataclass(frozen=True)
class _Grid:
    """Speeds (n_speed,) and positions (n_position,) at which profiles are simulated, in each direction of trains."""

    vehicle_track: VehicleTrackModel | GreensFunctionModel
    runs: Sequence[Run]
    speeds_kmh: FloatArray
    positions_m: FloatArray
    threads: int | None = None
    patch_m: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Return (n_speed, n_position)."""
        return len(self.speeds_kmh), len(self.positions_m)

    def over(self, profiles: Sequence[Profile], *, low_passed: bool = True) -> list[Passages]:
        """Return the passages over each profile, the worse of the directions, of shape (n_speed, n_position)."""
        wheel = self.vehicle_track.wheel
        with executor(self.threads) as pool:
            wheel_paths = list(pool.map(lambda p: wheel_path_over(p[0], p[1], wheel.radius_m, self.patch_m), profiles))
        peak_maps = self.vehicle_track.peak_maps(
            [run.path(wheel_path) for wheel_path in wheel_paths for run in self.runs],
            self.speeds_kmh,
            np.stack([run.places(self.positions_m) for run in self.runs] * len(profiles)),
            low_passed=low_passed,
        )
        passages = [Passages.of_peak_map(peak_map, wheel.static_load_n) for peak_map in peak_maps]
        count = len(self.runs)
        if count == 1:
            return passages
        return [Passages.stacked(passages[i : i + count]).worst(axis=0) for i in range(0, len(passages), count)]

    def at(self, rows: Indices, columns: Indices) -> "_Grid":
        """Return the grid of some of the speeds and positions."""
        return replace(self, speeds_kmh=self.speeds_kmh[rows], positions_m=self.positions_m[columns])


class _Limits:
    """The limits that decide, tightened by factors; the search considers those that come into reach."""

    def __init__(self, limits: AssessmentSettings, relevant: RelevantMap) -> None:
        line_kmh, load_n = relevant.line_kmh, relevant.passages.static_load_n
        self._limits = [limit for limit in limits.limits if decides(limit) and applies(limit, line_kmh)]
        self._at_most = {id(limit): levels(limit, load_n).limit for limit in self._limits}
        self._norm_rad = gradient_norm_rad(line_kmh, limits.gradient_norm)
        self._factors = np.array([self._sure(limit, limits, relevant) for limit in self._limits])
        self._watched = np.zeros(len(self._limits), dtype=bool)

    def watch(self, excess: list[FloatArray]) -> None:
        """Add the limits that are exceeded or closest to being so to those that the search considers."""
        worst = _worst(excess)
        self._watched |= worst >= min(-_FAR, worst.max())

    def tighten(self, excess: list[FloatArray], by_reference: list[FloatArray]) -> None:
        """Tighten limits that the reference exceeds by as much as it differs from the fast engine."""
        exact = 1 + _worst(by_reference)
        factors = np.where(exact > 1, (1 + _worst(excess)) / exact, 1.0)
        self._factors = np.minimum(self._factors, factors)
        self.watch(by_reference)

    def tightened(self, excess: list[FloatArray]) -> list[FloatArray]:
        """Return by how much the tightened limits are exceeded."""
        return [(1 + e) / factor - 1 for e, factor in zip(excess, self._factors, strict=True)]

    def constraints(self, profiles: Sequence[Profile], grid: _Grid) -> FloatArray:
        """Return the constraints of the search, (n_profile, n_constraint)."""
        watched = [(self._limits[i], self._factors[i] * (1 - _SPARE)) for i in np.flatnonzero(self._watched)]
        low_passed = any(limit.name in _LOW_PASSED for limit, _ in watched)
        return np.array(
            [
                np.concatenate(
                    [(1 + self._excess(limit, profile, passages).ravel()) / factor - 1 for limit, factor in watched]
                )
                for profile, passages in zip(profiles, grid.over(profiles, low_passed=low_passed), strict=True)
            ]
        )

    def excess(self, profile: Profile, passages: Passages) -> list[FloatArray]:
        """Return by how much each limit is exceeded: in each passage, or (1,) for a geometry limit."""
        return [self._excess(limit, profile, passages) for limit in self._limits]

    def _sure(self, limit: Limit, limits: AssessmentSettings, relevant: RelevantMap) -> float:
        """Return the share of a limit that a force may reach for the model's uncertainty to keep the accepted risk."""
        rules, at_most = limits.rules, self._at_most[id(limit)]
        if limit.name in GEOMETRY_CRITERIA or limit.name == "contact_loss" or isinstance(rules, UnsetType):
            return 1.0
        if isinstance(rules.accepted_risk, UnsetType):
            return 1.0
        rows = [] if isinstance(rules.model_uncertainty, UnsetType) else rules.model_uncertainty
        rest = AT_REST.get(limit.name, relevant.passages.static_load_n)
        away = float(model_deviation(limit.name, np.array(rest + 1.0), relevant, rows)) * -float(
            ndtri(rules.accepted_risk)
        )
        return (rest + (at_most - rest) / (1 + away)) / at_most

    def _excess(self, limit: Limit, profile: Profile, passages: Passages) -> FloatArray:
        at_most = self._at_most[id(limit)]
        if limit.name == "contact_loss" and at_most <= 0:
            # Contact is lost or it is not: how near a passage is to it, the least force says.
            return _KEPT - passages.min_force_n / passages.static_load_n + passages.contact_loss_s / _LOST_S
        values = self._values(limit, profile, passages)
        return values / at_most - 1 if at_most > 0 else values - at_most

    def _values(self, limit: Limit, profile: Profile, passages: Passages) -> FloatArray:
        if limit.name not in GEOMETRY_CRITERIA:
            values = FORCE_CRITERIA[limit.name](passages)
            assert values is not None, "all forces are computed"  # noqa: S101
            return values
        return np.array([self._of_geometry(limit, *profile)])

    def _of_geometry(self, limit: Limit, x_m: FloatArray, z_m: FloatArray) -> float:
        if limit.name in EDGE_CRITERIA:
            # Beyond the record the rail is level, as it is simulated; the verdict refuses edges that reach too far.
            readings = {edge.base_m: edge for edge in straightedge_readings(x_m, z_m, level_beyond=True)}
            edge = readings[known(limit.base_m) or STRAIGHTEDGE_M]
            return float(EDGE_CRITERIA[limit.name](np.asarray(edge.peak_m), np.asarray(edge.dip_m)))
        if limit.name == "quality_index":
            slope = largest_gradient if isinstance(limit.base_m, UnsetType) else largest_inclination
            return slope(x_m, z_m) / self._norm_rad
        return {"straightedge": straightedge_gap, "step": largest_step, "inclination": largest_inclination}[limit.name](
            x_m, z_m
        )


@dataclass(frozen=True)
class _Found:
    """A removal, its largest excess over a limit, and the result of its check on the exact track."""

    removal: Removal
    excess: float
    checked: int = 0
    within: int = 0
    peak_n: float | None = None

    @property
    def confirmed(self) -> bool:
        """True if the reference agrees in every passage checked."""
        return self.within == self.checked


def _preference(found: _Found) -> tuple[float, float, float]:
    """Return a key that is smaller for a better result: within limits, confirmed by the reference, little removed."""
    disputed = 1 - found.within / found.checked if found.checked else 1.0
    return max(found.excess, 0.0), disputed, found.removal.removed_m2


class Adviser:
    """Advises on many welds under the same settings and limits; making one loads the track's fit."""

    def __init__(
        self,
        settings: SimulationSettings,
        limits: AssessmentSettings,
        grinder: Grinder | None = None,
        *,
        on_fit: Callable[[str], None] | None = None,
        threads: int | None = None,
    ) -> None:
        """Load the track; the search uses a fast engine, `common-poles` for `reference`, and nothing random.

        Args:
            settings: of the simulation.
            limits: of the verdict.
            grinder: its capabilities.
            on_fit: called with a line of text if a fit has to be made.
            threads: that compute; one a core, if not given.

        Raises:
            InputError: settings that this version cannot simulate.
        """
        self._settings, self._limits, self._grinder = settings, limits, grinder or Grinder()
        self._threads = threads
        self._simulator = Simulator(_fast(settings), on_fit=on_fit, threads=threads)
        track = track_file.parse(settings.track_definition, settings.track).track
        self._reference = GreensFunctionModel(track, self._simulator.vehicle_track.wheel, threads=threads)

    def advise(self, profile: WeldProfile, *, on_step: Callable[[], None] = lambda: None) -> GrindingAdvice:
        """Return the minimum removal that brings a weld within its limits at all relevant speeds and positions.

        Args:
            profile: the weld.
            on_step: called after each step of the search.

        Raises:
            InputError: the grinder reaches no place on the profile, or no limit can be applied.
            NumericalError: a passage did not stay finite.
        """
        began = time.perf_counter()
        map_before = self._simulator.force_map(profile)
        relevant = relevant_range(map_before)
        before = judge_relevant(relevant, self._limits)
        found = _Found(self._nothing(profile), 0.0) if _within(before) else self._search(profile, relevant, on_step)
        # What does not help is not advised, however near it comes.
        removal = found.removal if found.excess <= 0 else self._nothing(profile)
        map_after = _as_finely_measured(self._simulator.force_map(_ground(profile, removal)), map_before)
        relevant_after = relevant_range(map_after)
        after = judge_relevant(relevant_after, self._limits)
        return GrindingAdvice(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self._settings.config_sha256,
            limits_sha256=self._limits.limits_sha256,
            software=SOFTWARE,
            reached=_within(after) and found.confirmed,
            reason=_reason(before, found, self._grinder),
            x_m=removal.x_m.tolist(),
            z_m=removal.z_m.tolist(),
            removal_m=removal.removal_m.tolist(),
            most_removed_m=float(removal.removal_m.max()),
            removed_m2=removal.removed_m2,
            band_limit_m=self._grinder.band_limit_m,
            stone_radius_m=self._grinder.stone_radius_m,
            decision_before=before.decision,
            decision_after=after.decision,
            before=before.criteria,
            after=after.criteria,
            speeds_kmh=relevant.speeds_kmh.tolist(),
            peak_before_n=relevant.worst_over_positions.peak_force_n.tolist(),
            peak_after_n=relevant_after.worst_over_positions.peak_force_n.tolist(),
            reference_checked=found.checked,
            reference_within=found.within,
            reference_peak_n=UNSET if found.peak_n is None else found.peak_n,
            elapsed_s=time.perf_counter() - began,
        )

    def _nothing(self, profile: WeldProfile) -> Removal:
        x, z = np.array(profile.x_m), np.array(profile.z_m)
        return least_removal(x, z, lambda profiles: np.full((len(profiles), 1), -1.0), self._grinder)

    def _search(self, profile: WeldProfile, relevant: RelevantMap, on_step: Callable[[], None]) -> _Found:
        """Search, check all speeds and positions, then the reference, until a removal passes both."""
        limits, x, z = _Limits(self._limits, relevant), np.array(profile.x_m), np.array(profile.z_m)
        grid = _Grid(
            self._simulator.vehicle_track,
            directed_runs(relevant.force_map.running, relevant.force_map.span_m),
            relevant.speeds_kmh,
            relevant.positions_m,
            self._threads,
            self._simulator.settings.patch_half_length_m,
        )
        excess = limits.excess((x, z), relevant.passages)
        limits.watch(excess)
        considered = _added(_spread(grid), _worst_axes(excess, grid))
        best, begin, checks = _Found(self._nothing(profile), _worst(excess).max()), None, 0
        for _ in range(MOST_ROUNDS):
            removal = least_removal(
                x, z, partial(limits.constraints, grid=grid.at(*considered)), self._grinder, begin=begin,
                on_step=on_step,
            )  # fmt: skip
            begin = removal = replace(removal, removal_m=np.round(removal.removal_m, _DECIMALS))
            ground = removal.x_m, removal.ground_m
            excess = limits.excess(ground, grid.over([ground])[0])
            found = _Found(removal, _worst(excess).max())
            tightened = limits.tightened(excess)
            if _worst(tightened).max() > 0:
                best = min(best, found, key=_preference)
                limits.watch(tightened)
                considered = _added(considered, _worst_axes(tightened, grid))
                if removal.reached:
                    continue
                break
            found, by_reference = self._checked(found, limits, grid, excess)
            best, checks = min(best, found, key=_preference), checks + 1
            if found.confirmed or checks == MOST_CHECKS:
                break
            limits.tighten(excess, by_reference)
        return best

    def _checked(
        self, found: _Found, limits: _Limits, grid: _Grid, excess: list[FloatArray]
    ) -> tuple[_Found, list[FloatArray]]:
        """Check the most critical passages by the reference; return also by how much they exceed each limit."""
        critical = replace(grid.at(*_critical(grid, _by_passage(excess, grid.shape))), vehicle_track=self._reference)
        ground = found.removal.x_m, found.removal.ground_m
        passages = critical.over([ground])[0]
        by_reference = limits.excess(ground, passages)
        within = _by_passage(by_reference, critical.shape) <= 0
        checked = replace(
            found, checked=within.size, within=int(within.sum()), peak_n=float(passages.peak_force_n.max())
        )  # fmt: skip
        return checked, by_reference


def advise(
    profile: WeldProfile,
    settings: SimulationSettings,
    limits: AssessmentSettings,
    grinder: Grinder | None = None,
    *,
    on_step: Callable[[], None] = lambda: None,
) -> GrindingAdvice:
    """Advise on one weld: see `Adviser`."""
    return Adviser(settings, limits, grinder).advise(profile, on_step=on_step)


def _fast(settings: SimulationSettings) -> SimulationSettings:
    engine = "common-poles" if settings.engine == "reference" else settings.engine
    fast = changed(settings, engine=engine, uncertainty=UNSET)
    return changed(fast, config_sha256=config_sha256(fast))


def _spread(grid: _Grid) -> Axes:
    """Return some speeds and positions, evenly spaced, the last of each among them."""
    speeds, positions = len(grid.speeds_kmh), len(grid.positions_m)
    rows = np.arange(speeds)[:: -max(1, -(-speeds // _SPEEDS))][::-1]
    return rows, np.arange(positions)[:: -max(1, -(-positions // _POSITIONS))][::-1]


def _added(axes: Axes, more: Axes) -> Axes:
    return np.union1d(axes[0], more[0]), np.union1d(axes[1], more[1])


def _worst_axes(excess: list[FloatArray], grid: _Grid) -> Axes:
    """Return the speeds of the worst passages at the two worst positions, and those positions."""
    by_passage = _by_passage(excess, grid.shape)
    columns = np.argsort(-by_passage.max(axis=0), kind="stable")[:2]
    return np.unique(by_passage[:, columns].argmax(axis=0)), columns


def _worst(excess: list[FloatArray]) -> FloatArray:
    """Return the largest excess of each limit, (n_limit,)."""
    return np.array([e.max() for e in excess])


def _by_passage(excess: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """Return the largest excess of a force limit in each passage, of a shape; of geometry alone that everywhere."""
    of_forces = [e for e in excess if e.ndim == 2]
    worst: FloatArray = np.max([np.broadcast_to(e, shape) for e in of_forces or excess], axis=0)
    return worst


def _critical(grid: _Grid, excess: FloatArray) -> Axes:
    """Return the speeds of the worst passages, some distance apart, and the worst positions at those."""
    rows: list[int] = []
    for row in np.argsort(-excess.max(axis=1), kind="stable").tolist():
        if all(abs(grid.speeds_kmh[row] - grid.speeds_kmh[other]) >= _APART_KMH for other in rows):
            rows.append(row)
    rows = sorted(rows[:_REFERENCE_SPEEDS])
    return np.array(rows), np.sort(np.argsort(-excess[rows].max(axis=0), kind="stable")[:_REFERENCE_POSITIONS])


def _ground(profile: WeldProfile, removal: Removal) -> WeldProfile:
    x, z = removal.x_m.tolist(), removal.ground_m.tolist()
    return changed(profile, x_m=x, z_m=z, profile_sha256=profile_sha256(x, z))


def _as_finely_measured(force_map: ForceMap, measured: ForceMap) -> ForceMap:
    """Return the map with the spacing of the measured samples, not of those on the rail beside them."""
    if not isinstance(force_map.measures, ProfileMeasures) or not isinstance(measured.measures, ProfileMeasures):
        return force_map
    return changed(force_map, measures=changed(force_map.measures, spacing_m=measured.measures.spacing_m))


def _within(verdict: Verdict) -> bool:
    return all(c.passed for c in verdict.criteria if c.decides)


def _reason(before: Verdict, found: _Found, grinder: Grinder) -> str:
    if _within(before):
        return "within its limits: nothing to grind"
    if found.excess > 0:
        return f"replace: no removal up to {grinder.most_m * 1e3:g} mm that was tried brings it within its limits"
    removal = found.removal
    places = removal.x_m[removal.removal_m > min(_NOTABLE_M, removal.removal_m.max() / 2)]
    took = (
        f"up to {removal.removal_m.max() * 1e3:.2f} mm removed between {places[0] * 100:.0f} and "
        f"{places[-1] * 100:.0f} cm from the weld's centre"
    )
    reference = f"{found.within} of {found.checked} passages by the reference engine are"
    if not found.confirmed:
        return f"replace: {took} bring it within its limits, but only {reference}"
    return f"{took} bring it within its limits; {reference}"
