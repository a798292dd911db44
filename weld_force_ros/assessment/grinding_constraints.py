"""Hold ground profiles against limits: the constraints of the search for a minimum grinding."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from msgspec import UnsetType
from numpy.typing import NDArray
from scipy.special import ndtri

from weld_force_ros.assessment.criteria import (
    EDGE_CRITERIA,
    FORCE_CRITERIA,
    GEOMETRY_CRITERIA,
    gradient_norm_rad,
    value_at_rest,
)
from weld_force_ros.assessment.decision import model_deviation
from weld_force_ros.assessment.grinding_search import Profile
from weld_force_ros.assessment.limits import applies, decides, levels
from weld_force_ros.messages import AssessmentSettings, Limit, known
from weld_force_ros.physics.analysis.geometry import (
    STRAIGHTEDGE_M,
    inclinations,
    largest_gradient,
    largest_step,
    straightedge_gap,
    straightedge_readings,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.threads import executor
from weld_force_ros.simulation.force_map_view import Passages, RelevantMap
from weld_force_ros.simulation.running import Run

_FAR = 0.15  # of a limit: grinding is not expected to bring a force that much nearer to it
_LOW_PASSED = ("p2_force", "force_20hz")
_SPARE = 1e-3  # of a limit that is left
_KEPT = 0.005  # of the static load: the least force where contact must not be lost
_PLACES_TOGETHER = 10  # of inclinations every 0.5 mm: within 5 mm the worst is taken
_LOST_S = 1e-3  # without contact are as bad as a static load missing

Indices: TypeAlias = NDArray[np.int64]
Axes: TypeAlias = tuple[Indices, Indices]


@dataclass(frozen=True)
class PassageGrid:
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

    def at(self, rows: Indices, columns: Indices) -> "PassageGrid":
        """Return the grid of some of the speeds and positions."""
        return replace(self, speeds_kmh=self.speeds_kmh[rows], positions_m=self.positions_m[columns])


class LimitConstraints:
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
        worst = largest(excess)
        self._watched |= worst >= min(-_FAR, worst.max())

    def tighten(self, excess: list[FloatArray], exceeded: list[FloatArray], relaxation: float = 1.0) -> None:
        """Tighten limits that are exceeded in a check by as much as it differs from what the search was told.

        Args:
            excess: over each limit, as the search has it.
            exceeded: over each limit, in the check.
            relaxation: more than 1 where the difference grows as more metal goes.
        """
        found, checked = 1 + largest(excess), 1 + largest(exceeded)
        factors = np.where(checked > 1, found / np.maximum(checked, 1.0) ** relaxation, 1.0)
        self._factors = np.minimum(self._factors, factors)
        self.watch(exceeded)

    def tightened(self, excess: list[FloatArray]) -> list[FloatArray]:
        """Return by how much the tightened limits are exceeded."""
        return [(1 + e) / factor - 1 for e, factor in zip(excess, self._factors, strict=True)]

    def constraints(self, profiles: Sequence[Profile], grid: PassageGrid) -> FloatArray:
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
        """Return by how much each limit is exceeded: in each passage, or (n_place,) along the rail for one of geometry.

        One a place and not the largest alone: which place is the worst changes as metal goes, and with it the slopes.
        """
        return [self._excess(limit, profile, passages) for limit in self._limits]

    def _sure(self, limit: Limit, limits: AssessmentSettings, relevant: RelevantMap) -> float:
        """Return the share of a limit that a force may reach to keep the accepted risk, its uncertainty considered."""
        rules, at_most = limits.rules, self._at_most[id(limit)]
        if limit.name in GEOMETRY_CRITERIA or limit.name == "contact_loss" or isinstance(rules, UnsetType):
            return 1.0
        if isinstance(rules.accepted_risk, UnsetType):
            return 1.0
        rows = [] if isinstance(rules.model_uncertainty, UnsetType) else rules.model_uncertainty
        rest = value_at_rest(limit.name, relevant.passages.static_load_n)
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
            values = FORCE_CRITERIA[limit.name].value(passages)
            assert values is not None, "all forces are computed"  # noqa: S101
            return values
        return np.atleast_1d(self._of_geometry(limit, *profile))

    def _of_geometry(self, limit: Limit, x_m: FloatArray, z_m: FloatArray) -> FloatArray | float:
        if limit.name in EDGE_CRITERIA:
            # Beyond the record the rail is level, as it is simulated; the verdict refuses edges that reach too far.
            readings = {edge.base_m: edge for edge in straightedge_readings(x_m, z_m, level_beyond=True)}
            edge = readings[known(limit.base_m) or STRAIGHTEDGE_M]
            return float(EDGE_CRITERIA[limit.name](np.asarray(edge.peak_m), np.asarray(edge.dip_m)))
        if limit.name == "quality_index" and isinstance(limit.base_m, UnsetType):
            return largest_gradient(x_m, z_m) / self._norm_rad
        if limit.name in ("quality_index", "inclination"):
            slopes = np.abs(inclinations(x_m, z_m)[1])
            slopes = np.maximum.reduceat(slopes, np.arange(0, len(slopes), _PLACES_TOGETHER))
            return slopes / self._norm_rad if limit.name == "quality_index" else slopes
        return {"straightedge": straightedge_gap, "step": largest_step}[limit.name](x_m, z_m)


def largest(excess: list[FloatArray]) -> FloatArray:
    """Return the largest excess of each limit, (n_limit,)."""
    return np.array([e.max() for e in excess])
