"""Searched fits on disk and by command: resumed, reproduced from their seed, written with picture."""

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np
import platformdirs
import pytest

from weld_force_ros.assessment.assessor import Assessor
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.cli.main import main
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.physics.track.beam import sections, static_compliance
from weld_force_ros.physics.track.support import Support, TabulatedSpring
from weld_force_ros.simulation import fit_file, fit_store, track_file
from weld_force_ros.simulation.few_passages import support_levels
from weld_force_ros.simulation.sampling import supported
from weld_force_ros.simulation.settings import (
    DEFAULT_TRACK,
    DEFAULT_UNCERTAINTY_SAMPLES,
    load_uncertainty,
    simulation_settings,
)
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.track_at_weld import TracksAtWelds

SMALL = fit_store.Search(degree=6, generations=3, population=8)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    return tmp_path / "weld_force_ros" / "fits"


@pytest.mark.skipif(
    np.lib.NumpyVersion(np.__version__) < "2.0.0", reason="its exp differs in the last bit, so that two fits are made"
)
@pytest.mark.parametrize("track", ["bilbao", "bilbao-viscous"])
def test_a_first_verdict_with_intervals_on_the_papers_track_fits_nothing(cache: Path, track: str):
    made: list[str] = []
    Simulator(simulation_settings(track=track, uncertainty=load_uncertainty(32)), on_fit=made.append)
    assert made == []
    assert not cache.exists()


@pytest.mark.skipif(
    np.lib.NumpyVersion(np.__version__) < "2.0.0", reason="its exp differs in the last bit, so that two fits are made"
)
def test_a_first_assessment_by_default_fits_nothing_even_where_sleepers_might_hang(cache: Path):
    made: list[str] = []
    settings = simulation_settings(
        speeds_kmh=[80.0], positions=1, uncertainty=load_uncertainty(DEFAULT_UNCERTAINTY_SAMPLES)
    )
    assert settings.track == DEFAULT_TRACK
    found = Assessor([settings], load_limits(), on_fit=made.append).assess(read_profile(find("weld-1-dip")))
    assert len(found.verdict.hanging) == 2
    assert made == []
    assert not cache.exists()


def test_the_default_track_is_causal():
    assert track_file.load(DEFAULT_TRACK).track.causal


def test_a_bundled_fit_of_other_supports_is_what_fitting_gives():
    definition = supported(track_file.load("bilbao"), float(support_levels(load_uncertainty(32))[0]))
    bundled, made = fit_store.fitted(definition), fit_store.make(definition)
    assert bundled.key == made.key
    omega = 2 * np.pi * np.linspace(30.0, 1500.0, 200)
    assert np.allclose(
        bundled.model().receptance(omega, [0.0, 0.3]), made.model().receptance(omega, [0.0, 0.3]), rtol=1e-6
    )


def test_an_interrupted_search_goes_on_and_ends_as_an_uninterrupted_one(cache: Path):
    definition = track_file.load("bilbao-continuous")
    whole = fit_store.make_rfp(definition, SMALL)
    seen: list[int] = []

    def stop_after_the_first(progress) -> None:
        seen.append(progress.population.generation)
        if len(seen) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_store.make_rfp(definition, SMALL, on_generation=stop_after_the_first)
    assert len(list(cache.glob("search-*.json"))) == 1
    resumed = fit_store.make_rfp(definition, SMALL, on_generation=lambda now: seen.append(now.population.generation))
    assert seen == [1, 2, 3]
    assert msgspec.to_builtins(resumed) == msgspec.to_builtins(whole)
    assert list(cache.glob("search-*.json")) == []


def test_fit_command_writes_what_it_says(cache: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    options = ["--degree", "6", "--generations", "3", "--population", "8", "--out", str(tmp_path / "out")]
    code = main(["fit", "bilbao-continuous", *options, "--json", "-"])
    out, err = capfd.readouterr()
    printed = json.loads(out)
    assert code == 0
    assert (printed["engine"], printed["order"], printed["seed"]) == ("rfp", 6, 1)
    assert json.loads((tmp_path / "out" / "bilbao-continuous.rfp.json").read_text()) == printed
    assert (tmp_path / "out" / "bilbao-continuous.rfp.png").read_bytes().startswith(b"\x89PNG")
    assert "error" in err


@pytest.mark.parametrize("options", [["--degree", "20"], ["--engine", "magic"], ["--generations", "0"]])
def test_a_fit_that_cannot_be_is_one_line(cache: Path, options: list[str], capfd: pytest.CaptureFixture[str]):
    assert main(["fit", "bilbao-continuous", *options]) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)


PAPERS = ["bilbao", "bilbao-continuous", "bilbao-viscous", "johansson-nielsen"]
"""Tracks of the paper, whose keys are those of before supports were chains."""


def test_keys_of_before_supports_were_chains_still_hold():
    """The files were written then; a key that they do not hold would make every user fit anew."""
    folder = resources.files("weld_force_ros.data") / "fits"
    for name in PAPERS:
        stored = json.loads((folder / f"{name}.common-poles.json").read_bytes())["key"]
        assert fit_store.key_of(track_file.load(name)) == stored


def test_key_tells_chains_apart():
    definition = track_file.load("johansson-nielsen")
    pad, ballast = definition.track.support.springs
    supports = [
        definition.track.support,
        Support((pad,)),
        Support((pad, ballast, ballast), (125.0, 125.0)),
        Support((TabulatedSpring(((1.0, 1e8, 0.1), (10.0, 1e8, 0.1))), ballast), (125.0,)),
        Support((TabulatedSpring(((1.0, 1e8, 0.1), (10.0, 1e8, 0.2))), ballast), (125.0,)),
    ]
    keys = {fit_store.key_of(replace(definition, track=replace(definition.track, support=one))) for one in supports}
    assert len(keys) == len(supports)


@pytest.mark.parametrize(
    ("name", "engine"),
    [(name, "common-poles") for name in track_file.shipped()] + [(name, "rfp") for name in (*PAPERS, DEFAULT_TRACK)],
)
def test_shipped_fits_hold_the_exact_static_stiffness_of_every_section(name: str, engine: str, cache: Path):
    definition = track_file.load(name)
    model = fit_store.fitted(definition, engine).model()
    assert not cache.exists()  # it was shipped, not made
    at = sections(definition.track, len(model.section_m))
    exact = static_compliance(definition.track, at)
    np.testing.assert_allclose(model.static_compliance(at), exact, rtol=1e-6)
    between = np.linspace(0.0, definition.track.spacing_m, 61)
    np.testing.assert_allclose(
        model.static_compliance(between), static_compliance(definition.track, between), rtol=5e-3
    )


def test_poles_that_change_with_speed_come_out_of_the_file_again(tmp_path: Path):
    fit = fit_store.fitted_moving(track_file.load("bilbao-viscous"))
    assert isinstance(fit, fit_file.MovingPolesFit)
    fit_file.write(fit, tmp_path / "fit.json")
    again = msgspec.json.decode((tmp_path / "fit.json").read_bytes(), type=fit_file.AnyFit)
    assert again == fit
    at = np.linspace(0.0, 1.2, 7)
    np.testing.assert_array_equal(again.model().shapes_at(at), fit.model().shapes_at(at))


def test_a_fit_at_rest_that_is_good_enough_stays_as_it_is():
    definition = track_file.load("johansson-nielsen")
    moving, usual = fit_store.fitted_moving(definition), fit_store.fitted(definition)
    assert isinstance(moving, fit_file.PolesFit)
    assert moving.residues_re == usual.residues_re
    assert moving.poles_im_rad_s == usual.poles_im_rad_s


@pytest.mark.parametrize(
    ("track", "engine", "moving"),
    [("bilbao-viscous", "common-poles", True), ("bilbao-viscous", "rfp", False), ("bilbao", "common-poles", False),
     ("embedded-rail", "common-poles", False)],
)  # fmt: skip
def test_settings_say_what_poles_are_fitted_to(track: str, engine: str, moving: bool):
    assert (simulation_settings(track=track, engine=engine).poles == "moving") == moving


def test_settings_that_say_nothing_of_poles_are_simulated_as_before():
    """Such as those of recordings of before: the fit at rest, whose results they hold."""
    definition, settings = track_file.load("bilbao-viscous"), simulation_settings(track="bilbao-viscous")
    before = TracksAtWelds(definition, msgspec.structs.replace(settings, poles=msgspec.UNSET)).usual
    now = TracksAtWelds(definition, settings).usual
    np.testing.assert_array_equal(before.vehicle_track.model.residues, fit_store.fitted(definition).model().residues)
    assert now.vehicle_track.model.order == fit_store.fitted_moving(definition).order == 16
    assert now.fit_error < 0.0115
