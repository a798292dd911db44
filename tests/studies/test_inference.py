"""Shapes inferred from the paper's text: prior, cost by hand, a search with a known end, what is written."""

import math

import msgspec
import numpy as np
import pytest

from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError
from weld_force_ros.measurement import profile_file
from weld_force_ros.studies import (
    captions,
    claims,
    increment_study,
    inference,
    inference_study,
    inferred_shapes,
    no_progress,
    shape_prior,
)
from weld_force_ros.studies.claims import Claim, Condition, Correction
from weld_force_ros.studies.inference import Inference, Solution, cost_of, wavelength_cost
from weld_force_ros.studies.shape_prior import (
    Term,
    curvature_share,
    profile_of,
    rms_gradient,
    terms_of,
    wavelengths_of,
)
from weld_force_ros.studies.study_context import StudyContext
from weld_force_ros.studies.weld_map import upward_ramp

PRIORS = shape_prior.load()
WELL_FORMED = """
weld-1:
  words: a dip
  terms:
    - {what: dip, height_um: [-500, -100], place_mm: [-20, 20], length_mm: [15, 150]}
"""
DIP = Term(height_um=-300.0, place_mm=10.0, length_mm=25.0)
DIP_PROFILE = profile_of([DIP])


def solution(weld: str = "weld-1", without_fold: int | None = None, **other: object) -> Solution:
    plain = Solution(
        weld=weld, without_fold=without_fold, seed=1, cost=0.0, terms=[DIP], prior_sha256=PRIORS[weld].sha256
    )  # fmt: skip
    return msgspec.structs.replace(plain, **other)


def claim(*criteria: Condition) -> Claim:
    return Claim(
        id="a-claim", where="section 3", statement="So it is.", geometry="inferred", study="map",
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


def test_where_criteria_were_corrected_those_count():
    subject = msgspec.structs.replace(
        claim(WITHIN), corrected=Correction(criteria=[ABOVE], reason="It asked for more.")
    )
    assert cost_of(subject, {"map.speed_kmh": 300.0, "map.depth": 0.3}) == 0
    assert cost_of(subject, {"map.speed_kmh": 300.0}) is None


def test_claims_are_counted_apart_by_whether_the_search_was_given_them():
    held = {"weld-4-linear": True, "weld-4-peak-from-ramp": False, "weld-4-position-does-not-matter": True}
    found = inference_study.Found(solution("weld-4", 3), held, frozenset({"weld-4-position-does-not-matter"}))
    assert found.counted(held_out=False) == (1, 2)
    assert found.counted(held_out=True) == (1, 1)


def test_a_search_is_given_all_claims_of_inferred_geometry_but_those_of_its_fold():
    inferred = {subject.id for subject in claims.load() if subject.geometry == "inferred"}
    given = [
        {subject.id for subject in Inference("weld-1", PRIORS["weld-1"], StudyContext(), fold).given}
        for fold in (None, *range(1, claims.FOLDS + 1))
    ]
    assert given[0] == inferred
    held_out = [inferred - some for some in given[1:]]
    assert set.union(*held_out) == inferred
    assert sum(map(len, held_out)) == len(inferred)  # each once
    assert {len(some) for some in held_out} == {9, 10}


@pytest.mark.parametrize("weld", ["weld-2", "weld-4"])
def test_shapes_drawn_from_the_prior_are_within_it_and_as_the_words_say(weld):
    inference = Inference(weld, PRIORS[weld], StudyContext())
    drawn = inference.drawn(20)
    assert len(drawn) == 20
    assert all(captions.contradictions(weld, profile) == 0 for profile in drawn)
    assert max(map(curvature_share, drawn)) <= shape_prior.MOST_CURVATURE
    again, heights = inference.drawn(3), np.array([z for _, z in drawn])
    np.testing.assert_array_equal([z for _, z in again], heights[:3])
    assert len(np.unique(heights, axis=0)) == 20


def test_drawn_shapes_of_weld_1_have_its_wavelengths():
    inference = Inference("weld-1", PRIORS["weld-1"], StudyContext())
    assert all(wavelength_cost(inference.prior.wavelengths_m, profile) == 0 for profile in inference.drawn(2))


def test_a_shape_that_the_wheel_touches_twice_costs_more_than_any_other():
    sought = Inference("weld-1", PRIORS["weld-1"], StudyContext())
    # 500 um at a length of 15 mm curve by 2.2 / m, the wheel itself by 1 / 0.45 m.
    cost = sought.cost(np.array([-500.0, 0.0, 15.0]))
    assert cost == pytest.approx(len(sought.given) + 1 + 500e-6 / 0.015**2 * 0.45 - 0.85, abs=0.02)


@pytest.fixture
def quick(monkeypatch):
    """Searches whose cost is the distance of their first height from -333 um, and no passages."""
    monkeypatch.setattr(Inference, "cost", lambda _self, parameters: abs(parameters[0] + 333.0))
    monkeypatch.setattr(Inference, "_quantities", lambda *_: {"map.linearity_weld_4": 0.98})
    monkeypatch.setattr(Inference, "drawn", lambda *_: 2 * [DIP_PROFILE])
    monkeypatch.setattr(
        increment_study,
        "quantities_over_weld_1",
        lambda _context, weld: {
            "increment.minimum_cells_ratio": 1.0, "increment.depressions_ratio": 0.5,
            "increment.spread_ratio": -1e4 * weld[1].min(),
        },
    )  # fmt: skip


@pytest.mark.usefixtures("quick")
def test_a_search_finds_a_known_minimum_within_the_prior_and_again_with_its_seed():
    sought = Inference("weld-1", PRIORS["weld-1"], StudyContext(), 2)
    generations: list[int] = []
    found = sought.search(7, lambda: generations.append(1))
    assert found.without_fold == 2
    assert found.terms[0].height_um == pytest.approx(-333.0, abs=0.5)
    assert found.cost == abs(found.terms[0].height_um + 333.0)
    assert 1 <= len(generations) <= inference.GENERATIONS + 1
    parameters = [v for term in found.terms for v in (term.height_um, term.place_mm, term.length_mm)]
    assert all(low <= v <= high for v, (low, high) in zip(parameters, PRIORS["weld-1"].bounds, strict=True))
    assert sought.search(7) == found
    assert sought.search(8) != found


@pytest.mark.usefixtures("quick")
def test_a_second_run_takes_what_the_first_found_unless_the_prior_changed(tmp_path, monkeypatch):
    first = inference_study.run(StudyContext(), "weld-1", tmp_path, no_progress)
    assert [row[1] for row in first.tables["solutions"].rows] == [None, 1.0, 2.0, 3.0, 4.0, 5.0]
    heights = first.tables["heights"].rows  # one shape, lower and higher
    assert [row[0] for row in heights] == [0.2, 0.5, 1.0, 2.0, 3.0]
    lowest_um = 1e6 * min(profile_file.read_profile(tmp_path / "weld-1.csv").z_m)
    np.testing.assert_allclose([row[4] for row in heights], [-0.01 * row[0] * lowest_um for row in heights], rtol=1e-4)
    monkeypatch.setattr(Inference, "search", None)
    assert inference_study.run(StudyContext(), "weld-1", tmp_path, no_progress).tables == first.tables
    stored = tmp_path / "weld-1-without-fold-2-seed-1.json"
    stored.write_bytes(msgspec.json.encode(solution(without_fold=2, prior_sha256="0")))
    with pytest.raises(TypeError):
        inference_study.run(StudyContext(), "weld-1", tmp_path, no_progress)
    stored.write_text("{}")
    with pytest.raises(InputError, match=stored.name):
        inference_study.run(StudyContext(), "weld-1", tmp_path, no_progress)


@pytest.mark.usefixtures("quick")
def test_where_a_search_meets_all_that_it_is_given_the_most_typical_of_several_that_do_is_taken(tmp_path, monkeypatch):
    depths = {1: 100.0, 2: 200.0, 3: 270.0, 4: 150.0, 5: 260.0, 6: 155.0, 7: 300.0, 8: 140.0, 9: 390.0}
    costs = {4: 0.1, 6: 0.1, 7: 0.1, 8: 0.1}  # in the midst of the others, but no solutions
    searched: list[int] = []

    def search(sought: Inference, seed: int, _on_generation: object) -> Solution:
        searched.append(seed)
        term = Term(-depths[seed], 0.0, 60.0)
        cost = 0.5 if sought.without_fold else costs.get(seed, 0.0)
        return solution(sought.weld, sought.without_fold, seed=seed, cost=cost, terms=[term])

    monkeypatch.setattr(Inference, "search", search)
    rows = inference_study.run(StudyContext(), "weld-1", tmp_path, no_progress).tables["solutions"].rows
    assert [row[2] for row in rows] == [0.0, *5 * [0.5]]
    assert searched == [*range(1, 10), *5 * [1]]  # the folds' first searches leave something
    # Of depths of 100, 200, 260, 270 and 390 um the median is nearest to the others.
    assert profile_file.read_profile(tmp_path / "weld-1.csv").z_m[250] == pytest.approx(-260e-6, abs=1e-9)


@pytest.mark.usefixtures("quick")
def test_the_command_leaves_shapes_that_are_read_as_welds_and_says_how_they_came_about(tmp_path, capsys):
    assert main(["study", "infer", "--weld", "4", "--out", str(tmp_path), "--json", "-"]) == 0
    lines = [msgspec.json.decode(line) for line in capsys.readouterr().out.splitlines()]
    # Weld 4 is linear, which is the second of the folds' claims on it.
    counts = [(line["without_fold"], line["given_met"], line["held_out_met"]) for line in lines]
    fold = claims.folds(claims.load())["weld-4-linear"]
    assert counts == [(None, 1, 0), *((n, int(n != fold), int(n == fold)) for n in range(1, claims.FOLDS + 1))]
    folder = tmp_path / "infer"
    shipped = (folder / "weld-4.csv").read_text(encoding="utf-8")
    assert "Inferred from the text" in shipped
    assert "all claims given, seed 1" in shipped
    assert "claims of fold 3 held out" in (folder / "weld-4-without-fold-3.csv").read_text(encoding="utf-8")
    stored = msgspec.json.decode((folder / "weld-4-seed-1.json").read_bytes(), type=Solution)
    profile = profile_file.read_profile(folder / "weld-4.csv")
    assert profile.weld_id == "weld-4"
    np.testing.assert_allclose(profile.x_m, stored.profile[0], atol=1e-12)
    np.testing.assert_allclose(profile.z_m, stored.profile[1], atol=0.51e-9)
    assert (tmp_path / "infer.html").exists()
    assert f"weld-4,weld-4-linear,{fold},yes,yes,6,6" in (folder / "claims.csv").read_text(encoding="utf-8")
    assert not (folder / inferred_shapes.FILE).exists()  # of all welds only
    assert main(["study", "infer", "--weld", "6", "--out", str(tmp_path)]) == 2


@pytest.mark.usefixtures("quick")
def test_searches_of_all_welds_leave_the_file_that_held_out_claims_are_evaluated_with(tmp_path, monkeypatch):
    monkeypatch.setattr(inference, "GENERATIONS", 1)
    inference_study.run(StudyContext(), None, tmp_path, no_progress)
    shapes = msgspec.json.decode((tmp_path / inferred_shapes.FILE).read_bytes(), type=list[Solution])
    assert [(shape.weld, shape.without_fold) for shape in shapes] == [
        (weld, fold) for weld in PRIORS for fold in (None, *range(1, claims.FOLDS + 1))
    ]


def test_shipped_shapes_are_of_the_prior_that_ships_and_the_profiles_those_given_all_claims():
    shapes = {(shape.weld, shape.without_fold): shape for shape in inferred_shapes.load()}
    assert set(shapes) == {(weld, fold) for weld in PRIORS for fold in (None, *range(1, claims.FOLDS + 1))}
    for (weld, fold), shape in shapes.items():
        assert shape.prior_sha256 == PRIORS[weld].sha256
        assert captions.contradictions(weld, shape.profile) == 0
        assert curvature_share(shape.profile) <= shape_prior.MOST_CURVATURE
        if fold is None:
            profile = profile_file.read_profile(profile_file.find(weld))
            np.testing.assert_allclose(profile.z_m, shape.profile[1], atol=0.51e-9)


def test_claims_on_several_welds_are_measured_over_the_shapes_of_their_fold():
    found = inferred_shapes.quantities_without(2, StudyContext(coarse=True))
    asked = {c.key for one in claims.load() if one.geometry == "inferred" for c in one.all_criteria}
    assert asked <= found.keys()
    # Over the shapes of another fold it is something else.
    assert found != inferred_shapes.quantities_without(3, StudyContext(coarse=True))


def test_a_weld_that_is_not_the_papers_is_refused(tmp_path):
    with pytest.raises(InputError, match="weld-9"):
        inference_study.run(StudyContext(), "weld-9", tmp_path, no_progress)
