"""Declare what a simulation is asked for and what it returns: settings, force map, force history."""

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from weld_force_ros.messages.fields import (
    MAX_CELLS,
    MAX_SAMPLED,
    MAX_SPEEDS,
    MAX_TEXT,
    MAX_VEHICLES,
    Cells,
    ChainageM,
    Direction,
    Engine,
    Message,
    Metres,
    Name,
    Number,
    PositionAxis,
    ProfileId,
    Running,
    Seconds,
    Sha256,
    SpeedAxis,
    SpeedKmh,
    Text,
    content_without_header,
    increasing,
    json_sha256,
    wrong_length,
)
from weld_force_ros.messages.profile import ProfileMeasures
from weld_force_ros.messages.support import SupportState


class Uncertainty(msgspec.Struct, kw_only=True, frozen=True):
    """Quantities that are uncertain, and how many samples of them are simulated."""

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
    design: (
        Annotated[
            Literal["quasi-random"],
            Meta(
                extra_json_schema={"type": "string"},
                description="how samples are drawn and simulated: quasi-random, where they can be the worst; if unset,"
                " random levels, at every speed and position",
            ),
        ]
        | UnsetType
    ) = UNSET
    hanging_share: (
        Annotated[float, Meta(description="share of sleepers that hang, of the two beside each weld", gt=0.0, lt=1.0)]
        | UnsetType
    ) = UNSET
    sleeper_spread: (
        Annotated[
            float,
            Meta(
                description="standard deviation of ln(stiffness and damping beneath a sleeper) from sleeper to sleeper",
                gt=0.0,
                le=1.0,
            ),
        ]
        | UnsetType
    ) = UNSET


class SimulationSettings(Message, kw_only=True):
    """Everything that a force map depends on beside the profile; latched, so that every recording holds it.

    `running` and `support` are those of profiles which do not state them; if unset, with, and as the track has it.
    """

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
    vehicle: Name | UnsetType = UNSET
    contact_patch_m: (
        Annotated[
            float,
            Meta(description="m, half length of the contact patch that heights are averaged over", gt=0.0, lt=0.05),
        ]
        | UnsetType
    ) = UNSET
    uncertainty: Uncertainty | UnsetType = UNSET
    running: Running | UnsetType = UNSET
    support: Annotated[list[SupportState], Meta(max_length=18)] | UnsetType = UNSET
    rolling: (
        Annotated[
            Literal["none"],
            Meta(
                extra_json_schema={"type": "string"},
                description="none: the contact follows the rail as it stands; if unset, the wheel rolls over it",
            ),
        ]
        | UnsetType
    ) = UNSET
    poles: (
        Annotated[
            Literal["moving"],
            Meta(
                description="common poles as a moving contact finds them; as a resting one does, if unset",
                extra_json_schema={"type": "string"},
            ),
        ]
        | UnsetType
    ) = UNSET

    @property
    def rolling_radius_m(self) -> float:
        """Radius of the circle that rolls over the rail; 0 where none does."""
        return self.wheel_radius_m if isinstance(self.rolling, UnsetType) else 0.0

    @property
    def patch_half_length_m(self) -> float:
        """Half length of the contact patch; 0 where the contact is a point."""
        return 0.0 if isinstance(self.contact_patch_m, UnsetType) else self.contact_patch_m

    def problem(self) -> str | None:
        """Return why the grid cannot be computed, or that the hash is not the content's; else None."""
        if len(self.speeds_kmh) * len(self.positions_m) > MAX_CELLS:
            return f"more than {MAX_CELLS} passages in one map"
        if not increasing(self.speeds_kmh) or not increasing(self.positions_m):
            return "speeds_kmh and positions_m must increase"
        if isinstance(self.uncertainty, Uncertainty) and self.uncertainty.radius_low_m > self.uncertainty.radius_high_m:
            return "uncertainty: radius_low_m is above radius_high_m"
        return None if self.config_sha256 == config_sha256(self) else "config_sha256 is not the hash of the settings"


class SpeedCurve(msgspec.Struct, kw_only=True):
    """The worst over all relevant positions, speed by speed, finer than the map: for speed advice.

    Attributes:
        at_m: where the weld lies in the passage with the largest peak.
        against: whether that passage runs against rising x; absent where one direction was simulated.
        estimated: whether a column's worst at that speed was not simulated but estimated from neighbouring speeds;
            absent where all was simulated.
        limits_sha256: of the limits for which simulated speeds were chosen, so that advice on speed by these limits is
            that of every speed simulated; absent where all was.
    """

    speeds_kmh: Annotated[list[SpeedKmh], Meta(min_length=1, max_length=MAX_SPEEDS)]
    peak_force_n: Cells
    min_force_n: Cells
    contact_loss_s: Cells
    at_m: Cells
    p2_force_n: Cells | UnsetType = UNSET
    force_20hz_n: Cells | UnsetType = UNSET
    against: Annotated[list[bool], Meta(max_length=MAX_SPEEDS)] | UnsetType = UNSET
    estimated: Annotated[list[bool], Meta(max_length=MAX_SPEEDS)] | UnsetType = UNSET
    limits_sha256: Sha256 | UnsetType = UNSET


class OppositeDirection(msgspec.Struct, kw_only=True):
    """Passages against rising x, in a force map of both directions: its columns, in its order and coordinates."""

    peak_force_n: Cells
    peak_x_m: Cells
    min_force_n: Cells
    contact_loss_s: Cells
    p2_force_n: Cells | UnsetType = UNSET
    force_20hz_n: Cells | UnsetType = UNSET


class UncertaintyResult(msgspec.Struct, kw_only=True):
    """Results of Monte-Carlo samples: the worst over speeds up to the line's, row-major (sample, position).

    `positions_m` are those that count; the inputs of each sample stand beside: factors on the nominal value, and the
    wheel's radius. Readings under straightedges, as `EdgeReading`, are row-major (straightedge, sample).
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
    edge_base_m: Annotated[list[Annotated[float, Meta(description="m", gt=0.0)]], Meta(max_length=20)] = []
    edge_peak_m: list[Metres] = []
    edge_dip_m: list[Metres] = []
    inclination_rad: Cells | UnsetType = UNSET
    step_m: Cells | UnsetType = UNSET
    hanging: (
        Annotated[
            list[Annotated[int, Meta(ge=0, le=3)]],
            Meta(description="sleepers that hang: 1 for the one before the weld, plus 2 for the next"),
        ]
        | UnsetType
    ) = UNSET
    sleeper_effect: (
        Annotated[
            list[Annotated[float, Meta(gt=0.0)]],
            Meta(
                max_length=MAX_SAMPLED,
                description="factor on the peak force, mean over positions, by what differs from sleeper to sleeper",
            ),
        ]
        | UnsetType
    ) = UNSET


class ForceMap(Message, kw_only=True):
    """Peak force over speed and position in the sleeper span.

    Matrices are row-major (speed, position). `positions_m` is the weld's centre after the sleeper, `peak_x_m` where
    the wheel was at the peak in the same coordinate (0 at that sleeper). They are of passages in the direction that
    `running` says; where that is both, with rising x, and `against` holds those of the other direction. `curve` and
    `spread` are the worst over the directions.
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
    span_m: Annotated[float, Meta(description="m, the sleeper spacing that positions repeat with", gt=0.0, le=1e3)]
    model_error: (
        Annotated[
            float,
            Meta(
                description="fit error: about the relative error of the force's dynamic part (force less static load)"
                " that comes from fitting this track in time; large where loss factors are not causal; what the model"
                " leaves out is the rules' model_uncertainty",
                ge=0.0,
                le=1e3,
            ),
        ]
        | UnsetType
    ) = UNSET
    pad_n_per_m: Annotated[float, Meta(description="N/m, stiffness of the track's pads", gt=0.0)] | UnsetType = UNSET
    vehicle: Name | UnsetType = UNSET
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
    spread: UncertaintyResult | UnsetType = UNSET
    line_speed_kmh: SpeedKmh | UnsetType = UNSET
    weld_position_m: Metres | UnsetType = UNSET
    chainage_m: ChainageM | UnsetType = UNSET
    rail: Name | UnsetType = UNSET
    running: Running | UnsetType = UNSET
    against: OppositeDirection | UnsetType = UNSET
    support: Annotated[list[SupportState], Meta(max_length=18)] | UnsetType = UNSET
    judged_together: Annotated[
        list[Sha256],
        Meta(
            max_length=MAX_VEHICLES,
            description="config_sha256 of the maps of all vehicles over the weld, this one among them: they have one"
            " verdict, by the vehicle that decides; empty: this map has its own",
        ),
    ] = []

    @property
    def configs_judged(self) -> list[str]:
        """The `config_sha256` of every map that the verdict is on, in the order of the vehicles."""
        return self.judged_together or [self.config_sha256]

    def problem(self) -> str | None:
        """Return which matrix does not fit its axes, or that axes are out of order; else None."""
        if not increasing(self.speeds_kmh) or not increasing(self.positions_m):
            return "speeds_kmh and positions_m must increase"
        if self.config_sha256 not in self.configs_judged:
            return "judged_together does not hold the map's own config_sha256"
        cells = len(self.speeds_kmh) * len(self.positions_m)
        names = OppositeDirection.__struct_fields__
        return (
            wrong_length(self, names, cells)
            or self._against_problem(names, cells)
            or self._curve_problem()
            or self._spread_problem()
        )

    def _against_problem(self, names: Sequence[str], cells: int) -> str | None:
        if isinstance(self.against, UnsetType):
            return "running is both, but against is missing" if self.running == "both" else None
        if self.running != "both":
            return "against is given, but running is not both"
        return wrong_length(self.against, names, cells, "against: ")

    def _curve_problem(self) -> str | None:
        if not isinstance(self.curve, SpeedCurve):
            return None
        if not increasing(self.curve.speeds_kmh):
            return "curve: speeds_kmh must increase"
        columns = [name for name in self.curve.__struct_fields__ if name not in ("speeds_kmh", "limits_sha256")]
        return wrong_length(self.curve, columns, len(self.curve.speeds_kmh), "curve: ")

    def _spread_problem(self) -> str | None:
        if not isinstance(self.spread, UncertaintyResult):
            return None
        samples = (
            "gradient_rad", "straightedge_m", "support_factor", "hertz_factor", "wheel_radius_m", "inclination_rad",
            "step_m", "hanging", "sleeper_effect",
        )  # fmt: skip
        others = (*samples, "positions_m", "edge_base_m", "edge_peak_m", "edge_dip_m")
        cells = [name for name in self.spread.__struct_fields__ if name not in others]
        count, edges = len(self.spread.support_factor), len(self.spread.edge_base_m)
        return (
            wrong_length(self.spread, samples, count, "spread: ")
            or wrong_length(self.spread, cells, count * len(self.spread.positions_m), "spread: ")
            or wrong_length(self.spread, ("edge_peak_m", "edge_dip_m"), count * edges, "spread: ")
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
    running: Direction | UnsetType = UNSET

    def problem(self) -> str | None:
        """Return that columns differ in length; else None."""
        lengths = {len(c) for c in (self.x_m, self.force_n, self.wheel_m, self.rail_m, self.irregularity_m)}
        return None if len(lengths) == 1 else "x_m, force_n, wheel_m, rail_m and irregularity_m differ in length"


def config_sha256(settings: SimulationSettings) -> str:
    """Return the identity of simulation settings: SHA-256 of their content without the header and the hash itself."""
    return json_sha256(content_without_header(settings, "config_sha256"))
