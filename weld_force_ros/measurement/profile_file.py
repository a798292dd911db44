"""Read and write measurement files: what an instrument wrote -> `messages.WeldProfile`.

`text_file` makes lines of bytes, `file_records` finds their records (`sample_table` the rows, `statements` what the
header states), `record` orders and mends the samples, `plausibility` refuses what no rail can have, `noise` estimates
the geometry. This module composes them; joining to the rail and the wheel belong to the simulation.

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
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, ProfileError, os_errors_as
from weld_force_ros.measurement import geometry, record, statements
from weld_force_ros.measurement.file_records import FileRecord, file_records
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.record import Record, Sample
from weld_force_ros.measurement.sample_table import SampleTable
from weld_force_ros.measurement.statements import Stated
from weld_force_ros.measurement.text_file import MAX_FILE_BYTES, TextFile, text_file
from weld_force_ros.messages import (
    SupportState,
    WeldProfile,
    mirrored_support,
    parse_support,
    profile_problem,
    profile_sha256,
    support_text,
)

_LONGEST_REASON = 300  # it may repeat what the file says
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
    return MeasurementFile(raw, form).welds(source)


def is_complete(raw: bytes, form: InstrumentFormat | None = None) -> bool:
    """Return whether a file's content says that it is all there: what a half-written one does not.

    Its last line is ended, and it announces its number of samples, has a footer, or reaches as far behind its own zero
    as it began before it. A file of which that cannot be told may be complete, and one that cannot be read never will.

    Args:
        raw: the content so far.
        form: as in `parse_profiles`.
    """
    return MeasurementFile(raw, form).is_complete


class MeasurementFile:
    """A measurement file's content: its records are read once, for whether it is all there and for its welds.

    Args:
        raw: the content so far.
        form: as in `parse_profiles`.
    """

    def __init__(self, raw: bytes, form: InstrumentFormat | None = None) -> None:
        self.raw = raw
        self._stated = form

    @cached_property
    def _text(self) -> TextFile:
        return text_file(self.raw, self._stated.encoding if self._stated else None)

    @cached_property
    def _records(self) -> tuple[list[FileRecord], InstrumentFormat]:
        with decimal.localcontext(_EXACT):
            return file_records(self._text, self._stated)

    @property
    def is_complete(self) -> bool:
        """Return what the function of this name does."""
        try:
            records, _ = self._records
        except ProfileError:
            return self.raw.startswith(b"PK")
        table, samples, header = records[-1]
        first, last = samples[0].x, samples[-1].x
        symmetric = first * last < 0 and abs(first + last) * 2 * len(samples) < abs(last - first)
        return self._text.is_ended and ("samples" in header or table.footer > 0 or symmetric)

    def welds(self, source: str) -> list[Understood]:
        """Return what `parse_profiles` does; once, as the samples are mended in place.

        Raises:
            ProfileError: the text cannot be used; one line with the source, the line, and what to do.
        """
        try:
            with decimal.localcontext(_EXACT):
                return self._welds(source)
        except ProfileError as error:
            reason = error.reason if len(error.reason) <= _LONGEST_REASON else error.reason[:_LONGEST_REASON] + "…"
            raise ProfileError(f"{_printable(source)}: {_printable(reason)}", error.remedy) from None

    def _welds(self, source: str) -> list[Understood]:
        records, form = self._records
        digest = hashlib.sha256(self.raw).hexdigest()
        stem = Path(source).stem[:190] or source[:190]
        found = list[Understood]()
        for count, (table, samples, header) in enumerate(records, start=1):
            name = stem if len(records) == 1 else f"{stem}-{table.weld or count}"
            try:
                found.append(_understood(table, samples, header, form, name, source, digest, self._text.notes))
            except ProfileError as error:
                where = "" if len(records) == 1 else f"weld {table.weld or count}: "
                raise ProfileError(f"{where}{error.reason}", error.remedy) from None
        return _told_apart(found)


def _told_apart(welds: list[Understood]) -> list[Understood]:
    """Give numbers to the welds of a file that have one name: they are no versions of each other."""
    named = Counter(weld.profile.weld_id for weld in welds)
    for count, weld in enumerate(welds, start=1):
        if named[weld.profile.weld_id] > 1:
            weld.profile.weld_id = f"{weld.profile.weld_id[:190]}-{count}"
    return welds


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
    if "support" in header:
        content["support"] = _support(header["support"])
    if form.x_direction == "against":  # turned, so that x rises in the running direction
        content.setdefault("running", "with")
        content |= {"support": mirrored_support(content["support"])} if "support" in content else {}
    content |= {"weld_id": table.weld} if table.weld else {}
    content |= {key: statements.stated_number(header[key], key) for key in statements.NUMBERS if key in header}
    if "chainage_m" not in content and abs(found.centre) > _CHAINAGE_FROM_M:
        turned = form.x_direction == "against"
        content["chainage_m"] = round(float(-found.centre if turned else found.centre), 6)
        content.setdefault("chainage_direction", "against" if turned else "with")
    content |= {"source": source[-200:], "x_m": found.x_m, "z_m": found.z_m, "conditioning": done[:50]}
    content |= {"source_sha256": digest, "format": form.name[:200]} | found.measured
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
    """Write a profile in the CSV form; it reads back with the same samples, to the last bit.

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
    """Return a profile in the CSV form; it reads back with the same samples.

    Args:
        profile: as `write_profile` takes it.
        source: where it goes, for messages.

    Raises:
        ProfileError: the profile breaks a bound.
    """
    text = samples_csv(profile, noise="none")
    if parse_profile(text, source).profile_sha256 != profile_sha256(profile.x_m, profile.z_m):
        raise ProfileError(f"{source}: the samples do not read back as they are", "give x increasing and centred")
    if problem := profile.problem():
        raise ProfileError(f"{source}: {problem}", "take it from profile_sha256(x_m, z_m)")
    return text


def _support(statement: Stated) -> list[SupportState]:
    try:
        return parse_support(statement.text)
    except InputError as error:
        raise ProfileError(f"{statement.where}{error.reason}", error.remedy) from None


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
    if not isinstance(profile.support, UnsetType):
        present["support"] = support_text(profile.support)
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


def files_in(folder: Path) -> list[Path]:
    """Return the files of a folder by name, without hidden ones and those that are still being copied.

    Raises:
        ProfileError: the folder cannot be read.
    """
    with os_errors_as(ProfileError, folder, "give a folder that can be read"):
        inside = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    return [path for path in inside if not path.name.endswith(UNFINISHED)]


def find(name_or_path: str | os.PathLike[str]) -> Path:
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
