"""Every command at 80 and 120 columns, and without a reader.

Long computations are replaced: the layout is the point.
"""

import csv
import io
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from typer.main import get_command

from tests.harness.reports import ground
from weld_force_ros.campaign import batch_task, estimate, sources, synthetic_network
from weld_force_ros.campaign.estimate import Estimate
from weld_force_ros.cli import bench, campaign, demo, grind
from weld_force_ros.cli.main import app, main
from weld_force_ros.cli.report import report
from weld_force_ros.measurement import profile_file
from weld_force_ros.physics.track import causal_twin
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.recording import replay as replaying
from weld_force_ros.recording import what_if as changing
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.recording.replay import Replayed
from weld_force_ros.recording.what_if import Changed
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.studies import benchmark_study, paper_studies
from weld_force_ros.studies.claims import EvaluatedClaim
from weld_force_ros.studies.gallery import RenderedStudy
from weld_force_ros.studies.paper_studies import StudyRun

ROOT = Path(__file__).parents[2]
BAG = str(ROOT / "bags" / "demo")
WELD = str(ROOT / "examples" / "weld.csv")
QUICK = ("--track", "bilbao-viscous", "--speeds", "80,160", "--positions", "2", "--uncertainty-samples", "0")
NETWORK = """
name: northern network
sources:
- {folder: welds, line: north}
vehicles:
  freight: {static_load_n: 110.0e+3}
  passenger: {static_load_n: 70.0e+3, mass_kg: 600.0}
sections:
- {name: plain-line, track: bilbao-viscous}
speeds: [80, 160]
positions: 2
"""

TABLES: dict[str, tuple[str, ...]] = {
    "assess": ("assess", WELD, "weld-1-dip", "--limits", "force,banenor-531", *QUICK),
    "inspect": ("inspect", WELD),
    "simulate": ("simulate", WELD, "weld-2-rise-between-shrinkages", *QUICK),
    "grind": ("grind", "weld-4-steep-ramp"),
    "show": ("show", BAG),
    "show a weld": ("show", BAG, "weld-4-steep-ramp", "--restrict", "80"),
    "limits list": ("limits", "list"),
    "limits check": ("limits", "check", "force", "banenor-531"),
    "bag info": ("bag", "info", BAG),
    "replay": ("replay", BAG),
    "replay verify": ("replay", "verify", BAG),
    "replay what-if": ("replay", "what-if", BAG, "--speeds", "20:120:5"),
    "receptance": ("receptance", "--at", "0.0,0.3", "--freq", "50,100"),
    "fit": ("fit", "bilbao-viscous", "--engine", "common-poles"),
    "fit rfp": ("fit", "bilbao"),
    "track identify": ("track", "identify", "hammer.csv", "--like", "bilbao", "--half-sleeper-mass", "150"),
    "track causal": ("track", "causal", "bilbao"),
    "study": ("study", "length", "--out", "study"),
    "study all": ("study", "all", "--out", "study"),
    "benchmark": ("benchmark",),
    "bench": ("bench",),
    "campaign --plan": ("campaign", "network.yaml", "--plan", "--workers", "2"),
    "campaign": ("campaign", "network.yaml", "--out", "again"),
    "query over": ("campaign", "query", "over", "results", "--at", "80"),
    "query worse": ("campaign", "query", "worse", "results", "--to", "80"),
    "query changed": ("campaign", "query", "changed", "results", "results"),
    "query sql": ("campaign", "query", "sql", "results", "select * from verdicts limit 2"),
}
OTHERS: dict[str, tuple[str, ...]] = {
    "help": ("-h",),
    "demo": ("demo", "--out", "shown"),
    "report": ("report", BAG, "-o", "page.html"),
    "init": ("init", "site"),
    "limits init": ("limits", "init", "ours.yaml", "--like", "banenor-531"),
    "bag export": ("bag", "export", BAG, "foxglove.mcap"),
    "bag recover": ("bag", "recover", BAG, "repaired"),
    "population": ("population", "3", "--out", "synthetic"),
    "campaign summary": ("campaign", "summary", "results"),
}
WRITTEN = ("study", "again", "shown", "page.html", "site", "ours.yaml", "foxglove.mcap", "repaired", "synthetic")
SLOW_ELSEWHERE = {"up", "node", "schema"}
"""Nodes (tests/ros), and JSON Schemas, which are lines of JSON."""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a hammer test, a small network and its results, in which long computations are replaced."""
    folder = tmp_path_factory.mktemp("here")
    before = Path.cwd()
    with pytest.MonkeyPatch.context() as patch:
        _replace_long_computations(patch)
        os.chdir(folder)
        _write_hammer_test(folder / "hammer.csv")
        (folder / "welds").mkdir()
        for weld in synthetic_network.network(3, seed=1):
            profile_file.write_profile(weld, folder / "welds" / f"{weld.weld_id}.csv")
        (folder / "network.yaml").write_text(NETWORK)
        assert main(["campaign", "network.yaml", "--out", "results"]) == 0
        yield folder
        os.chdir(before)


def _write_hammer_test(path: Path) -> None:
    track = track_file.load("concrete-soft-pads").track
    hz = np.arange(20.0, 1600.0, 20.0)
    mobility = 2j * np.pi * hz * receptance(track, hz, np.array([0.0]))
    rows = "".join(f"{f:g},{v.real:.8g},{v.imag:.8g}\n" for f, v in zip(hz, mobility[0], strict=True))
    path.write_text(f"# unit: m/s/N\nfrequency_hz,sleeper_real,sleeper_imag\n{rows}")


def _replace_long_computations(patch: pytest.MonkeyPatch) -> None:
    recording = open_recording(Path(BAG))
    advice = ground().grinding
    assert advice is not None
    hand = msgspec.structs.replace(advice, reason="up to 0.20 mm removed between -41 and 4 cm bring it within limits")
    patch.setattr(grind, "_adviser", lambda *_: SimpleNamespace(advise=lambda _: hand))
    patch.setattr(fit_store, "make_poles", fit_store.fitted)
    patch.setattr(fit_store, "make_rfp", lambda definition, *_, **__: fit_store.fitted(definition, "rfp"))
    patch.setattr(fit_store, "make_moving", lambda _, usual: usual)
    patch.setattr(fit_store, "keep", lambda _: None)
    replayed = [Replayed(one.weld_id, "verdict", one, ()) for one in recording.verdicts]
    patch.setattr(replaying, "replay", lambda *_, **__: iter(replayed))
    accepted = [msgspec.structs.replace(one, decision="undecided") for one in recording.verdicts]
    changed = [Changed(one, other) for one, other in zip(recording.verdicts, accepted, strict=True)]
    patch.setattr(changing, "what_if", lambda *_, **__: iter(changed))
    claims = msgspec.json.decode((ROOT / "docs" / "study" / "claims.json").read_bytes(), type=list[EvaluatedClaim])
    studied = StudyRun([RenderedStudy("length", "Length", [], ["forces"])], {}, claims)
    patch.setattr(paper_studies, "run_one", lambda *_: studied)
    patch.setattr(paper_studies, "run_all", lambda *_, **__: studied)
    near = benchmark_study.compare("mobility, two layers, 1809 Hz, m/(N s)", "rolland 26.08a1", 99.0, 100.0, 0.02)
    patch.setattr(benchmark_study, "run", lambda: iter([near]))
    measured = {"common_poles_s": 0.061, "common_poles_s_spread": [0.060, 0.065], "ratio_to_solve_ivp": 4550.0}
    patch.setattr(bench, "_benchmarks", lambda: SimpleNamespace(run=lambda **_: measured))
    patch.setattr(
        estimate, "estimate", lambda plan, workers, **_: Estimate(3, 1, workers, (0.03, 0.002), 2.0, 9e3, 2e3)
    )
    bilbao = track_file.load("bilbao")
    twin = causal_twin.causal_twin(bilbao.track, bilbao.wheel.compliance, at_hz=0.0)
    patch.setattr(causal_twin, "causal_twin", lambda *_, **__: twin)
    patch.setattr(campaign, "_assess", _assess_in_this_process)
    done = SimpleNamespace(bag=Path(BAG), recording=recording, left=0, seconds_to_verdict={})
    suite = SimpleNamespace(demo_profiles=dict, run_demo=lambda folder, **_: folder.mkdir() or done)
    patch.setattr(demo, "ros_module", lambda _: suite)
    patch.setattr(demo, "_draw_maps", lambda *_: None)
    patch.setattr(demo, "report", lambda bag, page, **_: report(bag, page))


def _assess_in_this_process(plan: Any, out: Path, *_: object) -> None:
    for batch in sources.batches(plan.sources, plan.batch_welds):
        batch_task.assess_batch(str(out), plan.sha256, batch)


@pytest.fixture
def clean(here: Path) -> Callable[[], None]:
    """Remove what commands have written; done once before a test."""

    def remove() -> None:
        for name in WRITTEN:
            target = here / name
            if target.is_dir():
                shutil.rmtree(target)
            target.unlink(missing_ok=True)

    remove()
    return remove


def test_every_command_is_among_these() -> None:
    named = {arguments[0] for arguments in (*TABLES.values(), *OTHERS.values())}
    assert named - {"-h"} == set(get_command(app).commands) - SLOW_ELSEWHERE


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("name", [*TABLES, *OTHERS])
def test_no_line_is_wider_than_the_terminal(
    name: str,
    columns: int,
    clean: Callable[[], None],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    capfd.readouterr()
    assert main(list({**TABLES, **OTHERS}[name])) in (0, 1)
    printed = capfd.readouterr()
    lines = printed.out.splitlines()
    assert lines
    assert [line for line in lines if len(line) > columns and " " in line.strip()] == []
    assert not {"\x1b", "\r", "━"} & set(printed.out + printed.err)
    assert "Traceback" not in printed.err


@pytest.mark.parametrize("name", TABLES)
def test_headings_are_whole_and_the_rows_are_csv_and_json(
    name: str, clean: Callable[[], None], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    capfd.readouterr()
    main(list(TABLES[name]))
    shown = set(capfd.readouterr().out.split())
    clean()
    code = main([*TABLES[name], "--as", "csv"])
    tables = [list(csv.reader(io.StringIO(text))) for text in capfd.readouterr().out.split("\n\n")]
    clean()
    assert main([*TABLES[name], "--as", "json"]) == code
    assert all(json.loads(line) is not None for line in capfd.readouterr().out.splitlines())
    for headings, *rows in filter(None, tables):
        assert all(headings)
        assert {len(row) for row in rows} <= {len(headings)}
        filled = [heading for i, heading in enumerate(headings[1:], 1) if any(row[i] for row in rows)]
        assert {word for heading in filled for word in heading.split()} - {"why"} <= shown


@pytest.mark.parametrize("name", [*TABLES, *OTHERS])
def test_a_reader_that_goes_ends_nothing_and_hears_nothing(
    name: str, clean: Callable[[], None], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`| head -1` whose reader has gone before the first line: the worst of it."""
    arguments = list({**TABLES, **OTHERS}[name])
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as unread, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", unread)
        assert main(arguments) in (0, 1)
    written = {name for name in WRITTEN if name in arguments and name != "study"}
    assert {name for name in written if not Path(name).exists()} == set()
    assert not {"Traceback", "Broken"} & set(capfd.readouterr().err.split())
