"""Search for the minimum grinding that brings a weld within its limits, given a function that evaluates profiles.

What a grinder takes off is never negative and no sharper along the rail than it can be steered: a sum of cubic
B-splines with coefficients that are not negative. With knots three quarters of the shortest wavelength apart, however
the coefficients vary, less than 2e-4 of the removal's energy lies at shorter waves: a wave of the coefficients with
frequency f comes back at 1/h - f, weaker by (f / (1/h - f))^8. Where metal was removed, the ground surface is what the
stone's circle touches from above: the morphological closing of z - d, nowhere above the measured surface.

The search is sequential linear programming with an exact penalty (Fletcher & Sainz de la Maza, Mathematical
Programming 43 (1989) 235): constraints are linearised by finite differences, a linear program trades removed area for
the largest excess within a trust region, and a step is accepted by the true constraints. Several sizes of the
region are tried at once, as many profiles side by side cost less than one after the other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import BSpline
from scipy.ndimage import grey_closing
from scipy.optimize import linprog, nnls

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, joined

KNOTS_PER_WAVE = 4 / 3
MARGIN = 1e-3  # of a limit: twice what the forces are computed to
MOST_STEPS = 15
_FIRST_REGION_M = 0.2e-3
_SMALLEST_REGION_M = 2e-6
_REGIONS = 0.5 ** np.arange(4)  # tried at once
_PROBE_M = 10e-6  # a few per cent of a force: far above its numerical noise, and nearly linear
_WORTH_A_STEP = 2e-3  # of the objective
_STEPS_A_RACE = 3
_STANDING = 500
_CURVATURES_PER_M = (0.025, 0.0016)  # of hollows to begin with: as 0.3 mm over 0.5 m has them, and far gentler
_PENALTY = 10.0  # of an excess of 1, in removals of everything

Profile: TypeAlias = tuple[FloatArray, FloatArray]
"""Positions and heights, positive up, each (n,)."""

Excess: TypeAlias = Callable[[Sequence[Profile]], FloatArray]
"""Of many profiles at once: (n_profile, n_constraint), value over limit less 1; within limits if none is positive."""


@dataclass(frozen=True)
class Grinder:
    """A grinder's capabilities: engineering judgement, not taken from a machine's data sheet.

    Attributes:
        band_limit_m: shortest wavelength that it can be steered to grind: less than a stone's own width is not.
        stone_radius_m: hollows that it leaves are no sharper.
        reach_m: how far it may work on rail before and behind the measured range.
        most_m: depth that may be removed.
        hand_margin_m: by which the depth may come out too large or too small; 0 for a machine that is steered. By hand
            it is ground to what an electronic straightedge shows, which its maker states to 0.030 mm (RAILPROF).
    """

    band_limit_m: float = 0.10
    stone_radius_m: float = 0.15
    reach_m: float = 0.5
    most_m: float = 1e-3
    hand_margin_m: float = 0.03e-3

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.isfinite(value) or value < 0 or (value == 0 and name not in ("reach_m", "hand_margin_m")):
                raise InputError(f"a grinder's {name} is {value:g}", "give a positive number of metres")


@dataclass(frozen=True)
class Removal:
    """Metal removed from a profile, each array (n,).

    Attributes:
        x_m: the profile's positions, and some beyond its ends as far as the grinder reaches.
        z_m: heights before; beyond the ends those of the rail that the simulation joins.
        removal_m: not negative.
        excess: (n_constraint,), of the ground profile.
        coefficients_m: (n_spline,), what a further search begins with.
    """

    x_m: FloatArray
    z_m: FloatArray
    removal_m: FloatArray
    excess: FloatArray
    coefficients_m: FloatArray

    @property
    def reached(self) -> bool:
        """True if the ground profile is within its limits."""
        return bool(self.excess.max() <= 0)

    @property
    def ground_m(self) -> FloatArray:
        """Heights after grinding."""
        return self.z_m - self.removal_m

    @property
    def removed_m2(self) -> float:
        """Area between both profiles."""
        return float(trapezoid(self.removal_m, self.x_m))


def least_removal(
    x_m: FloatArray,
    z_m: FloatArray,
    excess: Excess,
    grinder: Grinder | None = None,
    *,
    begin: Removal | None = None,
    on_step: Callable[[], None] = lambda: None,
) -> Removal:
    """Return the removal of least area that brings a profile within its limits, or the one that comes closest.

    It is a local optimum, the best found from several starts: nothing removed, what stands above its surroundings
    removed, and hollows softened.

    Args:
        x_m: (n,), increasing, 0 at the weld's centre.
        z_m: (n,), positive up.
        excess: evaluates profiles.
        grinder: its capabilities.
        begin: a removal from the same profile by the same grinder to begin with.
        on_step: called after each step of the search.

    Raises:
        InputError: the grinder reaches no place on the profile.
    """
    search = _Search(x_m, z_m, excess, grinder or Grinder())
    if begin is not None:
        return search.removal(search.descended(search.at([begin.coefficients_m])[0], MOST_STEPS, on_step))
    nothing, *gentle = search.at([np.zeros(search.splines.shape[1]), *search.gentle()])
    return search.removal(nothing if nothing.worst <= 0 else search.raced([nothing, *gentle], on_step))


@dataclass(frozen=True, eq=False)
class _Point:
    """A removal with its merit: its area in splines of the greatest depth, plus a penalty on the largest excess."""

    shares: FloatArray
    removal_m: FloatArray
    excess: FloatArray
    merit: float

    @property
    def worst(self) -> float:
        return float(self.excess.max())


def _merit(point: _Point) -> float:
    return point.merit


class _Search:
    """The search over one profile; coefficients are shares of the greatest depth."""

    def __init__(self, x_m: FloatArray, z_m: FloatArray, excess: Excess, grinder: Grinder) -> None:
        self.grinder, self._excess = grinder, excess
        self.x_m, self.z_m = extended(x_m, z_m, grinder.reach_m)
        self.knots_m = grinder.band_limit_m / KNOTS_PER_WAVE
        self.splines = splines(self.x_m, x_m[0] - grinder.reach_m, x_m[-1] + grinder.reach_m, self.knots_m)
        if self.splines.shape[1] == 0:
            raise InputError(
                f"waves of {grinder.band_limit_m:g} m are too long for this profile", "let the grinder reach farther"
            )
        self._penalty = _PENALTY * self.splines.shape[1]

    def at(self, coefficients_m: Sequence[FloatArray]) -> list[_Point]:
        """Evaluate removals, with the stone's circle taken into account."""
        most = self.grinder.most_m
        removals = [self._ground(self.splines @ c) for c in coefficients_m]
        excesses = self._excess([(self.x_m, self.z_m - removal) for removal in removals])
        return [
            self._point(c / most, removal, excess)
            for c, removal, excess in zip(coefficients_m, removals, excesses, strict=True)
        ]

    def _ground(self, wanted_m: FloatArray) -> FloatArray:
        """Return the removal that a stone of the grinder's radius leaves."""
        ground = closed(self.x_m, self.z_m - wanted_m, self.grinder.stone_radius_m)
        return np.where(wanted_m > 0, np.maximum(self.z_m - ground, 0.0), 0.0)

    def _point(self, shares: FloatArray, removal_m: FloatArray, excess: FloatArray) -> _Point:
        area = trapezoid(removal_m, self.x_m) / (self.knots_m * self.grinder.most_m)
        return _Point(shares, removal_m, excess, float(area + self._penalty * max(0.0, excess.max() + MARGIN)))

    def removal(self, point: _Point) -> Removal:
        coefficients = point.shares * self.grinder.most_m
        return Removal(self.x_m, self.z_m, point.removal_m, point.excess, coefficients)

    def gentle(self) -> list[FloatArray]:
        """Return starts, each (n_spline,): remove what stands above its surroundings, or soften hollows.

        A hollow is softened to a curvature by the lower envelope of parabolas that stand on the surface.
        """
        from_left = np.minimum.accumulate(np.minimum(self.z_m, 0.0))
        from_right = np.minimum.accumulate(np.minimum(self.z_m, 0.0)[::-1])[::-1]
        levelled = np.minimum(self.z_m, np.maximum(from_left, from_right))
        softened = [_softened(self.x_m, self.z_m, curvature) for curvature in _CURVATURES_PER_M]
        fitted = [nnls(self.splines, self.z_m - target)[0] for target in (levelled, *softened)]
        return [np.minimum(coefficients, self.grinder.most_m) for coefficients in fitted]

    def raced(self, starts: Sequence[_Point], on_step: Callable[[], None]) -> _Point:
        """Return the best point reached from any start: all go a few steps, the better half goes on."""
        running = list(starts)
        while len(running) > 1:
            running = sorted((self.descended(point, _STEPS_A_RACE, on_step) for point in running), key=_merit)
            running = running[: len(running) // 2]
        return self.descended(running[0], MOST_STEPS, on_step)

    def descended(self, here: _Point, steps: int, on_step: Callable[[], None]) -> _Point:
        """Go on step by step, as long as the merit improves."""
        region, slopes = _FIRST_REGION_M / self.grinder.most_m, None
        for _ in range(steps):
            slopes = self._slopes(here) if slopes is None else slopes
            regions = np.minimum(region, 1.0) * _REGIONS
            points = self.at([self.grinder.most_m * self._proposed(here, slopes, size) for size in regions])
            best = min(points, key=_merit)
            pays = best.merit < (1 - _WORTH_A_STEP) * here.merit
            region = 2 * regions[points.index(best)] if pays else regions[-1] / 2
            on_step()
            if best.merit < here.merit:
                here, slopes = best, None
            if region * self.grinder.most_m < _SMALLEST_REGION_M:
                break
        return here

    def _slopes(self, here: _Point) -> FloatArray:
        """Return the derivative of each constraint by each coefficient, (n_constraint, n_spline)."""
        most = self.grinder.most_m
        probes = self.at([most * here.shares + _PROBE_M * unit for unit in np.eye(len(here.shares))])
        return np.stack([probe.excess - here.excess for probe in probes], axis=1) * (most / _PROBE_M)

    def _proposed(self, here: _Point, slopes: FloatArray, region: float) -> FloatArray:
        """Return the coefficients (n_spline,) within the region that are best for linearised constraints."""
        shares = here.shares
        can_exceed = here.excess + MARGIN + region * np.abs(slopes).sum(axis=1) > 0
        rows, at = slopes[can_exceed], here.excess[can_exceed] + MARGIN
        solved = linprog(
            np.append(np.ones(len(shares)), self._penalty),
            A_ub=np.column_stack([rows, -np.ones(len(rows))]),
            b_ub=rows @ shares - at,
            bounds=[*zip(np.maximum(shares - region, 0.0), np.minimum(shares + region, 1.0), strict=True), (0.0, None)],
        )  # fmt: skip
        return np.asarray(solved.x[:-1])


def extended(x_m: FloatArray, z_m: FloatArray, reach_m: float) -> Profile:
    """Return a profile with the rail beside it as the simulation assumes it: joined, then level."""
    x, z, _ = joined(np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64))
    spacing = float(np.median(np.diff(x_m)))
    before = np.arange(x_m[0] - reach_m, x[0] - spacing / 2, spacing)
    behind = np.arange(x_m[-1] + reach_m, x[-1] + spacing / 2, -spacing)[::-1]
    return np.concatenate([before, x, behind]), np.concatenate([np.zeros(len(before)), z, np.zeros(len(behind))])


def splines(x_m: FloatArray, first_m: float, last_m: float, knots_m: float) -> FloatArray:
    """Return cubic B-splines at `x_m`, (n, n_spline): all that lie between two places, centred between them."""
    count = max(0, int((last_m - first_m) / knots_m + 1e-9) - 3)
    begin = (first_m + last_m - (count + 3) * knots_m) / 2
    one = BSpline.basis_element(np.arange(5.0), extrapolate=False)
    return np.asarray(np.nan_to_num(one((x_m[:, None] - begin) / knots_m - np.arange(count))))


def _softened(x_m: FloatArray, z_m: FloatArray, curvature_per_m: float) -> FloatArray:
    """Return the lower envelope, (n,), of parabolas that stand on the surface (n,)."""
    at = np.linspace(x_m[0], x_m[-1], _STANDING)
    squares = (at[:, None] - at) ** 2 / 2
    lower = np.min(np.interp(at, x_m, z_m) + curvature_per_m * squares, axis=1)
    return np.asarray(np.minimum(np.interp(x_m, at, lower), z_m))


def closed(x_m: FloatArray, z_m: FloatArray, radius_m: float) -> FloatArray:
    """Return the morphological closing (n,) of a surface by a circle: hollows that it cannot reach are bridged."""
    slopes = np.diff(z_m) / np.diff(x_m)
    if np.all(np.diff(slopes) <= (x_m[2:] - x_m[:-2]) / (2 * radius_m)):
        return z_m  # nowhere sharper than the circle, which reaches it everywhere
    grid = np.arange(x_m[0], x_m[-1] + RESAMPLED_STEP_M, RESAMPLED_STEP_M)
    surface = np.interp(grid, x_m, z_m)
    half = int(np.ceil(np.sqrt(2 * radius_m * np.ptp(surface)) / RESAMPLED_STEP_M))
    s = RESAMPLED_STEP_M * np.arange(-half, half + 1)
    circle = np.sqrt(np.maximum(radius_m**2 - s**2, 0.0)) - radius_m
    bridged = grey_closing(surface, footprint=np.ones(len(s)), structure=circle, mode="nearest")
    return np.asarray(np.maximum(np.interp(x_m, grid, bridged), z_m))
