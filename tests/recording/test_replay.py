"""Replay says what differs, and what is missing."""

import csv
from pathlib import Path

import msgspec
import pytest

from weld_force_ros.assessment.judge import assess, assess_vehicles, judge, simulate_vehicles
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import BagError
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.messages import TOPICS, ForceMap, Message, encode, parse_support
from weld_force_ros.recording import STRING, Recorder, replay, string_cdr, what_if
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.recording.table_export import export_tables
from weld_force_ros.recording.weld_records import records_of_recording
from weld_force_ros.report.weld_detail import content
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    settings = simulation_settings(speeds_kmh=[60, 120], positions=[0.1, 0.4])
    limits = load_limits()
    profile = read_profile(find("weld-4-steep-ramp"))
    done = assess(profile, Simulator(settings), limits)
    return [settings, limits, profile, done.force_map, done.history, done.verdict]


def recorded(folder: Path, messages: list[Message], *, damaged: bool = False) -> Recording:
    with Recorder(folder / "bag") as recorder:
        for n, message in enumerate(messages):
            text = msgspec.json.encode(message).decode() if damaged else encode(message).decode()
            topic = "/left" + "/" + TOPICS[type(message)].name
            recorder.write(topic, STRING, string_cdr(text), log_time_ns=n, publish_time_ns=n)
    return open_recording(folder / "bag")


def changed(messages: list[Message], kind: str, **fields: object) -> list[Message]:
    return [
        msgspec.structs.replace(m, **fields) if type(m).__name__ == kind else m  # type: ignore[misc]
        for m in messages
    ]


def differences(recording: Recording) -> list[str]:
    return [f"{r.kind}: {d}" for r in replay.replay(recording) for d in r.differences]


def test_an_untouched_recording_agrees_in_any_namespace(tmp_path, messages):
    results = list(replay.replay(recorded(tmp_path, messages)))
    assert [(r.kind, r.differences) for r in results] == [("force_map", ()), ("verdict", ())]


def test_welds_of_one_geometry_keep_their_own_line_speeds(tmp_path, messages):
    settings, limits, profile = messages[:3]
    slow = msgspec.structs.replace(profile, weld_id="slow", line_speed_kmh=60.0)
    done = assess(slow, Simulator(settings), limits)
    assert done.verdict.peak_force_n < messages[5].peak_force_n
    both = [*messages, slow, done.force_map, done.history, done.verdict]
    assert differences(recorded(tmp_path, both)) == []
    assert differences(recorded(tmp_path / "cut", both[:-1])) == ["verdict: no verdict was recorded for this profile"]


def test_one_force_changed_by_a_newton_is_found_and_placed(tmp_path, messages):
    peaks = list(messages[3].peak_force_n)
    peaks[2] += 1.0
    (found,) = differences(recorded(tmp_path, changed(messages, "ForceMap", peak_force_n=peaks)))
    assert found.startswith("force_map: peak_force_n differs by 1 at 120 km/h, 0.1 m (1 of 4 passages)")


def test_of_a_curve_the_forces_count_and_not_which_of_two_places_has_them(tmp_path, messages):
    curve = messages[3].curve
    other = msgspec.structs.replace(
        curve, at_m=[0.6 - at for at in curve.at_m], against=[not against for against in curve.against]
    )
    assert differences(recorded(tmp_path / "place", changed(messages, "ForceMap", curve=other))) == []
    forces = msgspec.structs.replace(curve, min_force_n=[curve.min_force_n[0] - 1.0, *curve.min_force_n[1:]])
    found = differences(recorded(tmp_path / "force", changed(messages, "ForceMap", curve=forces)))
    assert found == ["force_map: curve differs"]


def test_a_changed_decision_is_found(tmp_path, messages):
    other = "accept" if messages[5].decision != "accept" else "reject"
    (found,) = differences(recorded(tmp_path, changed(messages, "Verdict", decision=other)))
    assert found == f"verdict: decision was {other}, is {messages[5].decision}"


def test_a_weld_without_a_verdict_is_reported(tmp_path, messages):
    assert differences(recorded(tmp_path, messages[:3])) == ["verdict: no verdict was recorded for this profile"]


def test_a_verdict_without_a_map_is_reported(tmp_path, messages):
    without_map = [m for m in messages if type(m).__name__ != "ForceMap"]
    assert differences(recorded(tmp_path, without_map)) == ["verdict: no force map was recorded for this verdict"]


@pytest.fixture(scope="module")
def of_two_vehicles() -> list[Message]:
    """Settings, limits, profile, a map of each vehicle, and the verdict of the one that decides."""
    profile, limits = read_profile(find("weld-4-steep-ramp")), load_limits()
    settings = [
        simulation_settings(vehicle=name, speeds_kmh=[60, 120], positions=[0.1, 0.4])
        for name in ("passenger", "freight-22.5t")
    ]
    simulators = [Simulator(one) for one in settings]
    verdict = assess_vehicles(profile, simulators, limits).verdict
    return [*settings, limits, profile, *simulate_vehicles(profile, simulators), verdict]


def test_the_maps_of_several_vehicles_are_replayed_with_their_one_verdict(tmp_path, of_two_vehicles):
    recording = recorded(tmp_path, of_two_vehicles)
    results = list(replay.replay(recording))
    assert [(r.kind, r.differences) for r in results] == [("force_map", ()), ("force_map", ()), ("verdict", ())]
    assert results[2].computed.vehicle == of_two_vehicles[-1].vehicle
    records = records_of_recording(recorded(tmp_path / "open", of_two_vehicles[:-1]), None, load_limits())
    assert [record.verdict.vehicle for record in records] == [of_two_vehicles[-1].vehicle]
    (changed,) = what_if.what_if(recording, what_if.read_change(speeds="60"))
    assert changed.computed.worst_speed_kmh == 60.0


def test_tables_and_report_name_the_vehicle_that_decides(tmp_path, of_two_vehicles):
    recording, verdict = recorded(tmp_path, of_two_vehicles), of_two_vehicles[-1]
    export_tables(tmp_path / "bag", tmp_path / "tables", ["csv"])
    with (tmp_path / "tables" / "verdicts.csv").open(encoding="utf-8") as verdicts:
        assert [row["vehicle"] for row in csv.DictReader(verdicts)] == [verdict.vehicle]
    with (tmp_path / "tables" / "force_maps.csv").open(encoding="utf-8") as maps:
        assert {row["vehicle"] for row in csv.DictReader(maps)} == {"passenger", "freight-22.5t"}
    (record,) = records_of_recording(recording, None, load_limits())
    provenance = dict(content(record)["provenance"])
    assert provenance["vehicle"] == f"{verdict.vehicle}, which decides of 2"


def test_a_verdict_of_the_vehicle_that_does_not_decide_is_found(tmp_path, of_two_vehicles):
    *rest, verdict = of_two_vehicles
    other = next(m for m in rest[4:] if m.config_sha256 != verdict.config_sha256)
    fields = {name: getattr(judge(other, load_limits()), name) for name in verdict.__struct_fields__}
    found = differences(recorded(tmp_path, [*rest, msgspec.structs.replace(verdict, **fields)]))
    assert f"verdict: vehicle that decides was {other.vehicle}, is {verdict.vehicle}" in found


def test_a_verdict_without_the_map_of_a_vehicle_is_reported(tmp_path, of_two_vehicles):
    verdict = of_two_vehicles[-1]
    without = [m for m in of_two_vehicles if not isinstance(m, ForceMap) or m.config_sha256 == verdict.config_sha256]
    recording = recorded(tmp_path, without)
    assert differences(recording) == ["verdict: not every vehicle's force map was recorded for this verdict"]
    assert records_of_recording(recording, load_limits(), load_limits()) == []


def test_settings_missing_from_the_bag_are_named(tmp_path, messages):
    found = differences(recorded(tmp_path, messages[1:]))
    assert found[0] == "force_map: its simulation settings are not in the recording"


def test_a_verdict_that_cannot_be_judged_is_reported_and_ends_nothing(tmp_path, messages):
    recording = recorded(tmp_path, messages)
    recording.limits = {
        sha256: msgspec.structs.replace(limits, limits=[]) for sha256, limits in recording.limits.items()
    }
    (found,) = differences(recording)
    assert found.startswith("verdict: no limit can be applied")


def test_a_message_that_breaks_the_contract_is_reported_and_the_rest_replayed(tmp_path, messages):
    broken = changed(messages, "ForceHistory", speed_kmh=float("nan"))
    found = differences(recorded(tmp_path, broken, damaged=True))
    assert len(found) == 1
    assert found[0].startswith("message: ")


def test_a_bag_of_somebody_else_is_refused(tmp_path):
    with Recorder(tmp_path / "bag") as recorder:
        recorder.write("/chatter", STRING, string_cdr("hello"), log_time_ns=1, publish_time_ns=1)
    with pytest.raises(BagError, match="no message of this suite"):
        open_recording(tmp_path / "bag")


def test_a_cut_bag_is_replayed_up_to_the_cut(tmp_path, messages):
    recorded(tmp_path, messages)
    whole = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * 0.97)])
    recording = open_recording(cut)
    assert recording.damage
    assert differences(recording) == []


def test_a_map_keeps_its_direction_and_support_whatever_is_stated_of_the_weld_since(tmp_path):
    settings = simulation_settings(track="bilbao-viscous", speeds_kmh=[60, 120], positions=[0.1, 0.4], support="0=0.02")
    limits, simulator, profile = load_limits(), Simulator(settings), read_profile(find("weld-4-steep-ramp"))
    stated = msgspec.structs.replace(profile, running="against", support=parse_support("none"))
    for name, first, then in (("hangs", profile, stated), ("rests", stated, profile)):
        done = assess(first, simulator, limits)
        recording = recorded(tmp_path / name, [settings, limits, first, done.force_map, done.verdict, then])
        assert differences(recording) == []


@pytest.mark.parametrize("engine", ["common-poles", "rfp", "reference"])
def test_the_engine_is_recorded_and_computes_again_on_replay(tmp_path, engine):
    settings = simulation_settings(
        track="johansson-nielsen", engine=engine, speeds_kmh=[150], positions=[0.2], hertz_n_per_m15=9e10
    )
    limits, profile = load_limits(), read_profile(find("wheel-flat-0.9mm"))
    done = assess(profile, Simulator(settings), limits)
    messages = [settings, limits, profile, done.force_map, done.history, done.verdict]
    recording = recorded(tmp_path, messages)
    assert [m.engine for m in recording.force_maps] == [engine]
    assert differences(recording) == []
    # Another engine's numbers are told apart.
    other = "rfp" if engine != "rfp" else "common-poles"
    foreign = simulation_settings(
        track="johansson-nielsen", engine=other, speeds_kmh=[150], positions=[0.2], hertz_n_per_m15=9e10
    )
    peaks = Simulator(foreign).force_map(profile).peak_force_n
    found = differences(recorded(tmp_path / "foreign", changed(messages, "ForceMap", peak_force_n=peaks)))
    assert any("peak_force_n differs" in difference for difference in found)
