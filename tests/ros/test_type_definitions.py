"""Type descriptions against a second reader of ROS types."""

import json
import sys
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import String

from weld_force_ros.ros import qos
from weld_force_ros.ros.type_definitions import message_definition

TYPES = [String, WrenchStamped, DiagnosticArray]


@pytest.mark.parametrize("message_type", TYPES)
def test_definition_is_complete_and_its_hash_that_of_rosbags(message_type: type) -> None:
    definition = message_definition(message_type, qos.CONTRACT)
    store = get_typestore(Stores.EMPTY)
    parts = definition.text.split("=" * 80 + "\nMSG: ")
    types = get_types_from_msg(parts[0], definition.name)
    for part in parts[1:]:
        name, _, text = part.partition("\n")
        types |= get_types_from_msg(text, f"{name.replace('/', '/msg/')}")
    store.register(types)
    assert store.hash_rihs01(definition.name) == definition.type_hash


@pytest.mark.parametrize("message_type", TYPES)
def test_definition_starts_with_the_installed_text(message_type: type) -> None:
    definition = message_definition(message_type, qos.CONTRACT)
    package, _, name = definition.name.split("/")
    share = Path(sys.prefix) / "share" / package / "msg"
    assert definition.text.startswith((share / f"{name}.msg").read_text())
    hashes = json.loads((share / f"{name}.json").read_text())["type_hashes"]
    assert {"type_name": definition.name, "hash_string": definition.type_hash} in hashes


@pytest.mark.parametrize(
    ("profile", "history", "depth", "durability"),
    [(qos.CONTRACT, "keep_all", 0, "transient_local"), (qos.DIAGNOSTICS, "keep_last", 10, "volatile")],
)
def test_offered_qos_is_that_of_the_topic(profile: object, history: str, depth: int, durability: str) -> None:
    (offered,) = yaml.safe_load(message_definition(String, profile).offered_qos_profiles)
    assert (offered["history"], offered["depth"], offered["durability"]) == (history, depth, durability)
    assert offered["reliability"] == "reliable"
