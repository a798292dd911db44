"""The command line as a shell sees it: exit codes, one line for bad input, clean standard output."""

import json
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.main import get_command

from weld_force_ros import SOFTWARE
from weld_force_ros.cli.main import app, main
from weld_force_ros.measurement.shapes import REFERENCE_SHAPES
from weld_force_ros.messages import SCHEMAS, ForceMap, Verdict, decode, json_schema
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.simulation.settings import DEFAULT_TRACK

NEEDS_ROS = pytest.mark.skipif(find_spec("rclpy") is None, reason="without ROS, that is what is said")
QUICK = ["--speeds", "60,120", "--positions", "0.1,0.4"]
BAG = Path(__file__).parents[2] / "bags" / "demo"
BAG_OF_1_2 = Path(__file__).parents[1] / "data" / "demo-1.2"  # three of its welds
BAG_OF_1_1 = Path(__file__).parents[1] / "data" / "demo-1.1"  # as version 1.1 of the contract recorded it


def run(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str], str]:
    code = main(list(arguments))
    out, err = capfd.readouterr()
    return code, out.splitlines(), err


def bad_profile(folder: Path) -> Path:
    path = folder / "no-units.csv"
    path.write_text("x,z\n" + "".join(f"{i},0\n" for i in range(30)))
    return path


def test_simulate_writes_one_force_map_a_profile_and_nothing_else_to_stdout(capfd):
    code, lines, err = run(capfd, "simulate", "weld-1-dip", "cosine-dip-48mm", *QUICK, "--json", "-")
    maps = [decode(ForceMap, line) for line in lines]
    assert code == 0
    assert [m.weld_id for m in maps] == ["weld-1-dip", "cosine-dip-48mm"]
    assert all(m.speeds_kmh == [60.0, 120.0] and m.positions_m == [0.1, 0.4] for m in maps)
    assert "weld-1-dip" in err


def test_simulate_takes_a_file_of_the_users_own_and_writes_json_and_picture(capfd, tmp_path):
    profile = tmp_path / "mine.txt"
    profile.write_text("\n".join("0" for _ in range(30)) + "\n")
    target, picture = tmp_path / "map.jsonl", tmp_path / "map.png"
    stated = ["--x-unit", "mm", "--z-unit", "um", "--z-positive", "up", "--spacing", "5", "--noise", "none"]
    code, lines, _ = run(
        capfd, "simulate", str(profile), *stated, *QUICK, "--json", str(target), "--plot", str(picture)
    )
    force_map = decode(ForceMap, target.read_text())
    assert code == 0
    assert any(line.startswith("mine ") for line in lines)
    assert picture.read_bytes().startswith(b"\x89PNG")
    # A smooth rail: the peak stays near the static load.
    assert max(force_map.peak_force_n) < 1.1 * force_map.static_load_n


def test_a_whole_number_of_positions_divides_the_span_and_a_point_makes_metres(capfd):
    _, steps, _ = run(capfd, "simulate", "cosine-dip-48mm", "--speeds", "80", "--positions", "3", "--json", "-")
    _, metres, _ = run(capfd, "simulate", "cosine-dip-48mm", "--speeds", "80", "--positions", "0.3", "--json", "-")
    assert decode(ForceMap, steps[0]).positions_m == pytest.approx([0.0, 0.2, 0.4])
    assert decode(ForceMap, metres[0]).positions_m == [0.3]


def test_the_wheel_given_on_the_command_line_is_the_one_that_rolls(capfd):
    wheel = ["--wheel-mass", "0.7t", "--static-load", "80 kN", "--wheel-radius", "500mm", "--hertz", "9e10"]
    _, lines, _ = run(capfd, "simulate", "cosine-dip-48mm", *QUICK, *wheel, "--json", "-")
    force_map = decode(ForceMap, lines[0])
    assert force_map.static_load_n == 80000.0
    assert 80e3 < max(force_map.peak_force_n) < 160e3


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ([], "Missing command"),
        (["bag"], "Missing command"),
        (["frobnicate"], "No such command"),
        (["simulate"], "profiles"),
        (["simulate", "weld-1-dip", "--nope"], "No such option"),
        (["simulate", "weld-9"], "weld-1-dip"),
        (["simulate", "weld-1-dip", "--speeds", "fast"], "FIRST:LAST:STEP"),
        (["simulate", "weld-1-dip", "--speeds", "80,40"], "increasing"),
        (["simulate", "weld-1-dip", "--speeds", "0,40"], "positive"),
        (["simulate", "weld-1-dip", "--positions", "nan"], "finite"),
        (["simulate", "weld-1-dip", "--positions", "0"], "1 to 1000"),
        (["simulate", "weld-1-dip", "--track", "nowhere.yaml"], "johansson-nielsen"),
        (["simulate", "weld-1-dip", "--engine", "magic"], "common-poles"),
        (["simulate", "weld-1-dip", "--wheel-mass", "-5"], "positive"),
        (
            ["simulate", "weld-1-dip", *QUICK, "--json", "/proc/none/map.json"],
            "there is no folder /proc/none; make it first",
        ),
        (["simulate", "weld-1-dip", "--static-load", "9 tons"], "--static-load '9 tons' cannot be read; write 100kN"),
        (["grind", "weld-1-dip", "--hand-margin", "0.03"], "--hand-margin 30 mm"),
        (["simulate", "weld-1-dip", *QUICK, "--plot", "map.tiffany"], ".png"),
        (["receptance", "--at", "x"], "--at"),
        (["receptance", "--freq", "0"], "above 0"),
        (["receptance", "--engine", "magic"], "exact"),
        (["fit", "nowhere.yaml"], "nowhere.yaml"),
        (["replay"], "Missing command"),
        (["replay", "no-bag"], "no-bag"),
        (["replay", "no-bag", "--verify"], "no-bag"),
        (["simulate", "weld-1-dip", "--uncertainty", "4", "--unknown", "/nope"], "/nope"),
        (["bag", "info", "no-bag"], "no-bag"),
        pytest.param(["node", "conductor"], "simulator", marks=NEEDS_ROS),
        pytest.param(["node", "profile", "folder"], "--ros-args", marks=NEEDS_ROS),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(capfd, arguments, part):
    code, lines, err = run(capfd, *arguments)
    assert (code, lines) == (2, [])
    assert err.startswith("weld-force: ")
    assert err.count("\n") == 1
    assert len(err) < 350  # the names of all bundled tracks
    assert part in err
    assert "Traceback" not in err


def test_a_bad_profile_among_good_ones_costs_only_itself(capfd, tmp_path):
    code, lines, err = run(capfd, "simulate", str(bad_profile(tmp_path)), "weld-1-dip", *QUICK, "--json", "-")
    assert code == 2
    assert [decode(ForceMap, line).weld_id for line in lines] == ["weld-1-dip"]
    assert "no-units.csv" in err
    assert "x_unit" in err


def test_receptance_is_a_row_major_matrix_of_the_exact_track(capfd):
    from weld_force_ros.physics.track.beam import receptance
    from weld_force_ros.simulation import track_file

    code, lines, _ = run(capfd, "receptance", "--track", "bilbao", "--at", "0.0,0.30", "--freq", "50,100,200",
                         "--json", "-")  # fmt: skip
    (answer,) = map(json.loads, lines)
    exact = receptance(track_file.load("bilbao").track, [50, 100, 200], [0.0, 0.3])
    assert code == 0
    assert list(answer) == ["track", "engine", "at_m", "frequency_hz", "real_m_per_n", "imag_m_per_n"]
    assert answer["real_m_per_n"] == pytest.approx(exact.real.ravel().tolist())
    assert answer["imag_m_per_n"] == pytest.approx(exact.imag.ravel().tolist())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "old", "verdicts"),
    [
        (["verify", str(BAG)], False, 8),
        (["verify", str(BAG_OF_1_2)], False, 3),
        ([str(BAG_OF_1_1), "--verify"], True, 9),
    ],
    ids=["demo", "demo-1.2", "demo-1.1 by the flag of the last release"],
)
def test_replay_of_the_demos_bags_finds_every_verdict_equal(capfd, arguments, old, verdicts):
    code, lines, err = run(capfd, "replay", *arguments, "--json", "-")
    results = [json.loads(line) for line in lines]
    assert code == 0, err
    assert sum(r["kind"] == "verdict" for r in results) == verdicts
    assert all(r["equal"] for r in results)
    assert ("the old spelling goes" in err) == old


@pytest.mark.slow
def test_replay_without_verify_prints_the_verdicts_computed_again(capfd):
    code, lines, _ = run(capfd, "replay", str(BAG_OF_1_1), "--json", "-")
    assert code == 0
    assert {decode(Verdict, line).weld_id for line in lines} == set(REFERENCE_SHAPES)


def test_replay_what_if_is_a_command_with_options_of_its_own(capfd):
    code, lines, err = run(capfd, "replay", "what-if", str(BAG_OF_1_1), "--speeds", "60,80", "--json", "-")
    assert (code, len(lines)) == (0, 9)
    assert "old spelling" not in err
    assert "What if: --speeds 60,80" in err
    assert run(capfd, "replay", "what-if", str(BAG_OF_1_1))[0] == 2


@pytest.mark.parametrize("option", ["--uncertainty-samples", "--uncertainty"])
def test_samples_are_asked_for_in_the_new_spelling_and_in_the_old(capfd, option):
    code, lines, err = run(capfd, "simulate", "weld-1-dip", *QUICK, option, "2", "--json", "-")
    assert code == 0
    assert len(decode(ForceMap, lines[0]).spread.support_factor) == 2
    assert ("--uncertainty is now spelt --uncertainty-samples" in err) == (option == "--uncertainty")


def test_old_spellings_are_not_in_the_help(capfd):
    for command in (["simulate"], ["up"], ["replay", "verdicts"]):
        help_text = " ".join(run(capfd, *command, "--help")[1])
        assert not any(f" {old} " in help_text for old in ("--uncertainty", "--unknown", "--verify", "--what-if"))


def test_option_groups_show_each_option_once_and_arrive_as_objects(capfd):
    for command in ("simulate", "grind", "up"):
        help_text = " ".join(run(capfd, command, "--help")[1])
        assert all(help_text.count(f" {option} ") == 1 for option in ("--track", "--engine", "--wheel-mass"))


def test_help_names_the_track_that_is_taken_where_none_is_given(capfd):
    for command in ("assess", "simulate", "demo", "receptance"):
        assert f"default: {DEFAULT_TRACK}." in " ".join(" ".join(run(capfd, command, "--help")[1]).split())


def test_benchmarks_are_said_to_need_a_clone_where_there_is_none(capfd, tmp_path, monkeypatch):
    monkeypatch.setattr("weld_force_ros.__file__", str(tmp_path / "site-packages" / "weld_force_ros" / "__init__.py"))
    code, lines, err = run(capfd, "bench", "--quick")
    assert (code, lines, err.count("\n")) == (2, [], 1)
    assert "in a clone" in err


def test_bag_info_counts_what_the_demo_recorded(capfd):
    code, lines, _ = run(capfd, "bag", "info", str(BAG), "--json", "-")
    (found,) = map(json.loads, lines)
    counts = {t["topic"]: t["message_count"] for t in found["topics"]}
    assert code == 0
    assert counts["/verdict"] == counts["/force_map"] == counts["/weld_profile"] == len(open_recording(BAG).verdicts)
    assert found["closed"]
    assert found["indexed"]


def test_schemas_in_the_repository_are_the_contracts(tmp_path, capfd):
    committed = Path(__file__).parents[2] / "msgs_json"
    assert run(capfd, "schema", "--write", str(tmp_path))[0] == 0
    assert {f.name: f.read_bytes() for f in tmp_path.iterdir()} == {f.name: f.read_bytes() for f in committed.iterdir()}
    assert {f.stem for f in committed.iterdir()} == {kind.__name__ for kind in SCHEMAS}


def test_schema_to_stdout_is_one_json_line_a_message(capfd):
    _, lines, _ = run(capfd, "schema")
    assert [json.loads(line) for line in lines] == [json_schema(kind) for kind in SCHEMAS]


def test_the_installed_command_works_from_any_folder_and_survives_a_closed_pipe(tmp_path):
    command = Path(sys.executable).parent / "weld-force"
    piped = (
        f"{command} simulate weld-1-dip weld-2-rise-between-shrinkages --speeds 80 --positions 1 --json - | head -c 1"
    )
    done = subprocess.run(["bash", "-o", "pipefail", "-c", piped], cwd=tmp_path, capture_output=True, timeout=120)
    assert b"Traceback" not in done.stderr
    assert done.stdout == b"{"


def test_help_lists_every_command_once_by_what_one_wants_to_do(capfd):
    assert main(["-h"]) == 0
    listed = re.findall(r"^  ([a-z]+)  +\S", capfd.readouterr().out.partition("Assess:")[2], re.MULTILINE)
    assert sorted(listed) == sorted(get_command(app).commands)
    assert "..." not in listed


def test_version_is_one_line(capfd):
    assert main(["--version"]) == 0
    assert capfd.readouterr() == (f"{SOFTWARE}\n", "")
