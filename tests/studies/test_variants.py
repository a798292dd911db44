"""The paper's own fit and continuous track: parameters recovered, fractions against the receptance, what is shown."""

from dataclasses import replace

import numpy as np
import pytest

from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import track_file
from weld_force_ros.studies import (
    fit_weights,
    force_parts,
    hertz_change,
    no_progress,
    papers_fit,
    position_ratio,
    sleeper_harmonics,
    variants,
    variants_study,
)
from weld_force_ros.studies.paper_variant import (
    PaperVariant,
    continuous_like,
    fractions_of,
    support_factors,
    with_factors,
)
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


def test_our_poles_run_on_the_fitted_track_as_well():
    ours, fitted = StudyContext(), PaperVariant(fitted_continuous=True, fractions=False)
    assert type(fitted.model(BILBAO)) is type(ours.model(BILBAO))
    assert fitted.rfp_error(CONTINUOUS) == PaperVariant(fitted_continuous=True).rfp_error(CONTINUOUS)


def test_a_fit_in_one_section_meets_its_receptance_and_no_start_changes_it():
    discrete = track_file.load(BILBAO).track
    frequency = np.arange(25.0, 800.0, 25.0)
    for section, at_m in (("mid-span", 0.3), ("sleeper", 0.0)):
        wanted = np.abs(beam.receptance(discrete, frequency, at_m)[0])
        factors = support_factors(discrete, SMEARED, section)
        again = support_factors(discrete, SMEARED, section, start=(0.5, -0.5, 0.3, -0.3, 0.5))
        assert factors == pytest.approx(again, rel=1e-3)
        off = [
            np.sqrt(np.mean((np.abs(beam.receptance(track, frequency, 0.0)[0]) / wanted - 1) ** 2))
            for track in (with_factors(SMEARED, factors), SMEARED)
        ]
        assert off[0] < off[1]


def test_the_papers_fit_has_a_growing_pole_unless_something_is_held():
    task = papers_fit.FitTask(SMEARED)
    free, held = task.free_minimum(), task.fit(np.zeros(7))
    assert held.poles().real.max() < 0 < free.poles().real.max()
    assert task.objectives(free)[0] < task.objectives(held)[0]
    # Both are fractions of one receptance: by numpy's own polynomials.
    frequency_hz = np.linspace(10.0, 1500.0, 200)
    s = 2j * np.pi * frequency_hz / held.scale_rad_s
    values = np.polyval(held.numerator[0], s) / np.polyval(np.append(1.0, held.denominator[0]), s)
    exact = beam.receptance(SMEARED, frequency_hz, 0.0)[0]
    error = np.linalg.norm(values - exact) / np.linalg.norm(exact)
    assert task.objectives(held)[0] == pytest.approx(error, rel=1e-9)


def test_a_front_has_no_member_that_another_beats(monkeypatch):
    monkeypatch.setattr(papers_fit, "POPULATION", 8)
    monkeypatch.setattr(papers_fit, "GENERATIONS", 3)
    logarithms, targets = papers_fit.search(papers_fit.FitTask(SMEARED), 1)
    assert len(logarithms) == len(targets)
    assert np.all(np.diff(targets[:, 0]) >= 0)
    assert np.all(np.diff(targets[:, 1]) <= 0)


def test_receptances_differ_most_near_pinned_pinned():
    (beam_rail, safe) = position_ratio.position_ratios(StudyContext(coarse=True))
    for one in (beam_rail, safe):
        assert abs(one.frequency_hz[np.argmax(one.ratio)] / one.pinned_pinned_hz - 1) < 0.1
    low = beam_rail.frequency_hz < 900
    assert safe.ratio[low] == pytest.approx(beam_rail.ratio[low], rel=0.05)
    table = position_ratio.table([beam_rail, safe])
    assert {len(row) for row in table.rows} == {len(table.columns)}


@pytest.mark.slow
def test_the_force_on_smooth_rail_is_all_harmonics_and_the_second_can_be_the_largest():
    found = sleeper_harmonics.sleeper_harmonics(StudyContext(coarse=True))
    assert np.all(found.rest < 1e-3)
    at = dict(zip(found.speeds_kmh.tolist(), found.amplitude_n, strict=True))
    assert np.argmax(at[100.0]) == 0
    assert np.argmax(at[250.0]) == 1
    assert len(sleeper_harmonics.table(found).rows) == 4


@pytest.mark.slow
def test_parts_at_the_peak_add_up_to_it_and_the_sign_of_the_low_one_hangs_on_the_cut():
    context = StudyContext(coarse=True)
    found = force_parts.force_parts(context)
    weld = variants.by_sign(context)[0]
    at = int(np.searchsorted(found.speeds_kmh, 200.0))
    peak_n = context.vehicle_track(CONTINUOUS).peak_map(weld.wheel_path, [200.0], [0.0]).peak_force_n[0, 0]
    assert found.low_n[at, 1] + found.high_n[at] + 100e3 == pytest.approx(peak_n, rel=1e-3)
    assert found.low_n[at, 0] < 0 < found.low_n[at, 2]
    assert len(force_parts.table(found).rows) == 8


@pytest.mark.slow
def test_the_contacts_stiffness_changes_the_force_by_no_one_percentage():
    found = hertz_change.hertz_changes(StudyContext(coarse=True))
    dip = found[0]
    assert 0 < dip.at_maximum < 0.02 < 0.1 < dip.change.max()
    table = hertz_change.table(found)
    assert [row[0] for row in table.rows] == list(hertz_change.SHAPES)
    assert {len(row) for row in table.rows} == {len(table.columns)}


@pytest.mark.slow
def test_the_study_shows_what_differs_in_any_variant(monkeypatch):
    monkeypatch.setattr(variants_study, "STUDIES", ("length",))
    monkeypatch.setattr(variants_study, "_experiments", lambda contexts, advance: ([], {}))
    found = variants_study.run(True, no_progress)
    names = ["ours", "ours, fitted continuous", "fractions", "fractions, fitted continuous"]
    counts = found.tables["counts"].rows
    assert [row[0] for row in counts] == names
    assert len({sum(row[1:4]) for row in counts}) == 1
    shown = found.tables["claims"].rows
    evaluated = [row for row in shown if row[4] != "not evaluated"]
    assert [row[3] for row in evaluated[:4]] == names
    differing = sum(row[4] in ("partly", "differs") for row in evaluated)
    assert differing == sum(row[2] + row[3] for row in counts)
    smeared, fitted, fractions, both = found.tables["tracks"].rows
    assert smeared[1:] == fractions[1:]
    assert fitted[1:] == both[1:]
    assert fitted[6] < smeared[6]
    assert len(found.pictures) == 2


@pytest.mark.long
def test_every_experiment_leaves_a_table(monkeypatch):
    monkeypatch.setattr(variants_study, "STUDIES", ("length",))
    found = variants_study.run(True, no_progress)
    assert set(found.tables) == {
        "counts", "claims", "tracks", "readings", "papers_fit", "weights", "hertz", "positions", "harmonics", "parts"
    }  # fmt: skip
    assert len(found.pictures) == 6
    for table in found.tables.values():
        assert {len(row) for row in table.rows} == {len(table.columns)}


@pytest.mark.slow
def test_the_papers_second_kinks_come_out_of_a_fit_that_favours_low_frequencies(monkeypatch):
    """One exponent puts those of both dips where the paper has them: 112 and 230 km/h."""
    monkeypatch.setattr(fit_weights, "EXPONENTS", (0.9,))
    (effect,) = fit_weights.weight_effects(StudyContext())
    assert [effect.speeds_kmh[dip][2] for dip in (DIP_48, DIP_96)] == pytest.approx([112.0, 230.0], rel=0.01)
    assert [effect.speeds_kmh[dip][0] for dip in (DIP_48, DIP_96)] == pytest.approx([53.0, 107.0], rel=0.02)
    assert effect.fit_error > 0.2
