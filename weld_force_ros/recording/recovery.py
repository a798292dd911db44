"""Recover a cut or damaged recording into a whole one."""

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from weld_force_ros._files import whole_folder
from weld_force_ros.errors import BagError
from weld_force_ros.recording.bag_errors import as_bag_error
from weld_force_ros.recording.mcap_writer import write_mcap, write_metadata
from weld_force_ros.recording.reader import Bag, open_bag


@dataclass(frozen=True)
class RecoveryReport:
    """The outcome of a recovery.

    Attributes:
        target: the new bag.
        message_count: messages in it.
        lost_bytes: how much of the source is unreadable.
        lost_messages: how many messages of the source are known to be lost; a file that was cut does not show how many.
        damage: what is wrong with the source, in a clause; None if nothing is.
        lossy: whether something that was written to the source is not in the target.
        already: whether the target was there and held just that.
    """

    target: str
    message_count: int
    lost_bytes: int
    lost_messages: int
    damage: str | None
    lossy: bool
    already: bool


def recover(source: Path, target: Path | None = None) -> RecoveryReport:
    """Write all that is readable of a recording to a new bag, and read that again before it gets its name.

    A second time it finds what it did and changes nothing. A file of several that cannot be read does not keep the
    others from being recovered.

    Args:
        source: a bag folder or an .mcap file.
        target: folder of the new bag; by default beside the source, its name with `-recovered`.

    Raises:
        BagError: nothing is readable, the target holds something else or cannot be written, or does not read back the
            same.
    """
    bag = open_bag(source)
    target = target or _default_target(source.resolve())
    already = target.exists()
    if already:
        _check_holds(target, bag)
    else:
        with as_bag_error(target), whole_folder(target) as folder:
            name = f"{target.resolve().name}_0.mcap"
            write_mcap(folder / name, bag.messages(), bag.statistics)
            write_metadata(folder, {name: bag.statistics})
            if not _same(open_bag(folder), bag):
                raise BagError(f"{target}: did not read back as written", "check the disk and try again")
    return RecoveryReport(
        target=str(target),
        message_count=bag.statistics.message_count,
        lost_bytes=bag.lost_bytes,
        lost_messages=bag.lost_messages,
        damage=bag.damage,
        lossy=bag.lossy,
        already=already,
    )


def _default_target(source: Path) -> Path:
    return source.with_name(f"{source.name if source.is_dir() else source.stem}-recovered")


def _check_holds(target: Path, bag: Bag) -> None:
    """Raise a BagError unless the target is a whole recording of the same messages."""
    try:
        same = _same(open_bag(target), bag)
    except BagError:
        same = False
    if not same:
        raise BagError(
            f"{target} exists, holds something else and is not overwritten", "choose another name or remove it"
        )


def _same(made: Bag, bag: Bag) -> bool:
    return made.damage is None and all(a == b for a, b in zip_longest(made.messages(), bag.messages()))
