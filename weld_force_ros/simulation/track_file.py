"""Track files: YAML of the form of `data/tracks/bilbao.yaml`; numbers stand bare or as `{value, source}`."""

import os
from dataclasses import asdict, dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError, TrackError
from weld_force_ros.messages import legible
from weld_force_ros.physics.passage.hertz import CROWN_RADII_M, ContactRadii
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.track.beam import Rail, StripRail, Track
from weld_force_ros.physics.track.outline import outline
from weld_force_ros.simulation import section_file, support_file
from weld_force_ros.simulation.stated_number import Number, Reader

_DATA = resources.files("weld_force_ros.data")
_MOST_POISSON = 0.45
# Of rail steel, where a file names a section and no more: the values of the bundled tracks, with their sources there.
_YOUNGS_MODULUS_GPA = 210.0
_SHEAR_MODULUS_GPA = 81.0
_SHEAR_COEFFICIENT = 0.4
_LOSS_FACTOR = 0.01


class _RailFile(msgspec.Struct, forbid_unknown_fields=True):
    """A rail; mass, area and second moment may be left out where `section` names or describes one, and its steel."""

    youngs_modulus_gpa: Number | None = None
    shear_modulus_gpa: Number = _SHEAR_MODULUS_GPA
    shear_coefficient: Number = _SHEAR_COEFFICIENT
    mass_kg_per_m: Number | None = None
    area_cm2: Number | None = None
    second_moment_cm4: Number | None = None
    loss_factor: Number | None = None
    model: Literal["timoshenko", "finite-strip"] = "timoshenko"
    section: str | section_file.SectionFile = ""
    wear_mm: Number = 0.0
    crown_radius_m: Number | None = None


class _WheelFile(msgspec.Struct, forbid_unknown_fields=True):
    mass_kg: Number
    static_load_kn: Number
    radius_m: Number
    hertz_gn_per_m15: Number | None = None
    transverse_radius_m: Number | None = None


class _TrackFile(msgspec.Struct, forbid_unknown_fields=True):
    name: Annotated[str, Meta(min_length=1, max_length=200)]
    rail: _RailFile
    supports: support_file.SupportsFile
    wheel: _WheelFile
    description: str = ""


@dataclass(frozen=True)
class TrackDefinition:
    """A track with the wheel that runs on it by default, and the text that defines both.

    Attributes:
        radii: of the contact, where they are stated: they give the wheel's Hertz constant.
    """

    track: Track
    wheel: Wheel
    description: str
    text: str
    radii: ContactRadii | None = None

    @property
    def moving(self) -> bool:
        """Return whether poles can be fitted to what a moving contact finds: causal, on sleepers, the rail a beam."""
        return self.track.causal and not self.track.continuous and not isinstance(self.track.rail, StripRail)


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
        raise TrackError(f"no track {name_or_path!r}", f"use {', '.join(shipped())} or a FILE.yaml")
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
    reader = Reader(source)
    rail, supports = file.rail, file.supports
    support, pad_width_m = support_file.read(reader, supports)
    track = Track(
        name=file.name,
        rail=_rail(reader, rail),
        support=support,
        spacing_m=reader.within("supports.spacing_m", supports.spacing_m, 0.2, 2.0),
        continuous=supports.kind == "continuous",
        pad_width_m=pad_width_m,
    )
    if track.pad_width_m and not isinstance(track.rail, StripRail):
        raise reader.error("width_m of a pad under a rail that is a beam", "write `model: finite-strip`")
    radii = _radii(reader, rail, file.wheel)
    return TrackDefinition(track, _wheel(reader, file.wheel, radii), file.description, text, radii)


def _wheel(reader: Reader, file: _WheelFile, radii: ContactRadii | None) -> Wheel:
    if file.hertz_gn_per_m15 is None:
        if radii is None:
            raise reader.error("wheel.hertz_gn_per_m15 is missing", "give it, or rail.crown_radius_m")
        hertz_n_per_m15 = radii.hertz_n_per_m15
    else:
        if radii is not None:
            raise reader.error("wheel.hertz_gn_per_m15 beside rail.crown_radius_m, which gives it", "give either")
        hertz_n_per_m15 = reader.positive("wheel.hertz_gn_per_m15", file.hertz_gn_per_m15) * 1e9
    return Wheel(
        mass_kg=reader.positive("wheel.mass_kg", file.mass_kg),
        static_load_n=reader.positive("wheel.static_load_kn", file.static_load_kn) * 1e3,
        radius_m=reader.within("wheel.radius_m", file.radius_m, 0.1, 1.5),
        hertz_n_per_m15=hertz_n_per_m15,
    )


def _radii(reader: Reader, rail: _RailFile, wheel: _WheelFile) -> ContactRadii | None:
    """Return the radii of the contact, if the rail's crown is stated."""
    if rail.crown_radius_m is None:
        if wheel.transverse_radius_m is not None:
            raise reader.error("wheel.transverse_radius_m without rail.crown_radius_m", "give both")
        return None
    radii = ContactRadii(
        reader.within("wheel.radius_m", wheel.radius_m, 0.1, 1.5),
        reader.within("rail.crown_radius_m", rail.crown_radius_m, *CROWN_RADII_M),
    )
    if wheel.transverse_radius_m is not None:
        across_m = reader.within("wheel.transverse_radius_m", wheel.transverse_radius_m, -1e3, 1e3)
        radii = replace(radii, wheel_transverse_m=across_m)
    if not radii.touch_in_a_point:
        raise reader.error(
            f"wheel.transverse_radius_m is {radii.wheel_transverse_m:g}, hollower than the crown of {radii.crown_m:g}",
            "give a tread that touches it in one point",
        )
    return radii


def _rail(reader: Reader, file: _RailFile) -> Rail:
    """Return the beam, or the rail of finite strips, that a file describes."""
    section = _section(reader, file)
    standard = section.standard if section else None

    def of_section(name: str) -> float:
        number = getattr(file, name)
        if number is None and standard is not None:
            number = getattr(standard, name)
        if number is None:
            raise reader.error(f"rail.{name} is missing", f"give it, or name {', '.join(section_file.shipped())}")
        return reader.positive(f"rail.{name}", number)

    modulus, loss_factor = file.youngs_modulus_gpa, file.loss_factor
    if loss_factor is None:  # a file that states its steel states all of it
        loss_factor = _LOSS_FACTOR if modulus is None else 0.0
    if modulus is None:
        modulus = _YOUNGS_MODULUS_GPA
    beam = Rail(
        mass_kg_per_m=of_section("mass_kg_per_m"),
        area_m2=of_section("area_cm2") * 1e-4,
        second_moment_m4=of_section("second_moment_cm4") * 1e-8,
        youngs_modulus_pa=reader.positive("rail.youngs_modulus_gpa", modulus) * 1e9,
        shear_modulus_pa=reader.positive("rail.shear_modulus_gpa", file.shear_modulus_gpa) * 1e9,
        shear_coefficient=reader.within("rail.shear_coefficient", file.shear_coefficient, 0.05, 1.0),
        loss_factor=reader.within("rail.loss_factor", loss_factor, 0.0, 0.5),
    )
    wear_m = reader.within("rail.wear_mm", file.wear_mm, 0.0, 30.0) * 1e-3
    if file.model == "timoshenko":
        if wear_m:
            raise reader.error("rail.wear_mm of a beam", "write `model: finite-strip`")
        return beam
    if section is None or section.dimensions is None:
        name = file.section if section is None else section.name
        raise reader.error(
            f"finite strips of section {name!r}, whose outline is not known",
            f"name {', '.join(section_file.drawn())}, or describe one in its place",
        )
    poisson = beam.youngs_modulus_pa / (2 * beam.shear_modulus_pa) - 1
    if not 0 <= poisson <= _MOST_POISSON:
        raise reader.error(f"Poisson's ratio E / 2G - 1 is {poisson:.3g}", "correct either modulus")
    try:
        outline(section.dimensions, wear_m)
    except InputError as error:
        raise reader.error(error.reason, error.remedy) from None
    return StripRail(**asdict(beam), section=section.dimensions, wear_m=wear_m)


def _section(reader: Reader, file: _RailFile) -> section_file.SectionDefinition | None:
    """Return the section that is named or described; None for an unknown name, as a beam needs none."""
    if isinstance(file.section, str):
        return section_file.load(file.section) if file.section in section_file.shipped() else None
    try:
        return section_file.described(file.section)
    except ValueError as error:
        raise reader.error(f"rail.section has {error}", "give all of them, or none") from None
