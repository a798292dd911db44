"""Each criterion against an example worked by hand, and its source."""

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from weld_force_ros.assessment.criteria import (
    FORCE_CRITERIA,
    GEOMETRY_CRITERIA,
    geometry_values,
    gradient_norm_rad,
)
from weld_force_ros.assessment.limits import applies
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.messages import (
    EdgeReading,
    Limit,
    NormPoint,
    ProfileMeasures,
    SpeedCurve,
    UncertaintyResult,
    WeldProfile,
    profile_sha256,
)
from weld_force_ros.physics.analysis.geometry import (
    EDGES_M,
    irregularity_length,
    largest_inclination,
    largest_step,
    straightedge_readings,
)
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.profile_measures import profile_measures

STATIC_N = 100e3
CURVE = SpeedCurve(
    speeds_kmh=[80.0, 120.0],
    peak_force_n=[216e3, 172.8e3],
    min_force_n=[0.0, 30e3],
    contact_loss_s=[0.4e-3, 0.0],
    at_m=[0.0, 0.3],
    p2_force_n=[150e3, 160e3],
    force_20hz_n=[110e3, 112e3],
)


@pytest.mark.parametrize(
    ("name", "by_hand"),
    [
        ("peak_force", [216e3, 172.8e3]),
        ("p2_force", [150e3, 160e3]),
        ("force_20hz", [110e3, 112e3]),
        ("dynamic_factor", [2.16, 1.728]),
        ("hertz_pressure_index", [2.16 ** (1 / 3), 1.2]),  # 1.2^3 = 1.728
        ("unloading", [1.0, 0.7]),
        ("contact_loss", [0.4e-3, 0.0]),
    ],
)
def test_force_criteria_by_hand(name: str, by_hand: list[float]):
    values = FORCE_CRITERIA[name].value(Passages.of_message(CURVE, STATIC_N, (2,)))
    assert values == pytest.approx(by_hand)


def test_pressure_index_is_that_of_hertz_for_any_curvatures():
    """p0 = 3 F / (2 pi a b) with semi-axes a, b that grow as F^(1/3) (Johnson 1985, eq. 4.22 to 4.28)."""
    wheel = Wheel(600.0, STATIC_N, 0.45, 93.7e9)
    for radius_m in (0.1, 0.45):  # sphere on plane: a^3 = 3 F R / (4 E*), p0 = 3 F / (2 pi a^2)
        a_m = (3 * np.array([STATIC_N, 172.8e3]) * radius_m / (4 * 115e9)) ** (1 / 3)
        pressure = 3 * np.array([STATIC_N, 172.8e3]) / (2 * np.pi * a_m**2)
        assert pressure[1] / pressure[0] == pytest.approx(1.2)
    assert wheel.static_load_n == STATIC_N


def measures(gradient_rad: float = 2e-3, straightedge_m: float = 0.4e-3) -> ProfileMeasures:
    return ProfileMeasures(
        kind="dip", dip_m=1e-4, protrusion_m=0.0, gradient_rad=gradient_rad, straightedge_m=straightedge_m,
        spacing_m=5e-3,
    )  # fmt: skip


def test_geometry_criteria_by_hand():
    # esveld.com: 3.2 mrad at 40 km/h, 1.0 mrad at 300 km/h; half way between them 2.1 mrad at 170 km/h.
    assert gradient_norm_rad(170.0, []) == pytest.approx(2.1e-3)
    index, straightedge = on_geometry("quality_index"), on_geometry("straightedge")
    assert geometry_values(index, measures(2.1e-3), 170.0, []) == pytest.approx(1.0)
    assert geometry_values(index, measures(3.2e-3), 30.0, []) == pytest.approx(1.0)
    assert geometry_values(index, measures(3e-3), 350.0, []) == pytest.approx(3.0)
    own = [NormPoint(speed_kmh=100.0, gradient_rad=2e-3)]
    assert geometry_values(index, measures(3e-3), 350.0, own) == pytest.approx(1.5)
    assert geometry_values(straightedge, measures(), 350.0, []) == 0.4e-3
    assert geometry_values(straightedge, UNSET, 350.0, []) is None


def on_geometry(name: str, **stated: object) -> Limit:
    return Limit(name=name, limit=1.0, reject_limit=1.0, unit="as the criterion", source="by hand", **stated)


def test_readings_under_a_straightedge_by_hand():
    """A bent rail: heights 1 mm at the middle of 1 m fall to -0.24 mm at 0.6 m; the chord of 1 m is level at 0.1388."""
    x = np.linspace(-0.6, 0.6, 1201)
    z = 1e-3 * (1 - (x / 0.5) ** 2) + np.where(np.abs(x + 0.3) < 1e-9, -2e-3, 0.0)
    found = {edge.base_m: edge for edge in straightedge_readings(x, z)}
    assert set(found) == {0.1, 1.0}  # the record is too short for 1.5 and 3 m
    assert found[1.0].peak_m == pytest.approx(1e-3)
    assert found[1.0].dip_m == pytest.approx(2e-3 - 1e-3 * (1 - 0.36))  # the notch, 0.3 m from the middle
    assert found[0.1].peak_m == pytest.approx(1e-3 * 0.1**2)
    assert {edge.base_m for edge in straightedge_readings(x, z, level_beyond=True)} == set(EDGES_M)


def test_the_dip_under_an_edge_is_below_the_line_between_its_ends_though_the_record_is_tilted():
    x = np.linspace(-0.6, 0.6, 601)
    z = 2e-3 * x - 0.3e-3 * np.clip(1 - np.abs(x) / 0.2, 0.0, None)
    (edge,) = [edge for edge in straightedge_readings(x, z) if edge.base_m == 1.0]
    assert (edge.peak_m, edge.dip_m) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.3e-3))


@pytest.mark.parametrize("length_m", [1.2, 3.0])
def test_a_bent_rail_has_one_quality_index_from_short_and_from_long_records(length_m: float):
    """Height -k x^2 / 2: the inclination at 0.4875 m, the middle of the last 25 mm, is 0.4875 k."""
    x = np.linspace(-length_m / 2, length_m / 2, 1201)
    bend = 1.63e-3 / 0.4875
    assert largest_inclination(x, -bend * x**2 / 2) == pytest.approx(1.63e-3, rel=0.005)


def test_step_and_length_by_hand():
    x = np.linspace(-0.5, 0.5, 1001)
    assert largest_step(x, np.where(x > 0, 0.2e-3, 0.0)) == pytest.approx(0.2e-3)
    assert irregularity_length(x, np.where(np.abs(x) < 0.1, -1e-3 * (1 + np.cos(10 * np.pi * x)) / 2, 0.0)) == (
        pytest.approx(0.2, rel=0.02)
    )
    assert irregularity_length(x, np.zeros(1001)) == 0.0


@pytest.mark.parametrize(
    ("name", "by_hand"),
    [("straightedge_peak", 0.4e-3), ("straightedge_dip", 0.1e-3), ("straightedge_abs", 0.4e-3),
     ("inclination", 1.5e-3), ("step", 0.05e-3), ("quality_index", 0.5)],
)  # fmt: skip
def test_geometry_criteria_of_a_profile_and_of_samples_by_hand(name: str, by_hand: float):
    edges = [EdgeReading(base_m=1.0, peak_m=0.4e-3, dip_m=0.1e-3), EdgeReading(base_m=0.1, peak_m=1.0, dip_m=1.0)]
    measured = replace(measures(), edges=edges, inclination_rad=1.5e-3, step_m=0.05e-3)
    limit, norm = on_geometry(name, base_m=1.0), [NormPoint(speed_kmh=100.0, gradient_rad=3e-3)]
    assert geometry_values(limit, measured, 100.0, norm) == pytest.approx(by_hand)
    three = [1.0, 1.1, 1.2]
    sampled = UncertaintyResult(
        positions_m=[0.0], peak_force_n=[1.0] * 3, min_force_n=[1.0] * 3, contact_loss_s=[0.0] * 3,
        gradient_rad=[0.0] * 3, straightedge_m=[0.0] * 3, support_factor=[1.0] * 3, hertz_factor=[1.0] * 3,
        wheel_radius_m=[0.45] * 3, edge_base_m=[0.1, 1.0], edge_peak_m=[9.0] * 3 + [0.4e-3 * f for f in three],
        edge_dip_m=[9.0] * 3 + [0.1e-3 * f for f in three], inclination_rad=[1.5e-3 * f for f in three],
        step_m=[0.05e-3 * f for f in three],
    )  # fmt: skip
    assert geometry_values(limit, sampled, 100.0, norm) == pytest.approx([by_hand * f for f in three])
    assert geometry_values(on_geometry("straightedge_abs", base_m=3.0), measured, 100.0, norm) is None


def test_profile_is_measured_by_hand():
    """A triangle 0.5 mm deep on a base of 1 m: its flanks fall 1 mm per metre, and that is its depth under a metre."""
    x = np.linspace(-0.6, 0.6, 601)
    z = -0.5e-3 * np.clip(1 - np.abs(x) / 0.5, 0.0, None)
    profile = WeldProfile(
        weld_id="triangle", source="hand", x_m=x.tolist(), z_m=z.tolist(), profile_sha256=profile_sha256(x, z)
    )
    found = profile_measures(profile)
    assert (found.kind, found.protrusion_m) == ("dip", 0.0)
    assert found.dip_m == pytest.approx(0.5e-3)
    assert found.gradient_rad == pytest.approx(1e-3, rel=1e-6)
    assert found.straightedge_m == pytest.approx(0.5e-3, rel=0.01)
    assert found.spacing_m == pytest.approx(2e-3)


@pytest.mark.parametrize(
    ("above", "upto", "line", "holds"),
    [
        (UNSET, 160.0, 160.0, True),
        (UNSET, 160.0, 160.1, False),
        (160.0, 200.0, 160.0, False),
        (160.0, 200.0, 200.0, True),
        (300.0, UNSET, 301.0, True),
        (UNSET, UNSET, 10.0, True),
    ],
)
def test_limits_hold_above_one_speed_and_up_to_another(above, upto, line: float, holds: bool):
    limit = Limit(name="force_20hz", limit=1.0, reject_limit=1.0, unit="N", source="", above_kmh=above, to_kmh=upto)
    assert applies(limit, line) is holds


def test_every_force_limit_says_why_and_that_nobody_has_verified_it():
    settings = load_limits()
    assert {limit.name for limit in settings.limits} < set(FORCE_CRITERIA)
    assert not any(limit.verified for limit in settings.limits)
    assert all(limit.source and limit.applies for limit in settings.limits)
    assert not {limit.name for limit in settings.limits} & set(GEOMETRY_CRITERIA)
