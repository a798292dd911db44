"""Study `rail`: both rails side by side."""

import csv
import json
from dataclasses import replace

import numpy as np
import platformdirs
import pytest

from weld_force_ros.cli import main
from weld_force_ros.physics.track.beam import StripRail
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.studies import rail_study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    out = tmp_path_factory.mktemp("rail")
    assert main.main(["study", "rail", "--quick", "--out", str(out), "--json", str(out / "measured.json")]) == 0
    return out


@pytest.mark.long
def test_page_pictures_and_tables_are_there(studied):
    folder = studied / "rail"
    for name in ("dispersion", "receptances", "differences", "forces", "waves"):
        assert (folder / f"rail-{name}.png").stat().st_size > 10_000
        assert (folder / f"rail-{name}.svg").exists()
    page = (studied / "rail.html").read_text(encoding="utf-8")
    assert page.count("<img") == 5
    assert "http" not in page.split("<body")[1].replace("http://www.w3.org", "")


@pytest.mark.long
def test_what_is_measured_is_what_a_beam_leads_to_expect_at_low_frequency(studied):
    measured = json.loads((studied / "measured.json").read_text())
    assert np.abs(np.array(measured["rail.static_ratio"]) - 1).max() < 0.02
    assert measured["rail.largest_difference_below_500hz"] < 0.05
    assert measured["rail.bending_wavenumber_ratio_300hz"] == pytest.approx(1, abs=0.01)


@pytest.mark.long
def test_rows_say_where_the_rails_differ(studied):
    with (studied / "rail" / "differences.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["at_m"]) for row in rows] == [0.0, 0.15, 0.3]
    for row in rows:
        first, second = (float(row[f"over_{share}_percent_hz"]) for share in (5, 10))
        assert 500 < first <= second < 5000


def test_either_rail_of_a_track_is_made_from_the_other():
    beam = track_file.load("bilbao")
    waveguide = rail_study.with_waveguide(beam, "54E1")
    assert isinstance(waveguide.track.rail, StripRail)
    assert replace(rail_study.with_beam(waveguide).track, name="bilbao") == beam.track


def test_both_rails_of_the_papers_track_are_fitted_already(monkeypatch, tmp_path):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    beam = track_file.load("bilbao")
    made: list[str] = []
    for definition in (beam, rail_study.with_waveguide(beam, "60E1")):
        fit_store.fitted(definition, on_fit=made.append)
    assert made == []


def test_unknown_section_is_refused_in_a_line(capsys, tmp_path):
    assert main.main(["study", "rail", "--section", "61E1", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "61E1" in error
    assert error.count("\n") == 1
