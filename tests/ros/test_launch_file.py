"""The launch file, made of doubles: what it declares, starts and asks for."""

import asyncio
from collections.abc import Awaitable, Callable
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.harness import launch_doubles as doubles

pytest.importorskip("lifecycle_msgs.msg")

from lifecycle_msgs.msg import Transition

from weld_force_ros.ros import launcher
from weld_force_ros.ros.parameters import PARAMETERS, default_parameter_file

FILE = Path(__file__).parents[2] / "launch" / "weld_force.launch.py"
NODES = {"assessment_node", "simulator_node", "profile_node"}


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    doubles.install(monkeypatch)
    module = ModuleType("weld_force_launch")
    SourceFileLoader(module.__name__, str(FILE)).exec_module(module)
    monkeypatch.setattr(module, "ANSWER_S", 0.05)
    return module


def context(**given: str) -> doubles.LaunchContext:
    arguments = {"config": str(default_parameter_file()), "namespace": "", "folder": "", "bag": "", "autostart": "true"}
    return doubles.LaunchContext(arguments | given)


def nodes(entities: list[Any]) -> dict[str, doubles.LifecycleNode]:
    return {entity.name: entity for entity in entities if isinstance(entity, doubles.LifecycleNode)}


def handlers(entities: list[Any], kind: type, node: doubles.LifecycleNode) -> list[Any]:
    found = [e.event_handler for e in entities if isinstance(e, doubles.RegisterEventHandler)]
    target = "target_action" if kind is doubles.OnProcessStart else "target_lifecycle_node"
    return [handler for handler in found if isinstance(handler, kind) and getattr(handler, target) is node]


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.005)


def test_arguments_have_defaults_and_say_what_they_are(launch_file: ModuleType):
    *arguments, bring_up = launch_file.generate_launch_description().entities

    assert {argument.name for argument in arguments} == {"config", "namespace", "folder", "bag", "autostart"}
    assert all(argument.description for argument in arguments)
    defaults = {argument.name: argument.default_value for argument in arguments}
    shipped = doubles.PathJoinSubstitution(
        [doubles.FindPackageShare("weld_force_ros"), "config", default_parameter_file().name]
    )
    assert defaults.pop("config") == shipped
    assert defaults == {"namespace": "", "folder": "", "bag": "", "autostart": "true"}
    assert bring_up.function is launch_file.bring_up


def test_three_lifecycle_nodes_are_started_and_started_again(launch_file: ModuleType):
    started = nodes(launch_file.bring_up(context()))

    assert started.keys() == NODES
    for name, node in started.items():
        assert (node.package, node.executable) == ("weld_force_ros", name)
        assert callable(getattr(launcher, node.executable))
        assert node.namespace == doubles.LaunchConfiguration("namespace")
        assert node.respawn
        assert node.respawn_delay > 0.0
        assert float(node.sigterm_timeout) > launcher.DRAIN_S, "a second signal would stop a node that still drains"


def test_what_is_given_goes_before_the_config_and_nothing_else_does(
    launch_file: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.chdir(tmp_path)
    for node in nodes(launch_file.bring_up(context())).values():
        assert node.parameters == [str(default_parameter_file()), {"autostart": False}]

    given = nodes(launch_file.bring_up(context(folder="2026", bag="monday")))

    own = {name: node.parameters[-1] for name, node in given.items()}
    # A folder named by a number stays text.
    assert own["profile_node"]["folder"] == doubles.ParameterValue(str(tmp_path / "2026"), value_type=str)
    assert own["assessment_node"]["bag"] == doubles.ParameterValue(str(tmp_path / "monday"), value_type=str)
    assert own["simulator_node"] == {"autostart": False}
    for name, parameters in own.items():
        assert parameters.keys() <= {parameter.name for parameter in PARAMETERS[name]}


def test_a_config_that_is_not_there_is_refused(launch_file: ModuleType):
    with pytest.raises(RuntimeError, match=r"nowhere\.yaml.*no such file"):
        launch_file.bring_up(context(config="nowhere.yaml"))


def test_without_autostart_the_lifecycle_is_left_alone(launch_file: ModuleType):
    entities = launch_file.bring_up(context(autostart="false"))

    assert nodes(entities).keys() == NODES
    assert len(entities) == len(NODES)


def started(name: str, launch_file: ModuleType, scenario: Callable[..., Awaitable[None]]) -> None:
    """Run a scenario from the moment that a node's process has started."""

    async def play() -> None:
        launch = context()
        entities = launch_file.bring_up(launch)
        node = nodes(entities)[name]
        (handler,) = handlers(entities, doubles.OnProcessStart, node)
        handler.on_start(doubles.ProcessStarted(node), launch)
        client = launch.ros_node.clients
        await until(lambda: f"/{name}/get_state" in client)
        await scenario(launch, node, handler, client[f"/{name}/get_state"])

    doubles.run(play())


@pytest.mark.parametrize("name", sorted(NODES))
def test_a_node_is_configured_once_it_answers_however_late(name: str, launch_file: ModuleType):
    async def scenario(launch: Any, node: Any, handler: Any, client: doubles.Client) -> None:
        await until(lambda: client.requests == 3)
        assert not launch.emitted, "a request to a process that is not there"
        assert len(client.waiting) == 1, "requests that nobody answered pile up"
        client.waiting[0].answer()
        await asyncio.gather(*launch.tasks)
        (event,) = launch.emitted
        assert event.transition_id == Transition.TRANSITION_CONFIGURE
        assert event.lifecycle_node_matcher(node)
        assert not event.lifecycle_node_matcher(object())
        assert not client.waiting

    started(name, launch_file, scenario)


def test_a_node_that_died_is_configured_again(launch_file: ModuleType):
    async def scenario(launch: Any, node: Any, handler: Any, client: doubles.Client) -> None:
        for died_before in range(3):
            await until(lambda: bool(client.waiting))
            client.waiting[0].answer()
            await asyncio.gather(*launch.tasks)
            assert len(launch.emitted) == died_before + 1
            handler.on_start(doubles.ProcessStarted(node), launch)
        await until(lambda: bool(client.waiting))
        client.waiting[0].answer()
        await asyncio.gather(*launch.tasks)

    started("simulator_node", launch_file, scenario)


def test_a_node_that_dies_before_it_answers_is_configured_once(launch_file: ModuleType):
    async def scenario(launch: Any, node: Any, handler: Any, client: doubles.Client) -> None:
        handler.on_start(doubles.ProcessStarted(node), launch)
        handler.on_start(doubles.ProcessStarted(node), launch)
        await until(lambda: bool(client.waiting))
        client.waiting[0].answer()
        await asyncio.gather(*launch.tasks)
        assert len(launch.emitted) == 1

    started("profile_node", launch_file, scenario)


def test_a_shutdown_ends_the_wait(launch_file: ModuleType):
    async def scenario(launch: Any, node: Any, handler: Any, client: doubles.Client) -> None:
        launch.is_shutdown = True
        await asyncio.gather(*launch.tasks)
        assert not launch.emitted

    started("assessment_node", launch_file, scenario)


def test_a_configured_node_is_activated(launch_file: ModuleType):
    entities = launch_file.bring_up(context())
    for node in nodes(entities).values():
        (handler,) = handlers(entities, doubles.OnStateTransition, node)
        assert (handler.start_state, handler.goal_state) == ("configuring", "inactive")
        (entity,) = handler.entities
        assert entity.event.transition_id == Transition.TRANSITION_ACTIVATE
        assert entity.event.lifecycle_node_matcher(node)
