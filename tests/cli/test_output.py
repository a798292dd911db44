"""What a shell gets of each command: results on standard output, at any width, as table, CSV or JSON lines."""

import csv
import io
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from weld_force_ros.cli.main import main

DEMO = str(Path(__file__).parents[2] / "bags" / "demo")
EXPORT = str(Path(__file__).parents[1] / "data" / "instrument_files" / "railprof.txt")
QUICK = ("--track", "bilbao-viscous", "--speeds", "80,160", "--positions", "2", "--uncertainty-samples", "0")
WITH_TABLES = {
    "simulate": ("simulate", "weld-1-dip", "weld-2-rise-between-shrinkages", *QUICK),
    "inspect": ("inspect", EXPORT),
    "show": ("show", DEMO),
    "show of a weld": ("show", DEMO, "weld-4-steep-ramp"),
    "limits list": ("limits", "list"),
    "limits check": ("limits", "check", "banenor-532-joint"),
    "bag info": ("bag", "info", DEMO),
    "receptance": ("receptance", "--at", "0.0,0.3", "--freq", "50,100"),
}


def run(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(list(arguments)) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    return printed.out


@pytest.mark.parametrize("command", WITH_TABLES.values(), ids=WITH_TABLES.keys())
def test_tables_hold_every_word_whole_at_any_width(
    command: tuple[str, ...], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    main([*command, "--as", "csv"])
    headings, *rows = csv.reader(io.StringIO(capfd.readouterr().out.partition("\n\n")[0]))
    words = {word for row in rows for cell in row[: len(headings) - ("why" in headings)] for word in cell.split()}
    for columns in (80, 120):
        monkeypatch.setenv("COLUMNS", str(columns))
        lines = run(capfd, *command).splitlines()
        shown = set(" ".join(lines).split())
        assert {word for word in words if len(word) <= 30} <= shown
        as_grid = any(line.startswith("──") for line in lines)
        assert not as_grid or {word for heading in headings for word in heading.split()} - {"why"} <= shown
        assert all(len(line) <= columns for line in lines if "/" not in line)
        assert all(line == line.rstrip() for line in lines if "│" not in line)


@pytest.mark.parametrize(
    ("command", "lines"),
    [(("limits", "list"), 14), (("limits", "check", "force", "banenor-531"), 9), (("show", DEMO), 8)],
)
def test_json_is_lines_and_nothing_else_by_either_spelling(
    command: tuple[str, ...], lines: int, capfd: pytest.CaptureFixture[str]
):
    for spelling in (("--as", "json"), ("--json", "-")):
        assert main([*command, *spelling]) == 0
        printed = capfd.readouterr()
        assert len([json.loads(line) for line in printed.out.splitlines()]) == lines
        assert len(printed.err.splitlines()) > lines  # the table is for people, still


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--as", "xml"), "--as 'xml' is not known; use table, csv, json"),
        (("--as", "csv", "--json", "-"), "--as csv and --json exclude each other; give one of them"),
    ],
)
def test_one_form_at_a_time(options: tuple[str, ...], complaint: str, capfd: pytest.CaptureFixture[str]):
    assert main(["limits", "list", *options]) == 2
    assert capfd.readouterr() == ("", f"weld-force: {complaint}\n")


def test_further_tables_follow_an_empty_line_in_csv(capfd: pytest.CaptureFixture[str]):
    assert main(["bag", "info", DEMO, "--as", "csv"]) == 0
    topics, files = capfd.readouterr().out.split("\n\n")
    assert topics.startswith("topic,type,messages\n")
    assert files.startswith("file,begins,s,messages,kB,state\n")


def test_head_and_a_file_get_what_the_terminal_would_have_shown(tmp_path: Path):
    command = f"{sys.executable} -m weld_force_ros.cli show {DEMO}"
    shell = f"set -o pipefail; {command} | head -3; {command} > {tmp_path / 'all.txt'}"
    main_end, terminal = pty.openpty()
    environment = {**os.environ, "COLUMNS": "80"}
    done = subprocess.run(["bash", "-c", shell], stdout=subprocess.PIPE, stderr=terminal, env=environment, check=True)
    os.close(terminal)
    os.close(main_end)
    first = done.stdout.decode().splitlines()
    everything = (tmp_path / "all.txt").read_text().splitlines()
    assert first == everything[:3]
    assert len(everything) > 30
    assert "\x1b" not in "".join(everything)


def test_a_folder_that_is_missing_is_said_before_anything_is_computed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    missing = tmp_path / "nowhere"
    for arguments in (
        ("assess", "weld-1-dip", "--report", missing / "x.html"),
        ("simulate", "weld-1-dip", "--plot", missing / "x.png"),
        ("report", DEMO, "-o", missing / "x.html"),
        ("bag", "export", DEMO, missing / "x.mcap"),
        ("demo", "--out", missing / "x"),
        ("init", missing / "x"),
    ):
        assert main([str(argument) for argument in arguments]) == 2
        printed = capfd.readouterr()
        assert f"there is no folder {missing}; make it first" in printed.err
        assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert not missing.exists()
