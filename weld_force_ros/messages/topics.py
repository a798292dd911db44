"""List the topics of the suite and the JSON Schema of what they carry."""

from inspect import cleandoc
from typing import Any

import msgspec

from weld_force_ros.messages.assessment import AssessmentSettings, GrindingAdvice, Verdict
from weld_force_ros.messages.fields import Message
from weld_force_ros.messages.live import Inquiry, RailSurface, Rejection, Settled, WeldMarker
from weld_force_ros.messages.profile import WeldProfile
from weld_force_ros.messages.simulation import ForceHistory, ForceMap, SimulationSettings


class Topic(msgspec.Struct, frozen=True):
    """A row of the topic table; `name` is relative to the suite's namespace."""

    name: str
    type: type[Message]
    latched: bool
    description: str


TOPICS: dict[type[Message], Topic] = {
    topic.type: topic
    for topic in (
        Topic("weld_profile", WeldProfile, True, "measured weld geometries"),
        Topic("force_map", ForceMap, True, "peak force over speed and position"),
        Topic("force_history", ForceHistory, True, "the passage that decided the verdict"),
        Topic("verdict", Verdict, True, "decisions"),
        Topic("rejection", Rejection, True, "inputs that could not be used"),
        Topic("rail_surface", RailSurface, False, "running surface under the trolley, as it comes"),
        Topic("weld_marker", WeldMarker, False, "places where somebody saw a weld"),
        Topic("inquiry", Inquiry, False, "which measurements have an outcome?"),
        Topic("settled", Settled, True, "measurements that have their outcome"),
        Topic("simulation_settings", SimulationSettings, True, "track, engine, grid and wheel in force"),
        Topic("assessment_settings", AssessmentSettings, True, "limits in force"),
    )
}
SCHEMAS: tuple[type[Message], ...] = (*TOPICS, GrindingAdvice)
"""All that has a schema: what is published, and what is only written to files."""


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a message, with every reference written out: Lichtblick resolves none."""
    (schema,), components = msgspec.json.schema_components([kind], ref_template="{name}")
    inlined: dict[str, Any] = _inline(schema, components)
    required = sorted({*inlined.get("required", []), *Message.__struct_fields__}, key=list(inlined["properties"]).index)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"weld_force_ros/{kind.__name__}.json",
        **inlined,
        "required": required,
    }


def _inline(schema: Any, components: dict[str, Any]) -> Any:
    if isinstance(schema, list):
        return [_inline(item, components) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        referred = components[schema["$ref"]]
        return _inline({**referred, **{k: v for k, v in schema.items() if k != "$ref"}}, components)
    # Python 3.13 takes the indentation out of docstrings, which descriptions are; before it, this does.
    return {
        k: cleandoc(v) if k == "description" and isinstance(v, str) else _inline(v, components)
        for k, v in schema.items()
    }
