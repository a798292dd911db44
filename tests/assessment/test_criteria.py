"""Each criterion against an example worked by hand, and its source."""

import numpy as np
import pytest
from msgspec import UNSET

from weld_force_ros.assessment.criteria import CRITERIA, FORCE_CRITERIA, geometry_value, gradient_norm_rad
from weld_force_ros.assessment.limits import applies, load_limits
from weld_force_ros.messages import Limit, NormPoint, ProfileMeasures, SpeedCurve, WeldProfile, profile_sha256
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.simulator import profile_measures

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
    values = FORCE_CRITERIA[name](Passages.of_message(CURVE, STATIC_N, (2,)))
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
    assert geometry_value("quality_index", measures(2.1e-3), 170.0, []) == pytest.approx(1.0)
    assert geometry_value("quality_index", measures(3.2e-3), 30.0, []) == pytest.approx(1.0)
    assert geometry_value("quality_index", measures(3e-3), 350.0, []) == pytest.approx(3.0)
    own = [NormPoint(speed_kmh=100.0, gradient_rad=2e-3)]
    assert geometry_value("quality_index", measures(3e-3), 350.0, own) == pytest.approx(1.5)
    assert geometry_value("straightedge", measures(), 350.0, []) == 0.4e-3
    assert geometry_value("straightedge", UNSET, 350.0, []) is None


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


def test_shipped_limits_cover_every_criterion_and_every_line_speed_once():
    settings = load_limits()
    for line_kmh in (1.0, 40.0, 160.0, 161.0, 200.0, 250.0, 299.0, 300.0, 350.0, 1000.0):
        assert [limit.name for limit in settings.limits if applies(limit, line_kmh)] == list(CRITERIA)
    assert not any(limit.verified for limit in settings.limits)
    assert all(limit.source and limit.applies for limit in settings.limits)
