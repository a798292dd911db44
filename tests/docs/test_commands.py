"""Every `weld-force` command of README and docs is one that the program takes; those that cost little are run."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer

import weld_force_ros as wf
from tests.docs.pages import PAGES, ROOT, blocks, shown_after
from weld_force_ros.cli.main import app, main

_UsageError = typer.BadParameter.__base__


def commands() -> dict[str, str]:
    """Return every command line with the page it stands on, without comments."""
    found: dict[str, str] = {}
    for page in PAGES:
        lines = [line.strip() for block in blocks(page, "") for line in block.split("\n")]
        for line in [line for line in lines if line.startswith("weld-force ")]:
            found.setdefault(shlex.join(shlex.split(line, comments=True)), page.name)
    return found


COMMANDS = commands()
PROGRAM = typer.main.get_command(app)


def parse(arguments: list[str]) -> None:
    """Take a command line apart as the program does, without running it."""
    command = PROGRAM
    context = command.make_context("weld-force", arguments)
    while hasattr(command, "commands") and (rest := [*context._protected_args, *context.args]):
        name, command, rest = command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_is_one_that_the_program_takes(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In a folder where a file is made as soon as the program asks for it."""
    monkeypatch.chdir(tmp_path)
    for _ in range(4):
        try:
            return parse(shlex.split(line)[1:])
        except _UsageError as error:
            missing = re.search(r"'([^']+)' does not exist", error.format_message())
            if missing is None:
                pytest.fail(f"{COMMANDS[line]}: {line}: {error.format_message()}")
            Path(missing[1]).touch()
    return pytest.fail(f"{line} asks for a file again and again")


def test_what_the_program_does_not_take_is_found():
    with pytest.raises(_UsageError):
        parse(["assess", "weld.csv", "--lmits", "force"])
    with pytest.raises(_UsageError):
        parse(["bag", "infos", "monday"])
    with pytest.raises(_UsageError):
        parse(["simulate", "weld-1-dip", "--uncertainty-samples", "many"])


@pytest.fixture
def a_day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with what the pages' commands are given: a file, and a recording."""
    shutil.copy(ROOT / "examples/weld.csv", tmp_path / "weld.csv")
    shutil.copytree(ROOT / "bags/demo", tmp_path / "monday")
    shutil.copytree(ROOT / "bags/demo", tmp_path / "bags/demo")
    shutil.copytree(ROOT / "bags/demo", tmp_path / "cut-off")
    (recorded,) = (tmp_path / "cut-off").glob("*.mcap")
    recorded.write_bytes(recorded.read_bytes()[:400_000])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "96")
    return tmp_path


CHEAP = (
    "weld-force init site",
    "weld-force inspect weld.csv",
    "weld-force limits list",
    "weld-force limits check banenor-531",
    "weld-force limits init ours.yaml --like en14730-2",
    "weld-force bag info monday",
    "weld-force bag export monday monday-foxglove.mcap",
    "weld-force receptance --track bilbao --at 0.0,0.30 --freq 50,100,200 --json -",
)


@pytest.mark.parametrize("line", CHEAP)
@pytest.mark.usefixtures("a_day")
def test_a_command_of_the_pages_runs(line: str, capsys: pytest.CaptureFixture[str]):
    assert line in COMMANDS, "stands on a page"
    assert main(shlex.split(line)[1:]) == 0
    assert any(capsys.readouterr())


NOT_RUN = {
    "up": "until Ctrl-C; tests/ros",
    "demo": "until Ctrl-C; tests/ros",
    "node": "until Ctrl-C; tests/ros",
    "replay publish": "onto a live ROS graph; tests/ros",
    "campaign network.yaml": "a campaign; tests/campaign",
    "campaign query": "of a campaign's results; tests/campaign",
    "population": "a campaign's welds",
    "study": "minutes each; tests/studies",
    "benchmark": "run by .ci/run",
    "fit": "a search of minutes; tests/physics/engines",
    "track causal": "of a track with loss factors; tests/simulation",
}
"""Commands that no test of the pages runs; CONTRIBUTING.md names them too."""
COSTLY = [
    line for line in COMMANDS if line not in CHEAP and not line.removeprefix("weld-force ").startswith((*NOT_RUN,))
]


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("line", COSTLY)
def test_a_costly_command_of_the_pages_runs(line: str, a_day: Path):
    """Verdicts other than accept are exit code 1, messages that are lost 3."""
    (a_day / "measurements").mkdir()
    for copy in ("measurements/weld.csv", "export.txt"):
        shutil.copy(a_day / "weld.csv", a_day / copy)
    (a_day / "de.json").write_text("{}")
    if "site.yaml" in line:
        assert main(["init", "site"]) == 0
    if "ours.yaml" in line:
        assert main(["limits", "init", "ours.yaml", "--like", "banenor-531"]) == 0  # a template's numbers are missing
    if "hammer.csv" in line:
        receptance = wf.Track("concrete-soft-pads").receptance(np.geomspace(30.0, 2000.0, 200), at_m=0.0)
        rows = [
            f"{f},{r.real},{r.imag}"
            for f, r in zip(receptance.frequency_hz.values, receptance.values.ravel(), strict=True)
        ]
        (a_day / "hammer.csv").write_text("\n".join(["# unit: m/N", "frequency_hz,sleeper_real,sleeper_imag", *rows]))
    assert main(shlex.split(line)[1:]) in (0, 1, 3)


@pytest.mark.usefixtures("a_day")
@pytest.mark.parametrize(
    ("page", "line"),
    [
        ("exported-file.md", "weld-force inspect weld.csv"),
        ("ros2.md", "weld-force bag info bags/demo"),
        pytest.param(
            "exported-file.md",
            "weld-force assess weld.csv --limits force,banenor-531 --report weld.html",
            marks=pytest.mark.long,
        ),
    ],
)
def test_the_page_shows_what_comes_out(page: str, line: str, capsys: pytest.CaptureFixture[str]):
    shown = shown_after(ROOT / "docs/start" / page, f"{line}\n")
    main(shlex.split(line)[1:])
    printed = capsys.readouterr()
    assert (printed.out + printed.err).split() == shown.split()
