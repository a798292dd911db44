"""Read and write measurement files: text -> `messages.WeldProfile`.

Two forms are read: the CSV form, which states its own units and sign in `# key: value` lines, and plain columns of
numbers, as trolleys and electronic straightedges export them, for which the user makes the same statements in a
`PlainForm`. Units, centre and detrending are all that happens here; joining to the rail and the wheel belong to the
simulation.

Numbers are handled as exact decimals and the result is rounded to 1e-12 m, so that one geometry has one
`profile_sha256` whatever units it was exported in. A file with `centre: 0` and `detrend: none` asks for no change; its
values are kept to the last bit, which lets `write_profile` return any profile exactly.

The bounds of `messages.profile_problem` are applied once, after conditioning: that is the geometry which is simulated,
and an instrument's tilt, which may exceed 10 mm on its own, is no part of it.
"""

import decimal
import difflib
import hashlib
import itertools
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import UNSET

from weld_force_ros._files import whole_file
from weld_force_ros.errors import ProfileError, os_errors_as
from weld_force_ros.measurement.text_columns import (
    MAX_FILE_BYTES,
    Line,
    decoded,
    lines_of,
    number,
    quoted,
    read_columns,
)
from weld_force_ros.messages import MAX_SAMPLES, WeldProfile, profile_problem, profile_sha256

_POWER_OF_TEN = {"m": 0, "cm": -2, "mm": -3, "um": -6}
_MICRO = str.maketrans("µμ", "uu")  # the micro sign and the Greek letter
_REQUIRED = ("x_unit", "z_unit", "z_positive")
_TEXTS = ("weld_id", "rail", "instrument")
_NUMBERS = ("chainage_m", "line_speed_kmh", "weld_position_m")
_KEYS = (*_REQUIRED, *_TEXTS, *_NUMBERS, "detrend", "centre")

_OWN_UNIT = re.compile(r"(?:^|[\r\n])[ \t]*#+[ \t]*x_unit[ \t]*:[ \t]*\S")
_FARTHEST_M = 10**7  # no chainage is longer; a number beyond it has the wrong unit
_RESOLUTION_M = Decimal("1e-12")
_EXACT = decimal.Context(prec=200, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN)

_REMEDIES = (  # by what `profile_problem` says
    ("does not increase", "give columns x,z with x in the running direction, without repeated or reversed samples"),
    ("samples", "measure the whole weld at a spacing of 10 mm or finer"),
    ("length", "check x_unit (stated: {x_unit}), or cut the record to the weld and its surroundings"),
    ("spacing", "check x_unit (stated: {x_unit}), or measure at 10 mm or finer"),
    ("amplitude", "check z_unit (stated: {z_unit}); heights are probably in another unit"),
)


@dataclass(frozen=True, kw_only=True)
class PlainForm:
    """States what a plain file of numbers does not say about itself; what a file does say goes first.

    Attributes:
        x_unit: unit of the positions: m, cm, mm or um.
        z_unit: unit of the heights: m, cm, mm or um.
        z_positive: `up` if a protrusion is positive, `down` if a dip is.
        spacing: distance of the samples in `x_unit`, for a file with heights only.
        skip_rows: lines to skip at the top.
        weld_id: name of the weld; the file's stem if absent.
        rail: which rail.
        instrument: what it was measured with.
        chainage_m: chainage of the weld in m.
        line_speed_kmh: line speed in km/h.
        weld_position_m: the weld's centre after the preceding sleeper, in m.
        detrend: `line` removes the line between the two ends, `none` nothing.
        centre: position of the weld's centre in `x_unit`; the middle of the range if absent.
    """

    x_unit: str | None = None
    z_unit: str | None = None
    z_positive: str | None = None
    spacing: float | None = None
    skip_rows: int = 0
    weld_id: str | None = None
    rail: str | None = None
    instrument: str | None = None
    chainage_m: float | None = None
    line_speed_kmh: float | None = None
    weld_position_m: float | None = None
    detrend: str | None = None
    centre: float | None = None


class _Statement(NamedTuple):
    text: str
    where: str  # a prefix for messages: "line 3: ", or "" for the plain form


class _Sample(NamedTuple):
    line: int
    x: Decimal
    z: Decimal


def read_profile(path: Path, form: PlainForm | None = None) -> WeldProfile:
    """Read one measurement file.

    Args:
        path: a CSV or plain text file.
        form: what a plain file does not state itself.

    Returns:
        The conditioned profile; its `source` is the file's name without folders, the same on every machine.

    Raises:
        ProfileError: the file cannot be read or used; one line with the file, the line, and what to do.
    """
    with os_errors_as(ProfileError, path, "give the path of a readable profile file"), path.open("rb") as file:
        raw = file.read(MAX_FILE_BYTES + 1)
    name = path.name.encode("utf-8", "replace").decode()  # a name may hold bytes that no message can
    return msgspec.structs.replace(parse_profile(raw, str(path), form), source=name[-200:])


def parse_profile(data: str | bytes, source: str, form: PlainForm | None = None) -> WeldProfile:
    """Read a profile from text, or from the bytes of a file.

    Args:
        data: the text; `source_sha256` is taken of its bytes.
        source: where it comes from, for messages and the profile; its stem is the weld's default name.
        form: what the text may not state itself; where it does, the text goes first. `spacing` and `skip_rows`
            are for text without an `x_unit` of its own.

    Returns:
        The conditioned profile: x in m about the weld's centre, z in m positive up.

    Raises:
        ProfileError: the text cannot be used; one line with the source, the line, and what to do.
    """
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else bytes(data)
    try:
        with decimal.localcontext(_EXACT):
            return _profile(raw, source, form or PlainForm())
    except ProfileError as error:
        raise ProfileError(f"{' '.join(source.splitlines())}: {error.reason}", error.remedy) from None


def _profile(raw: bytes, source: str, form: PlainForm) -> WeldProfile:
    text = decoded(raw)
    if _OWN_UNIT.search(text):
        form = replace(form, spacing=None, skip_rows=0)  # its layout is the CSV form's
    lines = lines_of(text, form.skip_rows)
    stated = _statements([line for line in lines if line.is_comment], form)
    rows = [line for line in lines if not line.is_comment]
    samples = _samples(rows, form.spacing, stated)
    x_m, z_m, conditioning = _condition(samples, stated)
    if form.skip_rows:
        conditioning.insert(0, f"first {form.skip_rows} lines skipped")
    _check_bounds(x_m, z_m, samples, stated)
    content: dict[str, Any] = {"weld_id": Path(source).stem[:200] or source[:200]}
    content |= {key: stated[key].text for key in _TEXTS if key in stated}
    content |= {key: _stated_number(stated[key], key) for key in _NUMBERS if key in stated}
    content |= {"source": source[-200:], "x_m": x_m, "z_m": z_m, "conditioning": conditioning}
    content |= {"profile_sha256": profile_sha256(x_m, z_m), "source_sha256": hashlib.sha256(raw).hexdigest()}
    try:
        return msgspec.convert(content, WeldProfile)
    except msgspec.ValidationError as error:
        problem, _, field = str(error).partition(" - at `$.")
        raise ProfileError(f"{field.rstrip('`')}: {problem}", "correct this statement") from None


def _stated_number(statement: _Statement, key: str) -> float:
    value = float(number(statement.text, statement.where + key))
    if not math.isfinite(value):
        raise ProfileError(f"{statement.where}{key} {quoted(statement.text)} is too large", "correct this statement")
    return value


def _statements(comments: list[Line], form: PlainForm) -> dict[str, _Statement]:
    """Return what header and form state, checked; comments without a known key are free text."""
    stated: dict[str, _Statement] = {}
    for line in comments:
        key, colon, value = (part.strip() for part in line.text.lstrip("#").partition(":"))
        if not colon or not value:
            continue
        if key not in _KEYS:
            _refuse_misspelling(line.number, key)
        elif key in stated:
            raise ProfileError(f"line {line.number}: {key} is stated twice", "keep one statement, one weld a file")
        else:
            stated[key] = _Statement(_plain_unit(key, value), f"line {line.number}: ")
    return _with_form(stated, form)


def _refuse_misspelling(line: int, key: str) -> None:
    if similar := difflib.get_close_matches(key.lower(), _KEYS, n=1, cutoff=0.8):
        raise ProfileError(f"line {line}: unknown key {quoted(key)}", f"write {similar[0]}, if that is what is meant")


def _with_form(stated: dict[str, _Statement], form: PlainForm) -> dict[str, _Statement]:
    by_form = {key: _plain_unit(key, str(value)) for key in _KEYS if (value := getattr(form, key)) is not None}
    merged = {key: _Statement(text, "") for key, text in by_form.items()} | stated
    if missing := [key for key in _REQUIRED if key not in merged]:
        raise ProfileError(
            f"{', '.join(missing)} not stated",
            f"add a line such as '# {missing[0]}: {'up' if missing[0] == 'z_positive' else 'mm'}', "
            "or state it with the options for plain text files",
        )
    _check_choice(merged, "x_unit", tuple(_POWER_OF_TEN))
    _check_choice(merged, "z_unit", tuple(_POWER_OF_TEN))
    _check_choice(merged, "z_positive", ("up", "down"))
    _check_choice(merged, "detrend", ("line", "none"))
    return merged


def _plain_unit(key: str, text: str) -> str:
    return text.translate(_MICRO) if key.endswith("_unit") else text


def _check_choice(stated: Mapping[str, _Statement], key: str, choices: tuple[str, ...]) -> None:
    if key in stated and stated[key].text not in choices:
        raise ProfileError(
            f"{stated[key].where}{key} {quoted(stated[key].text)} is unknown", f"state one of {', '.join(choices)}"
        )


def _samples(rows: list[Line], spacing: float | None, stated: Mapping[str, _Statement]) -> list[_Sample]:
    """Return the samples in m, z as reported."""
    names = ["x", "z"] if spacing is None else ["z"]
    numbers = read_columns(rows, names)
    if not numbers:
        raise ProfileError("no samples", "give rows of x,z after the header")
    if len(numbers) > MAX_SAMPLES:
        raise ProfileError(
            f"{len(numbers)} samples, at most {MAX_SAMPLES}", "give one weld a file, at 0.1 mm or coarser"
        )
    if spacing is not None:
        if not (math.isfinite(spacing) and spacing > 0):
            raise ProfileError(f"spacing {spacing} is not a distance", "state the distance between samples in x_unit")
        step = Decimal(str(spacing))
        numbers = [(line, [step * index, z]) for index, (line, (z,)) in enumerate(numbers)]
    return [
        _Sample(
            line,
            _metres(x, stated["x_unit"].text, f"line {line}: x"),
            _metres(z, stated["z_unit"].text, f"line {line}: z"),
        )
        for line, (x, z) in numbers
    ]


def _metres(value: Decimal, unit: str, name: str) -> Decimal:
    metres = value.scaleb(_POWER_OF_TEN[unit])
    if abs(metres) > _FARTHEST_M:
        raise ProfileError(f"{name} is {metres:.3g} m", f"check the value and its unit (stated: {unit})")
    return metres


def _condition(samples: list[_Sample], stated: Mapping[str, _Statement]) -> tuple[list[float], list[float], list[str]]:
    """Apply sign, centre and detrending; return x_m, z_m and what was done."""
    x_unit, z_unit, z_positive = (stated[key].text for key in _REQUIRED)
    z_sign = 1 if z_positive == "up" else -1
    x = [sample.x for sample in samples]
    z = [sample.z if z_sign > 0 else -sample.z for sample in samples]
    centre, origin = _centre(x, stated)
    detrend = stated["detrend"].text if "detrend" in stated else "line"
    done = [
        f"x converted from {x_unit} and z from {z_unit} to m" + ("" if z_sign > 0 else ", z turned positive up"),
        f"centred on x = {float(centre):.12g} m, {origin}",
    ]
    if detrend == "none":
        done.append("not detrended, as stated")
        if origin == "as stated" and centre == 0:
            return [float(v) for v in x], [float(v) for v in z], done
    else:
        z, line = _without_line(x, z)
        done.append(line)
    done.append("rounded to 1e-12 m")
    return [_rounded(v - centre) for v in x], [_rounded(v) for v in z], done


def _centre(x: list[Decimal], stated: Mapping[str, _Statement]) -> tuple[Decimal, str]:
    if "centre" not in stated:
        return (x[0] + x[-1]) / 2, "the middle of the range"
    text, where = stated["centre"]
    centre = _metres(number(text, where + "centre"), stated["x_unit"].text, where + "centre")
    if not min(x) <= centre <= max(x):
        raise ProfileError(
            f"{where}centre {text} lies outside the samples",
            f"state the weld's centre in x_unit ({stated['x_unit'].text}), within the measured range",
        )
    return centre, "as stated"


def _without_line(x: list[Decimal], z: list[Decimal]) -> tuple[list[Decimal], str]:
    """Return the heights less the line between the two ends, and what was done."""
    if len(x) < 2 or any(after <= before for before, after in itertools.pairwise(x)):
        return z, "not detrended"  # such positions are refused with the bounds
    run, rise = x[-1] - x[0], z[-1] - z[0]
    offset_um, slope_mm_per_m = float(z[0]) * 1e6, float(rise / run) * 1e3
    line = f"line between the ends removed: {offset_um:.6g} um at the start, slope {slope_mm_per_m:.6g} mm/m"
    return [height - z[0] - rise * (at - x[0]) / run for at, height in zip(x, z, strict=True)], line


def _rounded(metres: Decimal) -> float:
    return float(metres.quantize(_RESOLUTION_M)) + 0.0  # no negative zero: it would change the hash


def _check_bounds(x_m: list[float], z_m: list[float], samples: list[_Sample], stated: Mapping[str, _Statement]) -> None:
    problem = profile_problem(x_m, z_m)
    if problem is None:
        return
    template = next((remedy for word, remedy in _REMEDIES if word in problem), "correct the file")
    located = re.sub(
        r"sample (\d+)(?: to (\d+))?",
        lambda match: "line " + " to ".join(str(samples[int(row) - 1].line) for row in match.groups() if row),
        problem,
    )
    raise ProfileError(located, template.format(x_unit=stated["x_unit"].text, z_unit=stated["z_unit"].text))


def write_profile(profile: WeldProfile, path: Path) -> None:
    """Write a profile in the CSV form; it reads back with the same `profile_sha256`, to the last bit.

    Args:
        profile: a profile that keeps the contract, with its centre within its range.
        path: the file to write; an existing one is replaced.

    Raises:
        ProfileError: the profile breaks a bound, or the file cannot be written.
    """
    text = profile_csv(profile, str(path))
    with os_errors_as(ProfileError, path, "give a path that can be written"), whole_file(path) as stream:
        stream.write(text.encode())


def profile_csv(profile: WeldProfile, source: str) -> str:
    """Return a profile in the CSV form; it reads back with the same `profile_sha256`.

    Args:
        profile: as `write_profile` takes it.
        source: where it goes, for messages.

    Raises:
        ProfileError: the profile breaks a bound.
    """
    present = {key: value for key in (*_TEXTS, *_NUMBERS) if (value := getattr(profile, key)) is not UNSET}
    stated = present | {"x_unit": "mm", "z_unit": "um", "z_positive": "up", "detrend": "none", "centre": "0"}
    header = [f"# {key}: {_printable(str(value))}" for key, value in stated.items()]
    history = [f"# {_printable(step).replace(':', ' -')}" for step in profile.conditioning]
    rows = [f"{_shifted(x, 3)},{_shifted(z, 6)}" for x, z in zip(profile.x_m, profile.z_m, strict=True)]
    text = "\n".join([*header, *history, "x,z", *rows]) + "\n"
    if parse_profile(text, source).profile_sha256 != profile.profile_sha256:
        raise ProfileError(
            f"{source}: profile_sha256 is not that of the samples", "take it from profile_sha256(x_m, z_m)"
        )
    return text


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else " " for character in text)


def _shifted(metres: float, power: int) -> str:
    """Return the shortest decimal of a float with its point moved, exactly."""
    return f"{Decimal(repr(float(metres))).scaleb(power):f}"


def shipped() -> dict[str, Path]:
    """Return the files of the bundled profiles by name."""
    folder = Path(str(resources.files("weld_force_ros.data").joinpath("profiles")))
    return {path.stem: path for path in sorted(folder.glob("*.csv"))}


def shipped_profile(name: str) -> WeldProfile:
    """Read a profile that comes with the package.

    Raises:
        ProfileError: there is none of that name.
    """
    if name not in shipped():
        raise ProfileError(f"no profile {name!r} comes with the package", f"use {', '.join(shipped())}")
    return read_profile(shipped()[name])


def find(name_or_path: str | Path) -> Path:
    """Return the file of a bundled profile's name, or of a path; a bundled name goes first, `./name` is always a path.

    Raises:
        ProfileError: neither a shipped profile nor an existing file; the message lists the names.
    """
    names = shipped()
    if isinstance(name_or_path, str) and name_or_path in names:
        return names[name_or_path]
    if os.path.exists(name_or_path):
        return Path(name_or_path)
    raise ProfileError(f"{name_or_path}: no such file or bundled profile", f"give a path or one of {', '.join(names)}")
