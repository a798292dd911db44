import contextlib
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import platformdirs
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from weld_force_ros.assessment.judge import assess, deciding_history, judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Limit,
    SimulationSettings,
    Stamp,
    Verdict,
    WeldProfile,
    config_sha256,
    decode,
    encode,
    profile_sha256,
)
from weld_force_ros.simulation.settings import DEFAULT_SPEEDS, parse_positions, parse_speeds, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.track_file import load

SPEEDS, POSITIONS = [40.0, 90.0, 140.0], [0.0, 0.2, 0.4]


def profile(depth_m: float = 0.1e-3, **known: float | str) -> WeldProfile:
    x = np.linspace(-0.1, 0.1, 201)
    z = cosine_dip(x, 0.2, depth_m).tolist()
    sha = profile_sha256(x.tolist(), z)
    return WeldProfile(weld_id="by hand", source="test", x_m=x.tolist(), z_m=z, profile_sha256=sha, **known)


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(
        simulation_settings(track="johansson-nielsen", speeds_kmh=SPEEDS, positions=POSITIONS, running="with")
    )


@pytest.fixture(scope="module")
def force_map(simulator: Simulator) -> ForceMap:
    return simulator.force_map(profile())


increasing = st.lists(st.floats(0.1, 1000.0), min_size=1, max_size=20, unique=True).map(sorted)


@given(increasing)
@settings(deadline=None)
def test_listed_numbers_come_back(numbers: list[float]):
    text = ",".join(map(repr, numbers))
    assert parse_speeds(text) == numbers
    assert parse_positions(text) == numbers


@given(st.integers(1, 300), st.integers(0, 50), st.sampled_from([0.1, 0.25, 0.5, 1, 2.5, 5]))
@settings(deadline=None)
def test_range_of_speeds_includes_its_last(first: int, steps: int, step: float):
    speeds = parse_speeds(f"{first}:{first + steps * step!r}:{step}")
    assert speeds == pytest.approx([first + i * step for i in range(steps + 1)])


def test_range_stops_before_what_it_would_pass():
    assert parse_speeds("20:32:5") == [20.0, 25.0, 30.0]
    assert parse_speeds(DEFAULT_SPEEDS) == list(np.arange(20.0, 301.0, 5.0))


@given(st.integers(1, 1000))
def test_whole_number_of_positions_is_a_count(count: int):
    assert parse_positions(f" {count} ") == count


def test_number_with_a_point_is_a_place():
    assert parse_positions("15.") == [15.0]
    assert parse_positions("0.15,0.30") == [0.15, 0.30]


@pytest.mark.parametrize(
    "text",
    ["", "fast", "20:300", "20:300:5:1", "20:10:5", "20:300:0", "20:300:-5", "80,40", "80,80", "0", "-5,10", "40,,80"],
)
def test_speeds_out_of_form_or_order_are_refused(text: str):
    with pytest.raises(InputError, match=r"FIRST:LAST:STEP"):
        parse_speeds(text)


@pytest.mark.parametrize(
    "text", ["nan", "40,inf", "1e999", "inf:inf:1", "1:inf:1", "1:2:inf", "nan:2:1", "1:1e9:1e-9", "²"]
)
def test_speeds_without_bounds_are_refused(text: str):
    with pytest.raises(InputError, match=r"FIRST:LAST:STEP"):
        parse_speeds(text)


@pytest.mark.parametrize(
    "text",
    ["", "all", "0", "1001", "9" * 5000, "²", "0.3,0.1", "nan", "inf", "0.1,0.1", "0.1,"],
    ids=lambda text: text[:9],
)
def test_positions_that_cannot_be_simulated_are_refused(text: str):
    with pytest.raises(InputError, match=r"whole number of steps"):
        parse_positions(text)


@given(st.text("0123456789.,:-+eainf²", max_size=12))
@settings(deadline=None)
def test_arbitrary_axis_text_is_read_or_refused(text: str):
    for parse in (parse_speeds, parse_positions):
        with contextlib.suppress(InputError):
            parse(text)


def test_count_of_positions_divides_the_tracks_span():
    found = simulation_settings(track="johansson-nielsen", positions=5)
    assert found.positions_m == pytest.approx([0.0, 0.13, 0.26, 0.39, 0.52])


def test_wheel_is_the_tracks_unless_given():
    own = load("johansson-nielsen").wheel
    found = simulation_settings(track="johansson-nielsen", wheel_mass_kg=800.0)
    assert (found.wheel_mass_kg, found.static_load_n) == (800.0, own.static_load_n)
    assert (found.wheel_radius_m, found.hertz_n_per_m15) == (own.radius_m, own.hertz_n_per_m15)


@pytest.mark.parametrize(
    "wrong",
    [
        {"track": "nowhere"},
        {"engine": "guess"},
        {"engine": "magic"},
        {"wheel_mass_kg": 0.0},
        {"wheel_radius_m": float("nan")},
        {"wheel_radius_m": 5.0},
        {"static_load_n": -1.0},
        {"hertz_n_per_m15": float("inf")},
        {"speeds_kmh": []},
        {"speeds_kmh": [80.0, 40.0]},
        {"speeds_kmh": [1e4]},
        {"positions": 0},
        {"positions": [float("nan")]},
        {"speeds_kmh": [1.0 + i / 10 for i in range(1000)], "positions": 201},
    ],
    ids=str,
)
def test_settings_that_cannot_be_simulated_are_refused(wrong: dict):
    with pytest.raises(InputError) as caught:
        simulation_settings(**wrong)
    assert "\n" not in str(caught.value)


def test_hash_of_settings_follows_their_content_and_not_their_header():
    plain = simulation_settings(speeds_kmh=SPEEDS)
    again = simulation_settings(speeds_kmh=SPEEDS)
    again.sequence, again.stamp, again.publisher = 7, Stamp(sec=5), "/simulator"
    assert config_sha256(again) == plain.config_sha256
    for field, value in {
        "track": "x", "track_definition": "y", "engine": "rfp", "speeds_kmh": [1.0], "positions_m": [0.1],
        "wheel_mass_kg": 1.0, "static_load_n": 1.0, "wheel_radius_m": 0.4, "hertz_n_per_m15": 1.0,
    }.items():  # fmt: skip
        changed = msgspec.structs.replace(plain, **{field: value})
        assert config_sha256(changed) != plain.config_sha256, field


@pytest.mark.slow
def test_settings_alone_replay_the_identical_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    path = tmp_path / "mine.yaml"
    path.write_text(load("bilbao-continuous").text.replace("name: bilbao-continuous", "name: mine"))
    first = simulation_settings(track=str(path), speeds_kmh=SPEEDS, positions=1, wheel_mass_kg=700.0)
    recorded = encode(first)
    before = Simulator(first).force_map(profile())
    path.unlink()
    after = Simulator(decode(SimulationSettings, recorded)).force_map(profile())
    after.elapsed_s = before.elapsed_s
    assert encode(after) == encode(before)


def test_map_carries_what_is_known_of_the_weld(simulator: Simulator):
    known = profile(line_speed_kmh=100.0, weld_position_m=0.1, chainage_m=12.5, rail="left")
    found = simulator.force_map(known)
    encode(found)
    assert (found.weld_id, found.profile_sha256) == ("by hand", known.profile_sha256)
    assert (found.line_speed_kmh, found.weld_position_m, found.chainage_m, found.rail) == (100.0, 0.1, 12.5, "left")
    assert (found.config_sha256, found.span_m) == (simulator.settings.config_sha256, 0.65)


def test_map_is_row_major_in_speed(simulator: Simulator, force_map: ForceMap):
    alone = Simulator(
        simulation_settings(track="johansson-nielsen", speeds_kmh=[90.0], positions=[0.4], running="with")
    )
    assert alone.force_map(profile()).peak_force_n == [force_map.peak_force_n[1 * 3 + 2]]


def test_several_threads_may_share_a_simulator(simulator: Simulator, force_map: ForceMap):
    found: list[ForceMap] = []
    threads = [threading.Thread(target=lambda: found.append(simulator.force_map(profile()))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert [m.peak_force_n for m in found] == [force_map.peak_force_n] * 3


def test_assessment_is_map_worst_history_and_verdict(simulator: Simulator, force_map: ForceMap):
    known = profile(line_speed_kmh=100.0, chainage_m=12.5, rail="left")
    limits = load_limits()
    found = assess(known, simulator, limits)
    for message in (found.force_map, found.history, found.verdict):
        encode(message)
    worst = max(force_map.peak_force_n[: 2 * 3])  # 140 km/h is above the line's speed
    place = force_map.peak_force_n.index(worst)
    verdict = found.verdict
    assert verdict.peak_force_n == worst
    assert (verdict.worst_speed_kmh, verdict.worst_position_m) == (SPEEDS[place // 3], POSITIONS[place % 3])
    assert (verdict.judged_speed_kmh, verdict.chainage_m, verdict.rail) == (90.0, 12.5, "left")
    assert verdict.limits_sha256 == limits.limits_sha256
    assert [c.name for c in verdict.criteria] == [limit.name for limit in limits.limits]
    assert not any(c.verified for c in verdict.criteria)
    history = found.history
    assert (history.speed_kmh, history.position_m) == (verdict.worst_speed_kmh, verdict.worst_position_m)
    assert max(history.force_n) == pytest.approx(worst, rel=1e-3)
    assert history.x_m[np.argmax(history.force_n)] == pytest.approx(verdict.worst_x_m, abs=2e-3)


def test_history_goes_up_over_what_is_up(simulator: Simulator):
    rise: ForceHistory = simulator.force_history(profile(depth_m=-0.2e-3), 40.0, 0.2)
    x, irregularity = np.array(rise.x_m), np.array(rise.irregularity_m)
    assert irregularity.max() == pytest.approx(0.2e-3, rel=5e-3)  # the contact patch averages over the crest
    assert x[irregularity.argmax()] == pytest.approx(0.2, abs=2e-3)
    far, on_top = np.argmin(np.abs(x)), np.argmin(np.abs(x - 0.2))
    assert rise.wheel_m[on_top] > rise.wheel_m[far]
    assert max(rise.rail_m) < 0.0  # the load presses the rail down


def test_unknown_facts_stay_absent_in_the_verdict(force_map: ForceMap):
    verdict: Verdict = judge(force_map, load_limits())
    assert verdict.chainage_m is UNSET
    assert b"chainage_m" not in encode(verdict)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("- {name: colour, limit: 1, reject_limit: 2, unit: N, source: s}", "'colour' names no criterion"),
        ("- {name: peak_force, limit: 3, reject_limit: 2, unit: N, source: s}", "reject_limit is below limit"),
        ("- {name: peak_force, limit: .nan, reject_limit: 2, unit: N, source: s}", "limit"),
        ("- {name: peak_force, limit: 1, unit: N}", "source is missing"),
        ("- {name: peak_force, limit: 1, unit: N, source: {text: t}}", "source: .*kind"),
        ("- {name: peak_force, limit: 1, unit: N, source: {text: t, kind: rumour}}", "source: .*rumour"),
        ("- {name: peak_force, limit: 1, unit: N, source: {text: , kind: standard}}", "nothing stands behind text"),
        ("- {name: peak_force, limit: 1, unit: N, source: s, verified: true}", "verified_by"),
        ("- {name: peak_force, limit: 1, unit: N, source: s, verified_by: {by: me}}", "date"),
        ("- {name: peak_force, limit: 1, unit: N, source: s, rule_book: mine}", "rule_book is unknown"),
        ("{name: mine, limits: [], template: why}", "without numbers"),
        ("[]", "limits"),
        ("- &a [*a]", "anchors"),
        ("[" * 50_000, "nested"),
        ("\0", "characters are not allowed"),
    ],
    ids=lambda text: text[:40],
)
def test_limits_that_cannot_be_used_are_refused(text: str, complaint: str, tmp_path: Path):
    path = tmp_path / "limits.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        load_limits(path)
    assert "\n" not in str(caught.value)


def test_missing_limits_file_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.yaml"):
        load_limits(tmp_path / "none.yaml")


def test_own_limits_decide(force_map: ForceMap, tmp_path: Path):
    path = tmp_path / "limits.yaml"
    path.write_text(
        "- {name: peak_force, limit: 1.0, reject_limit: 2.0, unit: N, source: ours, "
        "verified_by: {by: A. Name, date: 2026-11-28, document: our rules}}\n"
    )
    verdict = judge(force_map, load_limits(path))
    assert verdict.decision == "reject"
    assert (verdict.criteria[0].source, verdict.criteria[0].verified) == ("ours", True)


@pytest.mark.parametrize(("name", "limit"), [("unloading", 1e-3), ("contact_loss", 1e-9), ("p2_force", 1.0)])
def test_the_history_is_that_of_the_passage_that_decided(simulator: Simulator, name: str, limit: float):
    rule = Limit(name=name, limit=limit, reject_limit=2 * limit, unit="", source="by hand")
    limits = AssessmentSettings(limits_sha256="0" * 64, limits=[rule])
    deep = profile(depth_m=1.5e-3)
    found = assess(deep, simulator, limits)
    (criterion,) = found.verdict.criteria
    assert (found.history.speed_kmh, found.history.position_m) == (criterion.speed_kmh, criterion.position_m)
    again = deciding_history(deep, simulator, found.force_map, limits)
    assert again.force_n == found.history.force_n
    by_peak = deciding_history(deep, simulator, found.force_map)
    assert (by_peak.speed_kmh, by_peak.position_m) == (found.verdict.worst_speed_kmh, found.verdict.worst_position_m)


def test_the_history_of_a_weld_that_its_geometry_decides_on_is_that_of_the_highest_peak(simulator: Simulator):
    rule = Limit(name="straightedge", limit=1e-9, reject_limit=1.0, unit="m", source="by hand")
    found = assess(profile(), simulator, AssessmentSettings(limits_sha256="0" * 64, limits=[rule]))
    assert found.verdict.decision == "grind"
    assert (found.history.speed_kmh, found.history.position_m) == (
        found.verdict.worst_speed_kmh, found.verdict.worst_position_m,
    )  # fmt: skip


def test_each_weld_of_a_batch_took_its_own_share_of_the_time(simulator: Simulator):
    welds = [profile(depth_m=depth * 1e-5) for depth in range(1, 17)]
    began = time.perf_counter()
    took = [force_map.elapsed_s for force_map in simulator.force_maps(welds)]
    total = time.perf_counter() - began
    assert min(took) > 0.0
    assert sum(took) <= total
    assert max(took) < total / 2  # not the whole batch's on the first


@pytest.mark.parametrize("engine", ["common-poles", "reference"])
def test_a_simulator_of_one_thread_starts_no_other(engine: str, monkeypatch: pytest.MonkeyPatch):
    simulator = Simulator(
        simulation_settings(track="bilbao-viscous", engine=engine, speeds_kmh=[80.0], positions=[0.1]), threads=1
    )
    monkeypatch.setattr(threading.Thread, "start", lambda thread: pytest.fail(f"{thread.name} was started"))
    assert len(list(simulator.force_maps([profile(), profile(depth_m=0.2e-3)]))) == 2
