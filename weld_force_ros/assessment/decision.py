"""Decide under uncertainty: two answers, geometry by standard and force by model, each with its risk.

After ISO 14253-1 and JCGM 106: a weld is accepted if the probability that it exceeds a limit is at most the accepted
risk, refused if it is at least one minus that, and undecided between. Probabilities are means over the samples of what
is uncertain and, where the weld's position in the span is unknown, over positions, all of them equally likely. A force
carries the engine's fit error and the model uncertainty, of what no engine knows, as well: a sample exceeds its limit
with the probability that a normal deviation takes it there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros.assessment.criteria import GEOMETRY_CRITERIA, value_at_rest
from weld_force_ros.assessment.limits import Levels, decides, ratio
from weld_force_ros.assessment.probability import (
    CONTACT,
    HANGING,
    PLACE,
    RADIUS,
    REST,
    SLEEPERS,
    SUPPORT,
    WIDENED,
    influences,
)
from weld_force_ros.messages import (
    Answer,
    AnswerDecision,
    Criterion,
    Decision,
    ForceMap,
    Limit,
    ModelUncertainty,
    UncertaintyResult,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import RelevantMap

_MODEL = "the model itself"
_MEASUREMENTS = {
    PLACE: "measure the weld's distance from the sleeper before it",
    REST: "measure the weld once more",
    SUPPORT: "look at the sleepers beside the weld: whether they are supported, and the state of their pads",
    SLEEPERS: "look at the ballast of the sleepers beside the weld: whether one carries more than the others",
    HANGING: "look whether the sleepers beside the weld hang",
    CONTACT: "measure the rail head's cross profile at the weld",
    RADIUS: "state the vehicles and their wheels",
}
"""What would narrow each of the uncertain quantities, the cheapest first."""


@dataclass(frozen=True)
class Judged:
    """A limit that applies, and how its criterion stands against it.

    Attributes:
        limit: as the rule book states it.
        criterion: as the verdict shows it.
        levels: what the limit comes to.
        values: (n_sample, n_position), over speeds the worst; of geometry (n_sample, 1).
        deviation: of each value, the standard deviation that fit error and model uncertainty add.
    """

    limit: Limit
    criterion: Criterion
    levels: Levels
    values: FloatArray
    deviation: FloatArray

    def exceeds(self) -> FloatArray:
        """Return the probability that each value is beyond the limit, as `values`."""
        return _beyond(self.values, self.levels.limit, self.deviation)

    def rejects(self) -> FloatArray:
        """Return the probability that each value is beyond the reject limit."""
        return _beyond(self.values, self.levels.reject_limit, self.deviation)

    @property
    def of_geometry(self) -> bool:
        """Return whether the limit is on the profile itself."""
        return self.limit.name in GEOMETRY_CRITERIA


_erfc = np.vectorize(math.erfc, otypes=[np.float64])  # SciPy's normal distribution costs more to import


def _beyond(values: FloatArray, limit: float, deviation: FloatArray) -> FloatArray:
    certain = (values > limit).astype(np.float64)
    if not np.isfinite(limit) or not np.any(deviation > 0):
        return certain
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(deviation > 0, 0.5 * _erfc((limit - values) / deviation / math.sqrt(2)), certain)


def widened(values: FloatArray) -> FloatArray:
    """Return values (n_sample, n) whose distances from the median of samples are those of `probability.interval`."""
    middle = np.median(values, axis=0)
    return np.asarray(middle + WIDENED * (values - middle))


def model_deviation(
    name: str, values: FloatArray, relevant: RelevantMap, rows: Sequence[ModelUncertainty]
) -> FloatArray:
    """Return the standard deviation that fit error and model uncertainty add to a criterion's values, in its unit.

    Both are shares of the force's dynamic part, so of how far a criterion is from its value at rest.
    """
    if name in GEOMETRY_CRITERIA:
        return np.zeros_like(values)
    share = force_share(relevant.force_map, rows)
    rest = value_at_rest(name, relevant.passages.static_load_n)
    return np.asarray(share * np.abs(values - rest) * (1.0 if name != "contact_loss" else 0.0))


def force_share(force_map: ForceMap, rows: Sequence[ModelUncertainty]) -> float:
    """Return fit error and model uncertainty together, a standard deviation as a share of forces' dynamic part."""
    return float(np.hypot(_fit_error(force_map), model_share(force_map, rows)))


def _fit_error(force_map: ForceMap) -> float:
    error = force_map.model_error
    return 0.0 if isinstance(error, UnsetType) else error


def model_share(force_map: ForceMap, rows: Sequence[ModelUncertainty]) -> float:
    """Return the model uncertainty of this weld on this track, a standard deviation as a share of the dynamic part."""
    measures, pad = force_map.measures, force_map.pad_n_per_m
    length_m = 0.0 if isinstance(measures, UnsetType) or isinstance(measures.length_m, UnsetType) else measures.length_m
    stiffness = 0.0 if isinstance(pad, UnsetType) else pad
    fitting = [row.share for row in rows if length_m >= row.from_length_m and stiffness >= row.from_pad_n_per_m]
    return fitting[-1] if fitting else 0.0


def answer(
    judged: Sequence[Judged], doubts: Sequence[str], risk: float, *, is_geometry: bool, certain_places: bool
) -> Answer:
    """Return the answer to one of the two questions.

    Args:
        judged: all limits that apply.
        doubts: what stands in the way of accepting, in clauses.
        risk: that is accepted.
        is_geometry: which of the questions.
        certain_places: whether the weld's position is known or the worst is to count.
    """
    own = [one for one in judged if one.of_geometry is is_geometry and decides(one.limit)]
    if not own:
        what = "choose a rule book with --limits" if is_geometry else "add the rule book `force` to --limits"
        return Answer(decision="not assessed", reason=f"no limit on the {_NAMES[is_geometry]} was chosen: {what}")
    exceeding = _probability([one.exceeds() for one in own], certain_places)
    rejecting = _probability([one.rejects() for one in own], certain_places)
    nearest = max(own, key=lambda one: ratio(one.criterion)).criterion
    decision: AnswerDecision = "undecided"
    if rejecting >= 1 - risk:
        decision = "reject"
    elif exceeding >= 1 - risk:
        decision = "grind"
    elif exceeding <= risk and not doubts:
        decision = "accept"
    return Answer(
        decision=decision,
        reason="; ".join([_reason(nearest, exceeding), *doubts]),
        rule_books=sorted({one.limit.rule_book for one in own if isinstance(one.limit.rule_book, str)}),
        criterion=nearest.name,
        margin=1 - nearest.value / nearest.limit if nearest.limit > 0 else UNSET,
        exceeding=exceeding,
        source=nearest.source,
        verified=nearest.verified,
        doubts=[*doubts],
    )


_NAMES = {True: "geometry", False: "force"}


def _probability(of_limits: Sequence[FloatArray], certain_places: bool) -> float:
    """Return the probability that any limit is exceeded: the errors of all are taken to go together."""
    widest = max(p.shape[1] for p in of_limits)
    largest = np.maximum.reduce([np.broadcast_to(p, (_samples(of_limits), widest)) for p in of_limits])
    return float(largest.mean() if not certain_places else largest.mean(axis=0).max())


def _samples(of_limits: Sequence[FloatArray]) -> int:
    return max(len(p) for p in of_limits)


def _reason(nearest: Criterion, exceeding: float) -> str:
    share = (
        f"{nearest.value / nearest.limit:.2f} of its limit"
        if nearest.limit > 0
        else ("within its limit" if nearest.passed else "over its limit of zero")
    )
    return f"{nearest.name} is {share}; probability of exceeding a limit {exceeding:.0%}"


def overall(geometry: Answer, force: Answer) -> Decision:
    """Return the decision on a weld: green only where both answers are."""
    answers = (geometry.decision, force.decision)
    for decision in ("reject", "grind"):
        if decision in answers:
            return decision
    return "accept" if answers == ("accept", "accept") else "undecided"


def measure_next(
    judged: Sequence[Judged], spread: UncertaintyResult | UnsetType, *, position_known: bool
) -> str | None:
    """Return the one measurement that would decide most cheaply, from the shares of the variance; None if none would.

    Args:
        judged: limits of the undecided answers.
        spread: the samples' inputs.
        position_known: whether the weld's position in the span is.
    """
    open_ones = [one for one in judged if decides(one.limit) and 0 < float(one.exceeds().mean()) < 1]
    if not open_ones:
        return None
    nearest = max(open_ones, key=lambda one: ratio(one.criterion))
    shares = _shares(nearest, spread)
    if position_known:
        shares.pop(PLACE, None)
    most = max(shares, key=shares.__getitem__, default=_MODEL)
    measurable = [name for name in _MEASUREMENTS if shares.get(name, 0.0) >= 0.5 * shares.get(most, 1.0)]
    if not measurable:
        return (
            f"no measurement of the weld decides {nearest.limit.name}: {shares.get(_MODEL, 0.0):.0%} of its variance "
            "is fit error and model uncertainty: go by the geometry, or have the force measured"
        )
    name = measurable[0]
    return f"{_MEASUREMENTS[name]} ({shares[name]:.0%} of the variance of {nearest.limit.name} is {name})"


def _shares(judged: Judged, spread: UncertaintyResult | UnsetType) -> dict[str, float]:
    """Return shares of the variance of a criterion's value, fit error and model uncertainty as one of them."""
    sampled = float(np.var(judged.values))
    model = float(np.mean(judged.deviation**2))
    total = sampled + model
    if total <= 0:
        return {}
    if isinstance(spread, UnsetType) or len(judged.values) == 1:
        return {PLACE: sampled / total, _MODEL: model / total}
    of_samples = influences(judged.values, spread)
    return {**{name: share * sampled / total for name, share in of_samples.items()}, _MODEL: model / total}
