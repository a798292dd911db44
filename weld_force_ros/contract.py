"""All that crosses a process or a disk: messages, their units and limits, and the topic table.

Every message is a flat JSON object inside a `std_msgs/String`; its JSON Schema stands in `msgs_json/`. How a message
may change: a new field has a default and readers ignore fields they do not know (minor version); anything else is a
new major version, which older readers refuse. An unknown value is an absent field, never null. SI units throughout
but for speeds, which are km/h and say so.
"""

import hashlib
import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, Protocol, TypeVar

import msgspec
from msgspec import UNSET, Meta, UnsetType

from weld_force_ros.errors import MessageError

SCHEMA_VERSION = "1.2"

MAX_MESSAGE_BYTES = 16 * 2**20
MAX_SAMPLES = 50_000
MAX_SPEEDS = 1_000
MAX_POSITIONS = 1_000
MAX_CELLS = 200_000
MAX_TEXT = 65_536
MAX_IDS = 1_000
MAX_SAMPLED = 10_000

MIN_PROFILE_SAMPLES = 20
MAX_PROFILE_SPACING_M = 0.010
MAX_PROFILE_AMPLITUDE_M = 0.010
MAX_PROFILE_LENGTH_M = 5.0


_SHA256 = r"^[0-9a-f]{64}(?!\n)$"  # to Python, $ alone is also before a last line break
_VERSION = r"^[0-9]{1,9}\.[0-9]{1,9}(?!\n)$"
_LONGEST_REASON = 300

Name = Annotated[str, Meta(min_length=1, max_length=200)]
Text = Annotated[str, Meta(max_length=MAX_TEXT)]
Sha256 = Annotated[str, Meta(pattern=_SHA256, description="SHA-256, lower-case hexadecimal")]
Number = Annotated[int, Meta(ge=0, lt=2**53)]
Metres = Annotated[float, Meta(description="m")]
SpeedKmh = Annotated[float, Meta(description="km/h", gt=0.0, le=1000.0)]
ForceN = Annotated[float, Meta(description="N")]
Seconds = Annotated[float, Meta(description="s", ge=0.0)]
Samples = Annotated[list[float], Meta(min_length=MIN_PROFILE_SAMPLES, max_length=MAX_SAMPLES)]
Cells = Annotated[list[float], Meta(min_length=1, max_length=MAX_CELLS)]
SpeedAxis = Annotated[list[SpeedKmh], Meta(min_length=1, max_length=MAX_SPEEDS)]
PositionAxis = Annotated[list[Metres], Meta(min_length=1, max_length=MAX_POSITIONS)]
Decision = Annotated[
    Literal["accept", "grind", "reject", "undecided"],
    Meta(
        extra_json_schema={"type": "string"},
        description="undecided: the input cannot support a decision; the reason says what is missing",
    ),
]
GeometryKind = Annotated[Literal["dip", "protrusion"], Meta(extra_json_schema={"type": "string"})]
CurveClass = Annotated[
    Literal["rises", "hollow"],
    Meta(extra_json_schema={"type": "string"}, description="hollow: somewhere less speed means more force"),
]
UnknownPosition = Annotated[Literal["undecided", "worst"], Meta(extra_json_schema={"type": "string"})]
Engine = Annotated[Literal["common-poles", "rfp", "reference"], Meta(extra_json_schema={"type": "string"})]
LengthUnit = Annotated[Literal["m", "cm", "mm", "um"], Meta(extra_json_schema={"type": "string"})]
UpOrDown = Annotated[Literal["up", "down"], Meta(extra_json_schema={"type": "string"})]
ProfileId = Annotated[
    str,
    Meta(pattern=_SHA256, description="identity of one measurement, which ends in one verdict or rejection"),
]
ProfileIds = Annotated[list[ProfileId], Meta(max_length=MAX_IDS)]
Batch = Annotated[list[float], Meta(min_length=1, max_length=MAX_SAMPLES)]


class Stamp(msgspec.Struct, kw_only=True, frozen=True):
    """Time since the epoch, in the form of builtin_interfaces/Time."""

    sec: Annotated[int, Meta(ge=-(2**31), lt=2**31)] = 0
    nanosec: Annotated[int, Meta(ge=0, lt=10**9)] = 0


class Message(msgspec.Struct, kw_only=True):
    """What every message carries; `sequence` counts up by one per publisher and topic, so that a gap is a loss.

    `publisher` is a node's full name and a token of its start: DDS tells a Python subscriber not who sent a message.
    """

    schema_version: Annotated[str, Meta(pattern=_VERSION)] = SCHEMA_VERSION
    publisher: Annotated[str, Meta(max_length=300)] = ""
    sequence: Number = 0
    stamp: Stamp = Stamp()

    def problem(self) -> str | None:
        """What the schema cannot say and is wrong here, or None."""
        return None


class WeldProfile(Message, kw_only=True):
    """A measured weld: heights along the rail, conditioned, about the weld's centre.

    `x_m` runs in the running direction with 0 at the weld's centre and increases strictly; `z_m` is positive up.
    """

    weld_id: Name
    source: Name
    x_m: Samples
    z_m: Samples
    profile_sha256: Sha256
    profile_id: ProfileId | UnsetType = UNSET
    source_sha256: Sha256 | UnsetType = UNSET
    rail: Name | UnsetType = UNSET
    instrument: Name | UnsetType = UNSET
    chainage_m: Metres | UnsetType = UNSET
    line_speed_kmh: SpeedKmh | UnsetType = UNSET
    weld_position_m: (
        Annotated[float, Meta(description="m of the weld's centre after the preceding sleeper", ge=0.0)] | UnsetType
    ) = UNSET
    conditioning: Annotated[list[Text], Meta(max_length=50)] = []

    def problem(self) -> str | None:
        """Why the geometry cannot be simulated, or the hash is not that of the samples; None if all is well."""
        return profile_problem(self.x_m, self.z_m) or (
            None
            if self.profile_sha256 == profile_sha256(self.x_m, self.z_m)
            else "profile_sha256 is not the hash of x_m and z_m"
        )


class Uncertainty(msgspec.Struct, kw_only=True, frozen=True):
    """What is not known exactly, and how many samples of it are rolled: `weld_force_ros.core.uncertainty`."""

    samples: Annotated[int, Meta(ge=2, le=MAX_SAMPLED)]
    seed: Number = 1
    noise_m: Annotated[float, Meta(description="m, standard deviation of the measured heights", ge=0.0, le=1e-3)]
    noise_length_m: Annotated[
        float, Meta(description="m along the rail over which noise is correlated", gt=0.0, le=1.0)
    ]
    support_spread: Annotated[
        float, Meta(description="standard deviation of ln(stiffness) of pad and ballast", ge=0.0, le=1.0)
    ]
    hertz_spread: Annotated[
        float,
        Meta(description="standard deviation of ln(Hertz constant): shapes of worn wheel and rail", ge=0.0, le=1.0),
    ]
    radius_low_m: Annotated[float, Meta(description="m, of the most worn wheel", gt=0.05, lt=2.0)]
    radius_high_m: Annotated[float, Meta(description="m, of a new wheel", gt=0.05, lt=2.0)]
    source: Text
    verified: bool = False


class SimulationSettings(Message, kw_only=True):
    """What a force map depends on beside the profile; latched, so that every recording holds it."""

    config_sha256: Sha256
    track: Name
    track_definition: Annotated[
        str, Meta(min_length=1, max_length=MAX_TEXT, description="the track file's text (YAML)")
    ]
    engine: Engine
    speeds_kmh: SpeedAxis
    positions_m: PositionAxis
    wheel_mass_kg: Annotated[float, Meta(description="kg", gt=0.0)]
    static_load_n: Annotated[float, Meta(description="N", gt=0.0)]
    wheel_radius_m: Annotated[float, Meta(description="m", gt=0.05, lt=2.0)]
    hertz_n_per_m15: Annotated[float, Meta(description="N/m^1.5", gt=0.0)]
    uncertainty: Uncertainty | UnsetType = UNSET

    def problem(self) -> str | None:
        """Speeds or positions out of order, too large a grid, or a hash that is not the content's; else None."""
        if len(self.speeds_kmh) * len(self.positions_m) > MAX_CELLS:
            return f"more than {MAX_CELLS} passages in one map"
        if not increasing(self.speeds_kmh) or not increasing(self.positions_m):
            return "speeds_kmh and positions_m must increase"
        if isinstance(self.uncertainty, Uncertainty) and self.uncertainty.radius_low_m > self.uncertainty.radius_high_m:
            return "uncertainty: radius_low_m is above radius_high_m"
        return None if self.config_sha256 == config_sha256(self) else "config_sha256 is not the hash of the settings"


class Limit(msgspec.Struct, kw_only=True, frozen=True):
    """A criterion's limits: up to `limit` passes, up to `reject_limit` asks for grinding, beyond it rejects.

    One with `above_kmh` or `to_kmh` holds for lines of those speeds: above the one, up to the other.
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


class Rules(msgspec.Struct, kw_only=True, frozen=True):
    """How limits become a decision; without rules the worst position counts and any sampling will do.

    Attributes:
        unknown_position: of a weld whose place in the span is unknown: the worst position's decision, or `undecided`
            where not all positions have the same.
        resolved_hz: what passes is undecided if samples are so far apart that at the worst speed they do not show waves
            up to this frequency; 0: any sampling will do.
        source: where these rules come from.
    """

    unknown_position: UnknownPosition = "undecided"
    resolved_hz: Annotated[float, Meta(description="Hz", ge=0.0)] = 0.0
    source: Text = ""
    verified: bool = False


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

    def problem(self) -> str | None:
        """A limit that cannot be applied, or a hash that is not the content's; else None."""
        for limit in self.limits:
            if limit.reject_limit < limit.limit:
                return f"limit {limit.name}: reject_limit is below limit"
        if not increasing([point.speed_kmh for point in self.gradient_norm]):
            return "gradient_norm: speeds must increase"
        return None if self.limits_sha256 == limits_sha256(self) else "limits_sha256 is not the hash of the limits"


class ProfileMeasures(msgspec.Struct, kw_only=True, frozen=True):
    """What a profile's geometry says without a wheel."""

    kind: GeometryKind
    dip_m: Annotated[float, Meta(description="m, deepest place below its surroundings", ge=0.0)]
    protrusion_m: Annotated[float, Meta(description="m, highest place above its surroundings", ge=0.0)]
    gradient_rad: Annotated[float, Meta(description="rad, largest gradient of heights averaged over 25 mm", ge=0.0)]
    straightedge_m: Annotated[
        float, Meta(description="m, largest distance between the rail and a straightedge of 1 m on it", ge=0.0)
    ]
    spacing_m: Annotated[float, Meta(description="m, largest distance of samples", gt=0.0)]


class SpeedCurve(msgspec.Struct, kw_only=True):
    """The worst over all positions that count, speed by speed, finer than the map: for advice on speed.

    Attributes:
        at_m: where the weld lies in the passage with the largest peak.
    """

    speeds_kmh: Annotated[list[SpeedKmh], Meta(min_length=1, max_length=MAX_SPEEDS)]
    peak_force_n: Cells
    min_force_n: Cells
    contact_loss_s: Cells
    at_m: Cells
    p2_force_n: Cells | UnsetType = UNSET
    force_20hz_n: Cells | UnsetType = UNSET


class Spread(msgspec.Struct, kw_only=True):
    """What samples of the unknown came to: the worst over speeds up to the line's, row-major (sample, position).

    `positions_m` are those that count; the inputs of each sample stand beside: factors on the nominal value, and the
    wheel's radius.
    """

    positions_m: PositionAxis
    peak_force_n: Cells
    min_force_n: Cells
    contact_loss_s: Cells
    p2_force_n: Cells | UnsetType = UNSET
    force_20hz_n: Cells | UnsetType = UNSET
    gradient_rad: Cells
    straightedge_m: Cells
    support_factor: Cells
    hertz_factor: Cells
    wheel_radius_m: Cells


class ForceMap(Message, kw_only=True):
    """Peak force over speed and position in the sleeper span.

    Matrices are row-major (speed, position). `positions_m` is the weld's centre after the sleeper, `peak_x_m` where
    the wheel was at the peak in the same coordinate (0 at that sleeper).
    """

    weld_id: Name
    profile_sha256: Sha256
    profile_id: ProfileId | UnsetType = UNSET
    config_sha256: Sha256
    track: Name
    engine: Engine
    speeds_kmh: SpeedAxis
    positions_m: PositionAxis
    peak_force_n: Cells
    peak_x_m: Cells
    min_force_n: Cells
    contact_loss_s: Cells
    static_load_n: Annotated[float, Meta(description="N", gt=0.0)]
    span_m: Annotated[float, Meta(description="m, the sleeper spacing that positions repeat with", gt=0.0)]
    model_error: (
        Annotated[
            float,
            Meta(
                description="about the relative error of the force's dynamic part (force less static load) that comes"
                " from representing this track in time; large where loss factors are not causal",
                ge=0.0,
            ),
        ]
        | UnsetType
    ) = UNSET
    elapsed_s: Seconds
    p2_force_n: (
        Annotated[Cells, Meta(description="N, largest force below 120 Hz (causal Butterworth low pass, 4th order)")]
        | UnsetType
    ) = UNSET
    force_20hz_n: (
        Annotated[Cells, Meta(description="N, largest force below 20 Hz (causal Butterworth low pass, 4th order)")]
        | UnsetType
    ) = UNSET
    measures: ProfileMeasures | UnsetType = UNSET
    curve: SpeedCurve | UnsetType = UNSET
    spread: Spread | UnsetType = UNSET
    line_speed_kmh: SpeedKmh | UnsetType = UNSET
    weld_position_m: Metres | UnsetType = UNSET
    chainage_m: Metres | UnsetType = UNSET
    rail: Name | UnsetType = UNSET

    def problem(self) -> str | None:
        """Matrices that do not fit their axes, or axes out of order; else None."""
        if not increasing(self.speeds_kmh) or not increasing(self.positions_m):
            return "speeds_kmh and positions_m must increase"
        cells = len(self.speeds_kmh) * len(self.positions_m)
        names = ("peak_force_n", "peak_x_m", "min_force_n", "contact_loss_s", "p2_force_n", "force_20hz_n")
        return _wrong_length(self, names, cells) or self._curve_problem() or self._spread_problem()

    def _curve_problem(self) -> str | None:
        if not isinstance(self.curve, SpeedCurve):
            return None
        if not increasing(self.curve.speeds_kmh):
            return "curve: speeds_kmh must increase"
        columns = [name for name in self.curve.__struct_fields__ if name != "speeds_kmh"]
        return _wrong_length(self.curve, columns, len(self.curve.speeds_kmh), "curve: ")

    def _spread_problem(self) -> str | None:
        if not isinstance(self.spread, Spread):
            return None
        samples = ("gradient_rad", "straightedge_m", "support_factor", "hertz_factor", "wheel_radius_m")
        cells = [name for name in self.spread.__struct_fields__ if name not in (*samples, "positions_m")]
        count = len(self.spread.support_factor)
        return _wrong_length(self.spread, samples, count, "spread: ") or _wrong_length(
            self.spread, cells, count * len(self.spread.positions_m), "spread: "
        )


class ForceHistory(Message, kw_only=True):
    """One passage in the space domain; `x_m` is 0 at the sleeper before the weld, displacements positive up."""

    weld_id: Name
    profile_sha256: Sha256
    profile_id: ProfileId | UnsetType = UNSET
    config_sha256: Sha256
    speed_kmh: SpeedKmh
    position_m: Metres
    x_m: Cells
    force_n: Cells
    wheel_m: Cells
    rail_m: Cells
    irregularity_m: Cells

    def problem(self) -> str | None:
        """Columns of different length; else None."""
        lengths = {len(c) for c in (self.x_m, self.force_n, self.wheel_m, self.rail_m, self.irregularity_m)}
        return None if len(lengths) == 1 else "x_m, force_n, wheel_m, rail_m and irregularity_m differ in length"


class Criterion(msgspec.Struct, kw_only=True, frozen=True):
    """One line of a verdict: the value found, the limit it was held against, and where the limit comes from.

    Attributes:
        speed_kmh, position_m: of the passage that the value is from; absent for what the geometry says by itself.
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
    exceeding: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    exceeding_reject: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET
    driver: Annotated[str, Meta(max_length=200)] | UnsetType = UNSET
    driver_share: Annotated[float, Meta(ge=0.0, le=1.0)] | UnsetType = UNSET


class PositionOutcome(msgspec.Struct, kw_only=True, frozen=True):
    """What would be decided if the weld lay there."""

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
    """What running at most at a speed would do to the peak force.

    Attributes:
        peak_force_n: at that speed.
        change: of it relative to the peak at the highest speed judged: 0.12 is 12 % more.
        within_limits: whether all speeds up to it are.
    """

    speed_kmh: SpeedKmh
    peak_force_n: ForceN
    change: float
    within_limits: bool


class Verdict(Message, kw_only=True):
    """What to do with a weld, and why.

    Attributes:
        unjudged: limits that could not be applied, as what they are about was not computed.
        by_position: what would be decided at each position, where the weld's own is unknown.
        permitted_speed_kmh: the highest speed up to which all speeds are within limits; absent if not even the lowest
            is, or nothing was said about speed.
        avoid: speeds beyond limits.
        restrictions: falling, from the highest speed judged.
        advice: in words, the most useful first.
        advice_step_kmh: how finely speeds were looked at.
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
    chainage_m: Metres | UnsetType = UNSET
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


class GrindingAdvice(Message, kw_only=True):
    """The least removal of metal that brings a weld within its limits; `x_m` is 0 at the weld's centre.

    Attributes:
        reached: whether a removal was found that does.
        z_m: heights before, positive up; `z_m - removal_m` is the ground profile, as it was simulated.
        band_limit_m: shortest wavelength that is ground.
        stone_radius_m: hollows are no sharper than that.
        removed_m2: area between both profiles.
        reference_checked: passages rolled again by the `reference` engine, and how many of them are within limits.
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

    def problem(self) -> str | None:
        """Columns of different length; else None."""
        return _wrong_length(self, ("z_m", "removal_m"), len(self.x_m)) or _wrong_length(
            self, ("peak_before_n", "peak_after_n"), len(self.speeds_kmh)
        )


class Rejection(Message, kw_only=True):
    """An input that could not be used, with what to do about it; the text it came as is kept."""

    source: Name
    reason: Text
    remedy: Text
    raw_text: Annotated[str, Meta(max_length=MAX_TEXT)] = ""
    raw_truncated: bool = False
    source_sha256: Sha256 | UnsetType = UNSET
    profile_sha256: Sha256 | UnsetType = UNSET
    profile_id: ProfileId | UnsetType = UNSET


class RailSurface(Message, kw_only=True):
    """A batch of running-surface samples in the order measured; batches may overlap, and the trolley may reverse."""

    chainage: Batch
    height: Batch
    chainage_unit: LengthUnit
    height_unit: LengthUnit
    height_positive: UpOrDown

    def problem(self) -> str | None:
        """Not one height for every chainage; else None."""
        if len(self.chainage) == len(self.height):
            return None
        return f"{len(self.chainage)} chainages but {len(self.height)} heights"


class WeldMarker(Message, kw_only=True):
    """Here is a weld: at `chainage_m`, or where the trolley is now; what is known of it goes into its profile."""

    chainage_m: Metres | UnsetType = UNSET
    weld_id: Name | UnsetType = UNSET
    line_speed_kmh: SpeedKmh | UnsetType = UNSET
    weld_position_m: (
        Annotated[float, Meta(description="m of the weld's centre after the preceding sleeper", ge=0.0)] | UnsetType
    ) = UNSET


class Inquiry(Message, kw_only=True):
    """Which of these measurements have their verdict or rejection? Answered on `settled`."""

    profile_ids: ProfileIds


class Settled(Message, kw_only=True):
    """These measurements have their verdict or rejection, recorded and published.

    The assessment node says so of each as it comes; asked by an Inquiry, it names those that have (perhaps none).
    """

    profile_ids: ProfileIds
    asked_by: Annotated[str, Meta(max_length=300, description="publisher of the inquiry; empty: not asked")] = ""
    asked_sequence: Number = 0


class Topic(msgspec.Struct, frozen=True):
    """A row of the topic table; `name` is relative to the suite's namespace."""

    name: str
    type: type[Message]
    latched: bool
    description: str


TOPICS: dict[type[Message], Topic] = {
    topic.type: topic
    for topic in (
        Topic("weld_profile", WeldProfile, True, "measured weld geometries"),
        Topic("force_map", ForceMap, True, "peak force over speed and position"),
        Topic("force_history", ForceHistory, True, "the worst passage of a map"),
        Topic("verdict", Verdict, True, "decisions"),
        Topic("rejection", Rejection, True, "inputs that could not be used"),
        Topic("rail_surface", RailSurface, False, "running surface under the trolley, as it comes"),
        Topic("weld_marker", WeldMarker, False, "places where somebody saw a weld"),
        Topic("inquiry", Inquiry, False, "which measurements have an outcome?"),
        Topic("settled", Settled, True, "measurements that have their outcome"),
        Topic("simulation_settings", SimulationSettings, True, "track, engine, grid and wheel in force"),
        Topic("assessment_settings", AssessmentSettings, True, "limits in force"),
    )
}

SCHEMAS: tuple[type[Message], ...] = (*TOPICS, GrindingAdvice)
"""All that has a schema: what is published, and what is only written to files."""

M = TypeVar("M", bound=Message)


class _Version(msgspec.Struct):
    schema_version: Annotated[str, Meta(pattern=_VERSION)]


def encode(message: Message) -> bytes:
    """The JSON of a message that keeps the contract.

    Raises:
        MessageError: a value that the contract forbids (a NaN, unequal lengths, a bound exceeded).
    """
    try:
        data = msgspec.json.encode(message)
    except UnicodeError as error:
        raise MessageError(f"{type(message).__name__}: {error}", "give text that UTF-8 can hold") from None
    decode(type(message), data)
    return data


def decode(kind: type[M], data: bytes | str) -> M:
    """Read and validate one message.

    Raises:
        MessageError: not JSON, another major version, or against the contract.
    """
    name = kind.__name__
    # A lone surrogate is no text that JSON could hold: as bytes it is refused like any other damage.
    raw = data.encode(errors="surrogatepass") if isinstance(data, str) else data
    if len(raw) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{name}: {len(raw)} bytes", f"send at most {MAX_MESSAGE_BYTES}")
    try:
        version = msgspec.json.decode(raw, type=_Version).schema_version
        if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
            raise MessageError(
                f"{name}: schema version {version} is unknown here",
                f"send version {SCHEMA_VERSION} or update this node",
            )
        message = msgspec.json.decode(raw, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"{name}: {legible(str(error))}", f"send JSON after msgs_json/{name}.json") from None
    problem = _not_finite(message) or message.problem()
    if problem:
        raise MessageError(f"{name}: {problem}", f"send JSON after msgs_json/{name}.json")
    return message


def legible(reason: str) -> str:
    """A parser's message as a clause of one short line: it may hold any part of the input."""
    line = " ".join("".join(c if c.isprintable() else " " for c in reason).split())
    return line if len(line) <= _LONGEST_REASON else line[:_LONGEST_REASON] + "…"


def _wrong_length(of: msgspec.Struct, names: Sequence[str], count: int, where: str = "") -> str | None:
    for name in names:
        column = getattr(of, name)
        if column is not UNSET and len(column) != count:
            return f"{where}{name} has {len(column)} values, the axes make {count}"
    return None


def _not_finite(message: msgspec.Struct) -> str | None:
    for field in message.__struct_fields__:
        value = getattr(message, field)
        values = value if isinstance(value, list) else [value]
        if any(isinstance(v, float) and not math.isfinite(v) for v in values):
            return f"{field} holds a number that is not finite"
        for item in values:
            if isinstance(item, msgspec.Struct) and (problem := _not_finite(item)):
                return f"{field}: {problem}"
    return None


def increasing(values: Sequence[float]) -> bool:
    """Whether each value is larger than the one before it."""
    return all(a < b for a, b in itertools.pairwise(values))


def profile_problem(x_m: Sequence[float], z_m: Sequence[float]) -> str | None:
    """Why a geometry cannot be simulated, in one clause, or None.

    Bounds (design.md): 20 samples or more, x increasing, spacing up to 10 mm, heights spanning up to 10 mm, length up
    to 5 m.
    """
    if len(x_m) != len(z_m):
        return f"{len(x_m)} positions but {len(z_m)} heights"
    for name, values in (("x", x_m), ("z", z_m)):
        for row, value in enumerate(values, start=1):
            if not math.isfinite(value):
                return f"sample {row}: {name} is not a finite number"
    if len(x_m) < MIN_PROFILE_SAMPLES:
        return f"{len(x_m)} samples, {MIN_PROFILE_SAMPLES} are needed"
    steps = [b - a for a, b in itertools.pairwise(x_m)]
    for row, step in enumerate(steps, start=1):
        if step <= 0.0:
            return f"x does not increase from sample {row} to {row + 1}"
    length = x_m[-1] - x_m[0]
    if length > MAX_PROFILE_LENGTH_M * (1 + 1e-9):
        return f"length {length:.3f} m, at most {MAX_PROFILE_LENGTH_M:g} m"
    widest = max(range(len(steps)), key=steps.__getitem__)
    if steps[widest] > MAX_PROFILE_SPACING_M * (1 + 1e-9):
        bound_mm = MAX_PROFILE_SPACING_M * 1e3
        return f"spacing {steps[widest] * 1e3:.3g} mm after sample {widest + 1}, at most {bound_mm:g} mm"
    amplitude = max(z_m) - min(z_m)
    if amplitude > MAX_PROFILE_AMPLITUDE_M * (1 + 1e-9):
        return f"amplitude {amplitude * 1e3:.3g} mm, at most {MAX_PROFILE_AMPLITUDE_M * 1e3:g} mm"
    return None


def profile_sha256(x_m: Sequence[float], z_m: Sequence[float]) -> str:
    """Identity of a geometry: SHA-256 of the JSON of its samples (shortest round-trip decimals, so exact)."""
    return _sha256([list(map(float, x_m)), list(map(float, z_m))])


def measurement_id(source: str, content_sha256: str) -> str:
    """Identity of one measurement: of where it came from (a file's name) and of its content."""
    return _sha256([source, content_sha256])


class _About(Protocol):
    weld_id: str
    profile_sha256: str
    profile_id: str | UnsetType


def identity(message: _About) -> str:
    """Which measurement a message is about; of publishers that name none, one geometry of one weld is one."""
    if isinstance(message.profile_id, str):
        return message.profile_id
    return _sha256([message.weld_id, message.profile_sha256])


def config_sha256(settings: SimulationSettings) -> str:
    """Identity of simulation settings: SHA-256 of their content without the header and the hash itself."""
    return _sha256(_content(settings, "config_sha256"))


def limits_sha256(settings: AssessmentSettings) -> str:
    """Identity of what verdicts are made with; of limits without rules and norm as it always was."""
    limits = [msgspec.to_builtins(limit) for limit in settings.limits]
    if settings.rules is UNSET and not settings.gradient_norm:
        return _sha256(limits)
    return _sha256(_content(settings, "limits_sha256"))


def _content(message: Message, *without: str) -> dict[str, Any]:
    builtins: dict[str, Any] = msgspec.to_builtins(message)
    return {k: v for k, v in builtins.items() if k not in (*Message.__struct_fields__, *without)}


def _sha256(content: object) -> str:
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """JSON Schema (2020-12) of a message, with every reference written out: Lichtblick resolves none."""
    (schema,), components = msgspec.json.schema_components([kind], ref_template="{name}")
    inlined: dict[str, Any] = _inline(schema, components)
    required = sorted({*inlined.get("required", []), *Message.__struct_fields__}, key=list(inlined["properties"]).index)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"weld_force_ros/{kind.__name__}.json",
        **inlined,
        "required": required,
    }


def _inline(schema: Any, components: dict[str, Any]) -> Any:
    if isinstance(schema, list):
        return [_inline(item, components) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        referred = components[schema["$ref"]]
        return _inline({**referred, **{k: v for k, v in schema.items() if k != "$ref"}}, components)
    return {k: _inline(v, components) for k, v in schema.items()}
