"""Read a recording with the readers of others, and compare what they find with what was meant to be in it."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader

from weld_force_ros.errors import BagError
from weld_force_ros.recording.recorded import Recorded
from weld_force_ros.recording.rosbag2_format import FileForm


@dataclass(frozen=True)
class _Found:
    """Number of messages, and a sum over their topics, times and bytes that does not depend on the order."""

    count: int
    checksum: int


def check_by_others(folder: Path, messages: Iterable[Recorded], form: FileForm) -> str | None:
    """Read a bag by its index with the reader of MCAP and, if installed, with `rosbags`, and compare.

    Args:
        folder: the bag, of one .mcap file.
        messages: what was written to it.
        form: of the bag; `rosbags` reads that of rosbag2.

    Returns:
        What `rosbags` cannot read of it, as a clause; None if nothing, or if it is not asked.

    Raises:
        BagError: MCAP's own reader does not find the same.
    """
    expected = _found((m.topic, m.log_time_ns, m.data) for m in messages)
    (file,) = folder.glob("*.mcap")
    try:
        with file.open("rb") as stream:
            by_mcap = _found(
                (channel.topic, message.log_time, message.data)
                for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
            )
    except McapError as error:
        raise BagError(f"{folder}: MCAP's own reader fails: {error!r}", "check the disk and try again") from error
    if by_mcap != expected:
        raise BagError(f"{folder}: MCAP's own reader finds something else", "check the disk and try again")
    return _lacking_for_rosbags(folder, expected) if form.profile == "ros2" else None


def _lacking_for_rosbags(folder: Path, expected: _Found) -> str | None:
    try:
        from rosbags.rosbag2 import Reader
    except ImportError:
        return None
    try:
        with Reader(folder) as reader:
            found = _found((connection.topic, time_ns, data) for connection, time_ns, data in reader.messages())
    except Exception as error:  # rosbags has no common class for what it cannot read
        return f"rosbags cannot read it: {' '.join(str(error).split())}"
    return None if found == expected else f"rosbags reads {found.count} of {expected.count} messages of it as they are"


def _found(messages: Iterable[tuple[str, int, bytes]]) -> _Found:
    count = checksum = 0
    for topic, time_ns, data in messages:
        digest = hashlib.blake2b(b"%d %d " % (time_ns, len(data)) + data, digest_size=8, person=_person(topic))
        checksum = (checksum + int.from_bytes(digest.digest())) % 2**64
        count += 1
    return _Found(count, checksum)


def _person(topic: str) -> bytes:
    return hashlib.blake2b(topic.encode(errors="surrogateescape"), digest_size=16).digest()
