"""Describe how an instrument writes its files: descriptors in `data/instruments`, or a user's own YAML file.

A descriptor states what the files do not say of themselves, and by what they are recognised. What a file states goes
before what the user states, and that before the descriptor.
"""

import contextlib
import functools
import math
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError, ProfileError
from weld_force_ros.measurement.numbers import METRES, unit_of

_HEAD_LINES = 40
_PLAIN = "plain text"
HeaderKey = Literal[
    "x_unit", "z_unit", "z_positive", "weld_id", "line", "rail", "instrument", "calibration", "operator",
    "measured_on", "chainage_m",
    "line_speed_kmh", "weld_position_m", "running", "chainage_direction", "support", "kind", "detrend", "centre",
    "noise", "samples",
]  # fmt: skip
Column = str | Annotated[int, Meta(ge=1, le=64)]


class InstrumentError(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An instrument's own form error beside its noise: standard deviation, and length along the rail, in m."""

    deviation: Annotated[float, Meta(gt=0, le=1e-3)]
    length: Annotated[float, Meta(ge=0.05, le=10.0)]
    source: str


class InstrumentFormat(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The form of an instrument's files, and statements about the measurements in them.

    Attributes:
        name: of the format.
        source: where its description comes from.
        recognise: regular expressions; a file in whose first 40 lines each is found has this format.
        refuse: why files of this format cannot be used, in a clause; they are then refused with it.
        encoding: of the text, such as cp1252.
        separator: of the columns.
        decimal: mark.
        skip_rows: lines to skip at the top.
        columns: name in the heading, or number from 1, of the columns x, z, weld and rail. Several columns z are
            several passes over one weld.
        missing: texts that stand for a missing value, beside the usual ones.
        header: keys of the header block, by the statement that they make (`weld_id: Schweissung`).
        samples: key of the header block whose value is the number of rows.
        x_unit: unit of the positions.
        z_unit: unit of the heights.
        z_positive: `up` if a protrusion is positive, `down` if a dip is.
        x_direction: `with` if x increases in the running direction, `against` if it falls.
        spacing: distance of the samples in `x_unit`, for a file with heights only, or with a counter for x.
        weld_id: name of the weld; the file's stem if absent.
        line: that the weld lies on.
        rail: which rail.
        instrument: what it was measured with.
        calibration: of the instrument: date, certificate.
        operator: who measured.
        measured_on: date.
        kind: weld, joint or squat; a wheel is not read as a rail.
        chainage_m: chainage of the weld in m.
        line_speed_kmh: line speed in km/h.
        weld_position_m: the weld's centre after the preceding sleeper, in m.
        running: how trains run: `with` if x rises in their direction, `against` if it falls, `both`.
        support: supports that differ from the track's, such as `0=0.02`: sleeper 0 is the last before the weld.
        chainage_direction: `with` if chainage rises with x, `against` if it falls.
        detrend: `line` removes the line between the two ends, `none` nothing.
        centre: position of the weld's centre in `x_unit`.
        noise: `auto`, `none`, or the standard deviation of the measurement noise in m.
        form_error: of the instrument; samples that are taken as they are have none.
    """

    name: str = _PLAIN
    source: str = ""
    recognise: list[str] = []
    refuse: str | None = None
    encoding: str | None = None
    separator: Literal["tab", "semicolon", "comma", "space", "pipe"] | None = None
    decimal: Literal["point", "comma"] | None = None
    skip_rows: Annotated[int, Meta(ge=0, le=100_000)] = 0
    columns: dict[Literal["x", "z", "weld", "rail"], Column | list[Column]] = {}
    missing: list[str] = []
    header: dict[HeaderKey, str] = {}
    samples: str | None = None
    x_unit: str | None = None
    z_unit: str | None = None
    z_positive: str | None = None
    x_direction: Literal["with", "against"] = "with"
    spacing: Annotated[float, Meta(gt=0)] | None = None
    weld_id: str | None = None
    line: str | None = None
    rail: str | None = None
    instrument: str | None = None
    calibration: str | None = None
    operator: str | None = None
    measured_on: str | None = None
    kind: str | None = None
    chainage_m: float | None = None
    line_speed_kmh: float | None = None
    weld_position_m: float | None = None
    running: str | None = None
    support: str | None = None
    chainage_direction: str | None = None
    detrend: str | None = None
    centre: float | None = None
    noise: str | float | None = None
    form_error: InstrumentError | None = None

    def with_statements(self, stated: "InstrumentFormat | None") -> "InstrumentFormat":
        """Return this format with what a user states in place of what it says itself."""
        if stated is None:
            return self
        default = InstrumentFormat()
        given = {f: value for f in self.__struct_fields__ if (value := getattr(stated, f)) != getattr(default, f)}
        return msgspec.structs.replace(self, **given)


def format_of(format: str | None = None, **stated: Any) -> InstrumentFormat | None:
    """Return how files are to be read by options: those of the command line, of a node, of a campaign.

    Args:
        format: a bundled format's name or a descriptor's path; recognised by content if empty.
        stated: fields of `InstrumentFormat`; None, an empty text and 0 say nothing.

    Raises:
        InputError: no such format, no such field, or a value that is not of its type.
    """
    given = {key: value for key, value in stated.items() if value not in (None, "", 0, 0.0)}
    noise = given.get("noise")
    if isinstance(noise, str) and noise not in ("auto", "none"):
        with contextlib.suppress(ValueError):
            given["noise"] = float(noise)
    try:
        statements = msgspec.convert(given, InstrumentFormat)
    except msgspec.ValidationError as error:
        raise InputError(f"statements about measurement files: {error}", "see data/instruments") from None
    _check(statements, "statements about measurement files")
    if format:
        return load(format).with_statements(statements)
    return statements if given else None


@functools.cache
def shipped() -> Mapping[str, InstrumentFormat]:
    """Return the formats that come with the package, by name."""
    folder = resources.files("weld_force_ros.data").joinpath("instruments")
    files = sorted((file for file in folder.iterdir() if file.name.endswith(".yaml")), key=lambda file: file.name)
    return {file.name.removesuffix(".yaml"): _parse(file.read_bytes(), file.name) for file in files}


def load(name_or_path: str) -> InstrumentFormat:
    """Return a bundled format, or that of a YAML file.

    Raises:
        InputError: there is none, or the file is not of that form.
    """
    if name_or_path in shipped():
        return shipped()[name_or_path]
    try:
        data = _yaml.read(Path(name_or_path))
    except (OSError, ValueError) as error:
        raise InputError(
            f"format {name_or_path}: {error}", f"name one of {', '.join(shipped())}, or a descriptor (YAML)"
        ) from None
    return _parse(data, name_or_path)


def recognised(lines: list[str]) -> InstrumentFormat | None:
    """Return the bundled format of which a file is, by its first lines; None if it is of no known one.

    Raises:
        ProfileError: it could be of two.
    """
    head = "\n".join(lines[:_HEAD_LINES])
    found = [
        (name, form)
        for name, form in shipped().items()
        if form.recognise and all(re.search(pattern, head, re.MULTILINE) for pattern in form.recognise)
    ]
    if len(found) > 1:
        names = " or ".join(name for name, _ in found)
        raise ProfileError(f"the file could be of {names}", f"say which, with --format {found[0][0]}")
    return found[0][1] if found else None


def _parse(data: bytes, where: str) -> InstrumentFormat:
    remedy = "write it after data/instruments/railprof.yaml"
    try:
        form = msgspec.convert(_yaml.decode(data, dict[str, Any]), InstrumentFormat)
    except (msgspec.DecodeError, ValueError) as error:
        said = "".join(c if c.isprintable() else " " for c in str(error))
        raise InputError(f"format {where}: {' '.join(said.split())[:300]}", remedy) from None
    for pattern in form.recognise:
        try:
            re.compile(pattern)
        except re.error as error:
            raise InputError(f"format {where}: recognise {pattern!r}: {error}", remedy) from None
    _check(form, f"format {where}")
    return form


def _check(form: InstrumentFormat, where: str) -> None:
    """Refuse what a type cannot say of a value."""
    for key in ("x_unit", "z_unit"):
        if (unit := getattr(form, key)) is not None and unit_of(unit) is None:
            raise InputError(f"{where}: {key} {unit!r} is unknown", f"state one of {', '.join(METRES)}")
    if form.z_positive is not None and form.z_positive.casefold() not in ("up", "down"):
        raise InputError(f"{where}: z_positive {form.z_positive!r} is unknown", "state up or down")
    if form.encoding is not None:
        try:
            "".encode(form.encoding)
        except (LookupError, ValueError, UnicodeError):
            raise InputError(f"{where}: encoding {form.encoding!r} is unknown", "state one such as cp1252") from None
    if form.spacing is not None and not math.isfinite(form.spacing):
        raise InputError(f"{where}: spacing {form.spacing:g} of the samples", "state it in x_unit")
    if form.noise not in (None, "auto", "none") and not (isinstance(form.noise, float) and 0 < form.noise < math.inf):
        raise InputError(f"{where}: noise {form.noise!r} cannot be read", "state auto, none, or metres such as 5e-6")
