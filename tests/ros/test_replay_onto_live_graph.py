"""A recording played onto a graph that measures: what is live and what is played are not mixed without a word."""

import threading
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.harness.ros import DEADLINE_S, Outcomes, QuickSimulator, profile_text, wait_until
from weld_force_ros.messages import Header, Rejection, Verdict, read_header
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.ros.node_suite import KINDS, Kind, NodeSuite
from weld_force_ros.ros.playback import play
from weld_force_ros.ros.playback_plan import PlaybackOptions

DEMO = Path(__file__).parents[2] / "bags" / "demo"


def suite(outcomes: Outcomes, bag: Path, folder: Path | None = None, kinds: tuple[Kind, ...] = KINDS) -> NodeSuite:
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder or ""), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": "40,80", "positions": "0.15"},
        "assessment": {"bag": str(bag)},
    }
    return NodeSuite(
        kinds,
        parameters=parameters,
        load_simulator=QuickSimulator,
        on_verdict=outcomes,
        on_rejection=outcomes,
    )


CONTRACT = ("weld_profile", "simulation_settings", "assessment_settings", "force_map", "force_history", "settled")


def played(*topics: str) -> list[str]:
    said: list[str] = []
    play(
        DEMO,
        PlaybackOptions(rate=100.0, topics=topics or CONTRACT, clock=False),
        stop=threading.Event(),
        report=said.append,
        discovery_s=DEADLINE_S,
    )
    return said


def test_verdicts_are_of_the_simulator_here_and_played_maps_are_reported(
    domain_id: int, folder: Path, tmp_path: Path
) -> None:
    recorded = open_recording(DEMO)
    played_configs = {force_map.config_sha256 for force_map in recorded.force_maps}
    (folder / "live.csv").write_text(profile_text(weld_id="live"))
    outcomes, bag = Outcomes(), tmp_path / "bag"
    with suite(outcomes, bag, folder) as running:
        outcomes.wait(1)
        said = played()
        outcomes.wait(1 + len(recorded.profiles), lambda message: isinstance(message, Verdict))
        assert running.drain(30.0) == 0
        problem = running.nodes["assessment"].topics.diagnostics.last_error
    made = open_recording(bag)
    (config,) = made.settings.keys() - played_configs
    assert {verdict.config_sha256 for verdict in made.verdicts} == {config}
    assert sorted(verdict.weld_id for verdict in made.verdicts) == sorted(
        ["live", *(weld_id for weld_id, _ in recorded.profiles)]
    )
    assert {force_map.config_sha256 for force_map in made.force_maps} == {config}
    assert not list(made.welds_without_outcome())
    assert "played from a recording" in problem
    assert any("/force_map" in line and "live nodes publish" in line for line in said)


def test_without_a_simulator_a_recording_is_judged_as_it_is_played(domain_id: int, tmp_path: Path) -> None:
    recorded = open_recording(DEMO)
    outcomes = Outcomes()
    with suite(outcomes, tmp_path / "bag", kinds=("assessment",)) as running:
        played("weld_profile", "simulation_settings", "force_map", "force_history")
        outcomes.wait(len(recorded.verdicts), lambda message: isinstance(message, Verdict))
        assert running.drain(30.0) == 0
    made = open_recording(tmp_path / "bag")
    assert {v.config_sha256 for v in made.verdicts} == {m.config_sha256 for m in recorded.force_maps}
    assert len(made.verdicts) == len(recorded.verdicts)


def test_recorded_measurements_alone_are_measured_anew_here(domain_id: int, folder: Path, tmp_path: Path) -> None:
    recorded, outcomes = open_recording(DEMO), Outcomes()
    with suite(outcomes, tmp_path / "bag", folder) as running:
        assert not [line for line in played("weld_profile") if "force_map" in line]
        outcomes.wait(len(recorded.profiles), lambda message: isinstance(message, Verdict))
        assert running.drain(30.0) == 0
        wait_until(lambda: not running.nodes["assessment"].open_count)
    assert not outcomes.of(Rejection)


@pytest.mark.parametrize(
    ("stamp", "stamped_ns"),
    [('{"sec":3,"nanosec":7}', 3_000_000_007), ('{"sec":"now"}', 0), ("null", 0), ('{"sec":1e99}', 0), ("[]", 0)],
)
def test_stamp_is_read_of_any_header(stamp: str, stamped_ns: int) -> None:
    header = read_header(f'{{"publisher":"/a#1","sequence":4,"stamp":{stamp},"rest":[]}}')
    assert header is not None
    assert (header.publisher, header.sequence, header.stamped_ns) == ("/a#1", 4, stamped_ns)
    assert msgspec.structs.replace(Header(), sequence=4).stamped_ns == 0
