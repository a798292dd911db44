import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET, UnsetType

from weld_force_ros.assessment.verdict import WORST_POSITION, Evaluation, evaluate
from weld_force_ros.errors import InputError
from weld_force_ros.messages import ForceMap, Limit, ProfileMeasures, Rules, UncertaintyResult
from weld_force_ros.simulation.force_map_view import relevant_range

SPEEDS = [40.0, 80.0, 120.0]
POSITIONS = [0.0, 0.15, 0.30, 0.45]
PEAKS_KN = [
    [110.0, 111.0, 112.0, 113.0],
    [130.0, 150.0, 140.0, 120.0],
    [190.0, 170.0, 160.0, 180.0],
]


def force_map(
    line_speed_kmh: float | UnsetType = UNSET,
    weld_position_m: float | UnsetType = UNSET,
    contact_loss_s: float = 0.0,
) -> ForceMap:
    """A map on which every passage at 120 km/h loses contact for `contact_loss_s`."""
    return ForceMap(
        weld_id="by hand",
        profile_sha256="0" * 64,
        config_sha256="0" * 64,
        track="bilbao",
        engine="common-poles",
        speeds_kmh=SPEEDS,
        positions_m=POSITIONS,
        peak_force_n=[1e3 * peak for row in PEAKS_KN for peak in row],
        peak_x_m=[0.01 * cell for cell in range(12)],
        min_force_n=[50e3] * 12,
        contact_loss_s=[0.0] * 8 + [contact_loss_s] * 4,
        static_load_n=100e3,
        span_m=0.6,
        elapsed_s=1.0,
        line_speed_kmh=line_speed_kmh,
        weld_position_m=weld_position_m,
    )


def limit(name: str, least: float, most: float) -> Limit:
    return Limit(name=name, limit=least, reject_limit=most, unit="", source="by hand")


def evaluated(force_map: ForceMap, limits: list[Limit], rules: Rules = WORST_POSITION) -> Evaluation:
    return evaluate(relevant_range(force_map), limits, rules)


def test_worst_passage_is_named():
    found = evaluated(force_map(), [])
    assert (found.peak_force_n, found.worst_speed_kmh, found.worst_position_m) == (190e3, 120.0, 0.0)
    assert found.worst_x_m == pytest.approx(0.08)
    assert found.judged_speed_kmh == 120.0
    assert "190 kN at 120 km/h" in found.reason


@pytest.mark.parametrize(
    ("line_speed", "judged", "peak"),
    [(80.0, 80.0, 150e3), (119.9, 80.0, 150e3), (120.0, 120.0, 190e3), (300.0, 120.0, 190e3), (80, 80.0, 150e3)],
)
def test_nothing_above_line_speed_is_judged(line_speed: float, judged: float, peak: float):
    found = evaluated(force_map(line_speed, contact_loss_s=0.01), [limit("contact_loss", 0.0, 1.0)])
    assert (found.judged_speed_kmh, found.peak_force_n) == (judged, peak)
    assert found.criteria[0].passed == (judged < 120.0)


def test_map_wholly_above_line_speed_is_judged_at_its_lowest():
    found = evaluated(force_map(line_speed_kmh=30.0), [])
    assert (found.judged_speed_kmh, found.peak_force_n) == (40.0, 113e3)


@pytest.mark.parametrize(
    ("weld_position", "worst_position", "peak"),
    [
        (0.20, 0.15, 170e3),  # between 0.15 and 0.30
        (0.40, 0.45, 180e3),  # between 0.30 and 0.45
        (0.55, 0.00, 190e3),  # between 0.45 and the next sleeper
        (0.30, 0.30, 160e3),  # computed itself
        (0.90, 0.30, 160e3),  # the same place one span on
        (0, 0.00, 190e3),
    ],
)
def test_known_weld_position_is_judged_by_its_neighbours(weld_position: float, worst_position: float, peak: float):
    found = evaluated(force_map(weld_position_m=weld_position), [])
    assert (found.worst_position_m, found.peak_force_n) == (worst_position, peak)


@pytest.mark.parametrize(
    ("least", "most", "decision"),
    [
        (200e3, 300e3, "accept"),
        (190e3, 300e3, "accept"),  # exactly at the limit is within it
        (180e3, 300e3, "grind"),
        (180e3, 190e3, "grind"),
        (150e3, 180e3, "reject"),
    ],
)
def test_peak_force_decides(least: float, most: float, decision: str):
    found = evaluated(force_map(), [limit("peak_force", least, most)])
    assert found.decision == decision
    assert (found.criteria[0].value, found.criteria[0].passed) == (190e3, decision == "accept")
    assert ("peak_force" in found.reason) == (decision != "accept")


def test_worst_criterion_decides_and_all_are_listed():
    limits = [limit("peak_force", 180e3, 300e3), limit("dynamic_factor", 2.0, 3.0), limit("contact_loss", 0.0, 1e-3)]
    found = evaluated(force_map(contact_loss_s=2e-3), limits)
    assert found.decision == "reject"
    assert [(c.name, c.value, c.passed) for c in found.criteria] == [
        ("peak_force", 190e3, False),
        ("dynamic_factor", 1.9, True),
        ("contact_loss", 2e-3, False),
    ]
    assert evaluated(force_map(contact_loss_s=1e-3), limits).decision == "grind"


def test_limit_for_no_criterion_is_refused():
    with pytest.raises(InputError, match=r"no criterion.*peak_force"):
        evaluated(force_map(), [limit("colour", 1.0, 2.0)])


@given(st.floats(1e3, 1e6), st.floats(0.0, 1e6), st.floats(1.0, 2.0))
def test_looser_limits_never_decide_harder(least: float, margin: float, factor: float):
    severity = ["accept", "grind", "reject"].index
    tight = evaluated(force_map(), [limit("peak_force", least, least + margin)])
    loose = evaluated(force_map(), [limit("peak_force", least * factor, (least + margin) * factor)])
    assert severity(loose.decision) <= severity(tight.decision)


def measures(spacing_m: float = 1e-3, gradient_rad: float = 1e-3) -> ProfileMeasures:
    return ProfileMeasures(
        kind="dip", dip_m=1e-4, protrusion_m=0.0, gradient_rad=gradient_rad, straightedge_m=0.0, spacing_m=spacing_m
    )


UNDECIDED = Rules(unknown_position="undecided")


def test_criteria_say_where_and_by_how_much():
    found = evaluated(
        force_map(contact_loss_s=2e-3), [limit("peak_force", 200e3, 300e3), limit("contact_loss", 1e-3, 1.0)]
    )
    peak, loss = found.criteria
    assert (peak.margin, peak.reject_limit, peak.speed_kmh, peak.position_m) == (10e3, 300e3, 120.0, 0.0)
    assert peak.x_m == pytest.approx(0.08)
    assert loss.margin == pytest.approx(-1e-3)
    assert loss.speed_kmh == 120.0
    assert loss.x_m is UNSET


def test_unknown_position_that_decides_leaves_it_undecided_and_says_where():
    """At 175 kN, the weld passes between the sleepers and not near them: 190, 170, 160, 180 kN."""
    limits = [limit("peak_force", 175e3, 300e3)]
    found = evaluated(force_map(), limits, UNDECIDED)
    assert found.decision == "undecided"
    assert "accept at 15 to 30 cm, grind at 0 and 45 cm after the sleeper: measure" in found.reason
    assert [p.decision for p in found.by_position] == ["grind", "accept", "accept", "grind"]
    assert evaluated(force_map(), limits).decision == "grind"  # the worst position counts
    for at_m, decision in ((0.15, "accept"), (0.2, "accept"), (0.45, "grind"), (0.4, "grind")):
        known = evaluated(force_map(weld_position_m=at_m), limits, UNDECIDED)
        assert (known.decision, known.by_position) == (decision, [])


@given(st.floats(100e3, 200e3), st.floats(1.0, 1.5))
def test_undecided_only_where_positions_differ(least: float, factor: float):
    limits = [limit("peak_force", least, least * factor)]
    found = evaluated(force_map(), limits, UNDECIDED)
    decisions = {p.decision for p in found.by_position}
    assert (found.decision == "undecided") == (len(decisions) > 1)
    if len(decisions) == 1:
        assert decisions == {found.decision} == {evaluated(force_map(), limits).decision}


@pytest.mark.parametrize(
    ("spacing_m", "resolved_hz", "decision"),
    [
        (5e-3, 1000.0, "accept"),  # 120 km/h over 10 mm: 3333 Hz
        (10e-3, 1000.0, "accept"),  # 1667 Hz
        (10e-3, 2000.0, "undecided"),
        (10e-3, 0.0, "accept"),  # any sampling will do
    ],
)
def test_samples_too_far_apart_support_no_acceptance(spacing_m: float, resolved_hz: float, decision: str):
    rules = Rules(unknown_position="worst", resolved_hz=resolved_hz)
    coarse = msgspec.structs.replace(force_map(), measures=measures(spacing_m))
    found = evaluated(coarse, [limit("peak_force", 200e3, 300e3)], rules)
    assert found.decision == decision
    if decision == "undecided":
        # 33.3 m/s / 2000 Hz = 16.7 mm, twice a sample
        assert "10 mm apart do not show waves below 20 mm" in found.reason
        assert "above 1667 Hz at 120 km/h: measure every 8.3 mm or closer" in found.reason
    # What is over its limit already is so whatever was not seen.
    assert evaluated(coarse, [limit("peak_force", 150e3, 300e3)], rules).decision == "grind"


def test_a_criterion_that_was_not_computed_supports_no_acceptance():
    limits = [limit("peak_force", 200e3, 300e3), limit("p2_force", 1.0, 2.0), limit("straightedge", 1.0, 2.0)]
    found = evaluated(force_map(), limits)
    assert (found.decision, found.unjudged) == ("undecided", ["p2_force", "straightedge"])
    assert "p2_force was not computed" in found.reason
    assert evaluated(force_map(), [limit("peak_force", 150e3, 300e3), limits[1]]).decision == "grind"


def test_what_does_not_decide_is_shown_and_not_counted():
    beside = Limit(name="quality_index", limit=1.0, reject_limit=2.0, unit="1", source="", decides=False)
    steep = msgspec.structs.replace(force_map(), measures=measures(gradient_rad=0.1))
    found = evaluated(steep, [limit("peak_force", 200e3, 300e3), beside])
    assert (found.decision, found.criteria[1].passed, found.criteria[1].decides) == ("accept", False, False)
    assert "all within limits (informative only: quality_index)" in found.reason
    counted = msgspec.structs.replace(beside, decides=UNSET)
    assert evaluated(steep, [counted]).decision == "reject"
    assert evaluated(force_map(), [beside]).unjudged == []


@pytest.mark.parametrize(("line", "decision"), [(80.0, "accept"), (100.0, "accept"), (120.0, "grind")])
def test_limits_are_those_of_the_lines_speed(line: float, decision: str):
    limits = [
        Limit(name="peak_force", limit=160e3, reject_limit=300e3, unit="N", source="", to_kmh=100.0),
        Limit(name="peak_force", limit=140e3, reject_limit=300e3, unit="N", source="", above_kmh=100.0),
    ]
    found = evaluated(force_map(line_speed_kmh=line), limits)
    assert found.decision == decision
    assert [c.limit for c in found.criteria] == [160e3 if line <= 100.0 else 140e3]


def test_probability_is_the_share_of_samples_and_places_beyond_the_limit():
    places, factors = [0.0, 0.3], [0.8, 0.8, 1.25, 1.25]
    spread = UncertaintyResult(
        positions_m=places,
        # by support factor and place: 100 and 120 on soft, 140 and 160 kN on stiff supports
        peak_force_n=[100e3, 120e3, 100e3, 120e3, 140e3, 160e3, 140e3, 160e3],
        min_force_n=[0.0] * 8,
        contact_loss_s=[0.0] * 8,
        gradient_rad=[1e-3] * 4,
        straightedge_m=[1e-4, 2e-4, 3e-4, 4e-4],
        support_factor=factors,
        hertz_factor=[1.0] * 4,
        wheel_radius_m=[0.45] * 4,
    )
    sampled = msgspec.structs.replace(force_map(), spread=spread, measures=measures())
    found = evaluated(
        sampled, [limit("peak_force", 130e3, 150e3), limit("straightedge", 2.5e-4, 1.0), limit("unloading", 2.0, 3.0)]
    )
    peak, straightedge, unloading = found.criteria
    assert (peak.exceeding, peak.exceeding_reject) == (0.5, 0.25)
    # Means differ by 40 kN with the supports and by 20 kN with the place: variances 400 and 100 kN^2.
    assert (peak.driver, peak.driver_share) == ("support stiffness", pytest.approx(0.8))
    assert straightedge.exceeding == 0.5
    assert (unloading.exceeding, unloading.driver) == (0.0, UNSET)  # always the same
