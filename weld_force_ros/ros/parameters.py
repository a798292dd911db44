"""Define the parameters of the nodes, and read and check ROS parameter files that hold them (`data/config`)."""

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import msgspec

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError
from weld_force_ros.messages import SimulationSettings, legible
from weld_force_ros.simulation.settings import (
    DEFAULT_TRACK,
    DEFAULT_UNCERTAINTY_SAMPLES,
    load_uncertainty,
    parse_positions,
    parse_speeds,
    parse_vehicles,
    simulation_settings,
)

Value = str | float | int | bool


@dataclass(frozen=True)
class NodeParameter:
    """One parameter of a node.

    Attributes:
        name: its name in ROS.
        default: its value unless one is given; has the parameter's type.
        description: its meaning and unit.
        minimum: least number.
        maximum: largest number.
        live: whether it may change while the node is configured; otherwise only before.
        is_list: whether it is a list in text form, which ROS may read as text, number or list: `20:300:5`, `[40, 80]`.
    """

    name: str
    default: Value
    description: str
    minimum: float | None = None
    maximum: float | None = None
    live: bool = False
    is_list: bool = False


_UNIT = "of files that do not state it: m, cm, mm or um; empty: not stated"
_OWN = "0: the track's own"
_AUTOSTART = NodeParameter("autostart", True, "configure and activate at once, without a lifecycle manager")

_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_QOS_OVERRIDES = "qos_overrides."

PARAMETERS: dict[str, tuple[NodeParameter, ...]] = {
    "profile_node": (
        _AUTOSTART,
        NodeParameter("folder", "", "folder of measurement files, watched; captures are written to it"),
        NodeParameter("settle_s", 0.2, "s that a file whose content is complete must stay unchanged", 0.0, 600.0),
        NodeParameter("unfinished_s", 6.0, "s that any other file must stay unchanged before it is read", 0.0, 3600.0),
        NodeParameter("format", "", "a bundled format of measurement files, or a descriptor (YAML); empty: recognised"),
        NodeParameter("noise", "auto", "measurement noise: auto (estimated and taken out), none, or m"),
        NodeParameter("x_unit", "", f"unit of the positions {_UNIT}"),
        NodeParameter("z_unit", "", f"unit of the heights {_UNIT}"),
        NodeParameter("z_positive", "", "up or down: what a positive height means in files that do not state it"),
        NodeParameter("spacing", 0.0, "distance of samples in x_unit, for files of heights only", 0.0, 1e6),
        NodeParameter("line_speed_kmh", 0.0, "line speed of files that do not state it; 0: unknown", 0.0, 600.0),
        NodeParameter("skip_rows", 0, "lines to skip at the top of each file", 0, 100_000),
        NodeParameter("rail", "", "name of the rail that a live trolley measures, such as left"),
        NodeParameter(
            "running",
            "",
            "how trains run where a live stream does not say it: with (rising chainage), against, both; empty: unknown",
        ),
        NodeParameter("detect_welds", False, "look for welds in the live rail surface, beside those that are marked"),
        NodeParameter(
            "marker_offset_m",
            0.0,
            "m that a mark without chainage lies beyond the newest sample, towards higher chainages",
            -50.0,
            50.0,
        ),
        NodeParameter("mark_timeout_s", 600.0, "s after which a mark without its rail is given up", 1.0, 86_400.0),
    ),
    "simulator_node": (
        _AUTOSTART,
        NodeParameter("track", DEFAULT_TRACK, "a bundled track, or the path of a track file (YAML)"),
        NodeParameter(
            "vehicle",
            "",
            "bundled vehicles or vehicle files (YAML), with commas between them; empty: the track's wheel",
        ),
        NodeParameter("engine", "common-poles", "common-poles, rfp or reference"),
        NodeParameter("speeds", "20:300:5", "speeds in km/h: first:last:step, or a list", live=True, is_list=True),
        NodeParameter(
            "positions", "15", "equal steps over one span, or a list of m after the sleeper", live=True, is_list=True
        ),
        NodeParameter("wheel_mass_kg", 0.0, f"unsprung mass per wheel, kg; {_OWN}", 0.0, 1e4),
        NodeParameter("static_load_n", 0.0, f"static wheel load, N; {_OWN}", 0.0, 1e6),
        NodeParameter("wheel_radius_m", 0.0, f"wheel radius, m; {_OWN}", 0.0, 2.0),
        NodeParameter("hertz_n_per_m15", 0.0, f"contact stiffness, N/m^1.5; {_OWN}", 0.0, 1e13),
        NodeParameter(
            "crown_radius_m",
            0.0,
            "rail head's transverse radius, m, from which the Hertz constant follows; 0: none",
            0.0,
            2.0,
        ),
        NodeParameter("contact_patch", "on", "average the rail's heights over the contact patch: on or off"),
        NodeParameter(
            "rolling", "circle", "whether the wheel's circle rolls over the rail and bridges it: circle or none"
        ),
        NodeParameter(
            "running", "both", "how trains run over welds that do not state it: with (rising x), against or both"
        ),
        NodeParameter(
            "support", "", "supports that differ at welds that do not state them: 0=0.02,1=0.5; sleeper 0 is before it"
        ),
        NodeParameter(
            "uncertainty_samples",
            DEFAULT_UNCERTAINTY_SAMPLES,
            "samples of what is not known, for verdicts with probabilities; 0: none",
            0,
            10_000,
        ),
        NodeParameter("uncertainty", "", "file of what is uncertain (YAML); empty: the bundled one"),
    ),
    "assessment_node": (
        _AUTOSTART,
        NodeParameter(
            "limits",
            "",
            "rule books, names or files with commas between them; empty: force",
            live=True,
        ),
        NodeParameter("bag", "", "folder to record to; a recording there is continued; empty: no recording"),
        NodeParameter("split_mb", 256.0, "MB after which a new file of the bag is begun", 1.0, 1e6),
        NodeParameter("split_minutes", 60.0, "minutes after which a new file of the bag is begun", 0.1, 1e5),
    ),
    "dashboard_node": (
        _AUTOSTART,
        NodeParameter("port", 8765, "port that the page is served on; 0: any that is free", 0, 65_535),
        NodeParameter(
            "host", "127.0.0.1", "address that it is served on; any other than 127.0.0.1 puts a token into the address"
        ),
    ),
    "foxglove_node": (
        _AUTOSTART,
        NodeParameter("port", 8766, "port on 127.0.0.1 that Foxglove connects to; 0: any that is free", 0, 65_535),
    ),
    "trolley_node": (
        _AUTOSTART,
        NodeParameter("seed", 1, "of the simulated rail and of what goes wrong on it", 0, 2**31 - 1),
        NodeParameter("length_m", 200.0, "m of rail that is measured", 5.0, 1e5),
        NodeParameter("speed_m_per_s", 1.2, "m/s at which the trolley is pushed", 0.05, 20.0),
        NodeParameter("rate", 1.0, "how much faster than real", 0.1, 1000.0),
        NodeParameter("marks", "marker", "how welds are marked: marker (topic), service (capture_weld) or none"),
        NodeParameter("form", "json", "how samples are sent: json (rail_surface) or points (rail_surface_points)"),
    ),
}


def default_parameter_file() -> Path:
    """Return the parameter file that comes with the package: every parameter at its default."""
    return Path(str(resources.files("weld_force_ros.data") / "config" / "default.yaml"))


def read_parameter_file(path: Path) -> dict[str, dict[str, Any]]:
    """Read and check a ROS parameter file for these nodes.

    Args:
        path: YAML of the form `/**/simulator_node: {ros__parameters: {track: bilbao}}`. As in ROS, a pattern may end
            in a wildcard, and namespaces may be levels of their own.

    Returns:
        Parameters by node pattern: `{"/**/simulator_node": {"track": "bilbao"}}`.

    Raises:
        InputError: not readable, not of that form, an unknown node or parameter, a wrong type or a value out of range.
    """
    try:
        config = dict(_sections(_yaml.decode(_yaml.read(path), dict[str, Any])))
        if not config:
            raise ValueError("it holds no ros__parameters")
        for pattern, values in config.items():
            _check_section(pattern, values)
    except OSError as error:
        raise InputError(f"config {path}: {error.strerror or error}", "name a file that can be read") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise InputError(f"config {path}: {legible(str(error))}", "write it after data/config/default.yaml") from None
    return config


def values_of_node(config: Mapping[str, Mapping[str, Any]], node: str, namespace: str) -> dict[str, Any]:
    """Return what a parameter file says for one node; later lines override earlier ones.

    Args:
        config: the file, from `read_parameter_file`.
        node: a key of `PARAMETERS`.
        namespace: of the node, such as `/left`; empty or `/`: none.
    """
    full_name = f"/{namespace.strip('/')}/{node}".replace("//", "/")
    found: dict[str, Any] = {}
    for pattern, values in config.items():
        if _matches(pattern, full_name):
            found |= _declared(node, values) if _is_wildcard(pattern) else values
    return found


def check_values(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values in their parameters' types, once it is certain that a node can start with them.

    Raises:
        InputError: an unknown parameter, a wrong type, a value out of range, or settings that cannot be simulated.
    """
    check_names(node, values)
    try:
        typed = msgspec.convert(values, _structure(node))
    except msgspec.ValidationError as error:
        raise InputError(f"{node}: {error}", "see data/config/default.yaml for what it takes") from None
    if node == "simulator_node":
        settings_from_parameters(values)
    return {name: getattr(typed, name) for name in values}


def check_names(node: str, names: Iterable[str]) -> None:
    """Check that some node of the suite has these parameters: those of several nodes may be given to each.

    Raises:
        InputError: a parameter that none has; the nearest name is said.
    """
    own = [parameter.name for parameter in PARAMETERS[node]]
    others = sorted({parameter.name for parameters in PARAMETERS.values() for parameter in parameters} - set(own))
    for name in names:
        if name not in (*own, *others, *_OF_EVERY_NODE) and not name.startswith(_QOS_OVERRIDES):
            near = difflib.get_close_matches(name, own, 1) or difflib.get_close_matches(name, others, 1)
            raise InputError(
                f"{node}: no node has a parameter {name!r}",
                f"write {near[0]!r}" if near else "see data/config/default.yaml for what there is",
            )


def settings_from_parameters(values: Mapping[str, Any]) -> list[SimulationSettings]:
    """Return simulation settings, of each vehicle, from the simulator node's parameters, or else their defaults.

    Raises:
        InputError: values that cannot be simulated.
    """
    given = {parameter.name: parameter.default for parameter in PARAMETERS["simulator_node"]} | dict(values)
    wheel = ("wheel_mass_kg", "static_load_n", "wheel_radius_m", "hertz_n_per_m15", "crown_radius_m")
    of_any_vehicle: dict[str, Any] = {
        "track": given["track"],
        "engine": given["engine"],
        "speeds_kmh": parse_speeds(_list_text(given["speeds"])),
        "positions": parse_positions(_list_text(given["positions"])),
        "uncertainty": load_uncertainty(
            given["uncertainty_samples"], Path(given["uncertainty"]).expanduser() if given["uncertainty"] else None
        ),
        "contact_patch": given["contact_patch"],
        "rolling": given["rolling"],
        "running": given["running"],
        "support": given["support"],
        **{name: given[name] or None for name in wheel},
    }
    return [simulation_settings(vehicle=vehicle, **of_any_vehicle) for vehicle in parse_vehicles(given["vehicle"])]


def _list_text(value: Any) -> str:
    """Return a list parameter as text, which ROS and YAML may have turned into a number or an array."""
    return ",".join(map(str, value)) if isinstance(value, list) or hasattr(value, "typecode") else str(value)


def _matches(pattern: str, full_name: str) -> bool:
    tokens = [token for token in pattern.split("/") if token]
    expression = "".join({"**": "(/[^/]+)*", "*": "/[^/]+"}.get(token, f"/{re.escape(token)}") for token in tokens)
    return re.fullmatch(expression, full_name) is not None


def _sections(content: Mapping[str, Any], namespace: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters of each pattern, whose levels may be separate."""
    for key, value in content.items():
        pattern = f"{namespace}/{key.strip('/')}" if namespace else key
        if not isinstance(value, dict):
            raise ValueError(f"{pattern}: {value!r} where ros__parameters are expected")
        if "ros__parameters" not in value:
            if not value or not all(isinstance(inner, dict) for inner in value.values()):
                raise ValueError(
                    f"{pattern}: holds {', '.join(map(str, value)) or 'nothing'} instead of ros__parameters"
                )
            yield from _sections(value, pattern)
        elif len(value) > 1 or not isinstance(value["ros__parameters"], dict):
            raise ValueError(f"{pattern}: holds more than a map of ros__parameters")
        else:
            yield pattern, value["ros__parameters"]


def _is_wildcard(pattern: str) -> bool:
    return pattern.rpartition("/")[2] in ("*", "**")


def _declared(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    return {p.name: values[p.name] for p in PARAMETERS[node] if p.name in values}


def _check_section(pattern: str, values: Mapping[str, Any]) -> None:
    node = pattern.rpartition("/")[2]
    if node not in PARAMETERS and not _is_wildcard(pattern):
        raise ValueError(f"{pattern!r} names none of {', '.join(PARAMETERS)}")
    try:
        if node in PARAMETERS:
            check_names(node, values)
            msgspec.convert(values, _structure(node))
            return
        for node in PARAMETERS:
            check_names(node, values)
            msgspec.convert(_declared(node, values), _structure(node))
    except (msgspec.ValidationError, InputError) as error:
        raise ValueError(f"{pattern}: {error}") from None


def parameter_file_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a parameter file."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "weld_force_ros/config.json",
        "type": "object",
        "additionalProperties": False,
        "patternProperties": {
            f"^(/[A-Za-z0-9_*]+)*/?{node}$": {
                "type": "object",
                "additionalProperties": False,
                "required": ["ros__parameters"],
                "properties": {"ros__parameters": _schema_of(_structure(node))},
            }
            for node in PARAMETERS
        }
        | {
            r"^(/[A-Za-z0-9_*]+)*/\*\*?$": {
                "type": "object",
                "additionalProperties": False,
                "required": ["ros__parameters"],
                "properties": {"ros__parameters": _schema_of(_structure_of_all())},
            }
        },
    }


def _schema_of(structure: type[msgspec.Struct]) -> dict[str, Any]:
    return msgspec.json.schema_components([structure], ref_template="{name}")[1][structure.__name__]


def default_parameter_text() -> str:
    """Return the text of `data/config/default.yaml`: every parameter with its description, at its default."""
    lines = [
        "# Parameters of the nodes (ROS 2 parameter file), all at their defaults: copy it, and keep what you change.",
        "# Use: weld-force up --config FILE, or any ROS node with --ros-args --params-file FILE.",
        "# /**/ is every namespace; /left/simulator_node is the one of the left rail.",
    ]
    for node, parameters in PARAMETERS.items():
        lines += [f"/**/{node}:", "  ros__parameters:"]
        for parameter in parameters:
            bounds = f" ({parameter.minimum:g} to {parameter.maximum:g})" if parameter.minimum is not None else ""
            lines.append(f"    # {parameter.description}{bounds}{'; may change live' if parameter.live else ''}")
            lines.append(f"    {parameter.name}: {msgspec.json.encode(parameter.default).decode()}")
    return "\n".join(lines) + "\n"


def _structure(node: str) -> type[msgspec.Struct]:
    fields = [(parameter.name, _type(parameter), parameter.default) for parameter in PARAMETERS[node]]
    fields.append(("use_sim_time", bool, False))
    return msgspec.defstruct(node, fields, kw_only=True, forbid_unknown_fields=True)


def _structure_of_all() -> type[msgspec.Struct]:
    by_name = {p.name: p for parameters in PARAMETERS.values() for p in parameters}
    fields = [(name, _type(parameter), parameter.default) for name, parameter in by_name.items()]
    return msgspec.defstruct("any_node", [*fields, ("use_sim_time", bool, False)], forbid_unknown_fields=True)


def _type(parameter: NodeParameter) -> Any:
    if parameter.is_list:
        return Annotated[str | int | float | list[float], msgspec.Meta(description=parameter.description)]
    if parameter.minimum is None:
        return Annotated[type(parameter.default), msgspec.Meta(description=parameter.description)]
    bounds = msgspec.Meta(description=parameter.description, ge=parameter.minimum, le=parameter.maximum)
    return Annotated[type(parameter.default), bounds]
