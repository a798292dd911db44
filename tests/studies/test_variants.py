"""The paper's own fit and continuous track: parameters recovered, fractions against the receptance, what is shown."""

from dataclasses import replace

import numpy as np
import pytest

from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import track_file
from weld_force_ros.studies import fit_weights, no_progress, variants_study
from weld_force_ros.studies.paper_variant import PaperVariant, continuous_like, fractions_of
from weld_force_ros.studies.study_context import BILBAO, CONTINUOUS, DIP_48, DIP_96, StudyContext

SMEARED = track_file.load(CONTINUOUS).track


def test_a_continuous_track_is_recovered_from_its_receptance():
    known = Support((Spring(300e6, loss_factor=0.2), Spring(60e6, loss_factor=0.8)), (180.0,))
    found = continuous_like(replace(SMEARED, support=known), SMEARED).support
    for spring, exact in zip(found.springs, known.springs, strict=True):
        assert (spring.stiffness_n_per_m, spring.loss_factor) == pytest.approx(
            (exact.stiffness_n_per_m, exact.loss_factor), rel=1e-3
        )
    assert found.mass_kg == pytest.approx(180.0, rel=1e-3)


def test_the_fitted_track_is_nearer_to_the_discrete_one_than_the_smeared():
    frequency = np.arange(25.0, 800.0, 25.0)
    discrete = track_file.load(BILBAO).track
    mean = np.abs(beam.receptance(discrete, frequency, np.arange(60) * 0.01).mean(axis=0))

    def off(track: beam.Track) -> float:
        return float(np.sqrt(np.mean((np.abs(beam.receptance(track, frequency, 0.0)[0]) / mean - 1) ** 2)))

    fitted = PaperVariant(fitted_continuous=True).track(CONTINUOUS).track
    assert off(fitted) < 0.02 < 0.05 < off(SMEARED)


def test_fractions_of_the_papers_degrees_follow_the_receptance_and_are_stable():
    model = fractions_of(SMEARED)
    assert model.order == 8
    assert model.poles().real.max() < 0
    assert model.static_compliance(0.0) == pytest.approx(beam.static_compliance(SMEARED, np.zeros(1)), rel=1e-6)
    # Below 100 Hz nothing causal follows a hysteretic ballast.
    frequency = np.geomspace(100.0, 1400.0, 60)
    exact = beam.receptance(SMEARED, frequency, 0.0)
    assert np.sqrt(np.mean(np.abs(model.receptance(frequency, 0.0) / exact - 1) ** 2)) < 0.1


def test_a_variant_has_other_models_and_says_their_error():
    variant, ours = PaperVariant(), StudyContext()
    assert variant.track(CONTINUOUS).track == ours.track(CONTINUOUS).track
    assert variant.track(BILBAO).track == ours.track(BILBAO).track
    for name in (BILBAO, CONTINUOUS):
        assert type(variant.vehicle_track(name).model) is not type(ours.vehicle_track(name).model)
    assert variant.rfp_error(BILBAO) == pytest.approx(ours.rfp_error(BILBAO), rel=1e-6)
    assert 0 < variant.rfp_error(CONTINUOUS) < 0.2


@pytest.mark.slow
def test_the_study_shows_what_differs_in_any_variant(monkeypatch):
    monkeypatch.setattr(variants_study, "STUDIES", ("length",))
    found = variants_study.run(True, no_progress)
    names = ["ours", "fractions", "fractions, fitted continuous"]
    counts = found.tables["counts"].rows
    assert [row[0] for row in counts] == names
    assert len({sum(row[1:]) for row in counts}) == 1
    shown = found.tables["claims"].rows
    evaluated = [row for row in shown if row[4] != "not evaluated"]
    assert [row[3] for row in evaluated[:3]] == names
    differing = sum(row[4] in ("partly", "differs") for row in evaluated)
    assert differing == sum(row[2] + row[3] for row in counts)
    smeared, fractions, fitted = found.tables["tracks"].rows
    assert smeared[1:] == fractions[1:]
    assert fitted[6] < smeared[6]
    assert len(found.pictures) == 3


@pytest.mark.slow
def test_the_papers_second_kinks_come_out_of_a_fit_that_favours_low_frequencies(monkeypatch):
    """One exponent puts those of both dips where the paper has them: 112 and 230 km/h."""
    monkeypatch.setattr(fit_weights, "EXPONENTS", (0.9,))
    (effect,) = fit_weights.weight_effects(StudyContext())
    assert [effect.speeds_kmh[dip][2] for dip in (DIP_48, DIP_96)] == pytest.approx([112.0, 230.0], rel=0.01)
    assert [effect.speeds_kmh[dip][0] for dip in (DIP_48, DIP_96)] == pytest.approx([53.0, 107.0], rel=0.02)
    assert effect.fit_error > 0.2
