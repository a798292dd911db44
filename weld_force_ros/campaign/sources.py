"""Find and count a campaign's welds, and divide them into batches of one size across all sources.

A weld's number is its place in the order of the sources; files of a folder are taken in the order of their names, the
welds of a file in its own. A folder or a bag is read once, into a table beside the results: only then is it known how
many welds its files hold, and a batch need not read what lies before it.
"""

import hashlib
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import msgspec
from threadpoolctl import threadpool_limits

from weld_force_ros import SOFTWARE
from weld_force_ros.campaign import profile_table
from weld_force_ros.campaign.campaign_file import Campaign, SourceEntry
from weld_force_ros.campaign.profile_table import ProfileRow, RejectedRow
from weld_force_ros.errors import BagError, InputError, ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import UNFINISHED, read_profiles
from weld_force_ros.messages import WeldProfile, identity
from weld_force_ros.recording import contract_messages, is_recording_file, open_bag

UNPACKED = "unpacked"
"""Folder beside the results for folders and bags as tables."""

_READ_AT_ONCE = 2048  # files, by as many processes as there are cores
_WORTH_PROCESSES = 200  # files: reading fewer takes no longer than starting them


class Source(msgspec.Struct, frozen=True):
    """Welds of one table.

    Attributes:
        path: absolute.
        origin: as the campaign's file names it, or the folder or bag that the table is made of.
        line: name of the line that the welds are on.
        welds: number of rows: of welds, and of files and messages that hold none.
        state: digest of what the rows depend on: a source of another state is another source.
    """

    path: str
    origin: str
    line: str
    welds: int
    state: str


class SourceSlice(msgspec.Struct, frozen=True):
    """Part of a source: `count` welds from `first` on."""

    source: int
    first: int
    count: int


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
    """Return the sources of a campaign, with folders and bags unpacked.

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
        case "table":
            tables = sorted(path.rglob("*.parquet")) if path.is_dir() else [path]
            found = [_table(table, origin, entry.line, _state(table.parent, [table.name])) for table in tables]
        case "folder":
            files, form = _files(path), entry.file_format()
            if not files:
                raise InputError(f"folder {origin} holds no file", "name one that does")
            state = _state(path, files, f"{path} {form} {SOFTWARE}")
            welds = _measured(path, files, form)
            found = [_unpacked(welds, state, entry, campaign, lambda: say(f"reading {origin}: {len(files):,} files"))]
        case _:
            recordings = [path] if path.is_file() else sorted(filter(is_recording_file, path.rglob("*")))
            state = _state(path.parent, [str(file.relative_to(path.parent)) for file in recordings])
            found = [_unpacked(_recorded(path), state, entry, campaign, lambda: say(f"reading {origin}"))]
    if not sum(source.welds for source in found):
        raise InputError(f"{kind} {origin} holds no weld", "name one that does")
    return found


def _table(path: Path, origin: str, line: str, state: str) -> Source:
    return Source(str(path), origin, line, profile_table.count_rows(path), state)


def _unpacked(
    welds: Iterator[ProfileRow], state: str, entry: SourceEntry, campaign: Campaign, on_read: Callable[[], None]
) -> Source:
    """Return a folder or bag as a table beside the results, which is written unless it is there."""
    origin = entry.kind_and_path[1]
    table = campaign.out / UNPACKED / f"{(campaign.folder / origin).name}-{state[:16]}.parquet"
    if not table.exists():
        on_read()
        profile_table.write(table, welds)
    return _table(table, origin, entry.line, state)


def _files(folder: Path) -> list[str]:
    """Return all files below a folder but hidden ones and those still being written, as paths from there."""
    found = []
    for where, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        below = os.path.relpath(where, folder)
        found += [os.path.normpath(os.path.join(below, name)) for name in names if not name.startswith(".")]
    return sorted(name for name in found if not name.endswith(UNFINISHED))


def _state(folder: Path, files: list[str], read_by: str = "") -> str:
    """Return a digest of names, sizes and times of change, and of what else the rows depend on."""
    digest = hashlib.sha256(read_by.encode(errors="surrogateescape"))
    for name in files:
        stat = os.stat(folder / name)
        digest.update(f"{name}\0{stat.st_size}\0{stat.st_mtime_ns}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _measured(folder: Path, files: list[str], form: InstrumentFormat | None) -> Iterator[ProfileRow]:
    """Yield the welds of a folder's files in their order, or of a file why there are none."""
    read_file = partial(_welds_of_file, folder, form)
    if len(files) < _WORTH_PROCESSES:
        with threadpool_limits(1):
            yield from itertools.chain.from_iterable(map(read_file, files))
        return
    try:
        with ProcessPoolExecutor(mp_context=get_context("spawn"), initializer=threadpool_limits, initargs=(1,)) as pool:
            for begin in range(0, len(files), _READ_AT_ONCE):  # not all at once, for the sake of memory
                some = files[begin : begin + _READ_AT_ONCE]
                yield from itertools.chain.from_iterable(pool.map(read_file, some, chunksize=16))
    except BrokenProcessPool:
        raise InputError(f"{folder}: reading it was interrupted", "run the same command again") from None


def _welds_of_file(folder: Path, form: InstrumentFormat | None, name: str) -> Sequence[ProfileRow]:
    try:
        return read_profiles(folder / name, form)
    except ProfileError as error:
        legible_name = name.encode(errors="replace").decode()
        return [RejectedRow(legible_name, error.reason.removeprefix(f"{folder / name}: "), error.remedy)]


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
        at = 0
        while at < source.welds:
            count = min(room, source.welds - at)
            slices.append(SourceSlice(index, at, count))
            at, room = at + count, room - count
            if room == 0:
                yield WeldBatch(number, number * size, slices)
                number, slices, room = number + 1, [], size
    if slices:
        yield WeldBatch(number, number * size, slices)


def read(source: Source, part: SourceSlice) -> Iterator[ProfileRow]:
    """Yield the welds of a slice of a source, one for each that was counted."""
    return profile_table.read(Path(source.path), part.first, part.count)
