"""Claims: every form of criterion evaluated by hand, the words a reader sees, and the shipped file."""

import json
import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.errors import InputError
from weld_force_ros.studies import claims
from weld_force_ros.studies.claims import (
    Claim,
    Condition,
    Correction,
    EvaluatedClaim,
    GeometrySource,
    StudyName,
)

SHIPPED = claims.load()
WELL_FORMED = """
- id: first-maximum
  where: section 6
  statement: The maximum lies at 53 km/h.
  geometry: exact
  study: length
  criteria:
    - {key: length.first_maximum_kmh, within: [51.4, 54.6]}
  note: 3 %.
"""


def claim(
    *criteria: Condition,
    name: str = "a-claim",
    geometry: GeometrySource = "exact",
    if_not: str | None = None,
    corrected: Correction | None = None,
) -> Claim:
    return Claim(
        id=name,
        where="section 6",
        statement="Something is so.",
        geometry=geometry,
        study="length",
        criteria=list(criteria),
        note="Because it is.",
        if_not=if_not,
        corrected=corrected,
    )


def evaluated(subject: Claim, **measured: claims.Quantity) -> EvaluatedClaim:
    (result,) = claims.evaluate([subject], {f"length.{name}": value for name, value in measured.items()})
    return result


MAXIMUM = Condition(key="length.maximum_kmh", within=(51.4, 54.6))
RATIO = Condition(key="length.ratio", above=0.5)
SPREAD = Condition(key="length.spread", below=0.1)
GROWS = Condition(key="length.grows", is_=True)
STAYS = Condition(key="length.grows", is_=False)


@pytest.mark.parametrize(
    ("condition", "value", "verdict"),
    [
        (MAXIMUM, 51.4, "agrees"),
        (MAXIMUM, 54.6, "agrees"),
        (MAXIMUM, 54.61, "differs"),
        (MAXIMUM, 51.39, "differs"),
        (RATIO, 0.51, "agrees"),
        (RATIO, 0.5, "differs"),
        (SPREAD, 0.09, "agrees"),
        (SPREAD, 0.1, "differs"),
        (GROWS, True, "agrees"),
        (GROWS, False, "differs"),
        (STAYS, False, "agrees"),
        (STAYS, True, "differs"),
        (MAXIMUM, [52.0, 53.0], "agrees"),
        (MAXIMUM, [52.0, 60.0], "partly"),
        (MAXIMUM, [40.0, 60.0], "differs"),
        (MAXIMUM, [52.0, math.nan], "partly"),
        (MAXIMUM, [], "differs"),
        (MAXIMUM, math.nan, "differs"),
        (RATIO, math.nan, "differs"),
        (SPREAD, math.nan, "differs"),
        (RATIO, 3, "agrees"),
        (RATIO, np.float64(0.6), "agrees"),
        (GROWS, np.True_, "agrees"),
        (RATIO, np.array([0.6, 0.4]), "partly"),
    ],
)
def test_a_value_is_compared_with_its_criterion(condition, value, verdict):
    quantity = condition.key.removeprefix("length.")
    assert evaluated(claim(condition), **{quantity: value}).result == verdict


def test_a_claim_agrees_partly_if_only_some_criteria_hold():
    assert evaluated(claim(MAXIMUM, RATIO), maximum_kmh=53.0, ratio=1.0).result == "agrees"
    assert evaluated(claim(MAXIMUM, RATIO), maximum_kmh=53.0, ratio=0.0).result == "partly"
    assert evaluated(claim(MAXIMUM, RATIO), maximum_kmh=10.0, ratio=0.0).result == "differs"


def test_a_quantity_that_was_not_measured_is_named_whatever_the_others_say():
    verdict = evaluated(claim(MAXIMUM, RATIO), maximum_kmh=10.0)
    assert verdict.result == "not evaluated"
    assert verdict.why == "Not measured: length.ratio"
    assert verdict.values == {"length.maximum_kmh": 10.0}


def test_a_claim_without_criteria_cannot_be_tested_and_says_why():
    verdict = evaluated(claim(geometry="none"))
    assert (verdict.result, verdict.why) == ("not-testable", "Because it is.")


@pytest.mark.parametrize(
    ("condition", "value", "words"),
    [
        (MAXIMUM, 54.1, "54.1 km/h, required: 51.4 to 54.6 km/h"),
        (MAXIMUM, math.nan, "none, required: 51.4 to 54.6 km/h"),
        (MAXIMUM, [52.0, 60.0], "52, 60 km/h (1 of 2), required: 51.4 to 54.6 km/h"),
        (MAXIMUM, [52.0] * 6 + [60.0, math.nan], "52 to 60 km/h (6 of 8), required: 51.4 to 54.6 km/h"),
        (Condition(key="length.fall_n", above=0.0), 12345.6, "12346 N, required: above 0 N"),
        (Condition(key="length.peaks", within=(1.0, 1.0)), 2.0, "2, required: 1"),
        (SPREAD, 0.1234, "0.1234, required: below 0.1"),
        (GROWS, False, "no, required: yes"),
    ],
)
def test_what_was_measured_is_given_with_what_is_required(condition, value, words):
    quantity = condition.key.removeprefix("length.")
    assert evaluated(claim(condition), **{quantity: value}).measured == words


def test_each_of_several_quantities_is_named():
    measured = evaluated(claim(MAXIMUM, GROWS), maximum_kmh=53.0, grows=False).measured
    assert measured == "maximum 53 km/h, required: 51.4 to 54.6 km/h; grows no, required: yes"


def test_a_difference_says_which_quantity_what_it_means_and_that_the_shape_is_inferred():
    subject = claim(MAXIMUM, RATIO, geometry="inferred", if_not="It depends on the fit.")
    why = evaluated(subject, maximum_kmh=53.0, ratio=0.1).why
    assert why == (
        "Does not meet its criteria: ratio. It depends on the fit. "
        "The shape is inferred from the paper's text, which does not give it"
    )
    assert evaluated(subject, maximum_kmh=53.0, ratio=0.6).why == "Meets its criteria"


def test_a_corrected_criterion_stands_beside_the_first_one_and_changes_no_result():
    subject = claim(MAXIMUM, corrected=Correction(criteria=[GROWS], reason="It only says that it grows."))
    verdict = evaluated(subject, maximum_kmh=60.0, grows=True)
    assert (verdict.result, verdict.corrected_result) == ("differs", "agrees")
    assert verdict.corrected is not None
    assert verdict.corrected.measured == "yes, required: yes"
    assert verdict.corrected.reason == "It only says that it grows."
    assert evaluated(subject, maximum_kmh=53.0, grows=False).corrected_result == "differs"
    assert evaluated(subject, maximum_kmh=60.0).corrected_result == "not evaluated"
    (line,) = claims.summary([verdict]).rows[:1]
    assert line == ("exact", 0, 0, 1, 0, 0, 0.0, 1, 100.0)


@pytest.mark.parametrize(
    ("condition", "value"), [(MAXIMUM, True), (MAXIMUM, "fast"), (MAXIMUM, [True]), (GROWS, 1.0), (GROWS, [True])]
)
def test_a_value_of_the_wrong_kind_is_refused_with_its_key(condition, value):
    quantity = condition.key.removeprefix("length.")
    with pytest.raises(InputError, match=condition.key):
        evaluated(claim(condition), **{quantity: value})


numbers = st.floats(allow_nan=True, allow_infinity=False, width=32)
measurements = st.lists(numbers, min_size=1, max_size=4)


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("above"), numbers.filter(math.isfinite), measurements),
            st.tuples(st.just("below"), numbers.filter(math.isfinite), measurements),
        ),
        min_size=1,
        max_size=4,
    )
)
def test_the_result_counts_what_holds(required):
    conditions = [Condition(key=f"length.q{i}", **{form: limit}) for i, (form, limit, _) in enumerate(required)]
    held = [
        value > limit if form == "above" else value < limit for form, limit, measured in required for value in measured
    ]
    verdict = evaluated(claim(*conditions), **{f"q{i}": measured for i, (_, _, measured) in enumerate(required)}).result
    assert (verdict == "agrees") == all(held)
    assert (verdict == "differs") == (not any(held))
    assert verdict in ("agrees", "partly", "differs")


def test_the_file_holds_one_object_a_claim_in_json_that_any_reader_takes(tmp_path):
    verdict = evaluated(claim(MAXIMUM, GROWS), maximum_kmh=[53.0, math.nan], grows=np.True_)
    path = tmp_path / "claims.json"
    claims.write([verdict], path)

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    (entry,) = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert (entry["id"], entry["claim"], entry["where"]) == ("a-claim", "Something is so.", "section 6")
    assert (entry["geometry"], entry["result"]) == ("exact", "partly")
    assert entry["values"] == {"length.maximum_kmh": [53.0, None], "length.grows": True}
    assert entry["measured"] == verdict.measured
    assert "maximum" in entry["why"]


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(InputError, match="absent"):
        claims.write([], tmp_path / "absent" / "claims.json")


def test_the_table_has_a_row_a_claim_and_the_summary_counts_them_by_geometry(tmp_path):
    verdicts = claims.evaluate(
        [
            claim(MAXIMUM),
            claim(RATIO),
            claim(RATIO, geometry="assumed"),
            claim(SPREAD),
            claim(geometry="none"),
            claim(MAXIMUM, name="on-a-weld", geometry="inferred"),
        ],
        {"length.maximum_kmh": 53.0, "length.ratio": 0.1},
        {1: {"length.maximum_kmh": 60.0}},
    )
    table = claims.table(verdicts)
    results = [column.name for column in table.columns].index("result")
    assert [row[results] for row in table.rows] == [
        "agrees", "differs", "differs", "not evaluated", "not-testable", "agrees"
    ]  # fmt: skip
    counted = claims.summary(verdicts)
    assert counted.rows == [
        ("exact", 1, 0, 1, 1, 0, 50.0, 1, 50.0),
        ("inferred, all claims given", 1, 0, 0, 0, 0, 100.0, 1, 100.0),
        ("inferred, held out", 0, 0, 1, 0, 0, 0.0, 0, 0.0),
        ("assumed", 0, 0, 1, 0, 0, 0.0, 0, 0.0),
        ("none", 0, 0, 0, 0, 1, None, 0, None),
    ]
    counted.write_csv(tmp_path / "summary.csv")
    assert (tmp_path / "summary.csv").read_text(encoding="utf-8").startswith("geometry,agrees,partly,differs,")


def test_claims_of_inferred_geometry_take_folds_in_turn():
    subjects = [
        claim(RATIO, name=f"claim-{number}", geometry=geometry)
        for number, geometry in enumerate(["inferred", "exact", *6 * ["inferred"]])
    ]
    folds = claims.folds(subjects)
    assert folds == {f"claim-{n}": fold for n, fold in [(0, 1), (2, 2), (3, 3), (4, 4), (5, 5), (6, 1), (7, 2)]}


def test_a_held_out_claim_is_compared_with_what_is_measured_without_its_own_fold():
    corrected = Correction(criteria=[SPREAD], reason="It asked for more.")
    subjects = [
        claim(RATIO, geometry="inferred", corrected=corrected),
        claim(RATIO, name="another", geometry="inferred"),
        claim(RATIO, name="exact"),
    ]
    without_folds = {1: {"length.ratio": 0.2, "length.spread": 0.05}, 2: {"length.ratio": 0.9}}
    first, second, exact = claims.evaluate(subjects, {"length.ratio": 0.8}, without_folds)
    assert first.held_out is not None
    assert (first.result, first.held_out.result, first.held_out.corrected_result) == ("agrees", "differs", "agrees")
    assert first.held_out.measured == "0.2, required: above 0.5"
    assert second.held_out is not None
    assert (second.held_out.fold, second.held_out.result) == (2, "agrees")
    assert exact.held_out is None
    assert all(one.held_out is None for one in claims.evaluate(subjects, {"length.ratio": 0.8}))


def test_a_well_formed_file_is_read_as_it_stands():
    (read,) = claims.parse(WELL_FORMED.encode(), "own.yaml")
    assert read.criteria == [Condition(key="length.first_maximum_kmh", within=(51.4, 54.6))]


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("where: section 6", "where: [", "own.yaml"),
        ("  note: 3 %.\n", "", "note"),
        ("note:", "remark:", "remark"),
        ("exact", "guessed", "guessed"),
        ("study: length", "study: width", "width"),
        ("study: length", "study: hertz", "length.first_maximum_kmh"),
        ("within: [51.4, 54.6]", "within: [54.6, 51.4]", "54.6"),
        ("within: [51.4, 54.6]", "within: [51.4, .inf]", "inf"),
        ("within: [51.4, 54.6]", "above: .nan", "nan"),
        ("within: [51.4, 54.6]", "above: 1, below: 2", "exactly one"),
        (", within: [51.4, 54.6]", "", "exactly one"),
        ("within:", "outside:", "outside"),
        ("\n    - {key: length.first_maximum_kmh, within: [51.4, 54.6]}", " []", "geometry"),
        ("exact", "none", "geometry"),
        ("id: first-maximum", "id: First Maximum", "id"),
        ("  note:", "  corrected: {criteria: [], reason: Too much.}\n  note:", "criteria"),
        (
            "  note:",
            "  corrected: {criteria: [{key: hertz.change, above: 0}], reason: Too much.}\n  note:",
            "hertz.change",
        ),
        (WELL_FORMED, WELL_FORMED + WELL_FORMED, "twice"),
    ],
)
def test_a_malformed_file_is_refused_in_one_line_that_names_the_fault(old, new, names):
    text = WELL_FORMED.replace(old, new)
    assert text != WELL_FORMED
    with pytest.raises(InputError, match=names) as refusal:
        claims.parse(text.encode(), "own.yaml")
    assert "own.yaml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_the_shipped_claims_cover_every_study_with_at_least_thirty_that_can_be_tested():
    assert len([c for c in SHIPPED if c.criteria]) >= 30
    assert {c.study for c in SHIPPED if c.criteria} == set(get_args(StudyName))
    assert len({c.id for c in SHIPPED}) == len(SHIPPED)


@pytest.mark.parametrize(
    ("key", "stated_kmh", "tolerance"),
    [
        ("length.first_maximum_48mm_kmh", 53, 0.03),
        ("length.first_maximum_96mm_kmh", 107, 0.03),
        ("length.first_kink_48mm_kmh", 74, 0.04),
        ("length.first_kink_96mm_kmh", 151, 0.04),
        ("length.second_kink_48mm_kmh", 112, 0.05),
        ("length.second_kink_96mm_kmh", 230, 0.05),
    ],
)
def test_the_shipped_tolerances_are_those_set_for_the_length_study(key, stated_kmh, tolerance):
    (condition,) = [c for subject in SHIPPED for c in subject.criteria if c.key == key]
    assert condition.within == pytest.approx((stated_kmh * (1 - tolerance), stated_kmh * (1 + tolerance)))


def test_nothing_measured_leaves_every_shipped_claim_open():
    assert {verdict.result for verdict in claims.evaluate(SHIPPED, {})} == {"not evaluated", "not-testable"}
