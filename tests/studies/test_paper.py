"""`study all` at reduced resolution: what it leaves, and that a claim's result depends on what was measured."""

import json
import re
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import Result
from typer.testing import CliRunner

from weld_force_ros.cli import study as cli_study
from weld_force_ros.cli.main import main
from weld_force_ros.measurement import profile_file
from weld_force_ros.studies import claims, paper_studies
from weld_force_ros.studies.study_context import StudyContext

pytestmark = pytest.mark.slow


class Studied(NamedTuple):
    """What the command left: by which studies, where, and how it ended."""

    names: tuple[str, ...]
    out: Path
    result: Result


@pytest.fixture(
    scope="module",
    params=[("smooth", "length"), pytest.param(paper_studies.STUDIES, marks=pytest.mark.long)],
    ids=["two", "all"],
)
def studied(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Studied:
    out = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_studies, "run_all", partial(paper_studies.run_all, names=request.param))
        result = CliRunner().invoke(cli_study.app, ["all", "--quick", "--out", str(out)], catch_exceptions=False)
    return Studied(request.param, out, result)


def test_study_all_evaluates_every_claim(studied: Studied):
    assert studied.result.exit_code == 0
    entries = json.loads((studied.out / "claims.json").read_text(encoding="utf-8"))
    assert [entry["id"] for entry in entries] == [claim.id for claim in claims.load()]
    evaluated = [entry for entry in entries if entry["study"] in studied.names]
    assert len(evaluated) > len(studied.names)
    for entry in evaluated:
        assert entry["result"] in {"agrees", "partly", "differs", "not-testable"}
        assert all(entry[field] for field in ("claim", "where", "why"))
        assert entry["measured"] or entry["result"] == "not-testable"


def test_every_study_leaves_figures_and_data(studied: Studied):
    names, out, _ = studied
    for name in names:
        pictures = {path.stem for path in (out / name).glob("*.png")}
        assert pictures
        assert pictures == {path.stem for path in (out / name).glob("*.svg")}
        for table in (out / name).glob("*.csv"):
            assert len(table.read_text(encoding="utf-8").splitlines()) > 1
        assert list((out / name).glob("*.csv"))


def test_the_gallery_is_one_page_that_loads_nothing(studied: Studied):
    names, out, _ = studied
    page = (out / "gallery.html").read_text(encoding="utf-8")
    assert page.count('src="data:image/png;base64,') == len(list(out.glob("*/*.png")))
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert "<script" not in page
    for name in names:
        assert f'id="{name}"' in page
    # A phone scales it, and print keeps figures whole.
    assert "width=device-width" in page
    assert "break-inside: avoid" in page


def test_the_command_lists_the_studies_that_there_are():
    names = [command.name for command in cli_study.app.registered_commands]
    assert names == [*paper_studies.STUDIES, "all", "engines", "rail", "support", "infer", "variants"]


@pytest.mark.parametrize("study", ["all", "curve"])
def test_a_folder_that_cannot_be_made_is_one_line_before_anything_is_computed(study, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(paper_studies, "run_study", None)
    (tmp_path / "file").write_text("")
    assert main(["study", study, "--out", str(tmp_path / "file" / "out")]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "--out" in line


def test_what_fails_in_another_process_is_one_line(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(paper_studies, "run_all", partial(paper_studies.run_all, names=("smooth",)))
    (tmp_path / "smooth").write_text("")  # where a study's folder belongs
    assert main(["study", "all", "--quick", "--out", str(tmp_path)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert str(tmp_path / "smooth") in line


def test_a_weld_of_the_users_own_is_studied_and_not_compared_with_the_paper(tmp_path: Path):
    weld = profile_file.read_profile(profile_file.find("weld-4-steep-ramp"))
    own = tmp_path / "own.csv"
    profile_file.write_profile(weld, own)
    result = CliRunner().invoke(
        cli_study.app, ["curve", "--profile", str(own), "--quick", "--out", str(tmp_path / "out"), "--json", "-"]
    )
    assert result.exit_code == 0
    assert json.loads(result.stdout.splitlines()[0]) == {}
    assert list((tmp_path / "out" / "curve").glob("*.png"))


def test_another_track_takes_the_papers_place():
    context = StudyContext(own_track="johansson-nielsen")
    assert context.track("bilbao").track.spacing_m == pytest.approx(0.65)
    assert not context.uses_paper_inputs
