"""Shapes inferred from the paper's text: prior, cost by hand, a search with a known end, what is written."""

import math

import msgspec
import numpy as np
import pytest

from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError
from weld_force_ros.measurement import profile_file
from weld_force_ros.studies import claims, increment_study, inference, inference_study, no_progress, shape_prior
from weld_force_ros.studies.claims import Claim, Condition
from weld_force_ros.studies.inference import Inference, Solution, chosen, cost_of, held, wavelength_cost
from weld_force_ros.studies.shape_prior import (
    Term,
    curvature_share,
    profile_of,
    rms_gradient,
    terms_of,
    wavelengths_of,
)
from weld_force_ros.studies.study_context import Quantities, StudyContext
from weld_force_ros.studies.weld_map import upward_ramp

PRIORS = shape_prior.load()
WELL_FORMED = """
weld-1:
  words: a dip
  terms:
    - {what: dip, height_um: [-500, -100], place_mm: [-20, 20], length_mm: [15, 150]}
"""
DIP = Term(height_um=-300.0, place_mm=10.0, length_mm=25.0)


def solution(weld: str = "weld-1", seed: int = 1, cost: float = 0.0, term: Term = DIP) -> Solution:
    return Solution(weld=weld, seed=seed, cost=cost, terms=[term], prior_sha256=PRIORS[weld].sha256)


def claim(*criteria: Condition) -> Claim:
    return Claim(
        id="a-claim", where="section 3", statement="So it is.", geometry="inferred", role="fitted", study="map",
        criteria=list(criteria), note="Because it is.",
    )  # fmt: skip


def test_there_is_a_prior_of_each_weld_of_the_paper():
    assert list(PRIORS) == [f"weld-{n}" for n in range(1, 6)]


@pytest.mark.parametrize("name", PRIORS)
def test_a_prior_keeps_to_what_its_file_states(name):
    for low, high in PRIORS[name].bounds:
        assert low < high
    assert all(max(map(abs, term.height_um)) <= 500 for term in PRIORS[name].terms)


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("terms:", "terms: [", "own.yaml"),
        ("[-20, 20]", "[20, -20]", "20 to -20"),
        ("[-20, 20]", "[20, .inf]", "no range"),
        ("[15, 150]", "[0, 150]", "length"),
        ("what: dip, ", "", "what"),
        ("place_mm", "place_cm", "place_cm"),
    ],
)
def test_a_malformed_prior_is_refused_in_one_line(old, new, names):
    text = WELL_FORMED.replace(old, new)
    assert text != WELL_FORMED
    with pytest.raises(InputError, match=names) as refusal:
        shape_prior.parse(text.encode(), "own.yaml")
    assert "\n" not in str(refusal.value)


def test_a_profile_is_the_sum_of_its_terms_between_tapers_and_zero_at_its_ends():
    terms = terms_of([-300.0, 10.0, 25.0, 100.0, 0.0, 1e6])
    x, z = profile_of(terms)
    assert len(x) == 501
    assert (x[0], x[-1], z[0], z[-1]) == (-0.5, 0.5, 0.0, 0.0)
    # The dip is -300 um at 10 mm and e^-1/2 of it one standard deviation on; half-way into the taper half is left.
    assert np.interp([0.010, -0.200], x, z) == pytest.approx([-200e-6, 100e-6], abs=1e-8)
    assert z[np.argmin(np.abs(x - 0.036))] == pytest.approx(100e-6 - 300e-6 * math.exp(-0.5 * 1.04**2), abs=1e-9)
    assert np.interp(-0.425, x, z) == pytest.approx(50e-6, abs=1e-6)


def test_curvature_is_that_of_the_gaussian_at_its_bottom_and_gradient_that_of_its_flanks():
    # Of h exp(-(x/s)^2 / 2): curvature h / s^2 at its centre; its squared gradient integrates to h^2 sqrt(pi) / 2s.
    profile = profile_of([DIP])
    assert curvature_share(profile) == pytest.approx(300e-6 / 0.025**2 * 0.45, rel=5e-3)
    assert rms_gradient(profile) == pytest.approx(math.sqrt(0.5 * math.sqrt(math.pi) / 0.025) * 300e-6, rel=2e-3)


def test_strong_components_are_the_waves_that_a_profile_consists_of():
    x = np.linspace(-0.5, 0.5, 501)
    envelope = np.exp(-0.5 * (x / 0.2) ** 2)
    z = envelope * (1e-4 * np.cos(2 * np.pi * x / 0.165) + 0.5e-4 * np.sin(2 * np.pi * x / 0.05))
    assert wavelengths_of((x, z)) == pytest.approx([0.165, 0.05], rel=0.02)
    # A twentieth of the largest is not strong.
    weak = envelope * (1e-4 * np.cos(2 * np.pi * x / 0.165) + 0.5e-5 * np.sin(2 * np.pi * x / 0.05))
    assert wavelengths_of((x, weak)) == pytest.approx([0.165], rel=0.02)
    assert wavelength_cost([0.165], (x, z)) == 0
    assert wavelength_cost([0.165, 0.08], (x, z)) == pytest.approx(0.5 * (0.5 + 0.5 * 2.75 / 3.75), abs=0.02)
    assert wavelength_cost([], (x, z)) == 0
    assert wavelength_cost([0.165], (x, 0.0 * z)) == 1


def test_a_prior_is_cut_to_fewer_free_terms_and_keeps_what_the_words_name():
    simpler = PRIORS["weld-1"].with_free_terms(1)
    assert PRIORS["weld-1"].free_terms == 4
    assert [term.what for term in simpler.terms] == ["dip", "free"]
    assert simpler.sha256 != PRIORS["weld-1"].sha256
    assert PRIORS["weld-1"].with_free_terms(4) == PRIORS["weld-1"]


def test_a_ramp_leads_from_level_rail_to_the_first_crest():
    x = np.linspace(-0.5, 0.5, 1001)
    z = np.interp(x, [-0.3, -0.2, -0.1, 0.1, 0.3], [0.0, 1e-4, 0.5e-4, 2e-4, 0.0])
    start, end = upward_ramp((x, z))
    assert end == pytest.approx(-0.2, abs=1e-3)
    assert start == pytest.approx(-0.296, abs=1.1e-3)  # 2 % of the greatest height, 4 um, is reached 4 mm up the ramp
    # A first top below half the greatest height is none.
    assert upward_ramp((x, np.where(x < -0.1, 0.4 * z, z)))[1] == pytest.approx(0.1, abs=1e-3)
    assert np.isnan(upward_ramp((x, -z))).all()


WITHIN = Condition(key="map.speed_kmh", within=(80.0, 100.0))
ABOVE = Condition(key="map.depth", above=0.2)
BELOW = Condition(key="map.rise_n", below=0.0)
IS = Condition(key="map.falls", is_=True)


@pytest.mark.parametrize(
    ("condition", "value", "cost"),
    [
        (WITHIN, 100.0, 0.0),
        (WITHIN, 110.0, 0.5 + 0.5 * 0.5),  # one half width off: 1 / (1 + 1)
        (WITHIN, 70.0, 0.5 + 0.5 * 0.5),
        (WITHIN, math.nan, 1.0),
        (WITHIN, [90.0, 130.0], 0.5 * (0.5 + 0.5 * 0.75)),
        (WITHIN, [], 1.0),
        (ABOVE, 0.2, 0.5),
        (ABOVE, 0.0, 0.75),
        (BELOW, 30e3, 0.5 + 0.5 * 0.75),  # three tenths of the static load
        (BELOW, -1.0, 0.0),
        (IS, True, 0.0),
        (IS, False, 1.0),
    ],
)
def test_a_criterion_costs_nothing_or_from_a_half_to_one(condition, value, cost):
    assert cost_of(claim(condition), {condition.key: value}) == pytest.approx(cost)


def test_criteria_count_alike_and_only_if_their_quantity_was_measured():
    subject = claim(WITHIN, ABOVE, IS)
    assert cost_of(subject, {"map.speed_kmh": 90.0, "map.falls": False}) == pytest.approx(0.5)
    assert cost_of(subject, {"map.other": 1.0}) is None


def test_the_nearer_a_quantity_the_less_it_costs():
    costs = [cost_of(claim(WITHIN), {"map.speed_kmh": value}) for value in (300.0, 200.0, 120.0, 101.0, 100.0)]
    assert costs == sorted(costs, reverse=True)
    assert len(set(costs)) == 5


def test_claims_hold_as_far_as_they_were_measured_and_are_counted_by_role():
    measured: Quantities = {
        "map.linearity_weld_4": 0.98, "map.peak_on_ramp_share_weld_4": 0.5, "map.position_spread_weld_4": 0.1,
    }  # fmt: skip
    given = frozenset({"weld-4-linear", "weld-4-peak-from-ramp"})
    found = inference_study.Found(solution("weld-4"), held(measured), given)
    assert found.held == {
        "weld-4-linear": True, "weld-4-peak-from-ramp": False, "weld-4-position-does-not-matter": True,
    }  # fmt: skip
    assert found.counted("fitted") == (1, 2)
    assert found.counted("held-out") == (1, 1)
    assert held({}) == {}


def test_a_search_is_given_fitted_claims_only():
    roles = {subject.id: subject.role for subject in claims.load()}
    given = Inference("weld-1", PRIORS["weld-1"], StudyContext()).given
    assert given
    assert {roles[subject.id] for subject in given} == {"fitted"}


def test_a_search_may_be_given_a_study_more_which_then_counts_as_fitted():
    plain, also = (Inference("weld-1", PRIORS["weld-1"], StudyContext(), study).given for study in (None, "motion"))
    more = [subject for subject in also if subject not in plain]
    assert len(more) >= 5
    assert {(subject.study, subject.role) for subject in more} == {("motion", "held-out")}


def test_the_solution_that_ships_is_that_of_least_cost_and_of_equals_the_most_typical():
    low, middle, high = (solution(seed=n, term=Term(-100.0 * n, 0.0, 60.0)) for n in (1, 2, 3))
    costly = [solution(seed=n, cost=0.5, term=Term(-300.0, 0.0, 60.0)) for n in (4, 5)]
    assert chosen([low, middle, high, *costly]) is middle
    # Between 200 and 300 um lie five hundredths of the way: the nearer pair decides.
    assert chosen([low, high, solution(seed=6, term=Term(-290.0, 0.0, 60.0))]).seed == 6


def test_a_shape_that_the_wheel_touches_twice_costs_more_than_any_other():
    sought = Inference("weld-1", PRIORS["weld-1"], StudyContext())
    # 500 um at a length of 15 mm curve by 2.2 / m, the wheel itself by 1 / 0.45 m.
    cost = sought.cost(np.array([-500.0, 0.0, 15.0]))
    assert cost == pytest.approx(len(sought.given) + 1 + 500e-6 / 0.015**2 * 0.45 - 0.85, abs=0.02)


@pytest.fixture
def quick(monkeypatch):
    """Searches whose cost is the distance of their first height from -333 um, and no passages."""
    monkeypatch.setattr(Inference, "cost", lambda _self, parameters: abs(parameters[0] + 333.0))
    monkeypatch.setattr(Inference, "all_quantities", lambda _self, _profile: {"map.linearity_weld_4": 0.98})
    monkeypatch.setattr(
        increment_study,
        "quantities_over_weld_1",
        lambda _context, weld: {"increment.minimum_cells_ratio": 1.0, "increment.spread_ratio": -1e4 * weld[1].min()},
    )


@pytest.mark.usefixtures("quick")
def test_a_search_finds_a_known_minimum_within_the_prior_and_again_with_its_seed():
    sought = Inference("weld-1", PRIORS["weld-1"], StudyContext())
    generations: list[int] = []
    found = sought.search(7, lambda: generations.append(1))
    assert found.terms[0].height_um == pytest.approx(-333.0, abs=0.5)
    assert found.cost == abs(found.terms[0].height_um + 333.0)
    assert 1 <= len(generations) <= inference.GENERATIONS + 1
    parameters = [v for term in found.terms for v in (term.height_um, term.place_mm, term.length_mm)]
    assert all(low <= v <= high for v, (low, high) in zip(parameters, PRIORS["weld-1"].bounds, strict=True))
    assert sought.search(7) == found
    assert sought.search(8) != found


@pytest.mark.usefixtures("quick")
def test_a_second_run_takes_what_the_first_found_unless_the_prior_changed(tmp_path, monkeypatch):
    first = inference_study.run(StudyContext(), "weld-1", 2, tmp_path, no_progress)
    assert [row[2] for row in first.tables["solutions"].rows] == [1.0, 2.0]
    heights = first.tables["heights"].rows  # one shape, lower and higher
    assert [row[0] for row in heights] == [0.2, 0.5, 1.0, 3.0]
    np.testing.assert_allclose([row[3] for row in heights], 1e4 * 333e-6 * np.array([0.2, 0.5, 1.0, 3.0]), rtol=0.01)
    monkeypatch.setattr(Inference, "search", None)
    assert inference_study.run(StudyContext(), "weld-1", 2, tmp_path, no_progress).tables == first.tables
    stale = msgspec.structs.replace(solution(seed=1), prior_sha256="0")
    (tmp_path / "weld-1-free-0-seed-1.json").write_bytes(msgspec.json.encode(stale))
    with pytest.raises(TypeError):
        inference_study.run(StudyContext(), "weld-1", 1, tmp_path, no_progress)
    (tmp_path / "weld-1-free-0-seed-1.json").write_text("{}")
    with pytest.raises(InputError, match=r"weld-1-free-0-seed-1\.json"):
        inference_study.run(StudyContext(), "weld-1", 1, tmp_path, no_progress)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("least", "terms"), [({2: 0.0}, 2), ({3: 0.0, 4: 0.0}, 3), ({4: 0.5}, 4), ({}, 1)])
def test_a_weld_has_the_fewest_free_terms_that_do_or_else_the_number_that_got_nearest(
    tmp_path, monkeypatch, least, terms
):
    monkeypatch.setattr(Inference, "cost", lambda _self, parameters: least.get(len(parameters) // 3, 1.0))
    monkeypatch.setattr(inference, "GENERATIONS", 1)
    rows = inference_study.run(StudyContext(), "weld-1", 2, tmp_path, no_progress).tables["solutions"].rows
    assert [row[1] for row in rows] == [terms, terms]


@pytest.mark.usefixtures("quick")
def test_the_command_leaves_shapes_that_are_read_as_welds_and_says_how_they_came_about(tmp_path, capsys):
    assert main(["study", "infer", "--weld", "4", "--seeds", "2", "--out", str(tmp_path), "--json", "-"]) == 0
    lines = [msgspec.json.decode(line) for line in capsys.readouterr().out.splitlines()]
    assert [(line["weld"], line["seed"], line["fitted_met"]) for line in lines] == [("weld-4", 1, 1), ("weld-4", 2, 1)]
    shipped = (tmp_path / "infer" / "weld-4.csv").read_text(encoding="utf-8")
    assert "Inferred from the text" in shipped
    ((terms, seed),) = [(line["terms"], line["seed"]) for line in lines if line["shipped"]]
    assert f"seed {seed:.0f}" in shipped
    stored_in = tmp_path / "infer" / f"weld-4-free-{terms - 3:.0f}-seed-{seed:.0f}.json"  # three terms are named
    stored = msgspec.json.decode(stored_in.read_bytes(), type=Solution)
    profile = profile_file.read_profile(tmp_path / "infer" / "weld-4.csv")
    assert profile.weld_id == "weld-4"
    np.testing.assert_allclose(profile.x_m, stored.profile[0], atol=1e-12)
    np.testing.assert_allclose(profile.z_m, stored.profile[1], atol=0.51e-9)
    assert (tmp_path / "infer.html").exists()
    assert "weld-4,weld-4-linear,fitted,2,2" in (tmp_path / "infer" / "claims.csv").read_text(encoding="utf-8")
    assert main(["study", "infer", "--weld", "6", "--out", str(tmp_path)]) == 2


@pytest.mark.usefixtures("quick")
def test_what_a_search_was_given_beside_is_said_in_its_files(tmp_path):
    folder = tmp_path / "infer"
    options = ["study", "infer", "--also", "motion", "--seeds", "1", "--out", str(tmp_path)]
    assert main([*options, "--weld", "1"]) == 0
    assert "given also what is held out of the study motion" in (folder / "weld-1-also-motion.csv").read_text("utf-8")
    assert not (folder / "weld-1.csv").exists()
    assert main(options) == 2


def test_a_weld_that_is_not_the_papers_is_refused(tmp_path):
    with pytest.raises(InputError, match="weld-9"):
        inference_study.run(StudyContext(), "weld-9", 1, tmp_path, no_progress)
