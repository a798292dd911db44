"""`weld-force assess`: files and folders to verdicts, without ROS."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.end_to_end.test_imports import BLOCKED
from weld_force_ros.cli.main import main
from weld_force_ros.measurement.profile_file import find

QUICK = ("--track", "bilbao-viscous", "--speeds", "40:160:10", "--positions", "4", "--uncertainty-samples", "0")
STATED = (*QUICK, "--line-speed", "160", "--limits", "force,banenor-531")


def assess(capfd: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[dict]]:
    code = main(["assess", *map(str, arguments), "--json", "-"])
    return code, [json.loads(line) for line in capfd.readouterr().out.splitlines()]


def test_a_weld_gets_the_decision_of_both_answers(capfd):
    code, (bad, good) = assess(capfd, "weld-1-dip", "weld-5-ramp-protrusion", *STATED)
    assert code == 1
    assert (bad["decision"], bad["geometry"]["decision"], bad["force"]["decision"]) == ("grind", "grind", "grind")
    assert (good["decision"], good["geometry"]["decision"], good["force"]["decision"]) == ("accept",) * 3
    assert bad["geometry"]["rule_books"] == ["banenor-531"]
    assert bad["geometry"]["verified"]
    assert "Bane NOR" in bad["geometry"]["source"]
    assert not bad["force"]["verified"]
    assert bad["accepted_risk"] == 0.05


@pytest.mark.parametrize(
    ("weld", "fail_on", "code"),
    [("weld-5-ramp-protrusion", None, 0), ("weld-1-dip", None, 1), ("weld-1-dip", "grind", 1),
     ("weld-1-dip", "reject", 0)],
)  # fmt: skip
def test_scripts_choose_which_decisions_fail(capfd, weld: str, fail_on: str | None, code: int):
    assert assess(capfd, weld, *STATED, *(() if fail_on is None else ("--fail-on", fail_on)))[0] == code


def test_an_unknown_decision_to_fail_on_is_one_line(capfd):
    assert main(["assess", "weld-1-dip", "--fail-on", "colour"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "--fail-on" in line


def test_a_folder_is_its_finished_files_and_each_has_an_outcome(capfd, tmp_path: Path):
    for name in ("weld-1-dip", "weld-5-ramp-protrusion"):
        (tmp_path / f"{name}.csv").write_text(find(name).read_text())
    (tmp_path / "notes.csv").write_text("nothing to see")
    for unfinished in (".hidden.csv", "half.csv.part"):
        (tmp_path / unfinished).write_text("x")
    code, lines = assess(capfd, tmp_path, *STATED)
    assert code == 2
    assert [line.get("weld_id", line.get("source")) for line in lines] == [
        "notes.csv", "weld-1-dip", "weld-5-ramp-protrusion",
    ]  # fmt: skip


def test_a_weld_that_cannot_be_simulated_does_not_stop_the_others(capfd, tmp_path: Path):
    lost = tmp_path / "lost.csv"
    lost.write_text("# weld_position_m: 30\n" + find("weld-1-dip").read_text())
    code, (refused, judged) = assess(capfd, lost, "weld-5-ramp-protrusion", *STATED)
    assert code == 2
    assert "beyond the sleeper span" in refused["reason"]
    assert judged["decision"] == "accept"


def test_of_several_vehicles_the_one_that_decides_is_named(capfd):
    alone = {
        name: assess(capfd, "weld-2-rise-between-shrinkages", *STATED, "--vehicle", name)[1][0]
        for name in ("passenger", "locomotive")
    }
    gravest = max(alone.values(), key=lambda v: v["force"]["exceeding"])
    for several in (["passenger,locomotive"], ["passenger", "--vehicle", "locomotive"]):
        (both,) = assess(capfd, "weld-2-rise-between-shrinkages", *STATED, "--vehicle", *several)[1]
        assert both["vehicle"] == gravest["vehicle"]
        assert both["force"] == gravest["force"]


def test_a_command_of_one_vehicle_refuses_several(capfd):
    assert main(["simulate", "weld-1-dip", "--vehicle", "passenger", "--vehicle", "metro"]) == 2
    assert capfd.readouterr().err == (
        "weld-force: --vehicle: 2 vehicles; name one; `assess` judges a weld under several\n"
    )


def test_without_a_line_speed_the_first_thing_said_is_up_to_where_forces_hold(capfd):
    _, (verdict,) = assess(capfd, "weld-1-dip", *QUICK, "--limits", "force")
    assert verdict["decision"] == "undecided"
    assert verdict["force"]["reason"].startswith("the line's speed is not stated: forces are within limits up to ")
    assert "--line-speed" in verdict["measure_next"]


@pytest.mark.slow
def test_nothing_on_its_way_imports_ros_or_is_optional():
    program = BLOCKED + (
        "from weld_force_ros.cli.main import main\n"
        f"code = main({['assess', 'weld-5-ramp-protrusion', *STATED]!r})\n"
        "assert not OPTIONAL & sys.modules.keys(), OPTIONAL & sys.modules.keys()\n"
        "sys.exit(code)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
