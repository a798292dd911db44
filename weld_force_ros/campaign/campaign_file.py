"""Read the campaign's file (YAML): welds, tracks, vehicles, speeds and limits."""

from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, UnsetType

from weld_force_ros import _yaml
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.instruments import InstrumentFormat, format_of
from weld_force_ros.messages import AssessmentSettings, Name, SimulationSettings, legible
from weld_force_ros.simulation import track_file, vehicle_file
from weld_force_ros.simulation.settings import (
    DEFAULT_POSITIONS,
    DEFAULT_RUNNING,
    DEFAULT_SPEEDS,
    DEFAULT_TRACK,
    parse_positions,
    parse_speeds,
    simulation_settings,
)

DEFAULT_BATCH_WELDS = 256
OWN_WHEEL = "own"
"""The vehicle of a campaign that names none: the track's own wheel."""

Label = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,59}(?!\n)$")]
"""A name that may also be a folder's."""

_REMEDY = "write it as docs/whole-network.md shows"


class SourceEntry(msgspec.Struct, forbid_unknown_fields=True):
    """Names a source of welds: exactly one of a folder of profile files, a Parquet table, or a bag."""

    folder: str | UnsetType = msgspec.UNSET
    table: str | UnsetType = msgspec.UNSET
    bag: str | UnsetType = msgspec.UNSET
    line: Annotated[str, Meta(max_length=200)] = ""
    form: dict[str, Any] = {}

    @property
    def kind_and_path(self) -> tuple[str, str]:
        """Kind of the source, and its path as the file has it."""
        given = [(kind, path) for kind in ("folder", "table", "bag") if isinstance(path := getattr(self, kind), str)]
        if len(given) != 1:
            raise ValueError("each source is one of folder, table and bag")
        return given[0]

    def file_format(self) -> InstrumentFormat | None:
        """Return how files of the folder are to be read, beside what they state themselves."""
        return format_of(**self.form)


class _Vehicle(msgspec.Struct, forbid_unknown_fields=True):
    vehicle: str | None = None
    mass_kg: float | None = None
    static_load_n: float | None = None
    radius_m: float | None = None
    hertz_n_per_m15: float | None = None


class _SectionEntry(msgspec.Struct, forbid_unknown_fields=True):
    name: Label
    track: str = DEFAULT_TRACK
    lines: list[str] = []
    chainage_m: tuple[float, float] | None = None
    vehicles: list[Label] | None = None


class _CampaignFile(msgspec.Struct, forbid_unknown_fields=True):
    name: Name
    sources: Annotated[list[SourceEntry], Meta(min_length=1)]
    sections: list[_SectionEntry] = []
    vehicles: dict[Label, _Vehicle] | list[Label] = {}
    speeds: str | list[float] = DEFAULT_SPEEDS
    positions: int | str | list[float] = DEFAULT_POSITIONS
    engine: str = "common-poles"
    crown_radius_m: float | None = None
    contact_patch: str = "on"
    rolling: str = "circle"
    running: str = DEFAULT_RUNNING
    support: str = ""
    limits: str | None = None
    batch_welds: Annotated[int, Meta(ge=1, le=10_000)] = DEFAULT_BATCH_WELDS
    out: str | None = None


class NetworkSection(msgspec.Struct, frozen=True):
    """A part of the network of one track, with the settings of every vehicle that runs there.

    Attributes:
        lines: names of the lines that the section is on; any line if empty.
        chainage_m: begin and end; None contains every chainage, an unknown one too.
        vehicles: settings by the vehicle's name.
    """

    name: str
    lines: list[str]
    chainage_m: tuple[float, float] | None
    vehicles: dict[str, SimulationSettings]

    def contains(self, line: str, chainage_m: float | UnsetType) -> bool:
        """Return whether a weld lies in the section."""
        if self.lines and line not in self.lines:
            return False
        if self.chainage_m is None:
            return True
        return isinstance(chainage_m, float) and self.chainage_m[0] <= chainage_m < self.chainage_m[1]


class Campaign(msgspec.Struct, frozen=True):
    """A campaign as its file states it, complete and checked; paths of sources lead from `folder`."""

    name: str
    sources: list[SourceEntry]
    sections: list[NetworkSection]
    limits: AssessmentSettings
    batch_welds: int
    folder: Path
    out: Path


def read(path: Path) -> Campaign:
    """Read a campaign's file; paths in it lead from its folder.

    Raises:
        InputError: not readable, not of that form, or asking for something that cannot be simulated.
    """
    try:
        file = _yaml.decode(_yaml.read(path), _CampaignFile)
        for source in file.sources:
            _ = source.kind_and_path, source.file_format()
    except (OSError, msgspec.DecodeError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise InputError(f"campaign {path}: {legible(reason)}", _REMEDY) from None
    folder = path.absolute().parent
    sections = file.sections or [_SectionEntry("everywhere")]
    names = [section.name for section in sections]
    if len(set(names)) < len(names):
        raise InputError(f"campaign {path}: two sections of one name", "give each section a name of its own")
    return Campaign(
        name=file.name,
        sources=file.sources,
        sections=[_section(section, file, folder, path) for section in sections],
        limits=load_limits(file.limits, folder=folder),
        batch_welds=file.batch_welds,
        folder=folder,
        out=folder / (file.out or f"{path.stem}-results"),
    )


def _section(section: _SectionEntry, file: _CampaignFile, folder: Path, path: Path) -> NetworkSection:
    described = file.vehicles if isinstance(file.vehicles, dict) else {}
    bundled = {name: _Vehicle(vehicle=name) for name in vehicle_file.bundled()}
    vehicles = {OWN_WHEEL: _Vehicle(), **bundled, **described}
    chosen = list(file.vehicles or [OWN_WHEEL]) if section.vehicles is None else section.vehicles
    if unknown := [name for name in chosen if name not in vehicles]:
        raise InputError(
            f"campaign {path}, section {section.name}: vehicle {unknown[0]} is not described", "add it to `vehicles`"
        )
    return NetworkSection(
        section.name,
        section.lines,
        section.chainage_m,
        {name: _settings(section.track, vehicles[name], file, folder) for name in chosen},
    )


def _settings(track: str, vehicle: _Vehicle, file: _CampaignFile, folder: Path) -> SimulationSettings:
    speeds, positions = file.speeds, file.positions
    return simulation_settings(
        track=track if track in track_file.shipped() else str(folder / track),
        engine=file.engine,
        speeds_kmh=parse_speeds(speeds) if isinstance(speeds, str) else speeds,
        positions=parse_positions(positions) if isinstance(positions, str) else positions,
        vehicle=vehicle.vehicle,
        wheel_mass_kg=vehicle.mass_kg,
        static_load_n=vehicle.static_load_n,
        wheel_radius_m=vehicle.radius_m,
        hertz_n_per_m15=vehicle.hertz_n_per_m15,
        crown_radius_m=file.crown_radius_m if vehicle.hertz_n_per_m15 is None else None,
        contact_patch=file.contact_patch,
        rolling=file.rolling,
        running=file.running,
        support=file.support,
    )
