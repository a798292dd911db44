"""Write the page of the nodes' topics, services and parameters: `python -m benchmarks.interface_page > docs/nodes.md`.

All of it is asked of nodes that run; sizes are those of the demo's recording, which is in `bags/demo`.
"""

import tempfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from mcap.reader import make_reader
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from weld_force_ros.messages import TOPICS
from weld_force_ros.ros import environment
from weld_force_ros.ros.node_suite import ALL_KINDS, Kind, NodeSuite
from weld_force_ros.ros.parameters import PARAMETERS, NodeParameter

DEMO = Path(__file__).parents[1] / "bags" / "demo"

# How often, and in which frame: what neither a node nor a recording tells.
_HOW_OFTEN = {
    "/weld_profile": "one a weld", "/force_map": "one a weld and vehicle", "/force_history": "one a weld and vehicle",
    "/verdict": "one a weld", "/rejection": "one an input that cannot be used", "/rail_surface": "as the driver sends",
    "/weld_marker": "one a mark", "/inquiry": "at a start, and where outcomes stay away",
    "/settled": "one an outcome, and one an inquiry", "/simulation_settings": "one a start or change and vehicle",
    "/assessment_settings": "one a start or change", "/peak_force": "one a weld", "/criteria": "one a weld",
    "/diagnostics": "1 Hz and node", "/rail_surface_points": "as the driver sends",
}  # fmt: skip
_FRAMES = {"/peak_force": "`rail`", "/criteria": "`rail`", "/rail_surface_points": "any: x is chainage, z is up"}
_MEANING = {
    "/peak_force": "peak force of a verdict, N, z up: for plots",
    "/criteria": "all numbers of a verdict, as text: for plots",
    "/diagnostics": "state, counts and problems of each node",
    "/rail_surface_points": "running surface under the trolley, as a point cloud",
}
_SERVICES = {"/capture_weld": "mark a weld where the trolley is now; says where, or what is missing"}
_OF_EVERY_NODE = ("parameter_events", "rosout", "transition_event")


def page() -> str:
    """Return the page."""
    with _all_nodes() as suite:
        nodes = {suite.nodes[kind].get_name(): suite.nodes[kind] for kind in ALL_KINDS}
        topics = _topics(nodes)
        services = {
            node.resolve_service_name(service.srv_name): (_type_name(service.srv_type, "srv"), name)
            for name, node in nodes.items()
            for service in node.services
        }
    lines = [
        "# Nodes, topics, services, parameters",
        "",
        "Made by `python -m benchmarks.interface_page` from nodes that run, and held to them by a test. Names are in",
        "the nodes' namespace, if one is given. How to look at all this with `ros2`, and why JSON travels in strings:",
        "[ros.md](ros.md).",
        "",
        "## Topics",
        "",
        "*Latched*: reliable and transient local; who joins later gets as many of the last messages as stand there.",
        "Sizes are medians of the demo's recording.",
        "",
        "| topic | type | what | from | to | latched, depth | how often | size | frame |",
        "|---|---|---|---|---|---|---|---|---|",
        *_topic_rows(topics, _sizes()),
        "",
        "## Services",
        "",
        "| service | type | node | what |",
        "|---|---|---|---|",
        *(
            f"| `{name}` | `{kind}` | `{node}` | {_SERVICES[name]} |"
            for name, (kind, node) in sorted(services.items())
            if name in _SERVICES
        ),
        "",
        "Every node has ROS 2's own services of parameters (`ros2 param`) and of its lifecycle (`ros2 lifecycle`).",
        "",
        "## Parameters",
        "",
        "*Live* ones may change while the node is configured; the others before (`ros2 lifecycle set NODE cleanup`).",
    ]
    for node, parameters in PARAMETERS.items():
        lines += [
            "",
            f"### {node}",
            "",
            "| parameter | type | default | range | live | what |",
            "|---|---|---|---|---|---|",
        ]
        lines += [_parameter_row(parameter) for parameter in parameters]
    return "\n".join(lines) + "\n"


@contextmanager
def _all_nodes() -> Iterator[NodeSuite]:
    """Run one node of each kind, in a domain of their own."""
    environment.use_own_domain()
    with tempfile.TemporaryDirectory() as folder:
        parameters: dict[Kind, dict[str, Any]] = {
            "profile": {"folder": folder},
            "assessment": {"bag": str(Path(folder) / "bag")},
            "dashboard": {"port": 0},
            "foxglove": {"port": 0},
        }
        with NodeSuite(ALL_KINDS, parameters=parameters, ros_args=["--ros-args", "--log-level", "error"]) as suite:
            yield suite


def _topics(nodes: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return type, publishers with their quality of service, and subscribers of every topic that is the suite's own."""
    topics: dict[str, dict[str, Any]] = defaultdict(lambda: {"from": {}, "to": set()})
    for name, node in nodes.items():
        for publisher in node.publishers:
            if publisher.topic_name.rpartition("/")[2] not in _OF_EVERY_NODE:
                found = topics[publisher.topic_name]
                found["type"] = _type_name(publisher.msg_type, "msg")
                found["from"][name] = publisher.qos_profile
        for subscription in node.subscriptions:
            if subscription.topic_name.rpartition("/")[2] not in _OF_EVERY_NODE:
                found = topics[subscription.topic_name]
                found["type"] = _type_name(subscription.msg_type, "msg")
                found["to"].add(name)
    return topics


def _topic_rows(topics: dict[str, dict[str, Any]], sizes: dict[str, float]) -> Iterator[str]:
    meaning = {f"/{topic.name}": topic.description for topic in TOPICS.values()} | _MEANING
    schemas = {f"/{topic.name}": kind.__name__ for kind, topic in TOPICS.items()}
    order = [name for name in meaning if name in topics]
    for name in [*order, *sorted(topics.keys() - set(order))]:
        found = topics[name]
        kind = f"`{found['type']}`"
        if found["type"] == _type_name(String, "msg"):
            kind = f"[{schemas[name]}](../msgs_json/{schemas[name]}.json) in `{found['type']}`"
        size = f"{sizes[name] / 1e3:,.{0 if sizes[name] > 1e4 else 1}f} kB" if name in sizes else ""
        yield (
            f"| `{name}` | {kind} | {meaning[name]} | {_names(found['from']) or 'drivers, people'} |"
            f" {_names(found['to']) or 'who wants it'} | {_kept(list(found['from'].values()))} |"
            f" {_HOW_OFTEN[name]} | {size} | {_FRAMES.get(name, '')} |"
        )


def _names(nodes: Any) -> str:
    return ", ".join(f"`{name.removesuffix('_node')}`" for name in sorted(nodes))


def _kept(profiles: list[QoSProfile]) -> str:
    if not profiles:
        return "no"
    if any(profile.durability != DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles):
        return "no"
    return str(max(profile.depth for profile in profiles))  # the assessment node sends profiles again, from fewer


def _type_name(kind: type, form: str) -> str:
    return f"{kind.__module__.split('.')[0]}/{form}/{kind.__name__}"


def _sizes() -> dict[str, float]:
    found: dict[str, list[int]] = defaultdict(list)
    for path in sorted(DEMO.glob("*.mcap")):
        with path.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                found[channel.topic].append(len(message.data))
    return {topic: median(sizes) for topic, sizes in found.items()}


def _parameter_row(parameter: NodeParameter) -> str:
    kind = "text, number or list" if parameter.is_list else type(parameter.default).__name__
    default = "" if parameter.default == "" else f"`{parameter.default}`"
    bounds = "" if parameter.minimum is None else f"{parameter.minimum:g} to {parameter.maximum:g}"
    live = "yes" if parameter.live else ""
    return f"| `{parameter.name}` | {kind} | {default} | {bounds} | {live} | {parameter.description} |"


if __name__ == "__main__":
    print(page(), end="")
