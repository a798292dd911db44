"""The layout for Foxglove and Lichtblick: panels that they have, paths that our messages have."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.harness.bags import profile, record, rejection
from weld_force_ros import recording
from weld_force_ros.assessment.criteria import CRITERIA
from weld_force_ros.cli.main import main
from weld_force_ros.messages import TOPICS, json_schema
from weld_force_ros.recording.foxglove_layout import foxglove_layout

TITLES = {"lichtblickPanelTitle", "foxglovePanelTitle"}

# Lichtblick at 66adecb: packages/suite-base/src/panels/index.ts, and the type of each panel's configuration.
PANELS = {
    "Plot": {
        "paths", "showXAxisLabels", "showYAxisLabels", "showLegend", "legendDisplay", "showPlotValuesInLegend",
        "isSynced", "xAxisVal", "xAxisPath", "xAxisLabel", "yAxisLabel", "sidebarDimension",
    },
    "RawMessages": {"topicPath", "diffEnabled", "diffMethod", "diffTopicPath", "showFullMessageForDiff"},
    "Table": {"topicPath"},
    "StateTransitions": {"isSynced", "paths", "showPoints"},
    "Indicator": {"path", "style", "fallbackColor", "fallbackLabel", "rules"},
}  # fmt: skip
SERIES = {"value", "enabled", "timestampMethod", "label", "showLine"}

# packages/message-path/src/grammar.ne, as far as it is used here: /topic.name[:]{name=="text"}.name
PATH = re.compile(r'(?P<topic>/[a-z_/]+)(?P<fields>(\.[a-z0-9_]+(\[:\])?(\{[a-z_]+=="[^"]*"\})?)*)')
FIELD = re.compile(r'\.(?P<name>[a-z0-9_]+)(?P<slice>\[:\])?(\{(?P<key>[a-z_]+)=="(?P<value>[^"]*)"\})?')


def content() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(foxglove_layout())
    return found


def paths_in(config: Any) -> Iterator[str]:
    match config:
        case dict():
            for value in config.values():
                yield from paths_in(value)
        case list():
            for value in config:
                yield from paths_in(value)
        case str() if config.startswith("/"):
            yield config


def schema_of(path: str) -> dict[str, Any]:
    """The schema of what a message path leads to; fails where it leads nowhere."""
    whole = PATH.fullmatch(path)
    assert whole, path
    kinds = {f"/{topic.name}": kind for kind, topic in TOPICS.items()}
    found = json_schema(kinds[whole["topic"]])
    for field in FIELD.finditer(whole["fields"]):
        found = found["properties"][field["name"]]
        if field["slice"]:
            assert found["type"] == "array", path
            found = found["items"]
        if field["key"]:
            assert found["properties"][field["key"]]["type"] == "string"
            assert field["value"] in CRITERIA
    return found


def test_every_panel_exists_and_is_in_the_mosaic_once():
    panels = content()["configById"]
    for name, config in panels.items():
        kind = name.partition("!")[0]
        assert set(config) - TITLES <= PANELS[kind], name
        for series in config.get("paths", []):
            assert set(series) <= SERIES
            assert series["timestampMethod"] in ("receiveTime", "headerStamp")

    def leaves(node: Any) -> list[str]:
        if isinstance(node, str):
            return [node]
        assert node["direction"] in ("row", "column")
        assert 0 < node.get("splitPercentage", 50) < 100
        return leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(content()["layout"])) == sorted(panels)


def test_what_lichtblick_checks_on_import_is_there():
    """`validateLayoutData`: objects `configById` and `globalVariables`, and a speed of playback."""
    found = content()
    assert isinstance(found["globalVariables"], dict)
    assert isinstance(found["playbackConfig"]["speed"], int)


def test_every_path_leads_to_a_field_of_a_message():
    for path in paths_in(content()["configById"]):
        schema_of(path)


def test_plots_are_of_numbers_and_as_many_x_as_y():
    for name, config in content()["configById"].items():
        if not name.startswith("Plot"):
            continue
        paths = [series["value"] for series in config["paths"]]
        assert {schema_of(path)["type"] for path in paths} <= {"number", "integer"}
        if config["xAxisVal"] in ("currentCustom", "custom"):  # of the newest message, of all
            x = config["xAxisPath"]["value"]
            assert schema_of(x)["type"] == "number"
            assert {path.count("[:]") for path in (x, *paths)} == {1}
            assert {PATH.fullmatch(path)["topic"] for path in (x, *paths)} == {PATH.fullmatch(x)["topic"]}
        else:
            assert config["xAxisVal"] == "timestamp"


def test_rules_know_every_decision():
    rules = {rule["rawValue"] for rule in content()["configById"]["Indicator!decision"]["rules"]}
    assert rules == {"accept", "grind", "reject", "undecided"}


@pytest.mark.parametrize(
    ("topics", "files"),
    [
        (["/weld_profile"], {"out.layout.json": ""}),
        (["/left/weld_profile"], {"out.layout.json": "/left"}),
        (["/left/weld_profile", "/a/b/weld_profile"], {"out.left.layout.json": "/left", "out.a.b.layout.json": "/a/b"}),
    ],
)
def test_export_has_a_layout_for_each_namespace_beside_it(capfd, tmp_path, topics, files):
    bag = record(tmp_path / "bag", [(topic, profile(), i) for i, topic in enumerate(topics)])
    assert main(["bag", "export", str(bag), str(tmp_path / "out.mcap")]) == 0
    said = capfd.readouterr().out
    found = {path.name: json.loads(path.read_text()) for path in tmp_path.glob("*.json")}
    assert found.keys() == files.keys()
    for name, namespace in files.items():
        assert name in said
        assert found[name]["configById"]["RawMessages!rejection"]["topicPath"] == f"{namespace}/rejection"
        assert {path.removeprefix(namespace) for path in paths_in(found[name])} == set(paths_in(content()))


def test_tables_have_no_layout(tmp_path):
    bag = record(tmp_path / "bag", [("/rejection", rejection("too short"), 0)])
    assert recording.export_tables(bag, tmp_path / "tables").layouts == ()
    assert not list(Path(tmp_path / "tables").glob("*.json"))
