"""One file of a recording in any form: what is known of it once it was read through, and its messages in log order."""

import heapq
import os
import shutil
import tempfile
import weakref
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.records import Attachment, Metadata

from weld_force_ros.errors import BagError
from weld_force_ros.recording.recorded import Recorded
from weld_force_ros.recording.rosbag2_format import ChannelStatistics, FileForm, MessageDefinition

MAX_REORDERED_BYTES = 2**30
"""Bytes that may be held in memory to bring a file into log order."""

PACKED = ".zstd"
"""The ending of the name of a file that was compressed as a whole (`ros2 bag record --compression-mode file`)."""

CONVERT = (
    "`ros2 bag convert -i BAG -o out.yaml`, out.yaml: `output_bags: [{uri: NEW, storage_id: mcap, all_topics: true}]`"
)
"""The remedy for a form that is not read here."""


class RecordedFile(ABC):
    """One file, read from front to back as often as wanted; its state is known once it was scanned.

    Attributes:
        path: the file.
        size: in bytes, when it was scanned.
        statistics: what it holds.
        channels: topic and definition of each of its channels, whether or not it has messages.
        form: how it is written, and what it says of where it comes from.
        closed: whether its end is there.
        indexed: whether it has an index.
        lost_bytes: how much of it is unreadable.
        lost_messages: how many messages are known to be lost: by its summary, or of those that `expected_messages`
            said it holds. A file that was cut before it was closed cannot tell.
        rewritten: what of its form is another once its messages are written anew, a clause each.
        error: why nothing of it can be read; else None.
    """

    def __init__(self, path: Path, expected_messages: int = 0) -> None:
        self.path = path
        self.size = 0
        self.statistics = ChannelStatistics()
        self.channels: tuple[tuple[str, MessageDefinition], ...] = ()
        self.form = FileForm()
        self.closed = False
        self.indexed = False
        self.lost_bytes = 0
        self.lost_messages = 0
        self.rewritten: tuple[str, ...] = ()
        self.error: BagError | None = None
        self._expected_messages = expected_messages
        self._when_scanned: os.stat_result | None = None
        self._unpacked: Path | None = None

    @abstractmethod
    def stored(self) -> Iterator[Recorded]:
        """Yield every readable message in the order of the file.

        Raises:
            BagError: nothing of it can be read.
            OSError: the file cannot be read.
        """

    @abstractmethod
    def stated_messages(self) -> int | None:
        """Return how many messages the file states that it holds; None if it does not.

        Raises:
            OSError: the file cannot be read.
        """

    def extras(self) -> Iterator[Attachment | Metadata]:
        """Yield attachments and metadata records; errors as `stored`."""
        return iter(())

    @property
    def damage(self) -> str | None:
        """Return what is wrong with the file, in a clause; None if nothing is."""
        if self.error:
            return self.error.reason.replace(str(self.path), self.path.name)
        faults = [
            *(["was not closed"] * (not self.closed)),
            *([f"has {self.lost_bytes} unreadable bytes"] * (self.lost_bytes > 0)),
            *([f"lacks {self.lost_messages} messages"] * (self.lost_messages > 0)),
        ]
        return f"{self.path.name} {' and '.join(faults)}" if faults else None

    @property
    def lossy(self) -> bool:
        """Return whether something that was written cannot be read."""
        return self.lost_bytes > 0 or self.lost_messages > 0 or self.error is not None

    def scan(self) -> None:
        """Read the file through and set the attributes that describe its state."""
        statistics = ChannelStatistics()
        try:
            self.size = self.path.stat().st_size
            self._when_scanned = self._plain_path.stat()
            for topic, definition, _, log_time_ns, _, _ in self.stored():
                statistics.add(topic, definition, log_time_ns)
            for channel in self.channels:
                statistics.counts.setdefault(channel, 0)
            self.statistics = statistics
            stated = self.stated_messages()
        except FileNotFoundError:
            self.error = BagError(f"{self.path} is missing", "put it back, or go on without it")
        except OSError as error:
            self.error = BagError(f"{self.path}: {error.strerror or error}", "give a file that can be read")
        except BagError as error:
            self.error = error
            self.lost_bytes = self.size
        else:
            self._expected_messages = self._expected_messages if stated is None else stated
        self.lost_messages = max(0, self._expected_messages - self.statistics.message_count)

    def ordered(self, topics: Collection[str] | None = None) -> Iterator[Recorded]:
        """Yield messages of a scanned file in log order (those of one time in file order), of all or the named topics.

        Raises:
            BagError: too far out of order to be sorted in memory.
        """
        held: list[tuple[int, int, Recorded]] = []
        held_bytes = newest_ns = 0
        for ordinal, recorded in enumerate(self.stored()):
            # The scan found how late a message can come: one older than that by now is not overtaken any more.
            newest_ns = max(newest_ns, recorded.log_time_ns)
            if topics is None or recorded.topic in topics:
                heapq.heappush(held, (recorded.log_time_ns, ordinal, recorded))
                held_bytes += len(recorded.data)
            if held_bytes > MAX_REORDERED_BYTES:
                raise BagError(f"{self.path}: messages too far out of log order", "sort it by log time first")
            while held and held[0][0] <= newest_ns - self.statistics.lateness_ns:
                _, _, oldest = heapq.heappop(held)
                held_bytes -= len(oldest.data)
                yield oldest
        while held:
            yield heapq.heappop(held)[2]

    @property
    def _packed(self) -> tuple[str, ...]:
        """Return that the file was compressed as a whole, as a clause of `rewritten`; nothing if it was not."""
        return ("compressed as a whole, is now compressed in chunks",) * (self.path.suffix == PACKED)

    @property
    def _plain_path(self) -> Path:
        """Return the file itself, or what is packed in it: unpacked once, as far as it goes, until this object ends."""
        if self.path.suffix != PACKED:
            return self.path
        if self._unpacked is None:
            handle, name = tempfile.mkstemp(suffix=self.path.with_suffix("").suffix)
            weakref.finalize(self, Path(name).unlink, missing_ok=True)
            with open(handle, "wb") as unpacked:
                _unpack(self.path, unpacked)
            self._unpacked = Path(name)
        return self._unpacked


def _unpack(path: Path, target: BinaryIO) -> None:
    """Write what a packed file holds; of a damaged one, what comes before the damage."""
    with path.open("rb") as packed, suppress(zstandard.ZstdError):
        if packed.read(len(zstandard.FRAME_HEADER)) != zstandard.FRAME_HEADER:
            raise BagError(f"{path} is not compressed by zstd", CONVERT)
        packed.seek(0)
        shutil.copyfileobj(zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True), target)
