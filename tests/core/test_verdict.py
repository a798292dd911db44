import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET, UnsetType

from weld_force_ros.contract import ForceMap, Limit
from weld_force_ros.core.verdict import find
from weld_force_ros.errors import InputError

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


def test_worst_passage_is_named():
    found = find(force_map(), [])
    assert (found.peak_force_n, found.worst_speed_kmh, found.worst_position_m) == (190e3, 120.0, 0.0)
    assert found.worst_x_m == pytest.approx(0.08)
    assert found.judged_speed_kmh == 120.0
    assert "190 kN at 120 km/h" in found.reason


@pytest.mark.parametrize(
    ("line_speed", "judged", "peak"),
    [(80.0, 80.0, 150e3), (119.9, 80.0, 150e3), (120.0, 120.0, 190e3), (300.0, 120.0, 190e3), (80, 80.0, 150e3)],
)
def test_nothing_above_line_speed_is_judged(line_speed: float, judged: float, peak: float):
    found = find(force_map(line_speed, contact_loss_s=0.01), [limit("contact_loss", 0.0, 1.0)])
    assert (found.judged_speed_kmh, found.peak_force_n) == (judged, peak)
    assert found.criteria[0].passed == (judged < 120.0)


def test_map_wholly_above_line_speed_is_judged_at_its_lowest():
    found = find(force_map(line_speed_kmh=30.0), [])
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
    found = find(force_map(weld_position_m=weld_position), [])
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
    found = find(force_map(), [limit("peak_force", least, most)])
    assert found.decision == decision
    assert (found.criteria[0].value, found.criteria[0].passed) == (190e3, decision == "accept")
    assert ("peak_force" in found.reason) == (decision != "accept")


def test_worst_criterion_decides_and_all_are_listed():
    limits = [limit("peak_force", 180e3, 300e3), limit("dynamic_factor", 2.0, 3.0), limit("contact_loss", 0.0, 1e-3)]
    found = find(force_map(contact_loss_s=2e-3), limits)
    assert found.decision == "reject"
    assert [(c.name, c.value, c.passed) for c in found.criteria] == [
        ("peak_force", 190e3, False),
        ("dynamic_factor", 1.9, True),
        ("contact_loss", 2e-3, False),
    ]
    assert find(force_map(contact_loss_s=1e-3), limits).decision == "grind"


def test_limit_for_no_criterion_is_refused():
    with pytest.raises(InputError, match=r"no criterion.*peak_force"):
        find(force_map(), [limit("colour", 1.0, 2.0)])


@given(st.floats(1e3, 1e6), st.floats(0.0, 1e6), st.floats(1.0, 2.0))
def test_looser_limits_never_decide_harder(least: float, margin: float, factor: float):
    severity = ["accept", "grind", "reject"].index
    tight = find(force_map(), [limit("peak_force", least, least + margin)])
    loose = find(force_map(), [limit("peak_force", least * factor, (least + margin) * factor)])
    assert severity(loose.decision) <= severity(tight.decision)
