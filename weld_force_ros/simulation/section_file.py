"""Section files: YAML of the form of `data/sections/60E1.yaml`, a rail's cross-section by its published dimensions."""

from functools import cache
from importlib import resources
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros.errors import TrackError
from weld_force_ros.messages import legible
from weld_force_ros.physics.track.outline import Dimensions

_DATA = resources.files("weld_force_ros.data") / "sections"

_Mm = Annotated[float, Meta(gt=0, le=1000)]
_Figure = Annotated[float, Meta(gt=0, le=1e5)]
_Slope = Annotated[float, Meta(gt=0.1, le=1e4)]


class _CrownArc(msgspec.Struct, forbid_unknown_fields=True):
    radius_mm: _Mm
    half_width_mm: _Mm | None = None


class _Arc(msgspec.Struct, forbid_unknown_fields=True):
    radius_mm: _Mm
    turn_deg: Annotated[float, Meta(gt=0, lt=180)] | None = None


_Arcs = Annotated[list[_Arc], Meta(min_length=1, max_length=5)]


class _Prolonged(msgspec.Struct, forbid_unknown_fields=True):
    height_at_axis_mm: _Mm
    slope: _Slope


class _Outer(msgspec.Struct, forbid_unknown_fields=True):
    height_at_edge_mm: _Mm
    slope: _Slope


class _Head(msgspec.Struct, forbid_unknown_fields=True):
    crown: Annotated[list[_CrownArc], Meta(min_length=1, max_length=6)]
    side_slope: _Slope
    corner: _Arcs
    fishing: _Prolonged


class _Web(msgspec.Struct, forbid_unknown_fields=True):
    thickness_mm: _Mm
    upper_fillet: _Arcs
    lower_fillet: _Arcs


class _Foot(msgspec.Struct, forbid_unknown_fields=True):
    width_mm: _Mm
    top: _Prolonged
    joint: _Arcs
    outer: _Outer
    upper_corner: _Arcs
    lower_corner: _Arcs


class Standard(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The standard's own figures of a section; centroid and lateral second moment serve its outline only."""

    mass_kg_per_m: _Figure
    area_cm2: _Figure
    second_moment_cm4: _Figure
    centroid_mm: _Figure | None = None
    lateral_second_moment_cm4: _Figure | None = None


class SectionFile(msgspec.Struct, forbid_unknown_fields=True):
    """A rail section as its file states it; its outline (height, head, web, foot) may be left out, but as a whole."""

    name: Annotated[str, Meta(min_length=1, max_length=60)]
    description: str
    source: str
    standard: Standard
    height_mm: _Mm | None = None
    head: _Head | None = None
    web: _Web | None = None
    foot: _Foot | None = None


class SectionDefinition(msgspec.Struct, frozen=True):
    """A rail section's dimensions, None if its outline is not known, with its standard's own figures."""

    name: str
    description: str
    source: str
    dimensions: Dimensions | None
    standard: Standard


def shipped() -> list[str]:
    """Return the names of the bundled sections."""
    return sorted(f.name.removesuffix(".yaml") for f in _DATA.iterdir() if f.name.endswith(".yaml"))


def drawn() -> list[str]:
    """Return the names of the bundled sections whose outline is known, as finite strips need it."""
    return [name for name in shipped() if load(name).dimensions is not None]


def outline_of(name: str) -> Dimensions:
    """Return the dimensions of a bundled section by name.

    Raises:
        TrackError: there is none of that name, or its outline is not known.
    """
    dimensions = load(name).dimensions
    if dimensions is None:
        raise TrackError(f"the outline of rail section {name!r} is not known", f"use {', '.join(drawn())}")
    return dimensions


@cache
def load(name: str) -> SectionDefinition:
    """Return a bundled section by name.

    Raises:
        TrackError: there is none of that name.
    """
    if name not in shipped():
        raise TrackError(
            f"rail section {name!r} is unknown", f"use {', '.join(shipped())}, or describe one in its place"
        )
    return parse((_DATA / f"{name}.yaml").read_bytes(), name)


def parse(text: bytes, source: str) -> SectionDefinition:
    """Read a section from the text of its file; `source` names it in errors.

    Raises:
        TrackError: not of the form of `data/sections/60E1.yaml`.
    """
    try:
        return described(_yaml.decode(text, SectionFile))
    except (msgspec.DecodeError, ValueError) as error:
        raise TrackError(
            f"rail section {source}: {legible(str(error))}", "write it after data/sections/60E1.yaml"
        ) from None


def described(file: SectionFile) -> SectionDefinition:
    """Return a section from what its file says.

    Raises:
        ValueError: part of its outline is missing.
    """
    return SectionDefinition(file.name, file.description, file.source, _dimensions(file), file.standard)


def _dimensions(file: SectionFile) -> Dimensions | None:
    height_mm, head, web, foot = file.height_mm, file.head, file.web, file.foot
    if height_mm is None or head is None or web is None or foot is None:
        given = [name for name in ("height_mm", "head", "web", "foot") if getattr(file, name) is not None]
        if given:
            raise ValueError(f"{given[0]} without the rest of height_mm, head, web, foot")
        return None
    fillets = (head.corner, web.upper_fillet, web.lower_fillet, foot.joint, foot.upper_corner, foot.lower_corner)
    return Dimensions(
        height_m=height_mm / 1e3,
        crown=tuple((arc.radius_mm / 1e3, _metres(arc.half_width_mm)) for arc in head.crown),
        side_slope=head.side_slope,
        fishing=(head.fishing.height_at_axis_mm / 1e3, head.fishing.slope),
        web_m=web.thickness_mm / 1e3,
        foot_top=(foot.top.height_at_axis_mm / 1e3, foot.top.slope),
        foot_edge=(foot.outer.height_at_edge_mm / 1e3, foot.outer.slope),
        foot_width_m=foot.width_mm / 1e3,
        fillets=tuple(tuple((arc.radius_mm / 1e3, _radians(arc.turn_deg)) for arc in arcs) for arcs in fillets),
    )


def _metres(mm: float | None) -> float | None:
    return None if mm is None else mm / 1e3


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else float(np.radians(degrees))
