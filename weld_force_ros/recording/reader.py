"""Read recordings: a bag folder with its files, or one file."""

import heapq
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Attachment, Metadata

from weld_force_ros import _yaml
from weld_force_ros.errors import BagError
from weld_force_ros.recording.bag_errors import as_bag_error
from weld_force_ros.recording.mcap_reader import McapFile
from weld_force_ros.recording.recorded import Recorded
from weld_force_ros.recording.recorded_file import CONVERT, PACKED, RecordedFile
from weld_force_ros.recording.rosbag2_format import (
    UNKNOWN_DISTRO,
    ChannelStatistics,
    FileForm,
    merged,
    stated_origin,
)
from weld_force_ros.recording.sqlite3_reader import Sqlite3File
from weld_force_ros.recording.timeline import Gap

_READERS: dict[str, type[RecordedFile]] = {".mcap": McapFile, ".db3": Sqlite3File}


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a recording."""

    topic: str
    type_name: str
    message_count: int


@dataclass(frozen=True)
class FileSummary:
    """One file of a recording; `damage` is None for one that was closed and is whole."""

    name: str
    size_bytes: int
    message_count: int
    start_ns: int
    duration_s: float
    closed: bool
    indexed: bool
    damage: str | None


@dataclass(frozen=True)
class Summary:
    """Contents and state of a recording; `damage` is None for one that was closed and is whole.

    Durations leave out the `gaps`, times of more than a day without any message.
    """

    path: str
    files: tuple[FileSummary, ...]
    size_bytes: int
    message_count: int
    start_ns: int
    duration_s: float
    gaps: tuple[Gap, ...]
    topics: tuple[TopicSummary, ...]
    closed: bool
    indexed: bool
    lost_bytes: int
    lost_messages: int
    damage: str | None


class Bag:
    """A recording, scanned once when opened: what is damaged is known before the first message is used.

    Attributes:
        path: what was opened.
        files: its files, in order; those of which nothing can be read too.
        statistics: what they hold together.
    """

    def __init__(self, path: Path) -> None:
        """See `open_bag`."""
        self.path = path
        self.files: list[RecordedFile] = _files(path)
        if not self.files:
            raise BagError(f"{path} holds no .mcap file and no .db3", "give a bag folder or one of its files")
        for file in self.files:
            file.scan()
        errors = [file.error for file in self.files if file.error]
        if len(errors) == len(self.files):
            raise errors[0]
        self._readable = [file for file in self.files if not file.error]
        self.statistics: ChannelStatistics = merged(file.statistics for file in self._readable)
        if self.truncated and not self.statistics.message_count:
            raise BagError(f"{path} holds no readable message and was not closed", "nothing can be recovered from it")

    @property
    def truncated(self) -> bool:
        """Return whether a file was never closed, or its end is missing."""
        return not all(file.closed for file in self._readable)

    @property
    def lost_bytes(self) -> int:
        """Return how many bytes of message data are unreadable."""
        return sum(file.lost_bytes for file in self.files)

    @property
    def lost_messages(self) -> int:
        """Return how many messages are known to be lost; a file that was cut does not show how many."""
        return sum(file.lost_messages for file in self.files)

    @property
    def lossy(self) -> bool:
        """Return whether something that was written cannot be read."""
        return any(file.lossy for file in self.files)

    @property
    def form(self) -> FileForm:
        """Return what the recording states beside its messages: metadata.yaml first, its first file for the rest."""
        form = self._readable[0].form
        distro, custom_data = (stated_origin(metadata_of(self.path)) if self.path.is_dir() else None) or form[2:]
        return form._replace(
            ros_distro=form.ros_distro if distro == UNKNOWN_DISTRO else distro,
            custom_data=custom_data or form.custom_data,
        )

    @property
    def damage(self) -> str | None:
        """Return what is wrong with the files, in a clause; None if nothing is."""
        return "; ".join(file.damage for file in self.files if file.damage) or None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Recorded]:
        """Yield messages in log order (those of one time in file order), of all topics or of those named.

        Files are merged, each opened when its first message is due: a clock that was set back costs no memory.

        Raises:
            BagError: a file is too far out of order to be sorted in memory, or cannot be read any more.
        """
        heads: list[tuple[int, int, Recorded | None, Iterator[Recorded]]] = [
            (file.statistics.start_ns, ordinal, None, file.ordered(topics))
            for ordinal, file in enumerate(self._readable)
        ]
        heapq.heapify(heads)
        while heads:
            _, ordinal, recorded, stream = heads[0]
            if recorded:
                yield recorded
            try:
                following = next(stream, None)
            except OSError as error:
                raise BagError(f"{error.filename or self.path}: {error.strerror or error}", "try again") from error
            if following:
                heapq.heapreplace(heads, (following.log_time_ns, ordinal, following, stream))
            else:
                heapq.heappop(heads)

    @property
    def rewritten(self) -> tuple[str, ...]:
        """Return what of its form is another once its messages are written anew, a clause each."""
        return tuple(f"{file.path.name}: {clause}" for file in self._readable for clause in file.rewritten)

    def extras(self) -> Iterator[Attachment | Metadata]:
        """Yield attachments and metadata records of its files, without those of rosbag2, which say what is in a file.

        Raises:
            OSError: a file cannot be read any more.
        """
        for file in self._readable:
            yield from file.extras()

    def summary(self) -> Summary:
        """Return contents and state of the recording."""
        timeline = self.statistics.timeline
        return Summary(
            path=str(self.path),
            files=tuple(_file_summary(file) for file in self.files),
            size_bytes=sum(file.size for file in self.files),
            message_count=self.statistics.message_count,
            start_ns=self.statistics.start_ns,
            duration_s=timeline.duration_ns * 1e-9,
            gaps=timeline.gaps,
            topics=tuple(
                TopicSummary(topic, definition.name, n) for (topic, definition), n in self.statistics.counts.items()
            ),
            closed=not self.truncated,
            indexed=all(file.indexed for file in self._readable),
            lost_bytes=self.lost_bytes,
            lost_messages=self.lost_messages,
            damage=self.damage,
        )


def _file_summary(file: RecordedFile) -> FileSummary:
    return FileSummary(
        name=file.path.name,
        size_bytes=file.size,
        message_count=file.statistics.message_count,
        start_ns=file.statistics.start_ns,
        duration_s=file.statistics.timeline.duration_ns * 1e-9,
        closed=file.closed,
        indexed=file.indexed,
        damage=file.damage,
    )


def open_bag(path: Path) -> Bag:
    """Open a bag folder or one of its files, intact or cut, and read it through once.

    Files are MCAP or, with the extra `foreign`, sqlite3; they or their messages may be compressed by zstd. A file of
    several that is missing, empty, no recording or claims absurd sizes counts as damage; the others are read.

    Raises:
        BagError: no such path, no recording in it, no file that can be read, or cut before its first message.
    """
    return Bag(path)


def stored(path: Path) -> Iterator[Recorded]:
    """Yield every readable message of a bag folder or of one file, in one pass and in the order of the files.

    A file of a folder of which nothing can be read is passed over; a folder without files gives nothing.

    Raises:
        BagError: no such path, or a single file that cannot be read.
    """
    for file in _files(path):
        try:
            yield from file.stored()
        except (BagError, OSError) as error:
            if path.is_dir():
                continue
            if isinstance(error, BagError):
                raise
            raise BagError(f"{path}: {error.strerror or error}", "give a file that can be read") from error


def summary(path: Path) -> Summary:
    """Return contents and state of a recording; errors as `open_bag`."""
    return open_bag(path).summary()


def is_recording_file(path: Path) -> bool:
    """Return whether a file's name is that of a recording."""
    return _reader_of(path.name) is not None


def metadata_of(directory: Path) -> dict[str, Any]:
    """Return what metadata.yaml says; nothing if it is missing or broken: after a crash it may be either."""
    try:
        content = _yaml.decode(_yaml.read(directory / "metadata.yaml"), dict[str, Any])["rosbag2_bagfile_information"]
    except (OSError, ValueError, msgspec.DecodeError, KeyError):
        return {}
    return content if isinstance(content, dict) else {}


def listed_files(directory: Path) -> dict[str, int]:
    """Return the files that metadata.yaml names, with their numbers of messages; names are stripped of folders."""
    content = metadata_of(directory)
    try:
        names = [Path(name).name for name in content["relative_file_paths"]]
        counts = {Path(file["path"]).name: int(file["message_count"]) for file in content.get("files") or ()}
        return {name: counts.get(name, 0) for name in names if "\0" not in name}
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError):
        return {}


def series_of(file_name: str) -> str:
    """Return the name that the numbered files of a recording share."""
    return re.sub(r"_\d+\.(mcap|db3)(\.zstd)?$", "", file_name)


def _reader_of(file_name: str) -> type[RecordedFile] | None:
    return _READERS.get(Path(file_name.removesuffix(PACKED)).suffix)


def _file(path: Path, message_count: int = 0) -> RecordedFile:
    return (_reader_of(path.name) or McapFile)(path, message_count)


def _files(path: Path) -> list[RecordedFile]:
    if not path.is_dir():
        if not path.exists():
            raise BagError(f"{path} does not exist", "give a bag folder or one of its files")
        return [_file(path)]
    _check_compression(path)
    with as_bag_error(path, "give a folder that can be read"):
        # Shorter names first: bag_10.mcap comes after bag_9.mcap.
        there = sorted(filter(is_recording_file, path.iterdir()), key=lambda file: (len(file.name), file.name))
    listed = listed_files(path)
    series = {series_of(name) for name in (*listed, f"{path.resolve().name}_0.mcap")}
    unpacked = {name.removesuffix(PACKED) for name in listed}  # a packed file and what it holds are one
    unlisted = [
        file
        for file in there
        if file.name.removesuffix(PACKED) not in unpacked and (not listed or series_of(file.name) in series)
    ]
    return [*(_file(path / name, count) for name, count in listed.items()), *map(_file, unlisted)]


def _check_compression(directory: Path) -> None:
    """Raise a BagError if a recording is compressed otherwise than by zstd."""
    content = metadata_of(directory)
    mode, by = content.get("compression_mode"), content.get("compression_format")
    if mode and str(mode).lower() != "none" and by and by != "zstd":
        raise BagError(f"{directory} is compressed by {by!r}, {str(mode).lower()} by {str(mode).lower()}", CONVERT)
