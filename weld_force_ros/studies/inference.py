"""Search for shapes of the paper's welds that meet what its text says: differential evolution on the studies' own grid.

The cost of a shape is summed over the claims given to the search, each the mean of its criteria: 0 if a criterion
holds, else between a half and one, the more the further its quantity is from holding. Claims that are held out
(`data/claims.yaml` says how) are not looked at. Wavelengths that the text gives a weld count as one claim more.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, repeat

import msgspec
import numpy as np
from scipy.optimize import OptimizeResult, differential_evolution

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies import (
    captions,
    claims,
    curve_study,
    increment_study,
    motion_study,
    shape_prior,
    spectrum_study,
)
from weld_force_ros.studies.claims import Claim, Condition, Quantity
from weld_force_ros.studies.map_quantities import of_weld
from weld_force_ros.studies.shape_prior import Prior, Term
from weld_force_ros.studies.study_context import Profile, Quantities, StudyContext
from weld_force_ros.studies.weld_map import weld_maps

GENERATIONS = 80
SEARCHES = 9  # where the first meets all that it is given
_MEMBERS_PER_PARAMETER = 4
_DRAW_SEED = 1
_OF_WELD_1 = (
    motion_study.quantities_over_weld_1,
    increment_study.quantities_over_weld_1,
    spectrum_study.quantities_over_weld_1,
)
_WAVELENGTH_TOLERANCE = 0.1
_NO_SCALE_N = 10e3  # a tenth of the static load: how far a force is from the sign that it should have


class Solution(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The shape that one search ended with.

    Attributes:
        weld: `weld-1` to `weld-5`.
        without_fold: as of `Inference`.
        seed: of the search.
        cost: what is left of it; 0 if the shape meets every claim given.
        terms: of the shape.
        prior_sha256: of the prior that it was drawn from.
    """

    weld: str
    without_fold: int | None
    seed: int
    cost: float
    terms: list[Term]
    prior_sha256: str

    @property
    def profile(self) -> Profile:
        """Return positions from the weld's centre and heights, m."""
        return shape_prior.profile_of(self.terms)


@dataclass(frozen=True)
class Inference:
    """The search for one weld of the paper.

    Attributes:
        weld: `weld-1` to `weld-5`.
        prior: of its shape.
        context: the paper's track and wheel.
        without_fold: whose claims the search is not given; None if it is given all.
    """

    weld: str
    prior: Prior
    context: StudyContext
    without_fold: int | None = None

    @property
    def number(self) -> int:
        """Return which of the five welds it is."""
        return int(self.weld[-1])

    @cached_property
    def given(self) -> list[Claim]:
        """Return the claims that a search is given, those on other welds included, which it does not measure."""
        fold_of = claims.folds(self._inferred)
        return [claim for claim in self._inferred if fold_of[claim.id] != self.without_fold]

    def cost(self, parameters: FloatArray) -> float:
        """Return how far a shape is from meeting the claims given.

        It is more than any such, if the shape contradicts the words on it, or if a wheel touches it twice.
        """
        profile = shape_prior.profile_of(shape_prior.terms_of(parameters))
        contradictions = captions.contradictions(self.weld, profile)
        if contradictions:
            return len(self.given) + 2 + contradictions
        excess = shape_prior.curvature_share(profile) - shape_prior.MOST_CURVATURE
        if excess > 0:
            return len(self.given) + 1 + excess
        measured = self._quantities(profile, self._coarse)
        of_claims = sum(cost_of(claim, measured) or 0.0 for claim in self.given)
        return of_claims + wavelength_cost(self.prior.wavelengths_m, profile)

    def drawn(self, count: int) -> list[Profile]:
        """Draw shapes from the prior that the words allow, whatever the claims say; the same at each call."""
        random, (low, high) = np.random.default_rng(_DRAW_SEED), np.transpose(self.prior.bounds)
        draws = (random.uniform(*ends) for ends in repeat((low, high)))
        drawn = (shape_prior.profile_of(shape_prior.terms_of(parameters)) for parameters in draws)
        return list(islice(filter(self._is_allowed, drawn), count))

    def _is_allowed(self, profile: Profile) -> bool:
        return (
            captions.contradictions(self.weld, profile) == 0
            and shape_prior.curvature_share(profile) <= shape_prior.MOST_CURVATURE
            and wavelength_cost(self.prior.wavelengths_m, profile) == 0
        )

    def held(self, profile: Profile, *, coarse: bool = False) -> dict[str, bool]:
        """Return of each claim whether it holds over a shape, as far as it asks for something of this weld.

        If coarse, what takes long is measured as in a search.
        """
        measured = self._quantities(profile, self._coarse if coarse else self.context)
        costs = {claim.id: cost_of(claim, measured) for claim in self._inferred}
        return {name: cost == 0 for name, cost in costs.items() if cost is not None}

    @cached_property
    def _inferred(self) -> list[Claim]:
        return [claim for claim in claims.load() if claim.geometry == "inferred"]

    @cached_property
    def _coarse(self) -> StudyContext:
        return replace(self.context, coarse=True)

    def _quantities(self, profile: Profile, slow_ones: StudyContext) -> Quantities:
        """Return what claims ask for of this weld, with a context of its own for what takes long."""
        with np.errstate(all="ignore"):  # a shape without a hollow has no depth
            (weld_map,) = weld_maps(self.context, {self.weld: profile})
            measured = of_weld(self.number, weld_map)
            if self.number == 1:
                measured |= curve_study.quantities_over_weld_1(self.context, profile)
                for quantities_of in _OF_WELD_1:
                    measured |= quantities_of(slow_ones, profile)
            if self.number == 5:
                measured |= motion_study.quantities_over_weld_5(self.context, profile)
        return measured

    def search(self, seed: int, on_generation: Callable[[], object] = lambda: None) -> Solution:
        """Search for a shape, `GENERATIONS` at most; the same for the same seed."""

        def ended(intermediate_result: OptimizeResult) -> bool:
            on_generation()
            return bool(intermediate_result.fun == 0)

        found = differential_evolution(
            self.cost, self.prior.bounds, rng=np.random.default_rng(seed), popsize=_MEMBERS_PER_PARAMETER,
            maxiter=GENERATIONS, mutation=(0.4, 0.9), recombination=0.8, polish=False, callback=ended,
        )  # fmt: skip
        return Solution(
            weld=self.weld,
            without_fold=self.without_fold,
            seed=seed,
            cost=float(found.fun),
            terms=shape_prior.terms_of(found.x),
            prior_sha256=self.prior.sha256,
        )


def wavelength_cost(wavelengths_m: Sequence[float], profile: Profile) -> float:
    """Return the mean cost of the wavelengths that a weld must have: 0 if its spectrum has a clear peak near each."""
    if not wavelengths_m:
        return 0.0
    found_m = shape_prior.wavelengths_of(profile)
    away = [float(np.abs(found_m / wanted - 1).min(initial=np.inf)) for wanted in wavelengths_m]
    off = [share / _WAVELENGTH_TOLERANCE - 1 for share in away]
    return float(np.mean([0.5 + 0.5 * _saturated(distance) if distance > 0 else 0.0 for distance in off]))


def cost_of(claim: Claim, measured: Quantities) -> float | None:
    """Return the mean cost of a claim's criteria as far as their quantities were measured, None if none was.

    Where criteria were corrected, that is what the statement asks for.
    """
    costs = [_cost(c, measured[c.key]) for c in claim.stated_criteria if c.key in measured]
    return float(np.mean(costs)) if costs else None


def _cost(condition: Condition, value: Quantity) -> float:
    values = value if isinstance(value, list) else [value]
    distances = [
        0.0 if held else 0.5 + 0.5 * _saturated(_distance(condition, number))
        for held, number in zip(condition.holds(value), values or [np.nan], strict=True)
    ]
    return float(np.mean(distances))


def _saturated(distance: float) -> float:
    return distance / (1.0 + distance) if np.isfinite(distance) else 1.0


def _distance(condition: Condition, value: float | bool | str) -> float:
    """Return how far a value is from holding, relative to the width or the limit required; NaN if that says nothing."""
    if not isinstance(value, float) or not np.isfinite(value):
        return np.nan
    if condition.within is not None:
        low, high = condition.within
        return max(low - value, value - high, 0.0) / (0.5 * (high - low) or abs(high))
    limit = condition.above if condition.above is not None else condition.below
    if limit is None:
        return np.nan
    scale = abs(limit) or (_NO_SCALE_N if condition.key.endswith("_n") else 1.0)
    return abs(value - limit) / scale


def most_typical(solutions: Sequence[Solution]) -> Solution:
    """Return the solution whose heights differ least from those of the others, RMS, on average (their medoid)."""
    heights_m = [one.profile[1] for one in solutions]
    apart_m = [float(np.mean([shape_prior.rms(z - other) for other in heights_m])) for z in heights_m]
    return solutions[int(np.argmin(apart_m))]
