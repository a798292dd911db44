"""Advice on grinding: the least removal with the simulator in the loop, then rolled over again on the exact track.

The search looks at some of the speeds and positions. Its result is checked at all of them, and by the `reference`
engine where forces come nearest to their limits; a limit that is exceeded there is tightened by as much, and the search
goes on from where it was.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from weld_force_ros import tracks
from weld_force_ros.assess import SOFTWARE, Simulator, judge
from weld_force_ros.contract import (
    AssessmentSettings,
    ForceMap,
    GrindingAdvice,
    Limit,
    ProfileMeasures,
    SimulationSettings,
    Verdict,
    WeldProfile,
    config_sha256,
    profile_sha256,
)
from weld_force_ros.core.criteria import FORCE_CRITERIA, Passages, applies, decides, gradient_norm_rad
from weld_force_ros.core.geometry import largest_gradient, straightedge_gap
from weld_force_ros.core.grinding import Grinder, Profile, Removal, least_removal
from weld_force_ros.core.passage import Rig
from weld_force_ros.core.reference import GreenRig
from weld_force_ros.core.surface import Surface
from weld_force_ros.core.track import Real
from weld_force_ros.core.verdict import Judged, judged_part
from weld_force_ros.core.weld import wheel_trajectory

MOST_ROUNDS = 4
_MOST_SPEEDS, _MOST_POSITIONS = 16, 5  # in the search
_REFERENCE_SPEEDS, _REFERENCE_POSITIONS = 3, 4
_APART_KMH = 15.0  # speeds nearer to each other say the same
_SPARE = 2e-3  # of a limit that is tightened
_KEPT = 0.005  # of the static load: the least force where contact must not be lost
_LOST_S = 1e-3  # without contact are as bad as a static load missing
_NOTABLE_M = 5e-6  # of a removal: where it is said to begin and end
_DECIMALS = 10


@dataclass(frozen=True)
class _Rolling:
    """Speeds (n_speed,) and positions (n_position,) at which a rig rolls over profiles."""

    rig: Rig | GreenRig
    speeds_kmh: Real
    positions_m: Real

    def over(self, profiles: Sequence[Profile]) -> list[Passages]:
        """Passages of shape (n_speed, n_position) over each profile."""
        wheel = self.rig.wheel
        with ThreadPoolExecutor() as pool:
            trajectories = list(pool.map(lambda profile: wheel_trajectory(*profile, wheel.radius_m), profiles))
        surfaces = self.rig.surfaces(trajectories, self.speeds_kmh, self.positions_m, low_passed=True)
        return [
            Passages(wheel.static_load_n, s.peak_force_n, s.min_force_n, s.contact_loss_s, *_low_passed(s))
            for s in surfaces
        ]


def _low_passed(surface: Surface) -> tuple[Real | None, Real | None]:
    if surface.low_passed_n is None:
        return None, None
    below_120hz, below_20hz = surface.low_passed_n
    return below_120hz, below_20hz


class _Limits:
    """The limits that the decision hangs on, each with a factor that tightens it."""

    def __init__(self, limits: AssessmentSettings, line_kmh: float) -> None:
        self._limits = [limit for limit in limits.limits if decides(limit) and applies(limit, line_kmh)]
        self._norm_rad = gradient_norm_rad(line_kmh, limits.gradient_norm)
        self._factors = np.ones(len(self._limits))

    def tighten(self, exceeded: Real) -> None:
        """By what each limit (n_limit,) was exceeded, and a little more."""
        self._factors /= np.where(exceeded > 0, 1 + exceeded + _SPARE, 1.0)

    def constraints(self, profiles: Sequence[Profile], rolling: _Rolling) -> Real:
        """(n_profile, n_constraint), what the tightened limits are exceeded by."""
        rows = []
        for profile, passages in zip(profiles, rolling.over(profiles), strict=True):
            excess = self.excess(profile, passages)
            rows.append(np.concatenate([(1 + e.ravel()) / f - 1 for e, f in zip(excess, self._factors, strict=True)]))
        return np.array(rows)

    def excess(self, profile: Profile, passages: Passages) -> list[Real]:
        """What each limit itself is exceeded by: in each passage, or (1,) of the geometry's."""
        return [self._excess(limit, profile, passages) for limit in self._limits]

    def _excess(self, limit: Limit, profile: Profile, passages: Passages) -> Real:
        if limit.name == "contact_loss" and limit.limit <= 0:
            # Contact is lost or it is not: how near a passage is to it, the least force says.
            return _KEPT - passages.min_n / passages.static_n + passages.contact_loss_s / _LOST_S
        values = self._values(limit.name, profile, passages)
        return values / limit.limit - 1 if limit.limit > 0 else values - limit.limit

    def _values(self, name: str, profile: Profile, passages: Passages) -> Real:
        if name == "straightedge":
            return np.array([straightedge_gap(*profile)])
        if name == "quality_index":
            return np.array([largest_gradient(*profile) / self._norm_rad])
        values = FORCE_CRITERIA[name](passages)
        assert values is not None, "all forces are computed"  # noqa: S101
        return values


@dataclass(frozen=True)
class _Found:
    """A removal, and what came of rolling it over again on the exact track."""

    removal: Removal
    checked: int = 0
    within: int = 0
    peak_n: float | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the reference says the same."""
        return self.within == self.checked


class Adviser:
    """Advice for many welds under the same settings and limits; making one loads the track's fit."""

    def __init__(
        self,
        settings: SimulationSettings,
        limits: AssessmentSettings,
        grinder: Grinder | None = None,
        *,
        on_fit: Callable[[str], None] | None = None,
    ) -> None:
        """The search is by a fast engine, `common-poles` in place of `reference`; nothing is drawn at random.

        Raises:
            InputError: settings that this version cannot simulate.
        """
        self._settings, self._limits, self._grinder = settings, limits, grinder or Grinder()
        self._simulator = Simulator(_fast(settings), on_fit=on_fit)
        track = tracks.parse(settings.track_definition, settings.track).track
        self._reference = GreenRig(track, self._simulator.rig.wheel)

    def advise(self, profile: WeldProfile, *, on_step: Callable[[], None] = lambda: None) -> GrindingAdvice:
        """The least removal that brings a weld within its limits at all speeds and positions that count.

        Args:
            profile: the weld.
            on_step: called after each step of the search.

        Raises:
            InputError: the grinder reaches no place on the profile, or no limit can be applied.
            NumericalError: a passage did not stay finite.
        """
        began = time.perf_counter()
        map_before = self._simulator.force_map(profile)
        before, judged = judge(map_before, self._limits), judged_part(map_before)
        found = self._search(profile, judged, on_step)
        removal = found.removal
        map_after = _as_finely_measured(self._simulator.force_map(_ground(profile, removal)), map_before)
        after = judge(map_after, self._limits)
        return GrindingAdvice(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self._settings.config_sha256,
            limits_sha256=self._limits.limits_sha256,
            software=SOFTWARE,
            reached=_within(after) and found.confirmed,
            reason=_reason(before, after, found, self._grinder),
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
            speeds_kmh=judged.speeds_kmh.tolist(),
            peak_before_n=judged.passages.peak_n.max(axis=1).tolist(),
            peak_after_n=judged_part(map_after).passages.peak_n.max(axis=1).tolist(),
            reference_checked=found.checked,
            reference_within=found.within,
            reference_peak_n=UNSET if found.peak_n is None else found.peak_n,
            elapsed_s=time.perf_counter() - began,
        )

    def _search(self, profile: WeldProfile, judged: Judged, on_step: Callable[[], None]) -> _Found:
        """Search, check and tighten, until what was found stands the check."""
        limits, rig = _Limits(self._limits, judged.line_kmh), self._simulator.rig
        fully = _Rolling(rig, judged.speeds_kmh, judged.positions_m)
        coarsely = _Rolling(rig, _some(judged.speeds_kmh, _MOST_SPEEDS), _some(judged.positions_m, _MOST_POSITIONS))
        found: _Found | None = None
        for _ in range(MOST_ROUNDS):
            removal = least_removal(
                np.array(profile.x_m), np.array(profile.z_m), lambda profiles: limits.constraints(profiles, coarsely),
                self._grinder, begin=found and found.removal, on_step=on_step,
            )  # fmt: skip
            if found is not None and not removal.reached:
                break
            removal = replace(removal, removal_m=np.round(removal.removal_m, _DECIMALS))
            found, exceeded = self._checked(removal, limits, fully)
            if not removal.reached or np.all(exceeded <= 0):
                break
            limits.tighten(exceeded)
        assert found is not None  # noqa: S101
        return found

    def _checked(self, removal: Removal, limits: _Limits, fully: _Rolling) -> tuple[_Found, Real]:
        """A removal at every speed and position, then by the reference, and what each limit (n_limit,) is exceeded by.

        The reference has no say where nothing was taken off, or not enough.
        """
        ground = removal.x_m, removal.ground_m
        excess = limits.excess(ground, fully.over([ground])[0])
        if not removal.reached or not removal.removal_m.any():
            return _Found(removal), _worst(excess)
        critical = replace(_critical(fully, _by_passage(excess)), rig=self._reference)
        exactly = critical.over([ground])[0]
        by_reference = limits.excess(ground, exactly)
        within = _by_passage(by_reference) <= 0
        found = _Found(removal, within.size, int(within.sum()), float(exactly.peak_n.max()))
        return found, np.maximum(_worst(excess), _worst(by_reference))


def advise(
    profile: WeldProfile,
    settings: SimulationSettings,
    limits: AssessmentSettings,
    grinder: Grinder | None = None,
    *,
    on_step: Callable[[], None] = lambda: None,
) -> GrindingAdvice:
    """Advice for one weld: see `Adviser`."""
    return Adviser(settings, limits, grinder).advise(profile, on_step=on_step)


def _fast(settings: SimulationSettings) -> SimulationSettings:
    engine = "common-poles" if settings.engine == "reference" else settings.engine
    fast = changed(settings, engine=engine, uncertainty=UNSET)
    return changed(fast, config_sha256=config_sha256(fast))


def _some(values: Real, most: int) -> Real:
    """At most so many of them, evenly, the last among them."""
    return values[:: -max(1, -(-len(values) // most))][::-1]


def _worst(excess: list[Real]) -> Real:
    """Of each limit, (n_limit,)."""
    return np.array([e.max() for e in excess])


def _by_passage(excess: list[Real]) -> Real:
    """The worst limit of force in each passage, (n_speed, n_position)."""
    return np.max([e for e in excess if e.ndim == 2], axis=0)


def _critical(rolling: _Rolling, excess: Real) -> _Rolling:
    """The speeds with the worst passages, some way apart, and the worst positions at those."""
    rows = _apart(rolling.speeds_kmh, excess.max(axis=1))
    columns = np.sort(np.argsort(-excess[rows].max(axis=0), kind="stable")[:_REFERENCE_POSITIONS])
    return replace(rolling, speeds_kmh=rolling.speeds_kmh[rows], positions_m=rolling.positions_m[columns])


def _apart(speeds_kmh: Real, excess: Real) -> NDArray[np.int64]:
    chosen: list[int] = []
    for row in np.argsort(-excess, kind="stable").tolist():
        if all(abs(speeds_kmh[row] - speeds_kmh[other]) >= _APART_KMH for other in chosen):
            chosen.append(row)
    return np.sort(chosen[:_REFERENCE_SPEEDS])


def _ground(profile: WeldProfile, removal: Removal) -> WeldProfile:
    x, z = removal.x_m.tolist(), removal.ground_m.tolist()
    return changed(profile, x_m=x, z_m=z, profile_sha256=profile_sha256(x, z))


def _as_finely_measured(force_map: ForceMap, measured: ForceMap) -> ForceMap:
    """With the distance of samples that were measured, not of those on the rail beside them."""
    if not isinstance(force_map.measures, ProfileMeasures) or not isinstance(measured.measures, ProfileMeasures):
        return force_map
    return changed(force_map, measures=changed(force_map.measures, spacing_m=measured.measures.spacing_m))


def _within(verdict: Verdict) -> bool:
    return all(c.passed for c in verdict.criteria if c.decides)


def _reason(before: Verdict, after: Verdict, found: _Found, grinder: Grinder) -> str:
    if _within(before):
        return "within its limits: nothing to grind"
    removal = found.removal
    places = removal.x_m[removal.removal_m > _NOTABLE_M]
    took = "nothing taken off"
    if len(places):
        took = (
            f"up to {removal.removal_m.max() * 1e3:.2f} mm taken off between {places[0] * 100:.0f} and "
            f"{places[-1] * 100:.0f} cm from the weld's centre"
        )
    reference = f"{found.within} of {found.checked} passages by the reference engine are"
    if not _within(after):
        left = ", ".join(f"{c.name} {c.value:.4g} {c.unit}" for c in after.criteria if c.decides and not c.passed)
        return (
            f"replace: no removal up to {grinder.most_m * 1e3:g} mm that was tried brings it within its limits; "
            f"with {took} there remains {left}"
        )
    if not found.confirmed:
        return f"replace: {took} bring it within its limits, but only {reference}"
    return f"{took} bring it within its limits; {reference}"
