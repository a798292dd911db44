"""Declare limits, rules, the verdict and the grinding advice."""

from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import UNSET, Meta, UnsetType

from weld_force_ros.messages.fields import (
    MAX_POSITIONS,
    MAX_SPEEDS,
    MAX_TEXT,
    Cells,
    ChainageDirection,
    ChainageM,
    CurveClass,
    Decision,
    Direction,
    ForceN,
    GeometryKind,
    Message,
    Metres,
    Name,
    ProfileId,
    Seconds,
    Sha256,
    SpeedAxis,
    SpeedKmh,
    Text,
    UnknownPosition,
    content_without_header,
    increasing,
    json_sha256,
    wrong_length,
)

SourceKind: TypeAlias = Literal["standard", "quotation", "vendor", "judgement"]
"""A number's authority: the text in force, a publication that quotes it, a maker's, nobody's but its author's."""


class Limit(msgspec.Struct, kw_only=True, frozen=True):
    """A criterion's limits: up to `limit` passes, up to `reject_limit` asks for grinding, beyond it rejects.

    One with speeds holds for lines of those speeds: above `above_kmh`, from `from_kmh` on, below `below_kmh`, up to
    `to_kmh`.

    Attributes:
        beyond: `grind`: nothing beyond the limits rejects.
        form: `times_static`: the numbers are multiples of the static wheel load; `plus_static`: they are added to it.
        cap: in the criterion's unit: the limits are no higher, whatever the form gives.
        base_m: length of the straightedge or chord that the criterion is measured on.
        measurable: the least that the rule book's own means show, in the criterion's unit: with a feeler gauge, "no
            dip" is none that its thinnest leaf finds. Added to the limit.
        rule_book: name of the set of limits that this one is of.
        source_kind: what kind of text the source is.
        verified_by: who checked the number where that was the user, when, and against which document.
    """

    name: Name
    limit: float
    reject_limit: float
    unit: Annotated[str, Meta(max_length=20)]
    source: Text
    verified: bool = False
    applies: Annotated[str, Meta(max_length=MAX_TEXT, description="why a weld is held against it")] | UnsetType = UNSET
    decides: (
        Annotated[bool, Meta(description="false: shown beside the others, but the decision does not hang on it")]
        | UnsetType
    ) = UNSET
    above_kmh: Annotated[float, Meta(description="km/h", ge=0.0)] | UnsetType = UNSET
    to_kmh: Annotated[float, Meta(description="km/h", ge=0.0)] | UnsetType = UNSET
    from_kmh: Annotated[float, Meta(description="km/h", ge=0.0)] | UnsetType = UNSET
    below_kmh: Annotated[float, Meta(description="km/h", ge=0.0)] | UnsetType = UNSET
    beyond: Annotated[Literal["grind"], Meta(extra_json_schema={"type": "string"})] | UnsetType = UNSET
    form: Annotated[Literal["times_static", "plus_static"], Meta(extra_json_schema={"type": "string"})] | UnsetType = (
        UNSET
    )
    cap: float | UnsetType = UNSET
    base_m: Annotated[float, Meta(description="m", gt=0.0)] | UnsetType = UNSET
    measurable: Annotated[float, Meta(ge=0.0)] | UnsetType = UNSET
    rule_book: Name | UnsetType = UNSET
    source_kind: Annotated[SourceKind, Meta(extra_json_schema={"type": "string"})] | UnsetType = UNSET
    verified_by: Text | UnsetType = UNSET


class ModelUncertainty(msgspec.Struct, kw_only=True, frozen=True):
    """How far forces may be off the truth beyond the fit error, by length of the defect and kind of track.

    Attributes:
        share: standard deviation, as a share of the force's dynamic part.
        from_length_m: of irregularities from that length on.
        from_pad_n_per_m: on pads from that stiffness on. Of the rows that fit, the last counts.
    """

    share: Annotated[float, Meta(ge=0.0, le=2.0)]
    from_length_m: Annotated[float, Meta(description="m", ge=0.0)] = 0.0
    from_pad_n_per_m: Annotated[float, Meta(description="N/m", ge=0.0)] = 0.0


class RuleBook(msgspec.Struct, kw_only=True, frozen=True):
    """A set of limits under one name."""

    name: Name
    title: Text
    state: Text = ""


class Rules(msgspec.Struct, kw_only=True, frozen=True):
    """Rules by which limits become a decision; without them the worst position counts and any sampling will do.

    Attributes:
        unknown_position: of a weld whose place in the span is unknown: the worst position's decision, or `undecided`
            where not all positions have the same.
        resolved_hz: what passes is undecided if samples are so far apart that at the worst speed they do not show waves
            up to this frequency; 0: any sampling will do.
        source: where these rules come from.
        accepted_risk: a weld is accepted if the probability that it exceeds a limit is at most that, and refused if it
            is at least one minus that; without it, values are compared with limits and probabilities only shown.
        model_uncertainty: of forces, for what the model leaves out; counts in probabilities, with the fit error.
    """

    unknown_position: UnknownPosition = "undecided"
    resolved_hz: Annotated[float, Meta(description="Hz", ge=0.0)] = 0.0
    source: Text = ""
    verified: bool = False
    accepted_risk: Annotated[float, Meta(gt=0.0, lt=0.5)] | UnsetType = UNSET
    model_uncertainty: Annotated[list[ModelUncertainty], Meta(max_length=100)] | UnsetType = UNSET


class NormPoint(msgspec.Struct, kw_only=True, frozen=True):
    """A largest gradient by line speed; linear between points, constant beyond them."""

    speed_kmh: SpeedKmh
    gradient_rad: Annotated[float, Meta(description="rad", gt=0.0)]


class AssessmentSettings(Message, kw_only=True):
    """The limits that verdicts are made with; latched, so that every recording holds them."""

    limits_sha256: Sha256
    limits: Annotated[list[Limit], Meta(min_length=1, max_length=100)]
    rules: Rules | UnsetType = UNSET
    gradient_norm: Annotated[list[NormPoint], Meta(max_length=100)] = []
    rule_books: Annotated[list[RuleBook], Meta(max_length=50)] | UnsetType = UNSET

    def problem(self) -> str | None:
        """Return why a limit cannot be applied, or that the hash is not the content's; else None."""
        for limit in self.limits:
            if limit.reject_limit < limit.limit:
                return f"limit {limit.name}: reject_limit is below limit"
        if not increasing([point.speed_kmh for point in self.gradient_norm]):
            return "gradient_norm: speeds must increase"
        return None if self.limits_sha256 == limits_sha256(self) else "limits_sha256 is not the hash of the limits"


class Criterion(msgspec.Struct, kw_only=True, frozen=True):
    """One line of a verdict: the value found, the limit it was held against, and where the limit comes from.

    Attributes:
        speed_kmh, position_m: of the passage that the value is from; absent for what the geometry says by itself.
        running: its direction, where the force map says it.
        low, high: 5 and 95 % of the value over the samples of what is uncertain.
        exceeding: share of samples of the unknown that exceed the limit.
        driver: which of the unknown quantities the value varies with most.
        driver_share: of the value's variance.
    """

    name: Name
    value: float
    limit: float
    unit: Annotated[str, Meta(max_length=20)]
    passed: bool
    source: Text
    verified: bool = False
    reject_limit: float | UnsetType = UNSET
    margin: Annotated[float, Meta(description="limit less value, negative beyond it")] | UnsetType = UNSET
    applies: Annotated[str, Meta(max_length=MAX_TEXT, description="why a weld is held against it")] | UnsetType = UNSET
    decides: Annotated[bool, Meta(description="false: shown, but the decision does not hang on it")] = True
    speed_kmh: SpeedKmh | UnsetType = UNSET
    position_m: Metres | UnsetType = UNSET
    x_m: Metres | UnsetType = UNSET
    running: Direction | UnsetType = UNSET
    low: float | UnsetType = UNSET
    high: float | UnsetType = UNSET
    exceeding: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    exceeding_reject: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    driver: Annotated[str, Meta(max_length=200)] | UnsetType = UNSET
    driver_share: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    base_m: Annotated[float, Meta(description="m", gt=0.0)] | UnsetType = UNSET
    rule_book: Name | UnsetType = UNSET
    source_kind: Annotated[SourceKind, Meta(extra_json_schema={"type": "string"})] | UnsetType = UNSET


AnswerDecision: TypeAlias = Literal["accept", "grind", "reject", "undecided", "not assessed"]


class Answer(msgspec.Struct, kw_only=True, frozen=True):
    """The answer to one of the two questions about a weld: its geometry by standard, its forces by model.

    Attributes:
        decision: `not assessed` where no limit of the kind was chosen.
        reason: in a sentence.
        rule_books: whose limits were applied.
        criterion: the one nearest to its limit or farthest beyond it.
        margin: of it, as a share of its limit; negative beyond it, absent for a limit of zero.
        exceeding: probability that a limit of the kind is exceeded.
        source: where that criterion's limit comes from.
        verified: whether its number stands in a text that was read.
        doubts: what stands in the way of accepting, in clauses; the reason has them too.
    """

    decision: Annotated[AnswerDecision, Meta(extra_json_schema={"type": "string"})]
    reason: Text
    rule_books: Annotated[list[Name], Meta(max_length=50)] = []
    criterion: Name | UnsetType = UNSET
    margin: float | UnsetType = UNSET
    exceeding: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    source: Text = ""
    verified: bool = False
    doubts: Annotated[list[Text], Meta(max_length=200)] = []


class PositionOutcome(msgspec.Struct, kw_only=True, frozen=True):
    """The decision if the weld lay at that position."""

    position_m: Metres
    decision: Decision


class SpeedBand(msgspec.Struct, kw_only=True, frozen=True):
    """Speeds from one to another, both included."""

    from_kmh: SpeedKmh
    to_kmh: SpeedKmh


class HollowBand(msgspec.Struct, kw_only=True, frozen=True):
    """Speeds at which the peak is below what a lower speed reached."""

    from_kmh: SpeedKmh
    lowest_kmh: SpeedKmh
    to_kmh: SpeedKmh
    depth_n: Annotated[float, Meta(description="N, greatest fall", ge=0.0)]


class Restriction(msgspec.Struct, kw_only=True, frozen=True):
    """The effect of a speed restriction on the peak force.

    Attributes:
        peak_force_n: at that speed.
        change: of it relative to the peak at the highest speed judged: 0.12 is 12 % more.
        within_limits: whether all speeds up to it are.
    """

    speed_kmh: SpeedKmh
    peak_force_n: ForceN
    change: float
    within_limits: bool


class HangingOutcome(msgspec.Struct, kw_only=True, frozen=True):
    """What a weld would come to if sleepers beside it hung.

    Attributes:
        support: that was simulated.
        peak_force_n: the highest up to the line's speed.
        decision: what the forces would say.
    """

    support: Annotated[Text, Meta(description="as `--support` takes it: 0=0.02,1=0.02")]
    peak_force_n: ForceN
    worst_speed_kmh: SpeedKmh
    decision: Annotated[AnswerDecision, Meta(extra_json_schema={"type": "string"})]


class Verdict(Message, kw_only=True):
    """The decision on a weld, and its reasons.

    Attributes:
        unjudged: limits that could not be applied, as what they are about was not computed.
        by_position: what would be decided at each position, where the weld's own is unknown.
        permitted_speed_kmh: the highest speed up to which all speeds are within limits; absent if not even the lowest
            is, or nothing was said about speed.
        avoid: speeds beyond limits.
        restrictions: falling, from the highest speed judged.
        advice: in words, the most useful first.
        advice_step_kmh: how finely speeds were looked at.
        geometry: what the rule books chosen say about the profile.
        force: what the simulation says; the decision is `accept` only where both are.
        measure_next: the one measurement that would decide an undecided weld most cheaply.
        accepted_risk: that the decision was made with.
        hanging: what hanging sleepers would do, where that was asked for and the support is not stated.
    """

    weld_id: Name
    profile_sha256: Sha256
    profile_id: ProfileId | UnsetType = UNSET
    config_sha256: Sha256
    limits_sha256: Sha256
    software: Name
    decision: Decision
    reason: Text
    criteria: Annotated[list[Criterion], Meta(min_length=1, max_length=100)]
    peak_force_n: ForceN
    static_load_n: ForceN
    worst_speed_kmh: SpeedKmh
    worst_position_m: Metres
    worst_x_m: Metres
    judged_speed_kmh: Annotated[float, Meta(description="km/h, the highest speed that was judged", gt=0.0)]
    chainage_m: ChainageM | UnsetType = UNSET
    rail: Name | UnsetType = UNSET
    unjudged: Annotated[list[Name], Meta(max_length=100)] = []
    by_position: Annotated[list[PositionOutcome], Meta(max_length=MAX_POSITIONS)] = []
    geometry_kind: GeometryKind | UnsetType = UNSET
    curve_class: CurveClass | UnsetType = UNSET
    maxima_kmh: Annotated[list[SpeedKmh], Meta(max_length=MAX_SPEEDS)] = []
    hollows: Annotated[list[HollowBand], Meta(max_length=MAX_SPEEDS)] = []
    permitted_speed_kmh: SpeedKmh | UnsetType = UNSET
    avoid: Annotated[list[SpeedBand], Meta(max_length=MAX_SPEEDS)] = []
    restrictions: Annotated[list[Restriction], Meta(max_length=MAX_SPEEDS)] = []
    advice: Annotated[list[Text], Meta(max_length=100)] = []
    advice_step_kmh: Annotated[float, Meta(description="km/h", gt=0.0)] | UnsetType = UNSET
    samples: Annotated[int, Meta(description="of the unknown, that probabilities are from", ge=0)] = 0
    geometry: Answer | UnsetType = UNSET
    force: Answer | UnsetType = UNSET
    measure_next: Text | UnsetType = UNSET
    accepted_risk: Annotated[float, Meta(gt=0.0, lt=0.5)] | UnsetType = UNSET
    vehicle: Annotated[Name, Meta(description="that decides")] | UnsetType = UNSET
    worst_running: Direction | UnsetType = UNSET
    hanging: Annotated[list[HangingOutcome], Meta(max_length=10)] = []


RailSide: TypeAlias = Literal["rising chainage", "falling chainage", "both"]


class GrindingSpot(msgspec.Struct, kw_only=True, frozen=True):
    """A stretch of rail that is ground, in one piece; places are from the weld's centre.

    Attributes:
        deepest_m: where most is removed.
        side: of the weld's centre that it lies on; absent where nobody stated which way chainage goes.
    """

    from_m: Metres
    to_m: Metres
    depth_m: Annotated[float, Meta(description="m, most that is removed", ge=0.0)]
    deepest_m: Metres
    side: Annotated[RailSide, Meta(extra_json_schema={"type": "string"})] | UnsetType = UNSET


class GrindingAdvice(Message, kw_only=True):
    """The least removal of metal that brings a weld within its limits; `x_m` is 0 at the weld's centre.

    Attributes:
        reached: whether a removal was found that does.
        z_m: heights before, positive up; `z_m - removal_m` is the ground profile, as it was simulated.
        band_limit_m: shortest wavelength that is ground.
        stone_radius_m: hollows are no sharper than that.
        removed_m2: area between both profiles.
        reference_checked: passages simulated again by the `reference` engine, and how many of them are within limits.
        spots: where to grind, in the order of x.
        hand_margin_m: the limits are kept though the depth come out that much too large or too small.
        peak_by_hand_n: the largest peak force if it does.
        gradient_norm_rad: largest inclination that the norm allows on the line: a quality index of 1.
    """

    weld_id: Name
    profile_sha256: Sha256
    config_sha256: Sha256
    limits_sha256: Sha256
    software: Name
    reached: bool
    reason: Text
    x_m: Cells
    z_m: Cells
    removal_m: Cells
    most_removed_m: Annotated[float, Meta(description="m", ge=0.0)]
    removed_m2: Annotated[float, Meta(description="m^2", ge=0.0)]
    band_limit_m: Annotated[float, Meta(description="m", gt=0.0)]
    stone_radius_m: Annotated[float, Meta(description="m", gt=0.0)]
    decision_before: Decision
    decision_after: Decision
    before: Annotated[list[Criterion], Meta(max_length=100)]
    after: Annotated[list[Criterion], Meta(max_length=100)]
    speeds_kmh: SpeedAxis
    peak_before_n: Cells
    peak_after_n: Cells
    reference_checked: Annotated[int, Meta(ge=0)] = 0
    reference_within: Annotated[int, Meta(ge=0)] = 0
    reference_peak_n: ForceN | UnsetType = UNSET
    elapsed_s: Seconds
    spots: Annotated[list[GrindingSpot], Meta(max_length=1000)] = []
    hand_margin_m: Annotated[float, Meta(description="m", ge=0.0)] = 0.0
    peak_by_hand_n: ForceN | UnsetType = UNSET
    chainage_direction: ChainageDirection | UnsetType = UNSET
    gradient_norm_rad: Annotated[float, Meta(description="rad", gt=0.0)] | UnsetType = UNSET

    def problem(self) -> str | None:
        """Return which columns differ in length; else None."""
        return wrong_length(self, ("z_m", "removal_m"), len(self.x_m)) or wrong_length(
            self, ("peak_before_n", "peak_after_n"), len(self.speeds_kmh)
        )


def limits_sha256(settings: AssessmentSettings) -> str:
    """Return the identity of what verdicts are made with; of limits without rules and norm as in version 1.0."""
    limits = [msgspec.to_builtins(limit) for limit in settings.limits]
    if settings.rules is UNSET and not settings.gradient_norm:
        return json_sha256(limits)
    return json_sha256(content_without_header(settings, "limits_sha256"))
