"""Contract messages as plain JSON with their schemas, in an MCAP file of their own for Foxglove and Lichtblick."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import msgspec

from weld_force_ros._files import whole_file
from weld_force_ros.errors import BagError
from weld_force_ros.messages import Message, encode, json_schema
from weld_force_ros.recording.bag_errors import as_bag_error, refuse_existing
from weld_force_ros.recording.contract_messages import recorded_messages
from weld_force_ros.recording.foxglove_layout import foxglove_layout
from weld_force_ros.recording.mcap_writer import McapWriter
from weld_force_ros.recording.reader import open_bag
from weld_force_ros.recording.rosbag2_format import FileForm, MessageDefinition


@dataclass(frozen=True)
class ExportReport:
    """The numbers of messages that were exported, and that were not because they break the contract.

    Attributes:
        layouts: written beside, one for each namespace in it.
    """

    message_count: int
    invalid_count: int
    layouts: tuple[Path, ...] = ()


def export_json(source: Path, target: Path, *, on_invalid: Callable[[BagError], None] | None = None) -> ExportReport:
    """Write the contract messages as JSON with their schemas to an MCAP file, and layouts to see them beside it.

    Args:
        source: a bag folder or one of its files.
        target: the new .mcap file; must not exist.
        on_invalid: called with the error of each message that breaks the contract.

    Raises:
        BagError: the source is unreadable or holds no contract message, or the target exists or cannot be written.
    """
    bag = open_bag(source)
    refuse_existing(target)
    invalid_count = 0
    with as_bag_error(target), whole_file(target, fsync=True) as stream:
        writer = McapWriter(stream, chunked=True, form=FileForm(profile=""))
        for recorded, message in recorded_messages(bag):
            if isinstance(message, BagError):
                invalid_count += 1
                if on_invalid:
                    on_invalid(message)
                continue
            # Encoded anew: fields that the schema does not know may hold what Lichtblick throws on.
            data = encode(message)
            writer.add(recorded.topic, _json_definition(type(message)), data, *recorded[3:])
        writer.finish()
        check_found(source, writer.statistics.message_count)
    namespaces = sorted({topic.rpartition("/")[0] for topic, _ in writer.statistics.counts})
    return ExportReport(writer.statistics.message_count, invalid_count, tuple(_write_layouts(target, namespaces)))


def _write_layouts(target: Path, namespaces: list[str]) -> Iterator[Path]:
    """Write one layout beside an export, or one for each namespace if it has several."""
    for namespace in namespaces:
        name = namespace.replace("/", ".") if len(namespaces) > 1 else ""
        path = target.with_suffix(f"{name}.layout.json")
        with as_bag_error(path), whole_file(path, fsync=True) as stream:
            stream.write(foxglove_layout(namespace))
        yield path


def check_found(source: Path, message_count: int) -> None:
    """Raise a BagError if there was nothing to export."""
    if not message_count:
        raise BagError(f"{source} holds no usable message of this suite", "record with `weld-force up` or `demo`")


@lru_cache
def _json_definition(kind: type[Message]) -> MessageDefinition:
    schema = msgspec.json.encode(json_schema(kind)).decode()
    name = f"weld_force_ros/{kind.__name__}"
    return MessageDefinition(name, schema, schema_encoding="jsonschema", message_encoding="json")
