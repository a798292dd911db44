"""Track files: YAML of the form of `data/tracks/bilbao.yaml`; each number may stand bare or as `{value, source}`."""

import math
import os
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError, TrackError
from weld_force_ros.messages import legible
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.track.beam import Rail, Spring, StripRail, Track
from weld_force_ros.physics.track.outline import outline
from weld_force_ros.simulation import section_file

_DATA = resources.files("weld_force_ros.data")
_MOST_POISSON = 0.45


class _Sourced(msgspec.Struct, forbid_unknown_fields=True):
    value: float
    source: str


_Number = float | _Sourced


class _RailFile(msgspec.Struct, forbid_unknown_fields=True):
    """A rail; mass, area and second moment may be left out where `section` names or describes one."""

    youngs_modulus_gpa: _Number
    shear_modulus_gpa: _Number
    shear_coefficient: _Number
    mass_kg_per_m: _Number | None = None
    area_cm2: _Number | None = None
    second_moment_cm4: _Number | None = None
    loss_factor: _Number = 0.0
    model: Literal["timoshenko", "finite-strip"] = "timoshenko"
    section: str | section_file.SectionFile = ""
    wear_mm: _Number = 0.0


class _LayerFile(msgspec.Struct, forbid_unknown_fields=True):
    stiffness_kn_per_mm: _Number
    loss_factor: _Number = 0.0
    damping_kns_per_m: _Number = 0.0


class _PadFile(_LayerFile, forbid_unknown_fields=True):
    width_m: _Number = 0.0


class _SupportsFile(msgspec.Struct, forbid_unknown_fields=True):
    kind: Literal["periodic", "continuous"]
    spacing_m: _Number
    pad: _PadFile
    half_sleeper_mass_kg: _Number
    ballast: _LayerFile


class _WheelFile(msgspec.Struct, forbid_unknown_fields=True):
    mass_kg: _Number
    static_load_kn: _Number
    radius_m: _Number
    hertz_gn_per_m15: _Number


class _TrackFile(msgspec.Struct, forbid_unknown_fields=True):
    name: Annotated[str, Meta(min_length=1, max_length=200)]
    rail: _RailFile
    supports: _SupportsFile
    wheel: _WheelFile
    description: str = ""


@dataclass(frozen=True)
class TrackDefinition:
    """A track with the wheel that runs on it by default, and the text that defines both."""

    track: Track
    wheel: Wheel
    description: str
    text: str


def shipped() -> list[str]:
    """Return the names of the bundled tracks."""
    return sorted(f.name.removesuffix(".yaml") for f in (_DATA / "tracks").iterdir() if f.name.endswith(".yaml"))


def load(name_or_path: str) -> TrackDefinition:
    """Read a bundled track by name, or a user's own by the path of its YAML file.

    Raises:
        TrackError: neither a shipped track nor a readable file, or a file that does not describe a track.
    """
    if name_or_path in shipped():
        return parse((_DATA / "tracks" / f"{name_or_path}.yaml").read_text(encoding="utf-8"), name_or_path)
    path = Path(name_or_path)
    if path.suffix.lower() not in (".yaml", ".yml") or not os.path.isfile(path):  # Path.is_file raises on long names
        raise TrackError(
            f"track {name_or_path!r} is neither bundled nor a YAML file", f"use {', '.join(shipped())} or FILE.yaml"
        )
    try:
        text = _yaml.read(path).decode()
    except (OSError, ValueError) as error:
        raise TrackError(f"track file {path}: {error}", "give a readable YAML file") from None
    return parse(text, str(path))


def parse(text: str, source: str) -> TrackDefinition:
    """Read a track from the text of its file; `source` names it in errors.

    Raises:
        TrackError: not YAML, an unknown or missing field, or a number out of its range.
    """
    if len(text) > _yaml.MAX_BYTES:
        raise TrackError(f"track file {source}: over {_yaml.MAX_BYTES} characters", "a track file has some forty lines")
    try:
        file = _yaml.decode(text.encode(), _TrackFile)
    except (msgspec.DecodeError, ValueError) as error:
        raise TrackError(
            f"track file {source}: {legible(str(error))}", "write it after data/tracks/bilbao.yaml"
        ) from None
    reader = _Reader(source)
    rail, supports, wheel = file.rail, file.supports, file.wheel
    positive = reader.positive
    track = Track(
        name=file.name,
        rail=_rail(reader, rail),
        pad=reader.spring("supports.pad", supports.pad),
        sleeper_mass_kg=positive("supports.half_sleeper_mass_kg", supports.half_sleeper_mass_kg),
        ballast=reader.spring("supports.ballast", supports.ballast),
        spacing_m=reader.within("supports.spacing_m", supports.spacing_m, 0.2, 2.0),
        continuous=supports.kind == "continuous",
        pad_width_m=reader.within("supports.pad.width_m", supports.pad.width_m, 0.0, 0.4),
    )
    if track.pad_width_m and not isinstance(track.rail, StripRail):
        raise TrackError(
            f"track file {source}: supports.pad.width_m with a rail that is a beam", "write `model: finite-strip`"
        )
    running = Wheel(
        mass_kg=positive("wheel.mass_kg", wheel.mass_kg),
        static_load_n=positive("wheel.static_load_kn", wheel.static_load_kn) * 1e3,
        radius_m=reader.within("wheel.radius_m", wheel.radius_m, 0.1, 1.5),
        hertz_n_per_m15=positive("wheel.hertz_gn_per_m15", wheel.hertz_gn_per_m15) * 1e9,
    )
    return TrackDefinition(track, running, file.description, text)


def _rail(reader: "_Reader", file: _RailFile) -> Rail:
    """Return the beam, or the rail of finite strips, that a file describes."""
    section = _section(reader, file)
    standard = section.standard if section else None

    def of_section(name: str) -> float:
        number = getattr(file, name)
        if number is None and standard is not None:
            number = getattr(standard, name)
        if number is None:
            raise TrackError(f"track file {reader.source}: rail.{name} is missing", "give it, or name a section")
        return reader.positive(f"rail.{name}", number)

    beam = Rail(
        mass_kg_per_m=of_section("mass_kg_per_m"),
        area_m2=of_section("area_cm2") * 1e-4,
        second_moment_m4=of_section("second_moment_cm4") * 1e-8,
        youngs_modulus_pa=reader.positive("rail.youngs_modulus_gpa", file.youngs_modulus_gpa) * 1e9,
        shear_modulus_pa=reader.positive("rail.shear_modulus_gpa", file.shear_modulus_gpa) * 1e9,
        shear_coefficient=reader.within("rail.shear_coefficient", file.shear_coefficient, 0.05, 1.0),
        loss_factor=reader.within("rail.loss_factor", file.loss_factor, 0.0, 0.5),
    )
    wear_m = reader.within("rail.wear_mm", file.wear_mm, 0.0, 30.0) * 1e-3
    if file.model == "timoshenko":
        if wear_m:
            raise TrackError(f"track file {reader.source}: rail.wear_mm of a beam", "write `model: finite-strip`")
        return beam
    if section is None:
        raise TrackError(
            f"track file {reader.source}: finite strips of section {file.section!r}",
            f"name {', '.join(section_file.shipped())}, or describe one in its place",
        )
    poisson = beam.youngs_modulus_pa / (2 * beam.shear_modulus_pa) - 1
    if not 0 <= poisson <= _MOST_POISSON:
        raise TrackError(
            f"track file {reader.source}: Poisson's ratio E / 2G - 1 is {poisson:.3g}", "correct either modulus"
        )
    try:
        outline(section.dimensions, wear_m)
    except InputError as error:
        raise TrackError(f"track file {reader.source}: {error.reason}", error.remedy) from None
    return StripRail(**asdict(beam), section=section.dimensions, wear_m=wear_m)


def _section(reader: "_Reader", file: _RailFile) -> section_file.SectionDefinition | None:
    """Return the section that is named or described; None for an unknown name, as a beam needs none."""
    if isinstance(file.section, str):
        return section_file.load(file.section) if file.section in section_file.shipped() else None
    return section_file.described(file.section)


@dataclass(frozen=True)
class _Reader:
    source: str

    def within(self, name: str, number: _Number, least: float, most: float) -> float:
        value = number.value if isinstance(number, _Sourced) else number
        if not math.isfinite(value) or not least <= value <= most:
            raise TrackError(
                f"track file {self.source}: {name} is {value:g}", f"give a number from {least:g} to {most:g}"
            )
        return value

    def positive(self, name: str, number: _Number) -> float:
        return self.within(name, number, 1e-6, 1e6)

    def spring(self, name: str, layer: _LayerFile) -> Spring:
        spring = Spring(
            stiffness_n_per_m=self.positive(f"{name}.stiffness_kn_per_mm", layer.stiffness_kn_per_mm) * 1e6,
            loss_factor=self.within(f"{name}.loss_factor", layer.loss_factor, 0.0, 3.0),
            damping_ns_per_m=self.within(f"{name}.damping_kns_per_m", layer.damping_kns_per_m, 0.0, 1e5) * 1e3,
        )
        if spring.loss_factor == 0.0 and spring.damping_ns_per_m == 0.0:
            raise TrackError(
                f"track file {self.source}: {name} has no damping", "give loss_factor or damping_kns_per_m"
            )
        return spring
