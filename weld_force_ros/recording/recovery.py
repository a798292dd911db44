"""Recover a cut or damaged recording into a whole one."""

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from weld_force_ros._files import whole_folder
from weld_force_ros.errors import BagError
from weld_force_ros.recording.bag_errors import as_bag_error
from weld_force_ros.recording.identity import with_identity
from weld_force_ros.recording.mcap_writer import write_mcap, write_metadata
from weld_force_ros.recording.reader import Bag, open_bag
from weld_force_ros.recording.second_reader import check_by_others


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
        rewritten: what of the source's form is another in the target, a clause each.
        unread_by_others: what another reader cannot read of the target, in a clause; None if nothing.
    """

    target: str
    message_count: int
    lost_bytes: int
    lost_messages: int
    damage: str | None
    lossy: bool
    already: bool
    rewritten: tuple[str, ...]
    unread_by_others: str | None


def recover(source: Path, target: Path | None = None) -> RecoveryReport:
    """Write all that is readable of a recording to a new bag, and read that again before it gets its name.

    Attachments, metadata records, channels without messages, sequence numbers, the distribution and the identity of
    the recording are kept. It is read again here and by the readers of others (see `second_reader`). A second time it
    finds what it did and changes nothing. A file of several that cannot be read does not keep the others from being
    recovered.

    Args:
        source: a bag folder or one of its files.
        target: folder of the new bag; by default beside the source, its name with `-recovered`.

    Raises:
        BagError: nothing is readable, the target holds something else or cannot be written, or does not read back the
            same.
    """
    bag = open_bag(source)
    target = target or _default_target(source.resolve())
    already = target.exists()
    form = with_identity(bag.form)
    if already:
        _check_holds(target, bag)
        unread = check_by_others(target, bag.messages(), form)
    else:
        with as_bag_error(target), whole_folder(target) as folder:
            name = f"{target.resolve().name}_0.mcap"
            write_mcap(folder / name, bag.messages(), bag.statistics, form, bag.extras())
            write_metadata(folder, {name: bag.statistics}, form)
            if not _same(open_bag(folder), bag):
                raise BagError(f"{target}: did not read back as written", "check the disk and try again")
            unread = check_by_others(folder, bag.messages(), form)
    return RecoveryReport(
        target=str(target),
        message_count=bag.statistics.message_count,
        lost_bytes=bag.lost_bytes,
        lost_messages=bag.lost_messages,
        damage=bag.damage,
        lossy=bag.lossy,
        already=already,
        rewritten=bag.rewritten,
        unread_by_others=unread,
    )


def _default_target(source: Path) -> Path:
    return source.with_name(f"{source.name if source.is_dir() else source.name.partition('.')[0]}-recovered")


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
    if made.damage or made.statistics.counts != bag.statistics.counts:
        return False
    same_extras = all(a == b for a, b in zip_longest(made.extras(), bag.extras()))
    return same_extras and all(a == b for a, b in zip_longest(made.messages(), bag.messages()))
