"""Speed advice: equal to what trying every whole km/h by itself gives, and to curves worked by hand."""

import numpy as np
import pytest
from msgspec import UNSET

from weld_force_ros.assessment.judge import judge, told_apart
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.assessment.speed_advice import advise, in_prose_kmh
from weld_force_ros.measurement.synthetic_welds import SyntheticWeld, population
from weld_force_ros.messages import AssessmentSettings, Limit, SpeedBand, WeldProfile, limits_sha256, profile_sha256
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

SPEEDS = np.arange(20.0, 161.0)


def passages(peak_n: np.ndarray) -> Passages:
    return Passages(100e3, peak_n, 50e3 * np.ones_like(peak_n), 0.0 * peak_n, None, None)


def limit(most: float, name: str = "peak_force", **more) -> Limit:
    return Limit(name=name, limit=most, reject_limit=2 * most, unit="N", source="hand", **more)


def sealed(limits: list[Limit]) -> AssessmentSettings:
    settings = AssessmentSettings(limits_sha256="0" * 64, limits=limits)
    settings.limits_sha256 = limits_sha256(settings)
    return settings


def hump(summit_n: float) -> np.ndarray:
    """Up to a maximum at 80 km/h, down to 120 at 110 km/h, and up again."""
    return np.interp(SPEEDS, [20.0, 80.0, 110.0, 160.0], [110e3, summit_n, 120e3, 150e3])


def test_a_hump_is_told_in_words_and_numbers():
    found = advise(SPEEDS, passages(hump(180e3)), [limit(170e3)])
    # 110 + 70 (v - 20) / 60 = 170 at 71.4 km/h; 180 - 60 (v - 80) / 30 = 170 at 85 km/h
    assert found.permitted_speed_kmh == 71.0
    assert found.avoid == [SpeedBand(from_kmh=72.0, to_kmh=84.0)]
    assert [(h.from_kmh, h.lowest_kmh, h.depth_n) for h in found.hollows] == [
        (pytest.approx(80.0, abs=0.5), pytest.approx(110.0, abs=0.5), pytest.approx(60e3, rel=0.01))
    ]
    assert found.maxima_kmh == pytest.approx([80.0], abs=0.5)
    by_speed = {r.speed_kmh: r for r in found.restrictions}
    assert list(by_speed) == [160.0, 140.0, 120.0, 100.0, 80.0, 60.0, 40.0, 20.0]
    assert by_speed[80.0].change == pytest.approx(0.2)
    assert [speed for speed, r in by_speed.items() if r.within_limits] == [60.0, 40.0, 20.0]
    assert found.advice[0] == "forces are within limits up to 71 km/h"
    assert "slowing from 160 to 80 km/h raises the peak by 20 %" in found.advice
    assert "slowing from 160 to 60 km/h raises the peak by 4 % and brings it within limits" in found.advice
    assert found.advice_step_kmh == 1.0


def test_rising_force_permits_up_to_its_limit_and_nothing_gets_worse():
    found = advise(SPEEDS, passages(np.linspace(110e3, 180e3, len(SPEEDS))), [limit(145e3)])
    assert (found.permitted_speed_kmh, found.hollows, found.maxima_kmh) == (90.0, [], [])
    assert found.avoid == [SpeedBand(from_kmh=91.0, to_kmh=160.0)]
    assert not any("raises" in words for words in found.advice)


def test_nothing_is_permitted_where_the_lowest_speed_is_over():
    found = advise(SPEEDS, passages(np.full(len(SPEEDS), 150e3)), [limit(140e3)])
    assert found.permitted_speed_kmh is UNSET
    assert "20 km/h already" in found.advice[0]


def test_limits_by_line_speed_are_those_of_the_restricted_line():
    limits = [limit(130e3, to_kmh=100.0), limit(120e3, above_kmh=100.0)]
    found = advise(SPEEDS, passages(np.full(len(SPEEDS), 125e3)), limits)
    assert found.permitted_speed_kmh == 100.0
    assert found.avoid == [SpeedBand(from_kmh=101.0, to_kmh=160.0)]


def test_what_does_not_decide_does_not_restrict():
    found = advise(SPEEDS, passages(hump(180e3)), [limit(170e3, decides=False), limit(1e-3, "straightedge")])
    assert (found.permitted_speed_kmh, found.avoid) == (160.0, [])


def test_one_speed_is_no_curve_and_still_gets_its_advice():
    found = advise(np.array([80.0]), passages(np.array([150e3])), [limit(170e3)])
    assert (found.permitted_speed_kmh, found.hollows, len(found.restrictions)) == (80.0, [], 1)


def as_profile(weld: SyntheticWeld) -> WeldProfile:
    x, z = weld.x_m.tolist(), weld.z_m.tolist()
    return WeldProfile(weld_id=weld.weld_id, source="seed 7", x_m=x, z_m=z, profile_sha256=profile_sha256(x, z))


@pytest.mark.slow
def test_advice_is_what_trying_every_speed_gives():
    """Seeded welds, each with a limit that its curve meets; every whole km/h simulated, then looked at."""
    simulator = Simulator(simulation_settings(track="bilbao-viscous", positions=2, running="with"))
    vehicle_track = Simulator(simulator.settings).vehicle_track
    speeds = np.arange(20.0, 301.0)
    humps = 0
    for profile in map(as_profile, population(8, seed=7)):
        rolled = vehicle_track.peak_map(simulator.wheel_path(profile), speeds, simulator.settings.positions_m)
        curve = dict(zip(speeds.tolist(), rolled.peak_force_n.max(axis=1).tolist(), strict=True))
        most_n = float(np.quantile(list(curve.values()), 0.7)) + 0.123
        over = {speed for speed, peak in curve.items() if peak > most_n}
        verdict = judge(simulator.force_map(profile), sealed([limit(most_n)]))
        assert verdict.permitted_speed_kmh == (UNSET if 20.0 in over else min(over) - 1.0)
        bands = [np.arange(band.from_kmh, band.to_kmh + 1) for band in verdict.avoid]
        assert set(np.concatenate(bands).tolist()) == over
        assert {r.speed_kmh: r.change for r in verdict.restrictions} == pytest.approx(
            {speed: curve[speed] / curve[300.0] - 1 for speed in np.arange(20.0, 301.0, 20.0)}, abs=1e-6
        )
        humps += len(over) < 300.0 - min(over) + 1
    assert humps > 2  # the population is no easy one: force is not monotonic


def test_curve_counts_only_positions_that_can_be():
    weld = next(population(1, seed=3))
    profile = as_profile(weld)
    profile.weld_position_m, profile.line_speed_kmh = 0.12, 100.0
    simulator = Simulator(
        simulation_settings(track="bilbao-viscous", speeds_kmh=[40.0, 100.0, 130.0], positions=5, running="with")
    )
    force_map = simulator.force_map(profile)
    assert set(force_map.curve.at_m) == {0.12}
    assert force_map.curve.speeds_kmh == np.arange(40.0, 131.0).tolist()
    rows = {speed: force_map.peak_force_n[5 * i + 1] for i, speed in enumerate(force_map.speeds_kmh)}
    assert all(force_map.curve.peak_force_n[int(speed) - 40] == peak for speed, peak in rows.items())
    verdict = judge(force_map, load_limits())
    assert verdict.restrictions[0].speed_kmh == verdict.judged_speed_kmh == 100.0
    assert verdict.by_position == []


@pytest.mark.parametrize(("share", "told"), [(0.0, True), (0.6, True), (0.8, False)])
def test_nothing_below_the_models_error_is_a_finding(share, told):
    """The hump falls by 60 of 80 kN dynamic force, and slowing to 80 km/h adds 30 kN."""
    found = advise(SPEEDS, passages(hump(180e3)), [limit(170e3)], share)
    assert (len(found.hollows), len(found.maxima_kmh)) == ((1, 1) if told else (0, 0))
    assert found.curve_class == ("hollow" if told else "rises")
    assert any("km/h the peak is up to 60 kN less" in words for words in found.advice) == told


@pytest.mark.parametrize(("share", "told"), [(0.1, True), (0.3, True), (0.4, False)])
def test_a_restriction_that_changes_less_than_the_models_error_is_no_advice(share, told):
    """160 to 80 km/h: from 150 to 180 kN, so 30 of 80 kN of dynamic force."""
    found = advise(SPEEDS, passages(hump(180e3)), [limit(170e3)], share)
    assert ("slowing from 160 to 80 km/h raises the peak by 20 %" in found.advice) == told
    assert len(found.restrictions) == 8


@pytest.mark.parametrize(("share", "bands"), [(0.1, 1), (0.2, 0)])
def test_a_speed_is_to_be_avoided_where_it_is_clearly_beyond_a_limit(share, bands):
    """180 of 170 kN allowed: 10 of 80 kN of dynamic force beyond it."""
    found = advise(SPEEDS, passages(hump(180e3)), [limit(170e3)], share)
    assert len(found.avoid) == bands
    assert found.permitted_speed_kmh == 71.0
    assert found.advice[0] == "highest computed speed with all forces within limits: 70 km/h"


def test_speeds_in_words_are_rounded_down_but_not_below_what_was_computed():
    assert [in_prose_kmh(speed) for speed in (104.9, 105.0, 3.0)] == [100.0, 105.0, 3.0]
    assert in_prose_kmh(43.0, 42.0) == 43.0


def test_rules_without_an_accepted_risk_tell_every_difference_as_before():
    force_map = Simulator(simulation_settings(positions=2)).force_map(as_profile(next(population(1, 3))))
    assert told_apart(force_map, sealed([limit(1.0)])) is None
    assert told_apart(force_map, load_limits("force")) > 0.1
