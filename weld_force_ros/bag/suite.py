"""The suite's own messages in a recording: read after the contract, and exported as plain JSON."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from weld_force_ros import contract
from weld_force_ros.bag.form import STRING, MessageDefinition
from weld_force_ros.bag.reading import Bag, Recorded, open_bag
from weld_force_ros.bag.writing import McapWriter, disk, new_file, refuse_existing
from weld_force_ros.errors import BagError, MessageError


class ContractMessage(NamedTuple):
    """A message of the suite, or what is wrong with it."""

    topic: str
    message: contract.Message | BagError
    log_time_ns: int


def contract_messages(bag: Bag) -> Iterator[ContractMessage]:
    """The suite's messages in log order, whatever namespace they were recorded in.

    One that breaks the contract comes as a BagError in its place, so that the others are not lost.
    """
    for recorded, message in _suite_messages(bag):
        yield ContractMessage(recorded.topic, message, recorded.log_time_ns)


def _suite_messages(bag: Bag) -> Iterator[tuple[Recorded, contract.Message | BagError]]:
    kinds = {topic.name: topic.type for topic in contract.TOPICS.values()}
    for recorded in bag.messages():
        kind = kinds.get(recorded.topic.rpartition("/")[2])
        if kind is not None and recorded.definition.name == STRING.name:
            yield recorded, _contract_message(recorded, kind)


def _contract_message(recorded: Recorded, kind: type[contract.Message]) -> contract.Message | BagError:
    try:
        return contract.decode(kind, recorded.content.data)
    except MessageError as error:
        return recorded.problem(error.reason, error.remedy)
    except BagError as error:
        return error


@dataclass(frozen=True)
class ExportReport:
    """What was exported, and the messages that were not because they break the contract."""

    message_count: int
    refused: tuple[BagError, ...]


def export_json(source: Path, target: Path) -> ExportReport:
    """Write the suite's messages as JSON with their schemas to an MCAP of their own, for Foxglove and Lichtblick.

    Args:
        source: a bag folder or an .mcap file.
        target: the new .mcap file; must not exist.

    Raises:
        BagError: the source is unreadable or holds no message of the suite, or the target exists or cannot be written.
    """
    bag = open_bag(source)
    refuse_existing(target)
    refused: list[BagError] = []
    with disk(target), new_file(target) as stream:
        writer = McapWriter(stream, chunked=True, profile="")
        for recorded, message in _suite_messages(bag):
            if isinstance(message, BagError):
                refused.append(message)
                continue
            # Encoded anew: fields that the schema does not know may hold what Lichtblick throws on.
            data = contract.encode(message)
            writer.add(recorded.topic, _json_definition(type(message)), data, *recorded[3:])
        writer.finish()
        if not writer.tally.message_count:
            raise BagError(f"{source} holds no usable message of this suite", "record with `weld-force up` or `demo`")
    return ExportReport(writer.tally.message_count, tuple(refused))


@lru_cache
def _json_definition(kind: type[contract.Message]) -> MessageDefinition:
    schema = msgspec.json.encode(contract.json_schema(kind)).decode()
    name = f"weld_force_ros/{kind.__name__}"
    return MessageDefinition(name, schema, schema_encoding="jsonschema", message_encoding="json")
