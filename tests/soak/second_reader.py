"""Whole recordings read by others' readers: what they count is what an operator's tools will find."""

import json
from collections import Counter
from functools import lru_cache
from pathlib import Path

import jsonschema
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader


def check_export(mcap_path: Path) -> int:
    """Messages of an exported MCAP, each of which keeps the schema that its channel carries."""
    count = 0
    with mcap_path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema"), channel.topic
            _validator(schema.data).validate(json.loads(message.data))
            count += 1
    return count


@lru_cache
def _validator(schema: bytes) -> jsonschema.Draft202012Validator:
    jsonschema.Draft202012Validator.check_schema(json.loads(schema))
    return jsonschema.Draft202012Validator(json.loads(schema))


def check_bag(bag_dir: Path) -> Counter[str]:
    """Messages by topic of a bag folder that rosbags reads, each decoded; as many as `metadata.yaml` says."""
    topics: Counter[str] = Counter()
    with AnyReader([bag_dir]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            topics[connection.topic] += 1
        assert topics.total() == reader.message_count
        assert topics == Counter({topic: info.msgcount for topic, info in reader.topics.items() if info.msgcount})
    return topics
