"""Parameter files: what is read, what is refused, and that schema, reader and shipped file agree."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from msgspec import UNSET

from weld_force_ros.errors import InputError
from weld_force_ros.ros.parameters import (
    PARAMETERS,
    check_values,
    default_parameter_file,
    default_parameter_text,
    parameter_file_schema,
    read_parameter_file,
    settings_from_parameters,
    values_of_node,
)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "config.yaml"
    path.write_text(text)
    return path


def parameters(**given: Any) -> dict[str, Any]:
    return {"/**/simulator_node": {"ros__parameters": given}}


def test_shipped_file_is_the_table_at_its_defaults() -> None:
    assert default_parameter_file().read_text() == default_parameter_text()
    config = read_parameter_file(default_parameter_file())
    for node, rows in PARAMETERS.items():
        assert values_of_node(config, node, "") == {row.name: row.default for row in rows}


def test_shipped_schema_is_the_table_s() -> None:
    schema = json.loads(default_parameter_file().with_name("schema.json").read_text())
    assert schema == parameter_file_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(yaml.safe_load(default_parameter_file().read_text()), schema)


@pytest.mark.parametrize(
    ("config", "complaint"),
    [
        ({"/**/simulator": {"ros__parameters": {}}}, "names none of"),
        ({"/**/simulator_node": {"parameters": {}}}, "ros__parameters"),
        (parameters(trak="bilbao"), "no node has a parameter 'trak'; write 'track'"),
        (parameters(static_load=110_000), "write 'static_load_n'"),
        ({"/**": {"ros__parameters": {"limit": "force"}}}, "write 'limits'"),
        ({"/**": {"ros__parameters": {"wheel_mass_kg": "heavy"}}}, "wheel_mass_kg"),
        (parameters(track=5), "str"),
        (parameters(wheel_mass_kg=-1.0), "wheel_mass_kg"),
        (parameters(wheel_mass_kg="heavy"), "wheel_mass_kg"),
        (parameters(speeds=True), "speeds"),
        ({"/**/profile_node": {"ros__parameters": {"settle_s": 1e9}}}, "settle_s"),
        ({"/**/trolley_node": {"ros__parameters": {"seed": 1.5}}}, "seed"),
    ],
)
def test_file_that_no_node_could_start_with_is_refused_by_reader_and_schema(
    tmp_path: Path, config: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_parameter_file(written(tmp_path, yaml.safe_dump(config)))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(config, parameter_file_schema())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "- 1",
        "a: &x 1\nb: *x",
        "!!python/object/apply:os.system ['true']",
        "{" * 2000,
        "\x00",
        "/**/simulator_node: 3",
    ],
)
def test_what_is_no_parameter_file_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r"default\.yaml") as caught:
        read_parameter_file(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        read_parameter_file(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("pattern", "namespace", "meant"),
    [
        ("/**/simulator_node", "", True),
        ("/**/simulator_node", "/left", True),
        ("/**/simulator_node", "depot/left", True),
        ("/*/simulator_node", "/left", True),
        ("/*/simulator_node", "", False),
        ("/left/simulator_node", "/left/", True),
        ("/left/simulator_node", "/right", False),
        ("simulator_node", "", True),
        ("/**/profile_node", "/left", False),
    ],
)
def test_pattern_names_nodes_as_ros_reads_it(pattern: str, namespace: str, meant: bool) -> None:
    config = {pattern: {"track": "johansson-nielsen"}}
    assert values_of_node(config, "simulator_node", namespace) == ({"track": "johansson-nielsen"} if meant else {})


def test_later_lines_go_before_earlier_ones() -> None:
    config = {"/**/simulator_node": {"track": "bilbao", "speeds": "40"}, "/left/simulator_node": {"speeds": "80"}}
    assert values_of_node(config, "simulator_node", "left") == {"track": "bilbao", "speeds": "80"}


@pytest.mark.parametrize(
    ("value", "speeds"), [("40,80", [40, 80]), ([40, 80], [40, 80]), (60, [60]), ("20:40:10", [20, 30, 40])]
)
def test_lists_may_have_any_form_that_yaml_makes_of_them(value: Any, speeds: list[float]) -> None:
    check_values("simulator_node", {"speeds": value})
    (settings,) = settings_from_parameters({"speeds": value})
    assert settings.speeds_kmh == speeds


def test_vehicles_stand_in_one_text_with_commas_between_them() -> None:
    names = {"": [UNSET], "metro": ["metro"], "passenger, freight-22.5t": ["passenger", "freight-22.5t"]}
    for text, vehicles in names.items():
        settings = settings_from_parameters({"vehicle": text})
        assert [one.vehicle for one in settings] == vehicles
        assert len({one.config_sha256 for one in settings}) == len(vehicles)


@pytest.mark.parametrize("text", ["metro,metro", "metro,wheelbarrow", ",".join(map(str, range(21)))])
def test_vehicles_that_cannot_be_simulated_together_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        check_values("simulator_node", {"vehicle": text})


def test_settings_that_cannot_be_simulated_are_refused_before_a_node_starts() -> None:
    with pytest.raises(InputError, match="fast"):
        check_values("simulator_node", {"speeds": "fast"})


@pytest.mark.parametrize(
    ("text", "node", "namespace", "values"),
    [
        ("/**: {ros__parameters: {track: zhai, folder: f}}", "simulator_node", "", {"track": "zhai"}),
        ("/**: {ros__parameters: {track: zhai, folder: f}}", "profile_node", "left", {"folder": "f"}),
        ("/left/**: {ros__parameters: {track: zhai}}", "simulator_node", "left", {"track": "zhai"}),
        ("/left/**: {ros__parameters: {track: zhai}}", "simulator_node", "right", {}),
        ("/*: {ros__parameters: {track: zhai}}", "simulator_node", "", {"track": "zhai"}),
        ("/left: {simulator_node: {ros__parameters: {track: zhai}}}", "simulator_node", "left", {"track": "zhai"}),
        (
            "/**: {ros__parameters: {track: a}}\n/**/simulator_node: {ros__parameters: {track: b}}",
            "simulator_node", "", {"track": "b"},
        ),
    ],
)  # fmt: skip
def test_wildcards_and_namespaces_are_read_as_ros_reads_them(
    tmp_path: Path, text: str, node: str, namespace: str, values: dict[str, Any]
) -> None:
    """What rclpy itself makes of such a file: `test_own_clients.py`."""
    config = read_parameter_file(written(tmp_path, text))
    assert values_of_node(config, node, namespace) == values


def test_whole_numbers_are_taken_where_a_parameter_is_a_float() -> None:
    values = check_values("simulator_node", {"wheel_mass_kg": 600, "speeds": [20, 40], "uncertainty_samples": 0})
    assert values == {"wheel_mass_kg": 600.0, "speeds": [20, 40], "uncertainty_samples": 0}
    assert [type(value) for value in values.values()] == [float, list, int]
