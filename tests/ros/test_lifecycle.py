"""Lifecycle and parameters of the nodes, as a lifecycle manager and an operator see them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from std_msgs.msg import String

from tests.harness.ros import Outcomes, Probe, QuickSimulator, profile_text, wait_until
from weld_force_ros.messages import AssessmentSettings, ForceMap, SimulationSettings, Verdict, WeldProfile, decode
from weld_force_ros.ros import qos
from weld_force_ros.ros.node_suite import ALL_KINDS, KINDS, Kind, NodeSuite
from weld_force_ros.ros.parameters import PARAMETERS


@contextmanager
def suite(folder: Path, outcomes: Any = None, kinds: tuple[Kind, ...] = KINDS, **common: Any) -> Iterator[NodeSuite]:
    with NodeSuite(
        kinds,
        parameters={
            "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3, **common},
            "simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "0.15", **common},
            "assessment": common,
        },
        load_simulator=QuickSimulator,
        on_verdict=outcomes,
    ) as running:
        yield running


def change(probe: Probe, node: str, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(probe.call(ChangeState, f"/{node}/change_state", request).success)


def state(probe: Probe, node: str) -> str:
    return str(probe.call(GetState, f"/{node}/get_state", GetState.Request()).current_state.label)


def set_text(probe: Probe, node: str, name: str, text: str) -> tuple[bool, str]:
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
    request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
    (result,) = probe.call(SetParameters, f"/{node}/set_parameters", request).results
    return bool(result.successful), str(result.reason)


def test_managed_node_waits_for_its_manager_and_goes_all_the_way_round(
    domain_id: int, probe: Probe, folder: Path
) -> None:
    (folder / "weld.csv").write_text(profile_text())
    profiles = probe.collect("weld_profile", String, qos.CONTRACT)
    with suite(folder, kinds=("profile",), autostart=False):
        assert state(probe, "profile_node") == "unconfigured"
        assert change(probe, "profile_node", Transition.TRANSITION_CONFIGURE)
        assert state(probe, "profile_node") == "inactive"
        assert not profiles.messages
        assert change(probe, "profile_node", Transition.TRANSITION_ACTIVATE)
        profiles.wait(1)
        assert change(probe, "profile_node", Transition.TRANSITION_DEACTIVATE)
        assert change(probe, "profile_node", Transition.TRANSITION_CLEANUP)
        assert state(probe, "profile_node") == "unconfigured"
        assert change(probe, "profile_node", Transition.TRANSITION_CONFIGURE)
        assert change(probe, "profile_node", Transition.TRANSITION_ACTIVATE)
        profiles.wait(2)  # nobody keeps a ledger here: what is in the folder is measured anew
        assert change(probe, "profile_node", Transition.TRANSITION_ACTIVE_SHUTDOWN)
        assert state(probe, "profile_node") == "finalized"


@pytest.mark.parametrize("kind", ["simulator", "assessment"])
def test_inactive_node_leaves_what_comes_for_later(domain_id: int, probe: Probe, folder: Path, kind: Kind) -> None:
    outcomes = Outcomes()
    with suite(folder, outcomes) as running:
        assert change(probe, f"{kind}_node", Transition.TRANSITION_DEACTIVATE)
        for i in range(5):
            (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
        wait_until(lambda: running.nodes["profile"].topics.sent(WeldProfile) == 5)
        assert running.nodes[kind].topics.diagnostics.received["weld_profile"] == 0
        assert change(probe, f"{kind}_node", Transition.TRANSITION_ACTIVATE)
        outcomes.wait(5)
    assert sorted(v.weld_id for v in outcomes.messages) == [f"weld-{i}" for i in range(5)]


def test_failed_configuration_is_answered_and_may_be_tried_again(
    domain_id: int, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    late = tmp_path / "late"
    with suite(late, kinds=("profile",), autostart=False):
        assert not change(probe, "profile_node", Transition.TRANSITION_CONFIGURE)
        assert state(probe, "profile_node") == "unconfigured"
        late.mkdir()
        assert change(probe, "profile_node", Transition.TRANSITION_CONFIGURE)


def test_cleaned_up_assessment_lets_go_of_its_bag(domain_id: int, probe: Probe, folder: Path, tmp_path: Path) -> None:
    with NodeSuite(("assessment",), parameters={"assessment": {"bag": str(tmp_path / "bag")}}):
        assert change(probe, "assessment_node", Transition.TRANSITION_DEACTIVATE)
        assert change(probe, "assessment_node", Transition.TRANSITION_CLEANUP)
        assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_speeds_change_live_and_count_for_what_comes_after(domain_id: int, probe: Probe, folder: Path) -> None:
    outcomes, maps = Outcomes(), probe.collect("force_map", String, qos.CONTRACT)
    settings = probe.collect("simulation_settings", String, qos.CONTRACT)
    with suite(folder, outcomes):
        (folder / "before.csv").write_text(profile_text(100))
        outcomes.wait(1)
        assert set_text(probe, "simulator_node", "speeds", "100:120:10") == (True, "")
        settings.wait(2)
        (folder / "after.csv").write_text(profile_text(200))
        outcomes.wait(2)
        before, after = (decode(ForceMap, message.data) for message in maps.wait(2))
    assert (before.speeds_kmh, after.speeds_kmh) == ([40.0, 80.0], [100.0, 110.0, 120.0])
    assert decode(SimulationSettings, settings.messages[-1].data).config_sha256 == after.config_sha256


def test_limits_change_live(domain_id: int, probe: Probe, folder: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.yaml"
    limits.write_text("- {name: peak_force, limit: 1.0e+6, reject_limit: 2.0e+6, unit: N, source: hand}\n")
    outcomes, settings = Outcomes(), probe.collect("assessment_settings", String, qos.CONTRACT)
    with suite(folder, outcomes):
        (folder / "before.csv").write_text(profile_text(100))
        outcomes.wait(1)
        assert set_text(probe, "assessment_node", "limits", str(limits)) == (True, "")
        settings.wait(2)
        (folder / "after.csv").write_text(profile_text(200))
        before, after = outcomes.wait(2)
    assert (before.decision, after.decision) == ("undecided", "accept")
    assert decode(AssessmentSettings, settings.messages[-1].data).limits_sha256 == after.limits_sha256
    assert isinstance(after, Verdict)


@pytest.mark.parametrize(
    ("node", "name", "text", "reason"),
    [
        ("simulator_node", "speeds", "fast", "fast"),
        ("simulator_node", "positions", "0", "positions"),
        ("simulator_node", "track", "johansson-nielsen", "track cannot change while simulator_node is configured"),
        ("assessment_node", "limits", "nowhere.yaml", "nowhere.yaml"),
        ("assessment_node", "bag", "other", "bag cannot change"),
        ("profile_node", "folder", "elsewhere", "folder cannot change"),
    ],
)
def test_change_that_is_unsound_is_refused_with_its_reason(
    domain_id: int, probe: Probe, folder: Path, node: str, name: str, text: str, reason: str
) -> None:
    with suite(folder) as running:
        before = running.nodes[node.removesuffix("_node")].get_parameter(name).value  # type: ignore[index]
        done, said = set_text(probe, node, name, text)
        assert not done
        assert reason in said
        assert running.nodes[node.removesuffix("_node")].get_parameter(name).value == before  # type: ignore[index]


def test_what_is_fixed_may_change_before_the_node_is_configured(domain_id: int, probe: Probe, folder: Path) -> None:
    settings = probe.collect("simulation_settings", String, qos.CONTRACT)
    with suite(folder, kinds=("simulator",), autostart=False):
        assert set_text(probe, "simulator_node", "track", "johansson-nielsen") == (True, "")
        assert change(probe, "simulator_node", Transition.TRANSITION_CONFIGURE)
        assert decode(SimulationSettings, settings.wait(1)[0].data).track == "johansson-nielsen"


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_every_parameter_has_a_description_and_numbers_a_range(
    domain_id: int, probe: Probe, folder: Path, kind: Kind
) -> None:
    rows = PARAMETERS[f"{kind}_node"]
    with (
        suite(folder, kinds=(kind,), autostart=False)
        if kind in KINDS
        else NodeSuite((kind,), parameters={kind: {"autostart": False}})
    ):
        request = DescribeParameters.Request(names=[row.name for row in rows])
        described = probe.call(DescribeParameters, f"/{kind}_node/describe_parameters", request).descriptors
    for row, descriptor in zip(rows, described, strict=True):
        assert row.description in descriptor.description
        if isinstance(row.default, float):
            assert (descriptor.floating_point_range[0].from_value, descriptor.floating_point_range[0].to_value) == (
                row.minimum,
                row.maximum,
            )


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (["--config", "nowhere.yaml"], "nowhere.yaml"),
        (["--config", "bad.yaml"], "trak"),
        (["--track", "nowhere"], "nowhere"),
        (["--speeds", "fast"], "fast"),
        (["--spacing", "-1"], "spacing"),
        (["--folder", "elsewhere"], "elsewhere does not exist"),
        (["--bag", "taken"], "taken"),
        (["--limits", "nowhere.yaml"], "nowhere.yaml"),
        ([], "folder"),
    ],
)
def test_what_the_suite_cannot_start_with_is_one_line_and_exit_code_2(
    domain_id: int,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    options: list[str],
    part: str,
) -> None:
    from weld_force_ros.cli.main import main

    monkeypatch.chdir(folder)
    (folder / "bad.yaml").write_text("/**/simulator_node:\n  ros__parameters:\n    trak: bilbao\n")
    (folder / "taken").write_text("evidence")
    given = options if not options or "--folder" in options else ["--folder", ".", *options]
    assert main(["up", *given]) == 2
    out, err = capfd.readouterr()
    refusals = [line for line in err.splitlines() if line.startswith("weld-force: ")]
    assert out == ""
    assert len(refusals) == 1
    assert part in refusals[0]
    assert "Traceback" not in err
