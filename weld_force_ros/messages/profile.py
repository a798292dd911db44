"""Declare the measured weld and what its geometry says by itself."""

import hashlib
import itertools
import math
import struct
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import UNSET, Meta, UnsetType

from weld_force_ros.messages.fields import (
    MAX_MEASURED_SPACING_M,
    MAX_PROFILE_AMPLITUDE_M,
    MAX_PROFILE_LENGTH_M,
    MAX_PROFILE_SPACING_M,
    MAX_SAMPLES,
    MIN_PROFILE_SAMPLES,
    ChainageDirection,
    ChainageM,
    GeometryKind,
    IrregularityKind,
    Message,
    Name,
    ProfileId,
    Running,
    Samples,
    Sha256,
    SpeedKmh,
    Text,
    json_sha256,
)
from weld_force_ros.messages.support import SupportState


class FormError(msgspec.Struct, kw_only=True, frozen=True):
    """An instrument's own form error, the same in every measurement: its bend and its calibration.

    Attributes:
        deviation_m: standard deviation of the heights.
        length_m: along the rail, over which the error's correlation falls to 1/e.
        source: of the numbers.
    """

    deviation_m: Annotated[float, Meta(description="m, standard deviation", gt=0.0)]
    length_m: Annotated[float, Meta(description="m", gt=0.0)]
    source: Text = ""


class MeasurementNoise(msgspec.Struct, kw_only=True, frozen=True):
    """What is known of the noise in measured heights, and how the geometry was estimated from them.

    The posterior of the geometry is computed again from this and the measured samples.

    Attributes:
        method: of the estimate; `none`: the samples are the geometry.
        noise_m: standard deviation of the measurement noise, rounding included.
        stated: whether the noise was known, not estimated.
        resolution_m: the step in which heights were written; absent if there is none.
        outliers_m: positions of the samples that were set aside as wrong.
        form_error: of the instrument, which no estimate takes out; it counts beside the noise.
    """

    method: Name
    noise_m: Annotated[float, Meta(description="m, standard deviation", ge=0.0)]
    stated: bool = False
    resolution_m: Annotated[float, Meta(description="m", gt=0.0)] | UnsetType = UNSET
    outliers_m: Annotated[list[float], Meta(max_length=MAX_SAMPLES)] = []
    form_error: FormError | UnsetType = UNSET


class WeldProfile(Message, kw_only=True):
    """A measured weld: the rail's geometry, conditioned, about the weld's centre.

    `x_m` has 0 at the weld's centre and increases strictly; `z_m` is positive up. In which direction trains run along
    it, `running` says, where the file or the stream states it, and which way chainage goes, `chainage_direction`. Where
    the geometry was estimated from noisy samples, these stand beside it: `measured_x_m`, `measured_z_m`, levelled and
    centred like the estimate, and `noise`. Without `profile_sha256`, it is computed where the message is made or read.
    """

    weld_id: Name
    source: Name
    x_m: Samples
    z_m: Samples
    profile_sha256: Annotated[
        Sha256,
        Meta(description="SHA-256 of x_m, then z_m, as little-endian float64, -0 as 0; absent: the receiver's own"),
    ] = msgspec.field(default_factory=str)
    profile_id: ProfileId | UnsetType = UNSET
    source_sha256: Sha256 | UnsetType = UNSET
    rail: Name | UnsetType = UNSET
    instrument: Name | UnsetType = UNSET
    chainage_m: ChainageM | UnsetType = UNSET
    line_speed_kmh: SpeedKmh | UnsetType = UNSET
    weld_position_m: (
        Annotated[float, Meta(description="m of the weld's centre after the preceding sleeper", ge=0.0, le=1e3)]
        | UnsetType
    ) = UNSET
    conditioning: Annotated[list[Text], Meta(max_length=50)] = []
    measured_x_m: Samples | UnsetType = UNSET
    measured_z_m: Samples | UnsetType = UNSET
    noise: MeasurementNoise | UnsetType = UNSET
    format: Name | UnsetType = UNSET
    kind: IrregularityKind | UnsetType = UNSET
    operator: Name | UnsetType = UNSET
    running: Running | UnsetType = UNSET
    support: Annotated[list[SupportState], Meta(max_length=18)] | UnsetType = UNSET
    chainage_direction: ChainageDirection | UnsetType = UNSET
    measured_on: Annotated[Name, Meta(description="date as the file states it")] | UnsetType = UNSET
    line: Annotated[Name, Meta(description="that the weld lies on, as the file states it")] | UnsetType = UNSET
    calibration: Annotated[Name, Meta(description="of the instrument, as the file states it")] | UnsetType = UNSET
    file_version_of: (
        Annotated[
            Name,
            Meta(
                description="the file that it was read from: of measurements of one weld with the same, the last counts"
            ),
        ]
        | UnsetType
    ) = UNSET

    def __post_init__(self) -> None:
        if not self.profile_sha256:
            self.profile_sha256 = profile_sha256(self.x_m, self.z_m)

    def problem(self) -> str | None:
        """Return why the geometry cannot be simulated, or that the hash is not that of the samples; else None."""
        if problem := profile_problem(self.x_m, self.z_m):
            return problem
        stated, computed = self.profile_sha256, profile_sha256(self.x_m, self.z_m)
        if stated != computed and stated != _profile_sha256_until_1_5(self.x_m, self.z_m):
            return f"profile_sha256 is {stated}, but x_m and z_m make {computed}"
        if isinstance(self.measured_x_m, UnsetType) or isinstance(self.measured_z_m, UnsetType):
            alone = not isinstance(self.measured_x_m, UnsetType) or not isinstance(self.measured_z_m, UnsetType)
            return "measured_x_m and measured_z_m must come together" if alone else None
        problem = profile_problem(self.measured_x_m, self.measured_z_m, spacing_m=MAX_MEASURED_SPACING_M)
        return f"measured: {problem}" if problem else None


class EdgeReading(msgspec.Struct, kw_only=True, frozen=True):
    """Readings under a straightedge of a length that is laid over the weld, both positive."""

    base_m: Annotated[float, Meta(description="m, length of the straightedge", gt=0.0, le=1e3)]
    peak_m: Annotated[
        float, Meta(description="m, highest place above the line between the edge's ends", ge=0.0, le=1e3)
    ]
    dip_m: Annotated[float, Meta(description="m, lowest place below it", ge=0.0, le=1e3)]


class ProfileMeasures(msgspec.Struct, kw_only=True, frozen=True):
    """Measures of a profile's geometry by itself."""

    kind: GeometryKind
    dip_m: Annotated[float, Meta(description="m, deepest place below its surroundings", ge=0.0)]
    protrusion_m: Annotated[float, Meta(description="m, highest place above its surroundings", ge=0.0)]
    gradient_rad: Annotated[float, Meta(description="rad, largest gradient of heights averaged over 25 mm", ge=0.0)]
    straightedge_m: Annotated[
        float, Meta(description="m, largest distance between the rail and a straightedge of 1 m on it", ge=0.0)
    ]
    spacing_m: Annotated[float, Meta(description="m, largest distance of samples", gt=0.0)]
    edges: Annotated[
        list[EdgeReading], Meta(max_length=20, description="of every straightedge that the record is long enough for")
    ] = []
    inclination_rad: (
        Annotated[float, Meta(description="rad, largest inclination over 25 mm relative to the chord of 1 m", ge=0.0)]
        | UnsetType
    ) = UNSET
    length_m: (
        Annotated[float, Meta(description="m, of the irregularity: twice its width at half height", ge=0.0)] | UnsetType
    ) = UNSET
    step_m: Annotated[float, Meta(description="m, largest difference of heights within 10 mm", ge=0.0)] | UnsetType = (
        UNSET
    )
    noise_m: Annotated[float, Meta(description="m, standard deviation of the noise", ge=0.0)] | UnsetType = UNSET
    resolution_m: (
        Annotated[float, Meta(description="m, the step in which heights were written", gt=0.0)] | UnsetType
    ) = UNSET


def profile_problem(
    x_m: Sequence[float], z_m: Sequence[float], *, spacing_m: float = MAX_PROFILE_SPACING_M
) -> str | None:
    """Return why a geometry cannot be simulated, in one clause, or None.

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
    if steps[widest] > spacing_m * (1 + 1e-9):
        bound_mm = spacing_m * 1e3
        return f"spacing {steps[widest] * 1e3:.3g} mm after sample {widest + 1}, at most {bound_mm:g} mm"
    amplitude = max(z_m) - min(z_m)
    if amplitude > MAX_PROFILE_AMPLITUDE_M * (1 + 1e-9):
        return f"amplitude {amplitude * 1e3:.3g} mm, at most {MAX_PROFILE_AMPLITUDE_M * 1e3:g} mm"
    return None


def profile_sha256(x_m: Sequence[float], z_m: Sequence[float]) -> str:
    """Return the identity of a geometry: SHA-256 of all x, then all z, as little-endian float64, -0 as 0."""
    samples = [value + 0.0 for value in (*x_m, *z_m)]  # JSON writers of other languages drop the sign of a zero
    return hashlib.sha256(struct.pack(f"<{len(samples)}d", *samples)).hexdigest()


def _profile_sha256_until_1_5(x_m: Sequence[float], z_m: Sequence[float]) -> str:
    """Return the hash that contracts up to 1.5 have: of the samples' JSON as msgspec writes it."""
    return json_sha256([list(map(float, x_m)), list(map(float, z_m))])
