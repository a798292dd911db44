"""Advise on grinding: search the minimum removal with the simulator in the loop, then check it on the exact track.

The search considers some of the speeds and positions. Its result is checked at all of them, with the depth off by the
margin of a hand grinder too, and by the `reference` engine where forces come nearest to their limits; a limit that is
exceeded there is tightened by as much, and the search continues from where it was.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace as changed

from weld_force_ros import SOFTWARE
from weld_force_ros.assessment.criteria import gradient_norm_rad
from weld_force_ros.assessment.grinding_constraints import Axes, LimitConstraints, PassageGrid, largest
from weld_force_ros.assessment.grinding_search import Grinder, Removal, least_removal
from weld_force_ros.assessment.grinding_spots import by_hand, grinding_spots
from weld_force_ros.assessment.judge import asks_of, judge_relevant
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceMap,
    GrindingAdvice,
    ProfileMeasures,
    SimulationSettings,
    Verdict,
    WeldProfile,
    config_sha256,
    profile_sha256,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.force_map_view import RelevantMap, relevant_range
from weld_force_ros.simulation.running import directed_runs
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.track_at_weld import TracksAtWelds

MOST_ROUNDS = 8
MOST_CHECKS = 3
_SPEEDS, _POSITIONS = 12, 4  # that the search begins with
_REFERENCE_SPEEDS, _REFERENCE_POSITIONS = 3, 3
_APART_KMH = 15.0  # speeds nearer to each other say the same
_DECIMALS = 10
_MOST_RELAXATION = 2.0  # deeper grinding leaves more that a hand can miss


@dataclass(frozen=True)
class _Found:
    """A removal, its largest excess over a limit, ground as advised and by hand, and its check on the exact track."""

    removal: Removal
    excess: float
    by_hand: float = np.inf
    peak_by_hand_n: float | None = None
    checked: int = 0
    within: int = 0
    peak_n: float | None = None

    @property
    def confirmed(self) -> bool:
        """True if the reference agrees in every passage checked."""
        return self.within == self.checked

    @property
    def holds(self) -> bool:
        """True if it is confirmed, and within limits though the depth is off by the margin."""
        return self.confirmed and self.by_hand <= 0


def _preference(found: _Found) -> tuple[float, float, float, float]:
    """Return a key that is smaller for a better result: within limits, by hand too, confirmed, little removed."""
    disputed = 1 - found.within / found.checked if found.checked else 1.0
    return max(found.excess, 0.0), max(found.by_hand, 0.0), disputed, found.removal.removed_m2


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
        self._exact = TracksAtWelds(
            track_file.parse(settings.track_definition, settings.track),
            changed(settings, engine="reference", uncertainty=UNSET),
            threads=threads,
        )

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
        asks = asks_of(self._limits)
        map_before = self._simulator.force_map(profile, asks)
        relevant = relevant_range(map_before)
        before = judge_relevant(relevant, self._limits)
        if _within(before):
            found = _Found(self._nothing(profile), 0.0, by_hand=0.0)
        else:
            found = self._search(profile, relevant, on_step)
        # What does not help is not advised, however near it comes.
        removal = found.removal if found.excess <= 0 else self._nothing(profile)
        map_after = _as_finely_measured(self._simulator.force_map(_ground(profile, removal), asks), map_before)
        relevant_after = relevant_range(map_after)
        after = judge_relevant(relevant_after, self._limits)
        return GrindingAdvice(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self._settings.config_sha256,
            limits_sha256=self._limits.limits_sha256,
            software=SOFTWARE,
            reached=_within(after) and found.holds,
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
            spots=grinding_spots(removal, profile.chainage_direction),
            hand_margin_m=self._grinder.hand_margin_m,
            peak_by_hand_n=UNSET if found.peak_by_hand_n is None else found.peak_by_hand_n,
            chainage_direction=profile.chainage_direction,
            gradient_norm_rad=gradient_norm_rad(relevant.line_kmh, self._limits.gradient_norm),
        )

    def _nothing(self, profile: WeldProfile) -> Removal:
        x, z = np.array(profile.x_m), np.array(profile.z_m)
        return least_removal(x, z, lambda profiles: np.full((len(profiles), 1), -1.0), self._grinder)

    def _search(self, profile: WeldProfile, relevant: RelevantMap, on_step: Callable[[], None]) -> _Found:
        """Search, check all speeds and positions, then the reference, until a removal passes both."""
        limits, x, z = LimitConstraints(self._limits, relevant), np.array(profile.x_m), np.array(profile.z_m)
        vehicle_track = self._simulator.tracks.at(profile).vehicle_track
        grid = PassageGrid(
            vehicle_track,
            directed_runs(relevant.force_map.running, vehicle_track.opposite_m),
            relevant.speeds_kmh,
            relevant.positions_m,
            self._threads,
            self._simulator.settings.patch_half_length_m,
        )
        excess = limits.excess((x, z), relevant.passages)
        limits.watch(excess)
        reference = self._exact.at(profile).vehicle_track
        exact = replace(
            grid,
            vehicle_track=reference,
            runs=directed_runs(relevant.force_map.running, reference.opposite_m),
        )
        considered = _added(_spread(grid), _worst_axes(excess, grid))
        best, begin = _Found(self._nothing(profile), largest(excess).max()), None
        checks = hand_checks = 0
        for _ in range(MOST_ROUNDS):
            removal = least_removal(
                x, z, partial(limits.constraints, grid=grid.at(*considered)), self._grinder, begin=begin,
                on_step=on_step,
            )  # fmt: skip
            begin = removal = replace(removal, removal_m=np.round(removal.removal_m, _DECIMALS))
            ground = removal.x_m, removal.ground_m
            excess = limits.excess(ground, grid.over([ground])[0])
            found = _Found(removal, largest(excess).max())
            tightened = limits.tightened(excess)
            if largest(tightened).max() > 0:
                best = min(best, found, key=_preference)
                limits.watch(tightened)
                considered = _added(considered, _worst_axes(tightened, grid))
                if removal.reached:
                    continue
                break
            found, hand_excess = self._ground_by_hand(found, limits, grid)
            if found.by_hand > 0:
                best = min(best, found, key=_preference)
                hand_checks += 1
                limits.tighten(excess, hand_excess, min(hand_checks, _MOST_RELAXATION))
                considered = _added(considered, _worst_axes(hand_excess, grid))
                continue
            found, by_reference = self._checked(found, limits, exact, excess)
            best, checks = min(best, found, key=_preference), checks + 1
            if found.confirmed or checks == MOST_CHECKS:
                break
            limits.tighten(excess, by_reference)
        return best

    def _ground_by_hand(
        self, found: _Found, limits: LimitConstraints, grid: PassageGrid
    ) -> tuple[_Found, list[FloatArray]]:
        """Check the shapes that a hand grinder may leave; return also by how much the worst exceeds each limit."""
        if self._grinder.hand_margin_m == 0.0:
            return replace(found, by_hand=0.0), []
        shapes = by_hand(found.removal, self._grinder.hand_margin_m)
        passages = grid.over(shapes)
        of_shapes = [limits.excess(shape, over) for shape, over in zip(shapes, passages, strict=True)]
        excess = [np.max(of_limit, axis=0) for of_limit in zip(*of_shapes, strict=True)]
        peak_n = max(float(over.peak_force_n.max()) for over in passages)
        return replace(found, by_hand=float(largest(excess).max()), peak_by_hand_n=peak_n), excess

    def _checked(
        self, found: _Found, limits: LimitConstraints, exact: PassageGrid, excess: list[FloatArray]
    ) -> tuple[_Found, list[FloatArray]]:
        """Check the most critical passages by the reference; return also by how much they exceed each limit."""
        critical = exact.at(*_critical(exact, _by_passage(excess, exact.shape)))
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


def _spread(grid: PassageGrid) -> Axes:
    """Return some speeds and positions, evenly spaced, the last of each among them."""
    speeds, positions = len(grid.speeds_kmh), len(grid.positions_m)
    rows = np.arange(speeds)[:: -max(1, -(-speeds // _SPEEDS))][::-1]
    return rows, np.arange(positions)[:: -max(1, -(-positions // _POSITIONS))][::-1]


def _added(axes: Axes, more: Axes) -> Axes:
    return np.union1d(axes[0], more[0]), np.union1d(axes[1], more[1])


def _worst_axes(excess: list[FloatArray], grid: PassageGrid) -> Axes:
    """Return the speeds of the worst passages at the two worst positions, and those positions."""
    by_passage = _by_passage(excess, grid.shape)
    columns = np.argsort(-by_passage.max(axis=0), kind="stable")[:2]
    return np.unique(by_passage[:, columns].argmax(axis=0)), columns


def _by_passage(excess: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """Return the largest excess of a force limit in each passage, of a shape; of geometry alone that everywhere."""
    of_forces = [e for e in excess if e.ndim == 2]
    worst: FloatArray = np.max([np.broadcast_to(e, shape) for e in of_forces or largest(excess)], axis=0)
    return worst


def _critical(grid: PassageGrid, excess: FloatArray) -> Axes:
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
    spots = grinding_spots(found.removal)
    took = (
        f"up to {found.removal.removal_m.max() * 1e3:.2f} mm removed between {spots[0].from_m * 100:.0f} and "
        f"{spots[-1].to_m * 100:.0f} cm from the weld's centre"
    )
    margin = f"{grinder.hand_margin_m * 1e3:.2g} mm"
    if found.by_hand > 0:
        return (
            f"grind more exactly than by hand, or replace: {took} bring it within its limits, but not if the depth "
            f"comes out {margin} too large or too small"
        )
    reference = f"{found.within} of {found.checked} passages by the reference engine are"
    if not found.confirmed:
        return f"replace: {took} bring it within its limits, but only {reference}"
    held = f", also with {margin} more or less" if grinder.hand_margin_m else ""
    return f"{took} bring it within its limits{held}; {reference}"
