"""Read and write measurement files: what an instrument wrote -> `messages.WeldProfile`.

`text_file` makes lines of bytes, `sample_table` finds the rows, `statements` what the header states, `record` orders
and mends the samples, `plausibility` refuses what no rail can have, `noise` estimates the geometry. This module
composes them; joining to the rail and the wheel belong to the simulation.

Numbers are handled as exact decimals and rounded to 1e-12 m, so that one geometry has one `profile_sha256` whatever
units it was exported in. A file with `centre: 0`, `detrend: none` and `noise: none` asks for no change; its values are
kept to the last bit, which lets `write_profile` return any profile exactly.
"""

import decimal
import hashlib
import itertools
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from weld_force_ros._files import whole_file
from weld_force_ros.errors import ProfileError, os_errors_as
from weld_force_ros.measurement import geometry, instruments, record, statements
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.numbers import in_metres, is_kilometre_plus, is_missing, number, plain_number, unit_of
from weld_force_ros.measurement.record import Record, Sample
from weld_force_ros.measurement.sample_table import SampleTable, find_tables
from weld_force_ros.measurement.statements import Stated
from weld_force_ros.measurement.text_file import MAX_FILE_BYTES, TextFile, text_file
from weld_force_ros.messages import (
    MAX_PROFILE_LENGTH_M,
    MAX_SAMPLES,
    WeldProfile,
    profile_problem,
    profile_sha256,
)

_FARTHEST_M = 10**7  # no chainage is longer; a number beyond it has the wrong unit
_LONGEST_REASON = 300  # it may repeat what the file says
_WIDEST_SPACING = 1e9  # in any unit
_CHAINAGE_FROM_M = 50.0  # a position so far from zero is a chainage
_RESOLUTION_M = Decimal("1e-12")
_ESTIMATE_DECIMALS = 9
_EXACT = decimal.Context(prec=200, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN)

_REMEDIES = (  # by what `profile_problem` says
    ("samples", "measure the whole weld at a spacing of 10 mm or finer"),
    ("length", "check x_unit (stated: {x_unit}), or cut the record to the weld and its surroundings"),
    ("spacing", "check x_unit (stated: {x_unit}), or measure at 10 mm or finer"),
    ("amplitude", "check z_unit (stated: {z_unit}); heights are probably in another unit"),
)


@dataclass(frozen=True)
class Understood:
    """A measured weld and what was understood of its file.

    Attributes:
        profile: of the weld; it names the format.
        samples: number of samples as measured.
        spacing_m: usual distance of the samples.
    """

    profile: WeldProfile
    samples: int
    spacing_m: float


def read_profile(path: Path, form: InstrumentFormat | None = None) -> WeldProfile:
    """Read a measurement file of one weld.

    Args:
        path: of the file.
        form: what the file does not state itself.

    Returns:
        The conditioned profile; its `source` is the file's name without folders, the same on every machine.

    Raises:
        ProfileError: the file cannot be read or used, or holds several welds; one line with the file, the line, and
            what to do.
    """
    profiles = read_profiles(path, form)
    if len(profiles) > 1:
        raise ProfileError(f"{path}: holds {len(profiles)} welds", "read all of them, with read_profiles")
    return profiles[0]


def read_profiles(path: Path, form: InstrumentFormat | None = None) -> list[WeldProfile]:
    """Read all welds of a measurement file, as `read_profile` reads one.

    Raises:
        ProfileError: the file cannot be read, or a weld of it cannot be used.
    """
    return [understood.profile for understood in inspect_file(path, form)]


def inspect_file(path: Path, form: InstrumentFormat | None = None) -> list[Understood]:
    """Read all welds of a measurement file, with what was understood of it.

    Raises:
        ProfileError: the file cannot be read, or a weld of it cannot be used.
    """
    with os_errors_as(ProfileError, path, "give the path of a readable profile file"), path.open("rb") as file:
        raw = file.read(MAX_FILE_BYTES + 1)
    name = path.name.encode("utf-8", "replace").decode()  # a name may hold bytes that no message can
    found = parse_profiles(raw, str(path), form)
    return [replace(one, profile=msgspec.structs.replace(one.profile, source=name[-200:])) for one in found]


def parse_profile(data: str | bytes, source: str, form: InstrumentFormat | None = None) -> WeldProfile:
    """Read a profile from text, or from the bytes of a file, that hold one weld.

    Raises:
        ProfileError: the text cannot be used, or holds several welds.
    """
    found = parse_profiles(data, source, form)
    if len(found) > 1:
        raise ProfileError(f"{source}: holds {len(found)} welds", "give one weld a file")
    return found[0].profile


def parse_profiles(data: str | bytes, source: str, form: InstrumentFormat | None = None) -> list[Understood]:
    """Read all welds of a measurement file's text or bytes.

    Args:
        data: the text; `source_sha256` is taken of its bytes.
        source: where it comes from, for messages and the profile; its stem is the weld's default name.
        form: a format to read it by, and what the user states; where the file states something itself, that goes first.

    Returns:
        A conditioned profile for each weld, in the file's order: x in m about the weld's centre, z in m positive up.

    Raises:
        ProfileError: the text cannot be used; one line with the source, the line, and what to do.
    """
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else bytes(data)
    try:
        with decimal.localcontext(_EXACT):
            return _welds(raw, source, form)
    except ProfileError as error:
        reason = error.reason if len(error.reason) <= _LONGEST_REASON else error.reason[:_LONGEST_REASON] + "…"
        raise ProfileError(f"{_printable(source)}: {_printable(reason)}", error.remedy) from None


def is_complete(raw: bytes, form: InstrumentFormat | None = None) -> bool:
    """Return whether a file's content says that it is all there: what a half-written one does not.

    Its last line is ended, and it announces its number of samples, has a footer, or reaches as far behind its own zero
    as it began before it. A file of which that cannot be told may be complete, and one that cannot be read never will.

    Args:
        raw: the content so far.
        form: as in `parse_profiles`.
    """
    try:
        file = text_file(raw, form.encoding if form else None)
        with decimal.localcontext(_EXACT):
            tables = _tables(file, form)[0]
    except ProfileError:
        return raw.startswith(b"PK")
    _, samples, header = tables[-1]
    first, last = samples[0].x, samples[-1].x
    symmetric = first * last < 0 and abs(first + last) * 2 * len(samples) < abs(last - first)
    return file.is_ended and ("samples" in header or tables[-1][0].footer > 0 or symmetric)


def _welds(raw: bytes, source: str, stated: InstrumentFormat | None) -> list[Understood]:
    file = text_file(raw, stated.encoding if stated else None)
    tables, form = _tables(file, stated)
    digest = hashlib.sha256(raw).hexdigest()
    stem = Path(source).stem[:190] or source[:190]
    found = list[Understood]()
    for count, (table, samples, header) in enumerate(tables, start=1):
        name = stem if len(tables) == 1 else f"{stem}-{table.weld or count}"
        try:
            found.append(_understood(table, samples, header, form, name, source, digest, file.notes))
        except ProfileError as error:
            where = "" if len(tables) == 1 else f"weld {table.weld or count}: "
            raise ProfileError(f"{where}{error.reason}", error.remedy) from None
    return _told_apart(found)


def _told_apart(welds: list[Understood]) -> list[Understood]:
    """Give numbers to the welds of a file that have one name: they are no versions of each other."""
    named = Counter(weld.profile.weld_id for weld in welds)
    for count, weld in enumerate(welds, start=1):
        if named[weld.profile.weld_id] > 1:
            weld.profile.weld_id = f"{weld.profile.weld_id[:190]}-{count}"
    return welds


def _tables(
    file: TextFile, stated: InstrumentFormat | None
) -> tuple[list[tuple[SampleTable, list[Sample], dict[str, Stated]]], InstrumentFormat]:
    """Return the records of a file and the format by which it is read."""
    form = stated or InstrumentFormat()
    if form.name == InstrumentFormat().name:
        known = instruments.recognised([line.text for line in file.lines])
        if known is instruments.shipped()["weld-force"] and stated is not None:  # which needs no other layout
            stated = msgspec.structs.replace(
                stated, skip_rows=0, spacing=None, columns={}, separator=None, decimal=None
            )
        form = (known or InstrumentFormat()).with_statements(stated)
    if form.refuse:
        raise ProfileError(form.refuse, "export the heights along the rail")
    return [
        part for table in find_tables(file.lines, form, is_ended=file.is_ended) for part in _records(table, form)
    ], form


def _records(table: SampleTable, form: InstrumentFormat) -> list[tuple[SampleTable, list[Sample], dict[str, Stated]]]:
    """Return the records of a table, each with its samples in m and what is stated of it."""
    header = statements.statements(table.statements, form)
    for key, unit in (("x_unit", table.x_unit), ("z_unit", table.z_unit), ("z_positive", table.z_positive)):
        if unit is None:
            continue
        if key in header and (unit_of(header[key].text) or header[key].text.casefold()) != unit:
            raise ProfileError(
                f"{header[key].where}{key} {header[key].text}, but the heading of the column says {unit}",
                "correct the one that is wrong",
            )
        header.setdefault(key, Stated(unit, ""))
    header = statements.with_format(header, form)
    samples = _samples(table, form, header)
    if (count := header.get("samples")) and count.text.isdecimal() and int(count.text) != len(samples):
        raise ProfileError(
            f"{count.where}{count.text} samples announced, {len(samples)} are there", "the file is not complete"
        )
    records = []
    for part in record.divide(samples):
        if abs(part[-1].x - part[0].x) <= MAX_PROFILE_LENGTH_M:
            records.append((table, part, header))
            continue
        length_m = abs(part[-1].x - part[0].x)
        cut = replace(table, notes=[*table.notes, f"cut out of {length_m:.4g} m of rail"])
        records += [(cut, weld, header) for weld in record.cut_into_welds(record.ordered(part).samples)]
    return records


def _samples(table: SampleTable, form: InstrumentFormat, header: Mapping[str, Stated]) -> list[Sample]:
    if len(table.rows) > MAX_SAMPLES:
        raise ProfileError(
            f"{len(table.rows)} samples, at most {MAX_SAMPLES}", "give one weld a file, at 0.1 mm or coarser"
        )
    sign = -1 if form.x_direction == "against" else 1
    step = None
    if form.spacing is not None:
        if not 0 < form.spacing <= _WIDEST_SPACING:
            raise ProfileError(f"spacing {form.spacing:g} of the samples", "state it in x_unit, more than 0")
        step = Decimal(str(form.spacing))
    marks = tuple(form.missing)
    found = []
    for index, row in enumerate(table.rows):
        where, unit = f"line {row.line}: ", header["x_unit"].text
        if table.x is None or step is not None:
            x = (step or Decimal(0)) * index
        else:
            text = row.fields[table.x]
            x = number(text, where + "x", decimal_comma=table.x in table.decimal_comma)
            unit = "m" if is_kilometre_plus(text) else unit
        heights = list[Decimal | None]()
        for column in table.z:
            text = row.fields[column]
            missing = is_missing(text, marks)
            value = None if missing else number(text, where + "z", decimal_comma=column in table.decimal_comma)
            heights.append(None if value is None else in_metres(value, header["z_unit"].text, where + "z"))
        texts = [plain_number(row.fields[column], decimal_comma=column in table.decimal_comma) for column in table.z]
        found.append(Sample(row.line, sign * in_metres(x, unit, where + "x"), heights, texts))
    return found


def _understood(
    table: SampleTable,
    samples: list[Sample],
    header: Mapping[str, Stated],
    form: InstrumentFormat,
    name: str,
    source: str,
    digest: str,
    notes: Sequence[str],
) -> Understood:
    exact = header["noise"].text == "none" if "noise" in header else False
    mended = record.ordered(samples)
    record.without_nines(mended)
    measured = len(mended.samples)
    record.bridged(mended)
    found = geometry.exact(mended, header) if exact else geometry.estimated(mended, header, form.form_error)
    done = [*notes, *table.notes, *mended.notes, *found.done]
    if form.skip_rows:
        done.insert(0, f"first {form.skip_rows} lines skipped")
    _check_bounds(found.x_m, found.z_m, mended, header)
    content: dict[str, Any] = {"weld_id": name}
    content |= {key: header[key].text for key in (*statements.TEXTS, *statements.DIRECTIONS, "kind") if key in header}
    if form.x_direction == "against":  # turned, so that x rises in the running direction
        content.setdefault("running", "with")
    content |= {"weld_id": table.weld} if table.weld else {}
    content |= {key: statements.stated_number(header[key], key) for key in statements.NUMBERS if key in header}
    if "chainage_m" not in content and abs(found.centre) > _CHAINAGE_FROM_M:
        turned = form.x_direction == "against"
        content["chainage_m"] = round(float(-found.centre if turned else found.centre), 6)
        content.setdefault("chainage_direction", "against" if turned else "with")
    content |= {"source": source[-200:], "x_m": found.x_m, "z_m": found.z_m, "conditioning": done[:50]}
    content |= {"profile_sha256": profile_sha256(found.x_m, found.z_m), "source_sha256": digest}
    content |= {"format": form.name[:200]} | found.measured
    try:
        profile = msgspec.convert(content, WeldProfile)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        raise ProfileError(f"{where.rstrip('`')}: {problem}", "correct this statement") from None
    if wrong := profile.problem():
        raise ProfileError(wrong, "correct the file")
    steps = [float(b.x - a.x) for a, b in itertools.pairwise(mended.samples)]
    return Understood(profile, measured, float(np.median(steps)))


def _check_bounds(x_m: list[float], z_m: list[float], mended: Record, header: Mapping[str, Stated]) -> None:
    problem = profile_problem(x_m, z_m)
    if problem is None:
        return
    template = next((remedy for word, remedy in _REMEDIES if word in problem), "correct the file")
    located = re.sub(
        r"sample (\d+)(?: to (\d+))?",
        lambda match: "line " + " to ".join(_line_of(mended, int(row)) for row in match.groups() if row),
        problem,
    )
    raise ProfileError(located, template.format(x_unit=header["x_unit"].text, z_unit=header["z_unit"].text))


def _line_of(mended: Record, number_of_sample: int) -> str:
    return str(mended.samples[min(number_of_sample, len(mended.samples)) - 1].line)


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
    text = samples_csv(profile, noise="none")
    if parse_profile(text, source).profile_sha256 != profile.profile_sha256:
        raise ProfileError(
            f"{source}: profile_sha256 is not that of the samples", "take it from profile_sha256(x_m, z_m)"
        )
    return text


def samples_csv(profile: WeldProfile, *, noise: str) -> str:
    """Return the samples of a profile in the CSV form.

    Args:
        profile: with its centre within its range.
        noise: `none` if they are the geometry itself, `auto` if they are to be read as measured.
    """
    present = {
        key: value
        for key in (*statements.TEXTS, *statements.NUMBERS, *statements.DIRECTIONS, "kind")
        if (value := getattr(profile, key)) is not UNSET
    }
    stated = present | {"x_unit": "mm", "z_unit": "um", "z_positive": "up", "detrend": "none", "centre": "0"}
    stated |= {"noise": noise, "samples": len(profile.x_m)}
    header = [f"# {key}: {_printable(str(value))}" for key, value in stated.items()]
    history = [f"# {_printable(step).replace(':', ' -')}" for step in profile.conditioning]
    rows = [f"{_shifted(x, 3)},{_shifted(z, 6)}" for x, z in zip(profile.x_m, profile.z_m, strict=True)]
    return "\n".join([*header, *history, "x,z", *rows]) + "\n"


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


UNFINISHED = (".part", ".partial", ".crdownload", ".tmp", "~")
"""What copying programs end a file's name with until it is there."""


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
