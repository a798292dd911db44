"""A recording under other settings: what changes, what stays, and what cannot be said."""

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from tests.harness.limits import by_value
from weld_force_ros.assessment.judge import asks_of, judge
from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.messages import (
    TOPICS,
    ForceMap,
    Message,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
    encode,
    profile_sha256,
)
from weld_force_ros.recording import STRING, Recorder, string_cdr
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.recording.replay import replay
from weld_force_ros.recording.what_if import NotComputed, read_change, what_if
from weld_force_ros.simulation.settings import DEFAULT_TRACK, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

SPEEDS, POSITIONS = [60.0, 120.0], [0.1, 0.4]


def settings_of(**others: float) -> SimulationSettings:
    return simulation_settings(speeds_kmh=SPEEDS, positions=POSITIONS, **others)  # type: ignore[arg-type]


def assessed(profile: WeldProfile, settings: SimulationSettings) -> list[Message]:
    force_map = Simulator(settings).force_map(profile)
    return [profile, force_map, judge(force_map, by_value())]


@pytest.fixture(scope="module")
def weld() -> WeldProfile:
    return read_profile(find("weld-4-steep-ramp"))


@pytest.fixture(scope="module")
def messages(weld) -> list[Message]:
    settings = settings_of()
    return [settings, by_value(), *assessed(weld, settings)]


def recorded(folder: Path, messages: list[Message]) -> Recording:
    with Recorder(folder / "bag") as recorder:
        for n, message in enumerate(messages):
            data = string_cdr(encode(message).decode())
            recorder.write("/" + TOPICS[type(message)].name, STRING, data, log_time_ns=n, publish_time_ns=n)
    return open_recording(folder / "bag")


def without(messages: list[Message], kind: str) -> list[Message]:
    return [m for m in messages if type(m).__name__ != kind]


def half_as_high(weld: WeldProfile) -> WeldProfile:
    z_m = [z / 2 for z in weld.z_m]
    return replace(weld, z_m=z_m, profile_sha256=profile_sha256(weld.x_m, z_m))


def only(messages: list[Message], kind: type) -> list:
    return [m for m in messages if isinstance(m, kind)]


def limits_file(folder: Path, grind_above_n: float, reject_above_n: float) -> Path:
    path = folder / "limits.yaml"
    path.write_text(
        f"- {{name: peak_force, limit: {grind_above_n}, reject_limit: {reject_above_n}, unit: N, source: test}}\n"
    )
    return path


def test_fewer_speeds_leave_the_worst_of_those_that_remain(tmp_path, messages):
    (was,), (force_map,) = only(messages, Verdict), only(messages, ForceMap)
    (found,) = what_if(recorded(tmp_path, messages), read_change(speeds="60"))
    at_60 = force_map.peak_force_n[: len(POSITIONS)]
    assert found.recorded == was
    assert found.computed.peak_force_n == pytest.approx(max(at_60), rel=1e-6)
    assert found.computed.worst_speed_kmh == 60
    assert found.computed.worst_position_m == POSITIONS[at_60.index(max(at_60))]
    assert was.worst_speed_kmh == 120
    assert found.peak_force_change_percent == pytest.approx(100 * (max(at_60) - was.peak_force_n) / was.peak_force_n)


def test_other_limits_are_answered_by_simulating_what_the_curve_lacks(tmp_path, weld):
    simulator = Simulator(simulation_settings(track="bilbao-viscous", positions=3, running="with"))
    own, path = by_value(), limits_file(tmp_path, 135e3, 170e3)
    force_map = simulator.force_map(weld, asks_of(own))
    bag = recorded(tmp_path, [simulator.settings, own, weld, force_map, judge(force_map, own)])
    change = read_change(limits=str(path))
    (found,) = what_if(bag, change)
    assert found.computed == judge(simulator.force_map(weld), change.limits)
    assert judge(force_map, change.limits).advice_step_kmh > found.computed.advice_step_kmh == 1.0
    assert [one.differences for one in replay(bag)] == [(), ()]
    without_profile = [simulator.settings, own, force_map, judge(force_map, own)]
    (unknown,) = what_if(recorded(tmp_path / "without", without_profile), change)
    assert isinstance(unknown, NotComputed)


def test_another_track_keeps_the_recorded_wheel_speeds_and_positions(tmp_path, weld):
    wheel = {"wheel_mass_kg": 700.0, "static_load_n": 80e3, "wheel_radius_m": 0.5, "hertz_n_per_m15": 9e10}
    settings = settings_of(**wheel)
    bag = recorded(tmp_path, [settings, by_value(), *assessed(weld, settings)])
    (found,) = what_if(bag, read_change(track="johansson-nielsen"))
    *_, expected = assessed(weld, settings_of(track="johansson-nielsen", **wheel))
    assert found.computed == expected
    assert abs(found.peak_force_change_percent) > 1


def test_another_engine_is_the_one_that_computes(tmp_path, messages, weld):
    (found,) = what_if(recorded(tmp_path, messages), read_change(engine="rfp"))
    *_, expected = assessed(weld, settings_of(engine="rfp"))
    assert found.computed == expected
    assert found.computed.peak_force_n != found.recorded.peak_force_n


def test_the_recorded_settings_given_again_change_nothing(tmp_path, messages):
    (found,) = what_if(recorded(tmp_path, messages), read_change(track=DEFAULT_TRACK, speeds="60,120"))
    assert found.computed == found.recorded
    assert not found.decision_changed


@pytest.mark.parametrize(("grind", "reject", "decision"), [(0.9, 1.1, "grind"), (0.8, 0.9, "reject"), (2, 3, "accept")])
def test_other_limits_judge_the_recorded_forces_even_without_profile_and_settings(
    tmp_path, messages, grind, reject, decision
):
    (was,) = only(messages, Verdict)
    path = limits_file(tmp_path, grind * was.peak_force_n, reject * was.peak_force_n)
    bare = without(without(messages, "SimulationSettings"), "WeldProfile")
    (found,) = what_if(recorded(tmp_path, bare), read_change(limits=path))
    assert found.computed.decision == decision
    assert found.decision_changed == (decision != was.decision)
    assert found.peak_force_change_percent == 0
    assert found.computed.limits_sha256 != was.limits_sha256


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("SimulationSettings", "its simulation settings are not in the recording"),
        ("WeldProfile", "its profile is not in the recording"),
        ("AssessmentSettings", "its limits are not in the recording"),
        ("ForceMap", "its force map is not in the recording"),
        ("Verdict", "no verdict was recorded for this profile"),
    ],
)
def test_what_the_recording_lacks_is_named(tmp_path, messages, weld, kind, reason):
    bag = recorded(tmp_path, without(messages, kind))
    assert list(what_if(bag, read_change(speeds="60"))) == [NotComputed(weld.weld_id, reason)]


def test_a_rejected_profile_gets_no_verdict(tmp_path, messages, weld):
    refused = half_as_high(weld)
    rejections = [
        Rejection(source="a.csv", reason="no units", remedy="state them"),
        Rejection(source="b.csv", reason="not finite", remedy="look", profile_sha256=refused.profile_sha256),
    ]
    bag = recorded(tmp_path, [*messages, refused, *rejections])
    (found,) = what_if(bag, read_change(speeds="60"))
    assert found.recorded.profile_sha256 == weld.profile_sha256


def test_each_measurement_of_a_weld_is_compared_with_itself_and_of_a_repeated_one_the_last(tmp_path, messages, weld):
    again = assessed(half_as_high(weld), settings_of())
    bag = recorded(tmp_path, [*messages, *again, replace(messages[-1], sequence=7)])
    first, second = what_if(bag, read_change(speeds="60,120"))
    assert [first.weld_id, second.weld_id] == [weld.weld_id] * 2
    assert first.recorded.sequence == 7
    assert first.computed.peak_force_n == pytest.approx(messages[-1].peak_force_n)
    assert second.computed.peak_force_n == pytest.approx(again[-1].peak_force_n)


def test_of_several_settings_each_keeps_what_is_not_given(tmp_path, messages, weld):
    light = settings_of(static_load_n=80e3)
    bag = recorded(tmp_path, [*messages, light, *assessed(weld, light)])
    results = list(what_if(bag, read_change(speeds="60")))
    assert [r.computed.static_load_n for r in results] == [100e3, 80e3]
    assert [r.computed.judged_speed_kmh for r in results] == [60, 60]
    assert results[0].computed.peak_force_n > results[1].computed.peak_force_n


def test_welds_of_the_same_geometry_keep_their_own_line_speed(tmp_path, messages, weld):
    slow = replace(weld, weld_id="slow", line_speed_kmh=60.0)
    for n, profiles in enumerate(([weld, slow], [slow, weld])):
        told = [m for profile in profiles for m in assessed(profile, settings_of())]
        bag = recorded(tmp_path / str(n), [*messages[:2], *told])
        found = {r.weld_id: r.computed for r in what_if(bag, read_change(track="bilbao-viscous"))}
        assert {name: v.judged_speed_kmh for name, v in found.items()} == {weld.weld_id: 120, "slow": 60}


def test_positions_of_a_longer_span_lie_in_the_next_one(tmp_path, weld):
    settings = simulation_settings(track="johansson-nielsen", speeds_kmh=[60.0], positions=[0.62])
    bag = recorded(tmp_path, [settings, by_value(), *assessed(weld, settings)])
    (found,) = what_if(bag, read_change(track="bilbao"))
    wheel = {n: getattr(settings, n) for n in ("wheel_mass_kg", "static_load_n", "wheel_radius_m", "hertz_n_per_m15")}
    wrapped = simulation_settings(track="bilbao", speeds_kmh=[60.0], positions=[0.02], **wheel)
    *_, expected = assessed(weld, wrapped)
    assert found.computed.peak_force_n == pytest.approx(expected.peak_force_n, rel=1e-6)


def test_a_grid_grown_too_large_is_refused_before_anything_is_computed(tmp_path, weld):
    settings = simulation_settings(speeds_kmh=[60.0], positions=1000)
    bag = recorded(tmp_path, [settings, by_value(), weld])
    with pytest.raises(InputError, match="more than 200000 passages"):
        next(what_if(bag, read_change(speeds="20:320:1")))


def test_a_track_that_cannot_be_fitted_is_tried_once_and_said_for_every_weld(tmp_path, messages, weld, monkeypatch):
    bag = recorded(tmp_path, [*messages, *assessed(half_as_high(weld), settings_of())])
    tried = []

    def refuse(settings: SimulationSettings, **_: object) -> None:
        tried.append(settings.track)
        raise NumericalError("no usable fit")

    monkeypatch.setattr("weld_force_ros.recording.recomputation.Simulator", refuse)
    results = list(what_if(bag, read_change(track="bilbao-viscous")))
    assert results == [NotComputed(weld.weld_id, "no usable fit")] * 2
    assert tried == ["bilbao-viscous"]


def test_a_recorded_peak_of_nothing_makes_no_percentage(tmp_path, messages):
    bag = recorded(tmp_path, [*messages[:-1], replace(messages[-1], peak_force_n=0.0)])
    (found,) = what_if(bag, read_change(speeds="60"))
    assert isinstance(found, NotComputed)
    assert "not positive" in found.reason


def run(capfd: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[dict], str]:
    code = main([str(a) for a in arguments])
    out, err = capfd.readouterr()
    return code, [json.loads(line) for line in out.splitlines()], err


def test_the_command_shows_what_changes_first_and_exits_0(capfd, tmp_path, messages, weld):
    (was,) = only(messages, Verdict)
    calm = half_as_high(weld)
    (calm_verdict,) = only(told := assessed(calm, settings_of()), Verdict)
    rejection = Rejection(source="a.csv", reason="no units", remedy="state them")
    recorded(tmp_path, [*messages[:2], *told, *messages[2:], rejection])
    assert was.decision == calm_verdict.decision == "accept"
    between = (was.peak_force_n + calm_verdict.peak_force_n) / 2
    limits = limits_file(tmp_path, between, 2 * between)
    code, lines, err = run(capfd, "replay", tmp_path / "bag", "--what-if", "--limits", limits, "--json", "-")
    assert code == 0
    assert [line["decision_changed"] for line in lines] == [False, True]
    assert [line["computed"]["decision"] for line in lines] == ["accept", "grind"]
    assert [line["recorded"]["peak_force_n"] for line in lines] == [calm_verdict.peak_force_n, was.peak_force_n]
    rows = [line for line in err.splitlines() if weld.weld_id in line]
    assert "CHANGED" in rows[0]
    assert "ACCEPT → GRIND" in rows[0]
    assert f"{weld.weld_id} (2)" in rows[0]
    assert "CHANGED" not in rows[1]
    assert "verdicts that change: 1 of 2; not computed: 0; rejected, as recorded: 1" in err


def test_the_command_exits_1_if_a_verdict_could_not_be_computed(capfd, tmp_path, messages, weld):
    recorded(tmp_path, without(messages, "SimulationSettings"))
    code, lines, err = run(capfd, "replay", tmp_path / "bag", "--what-if", "--speeds", "60", "--json", "-")
    reason = "its simulation settings are not in the recording"
    assert (code, lines) == (1, [{"weld_id": weld.weld_id, "reason": reason}])
    assert f"NOT COMPUTED {weld.weld_id}: {reason}" in err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--what-if"], "--track, --speeds, --engine or --limits"),
        (["--what-if", "--verify", "--speeds", "60"], "exclude"),
        (["--speeds", "60"], "add --what-if"),
        (["--verify", "--track", "bilbao"], "add --what-if"),
        (["--what-if", "--track", "nowhere.yaml"], "nowhere.yaml"),
        (["--what-if", "--speeds", "fast"], "FIRST:LAST:STEP"),
        (["--what-if", "--speeds", "1:1001:0.5"], "speeds"),
        (["--what-if", "--engine", "magic"], "common-poles"),
        (["--what-if", "--limits", "no-limits.yaml"], "no-limits.yaml"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(capfd, tmp_path, messages, arguments, part):
    recorded(tmp_path, messages)
    code, lines, err = run(capfd, "replay", tmp_path / "bag", *arguments, "--json", "-")
    assert (code, lines) == (2, [])
    assert err.startswith("weld-force: ")
    assert err.count("\n") == 1
    assert part in err
