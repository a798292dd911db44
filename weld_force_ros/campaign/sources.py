"""Find and count a campaign's welds, and divide them into batches of one size across all sources.

A weld's number is its place in the order of the sources; files of a folder are taken in the order of their names. A bag
is read once, into a table beside the results: a batch then need not read what lies before it.
"""

import hashlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import msgspec

from weld_force_ros._files import TEMPORARY
from weld_force_ros.campaign import profile_table
from weld_force_ros.campaign.campaign_file import Campaign, SourceEntry
from weld_force_ros.campaign.profile_table import ProfileRow, RejectedRow
from weld_force_ros.errors import BagError, InputError, ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import read_profiles
from weld_force_ros.messages import WeldProfile, identity
from weld_force_ros.recording import contract_messages, open_bag

UNPACKED = "unpacked"
"""Folder beside the results for bags as tables."""


class Source(msgspec.Struct, frozen=True):
    """Welds of one folder or table.

    Attributes:
        path: absolute.
        origin: as the campaign's file names it.
        line: name of the line that the welds are on.
        welds: number of welds.
        state: digest of names, sizes and times of change: a source of another state is another source.
        form: how files are to be read, beside what they state themselves.
    """

    kind: Literal["folder", "table"]
    path: str
    origin: str
    line: str
    welds: int
    state: str
    form: InstrumentFormat | None = None


class SourceSlice(msgspec.Struct, frozen=True):
    """Part of a source: `count` welds from `first` on; of a folder, their files."""

    source: int
    first: int
    count: int
    files: list[str] = []


class WeldBatch(msgspec.Struct, frozen=True):
    """Welds that are assessed together; `first` is the number of the first one."""

    number: int
    first: int
    slices: list[SourceSlice]

    @property
    def welds(self) -> int:
        """Number of welds."""
        return sum(part.count for part in self.slices)


def find(campaign: Campaign, say: Callable[[str], None] = lambda _: None) -> list[Source]:
    """Return the sources of a campaign, with bags unpacked.

    Args:
        campaign: as its file states it.
        say: receives a line about what takes time.

    Raises:
        InputError: a source is not there, cannot be read or holds nothing.
    """
    return [source for entry in campaign.sources for source in _sources_of(entry, campaign, say)]


def _sources_of(entry: SourceEntry, campaign: Campaign, say: Callable[[str], None]) -> list[Source]:
    kind, origin = entry.kind_and_path
    path = campaign.folder / origin
    if not path.exists():
        raise InputError(f"{kind} {origin}: not there", "paths lead from the campaign file's folder")
    match kind:
        case "folder":
            files, form = _files(path), entry.file_format()
            found = [Source("folder", str(path), origin, entry.line, len(files), _state(path, files), form)]
        case "table":
            tables = sorted(path.rglob("*.parquet")) if path.is_dir() else [path]
            found = [_table(table, origin, entry.line, _state(table.parent, [table.name])) for table in tables]
        case _:
            found = [_bag(path, origin, entry.line, campaign.out / UNPACKED, say)]
    if not sum(source.welds for source in found):
        raise InputError(f"{kind} {origin} holds no weld", "name one that does")
    return found


def _table(path: Path, origin: str, line: str, state: str) -> Source:
    return Source("table", str(path), origin, line, profile_table.count_rows(path), state)


def _files(folder: Path) -> list[str]:
    """Return all files below a folder but hidden ones and those still being written, as paths from there."""
    found = []
    for where, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        below = os.path.relpath(where, folder)
        found += [os.path.normpath(os.path.join(below, name)) for name in names if not name.startswith(".")]
    return sorted(name for name in found if not name.endswith((TEMPORARY, ".partial")))


def _state(folder: Path, files: list[str]) -> str:
    digest = hashlib.sha256()
    for name in files:
        stat = os.stat(folder / name)
        digest.update(f"{name}\0{stat.st_size}\0{stat.st_mtime_ns}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _bag(path: Path, origin: str, line: str, unpacked: Path, say: Callable[[str], None]) -> Source:
    recordings = [path] if path.is_file() else sorted(path.rglob("*.mcap"))
    state = _state(path.parent, [str(file.relative_to(path.parent)) for file in recordings])
    table = unpacked / f"{path.name}-{state[:16]}.parquet"
    if not table.exists():
        say(f"reading {origin}")
        profile_table.write(table, _recorded(path))
    return _table(table, origin, line, state)


def _recorded(path: Path) -> Iterator[ProfileRow]:
    """Yield each measurement of a bag once, of each file the last version, and what of the bag cannot be read."""
    last = dict[tuple[str, str], str]()
    for _, message, _ in contract_messages(open_bag(path)):
        if isinstance(message, WeldProfile):
            last[_version(message)] = identity(message)
    seen = set[str]()
    for _, message, _ in contract_messages(open_bag(path)):
        if isinstance(message, BagError):
            yield RejectedRow(path.name, message.reason, message.remedy)
        elif isinstance(message, WeldProfile) and (who := identity(message)) not in seen:
            seen.add(who)
            if last[_version(message)] == who:
                yield message


def _version(profile: WeldProfile) -> tuple[str, str]:
    """Return what of several measurements only the last has: the file, or the measurement itself without one."""
    file = profile.file_version_of
    return (file, profile.weld_id) if isinstance(file, str) else ("", identity(profile))


def batches(sources: list[Source], size: int) -> Iterator[WeldBatch]:
    """Yield all welds in batches of `size`, the rest in the last one."""
    number, slices, room = 0, list[SourceSlice](), size
    for index, source in enumerate(sources):
        files = _files(Path(source.path)) if source.kind == "folder" else []
        at = 0
        while at < source.welds:
            count = min(room, source.welds - at)
            slices.append(SourceSlice(index, at, count, files[at : at + count]))
            at, room = at + count, room - count
            if room == 0:
                yield WeldBatch(number, number * size, slices)
                number, slices, room = number + 1, [], size
    if slices:
        yield WeldBatch(number, number * size, slices)


def read(source: Source, part: SourceSlice) -> Iterator[ProfileRow]:
    """Yield the welds of a slice of a source, one for each that was counted."""
    path = Path(source.path)
    if source.kind == "table":
        yield from profile_table.read(path, part.first, part.count)
        return
    for name in part.files:
        try:
            welds = read_profiles(path / name, source.form)
            if len(welds) > 1:
                raise ProfileError(
                    f"{path / name}: holds {len(welds)} welds", "give a campaign one weld a file, or a bag"
                )
            yield welds[0]
        except ProfileError as error:
            legible_name = name.encode(errors="replace").decode()
            yield RejectedRow(legible_name, error.reason.removeprefix(f"{path / name}: "), error.remedy)
