"""Advice from a curve that is simulated where its questions are open equals that of every speed simulated."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.speed_advice import advice, crossed, with_every_passage
from weld_force_ros.assessment.judge import asks_of, judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.assessment.speed_advice import SpeedAdvice, advise
from weld_force_ros.assessment.speed_questions import SpeedQuestions
from weld_force_ros.measurement.profile_file import read_profile, shipped_profile
from weld_force_ros.messages import Limit
from weld_force_ros.simulation.curve_bounds import CurveBounds
from weld_force_ros.simulation.curve_refinement import refine
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

KMH = np.arange(20.0, 301.0)
ON_MAP = np.arange(len(KMH)) % 5 == 0
LOAD_N = 100e3
DATA = Path(__file__).parents[1] / "data" / "instrument_files"


def limit(name: str, most: float, **more) -> Limit:
    return Limit(name=name, limit=most, reject_limit=2 * most, unit="", source="hand", **more)


def curve(seed: int) -> Passages:
    """Hills over speed at five places, the larger of two at each, and an unloading that follows them."""
    generator = np.random.default_rng(seed)
    hills = [
        sum(
            generator.uniform(5e3, 40e3) * np.exp(-(((KMH[:, None] - centre) / generator.uniform(10.0, 60.0)) ** 2))
            for centre in generator.uniform(20.0, 300.0, (3, 1, 5))
        )
        for _ in range(2)
    ]
    peak_n = LOAD_N + np.max(hills, axis=0) + generator.uniform(0.0, 100.0) * KMH[:, None]
    least_n = np.maximum(0.0, LOAD_N - 1.7 * (peak_n - LOAD_N))
    loss_s = np.where(least_n > 0, 0.0, 1e-8 * (1.7 * (peak_n - LOAD_N) - LOAD_N))
    return Passages(LOAD_N, peak_n, least_n, loss_s, LOAD_N + 0.4 * (peak_n - LOAD_N), None)


def answered(every: Passages, limits: list[Limit], share: float | None, count: int) -> tuple[SpeedAdvice, CurveBounds]:
    bounds = CurveBounds(every.at(ON_MAP), KMH[ON_MAP], KMH)
    refine(bounds, count, SpeedQuestions(limits, "0" * 64, share), lambda selected: every.at(~ON_MAP))
    return advise(KMH[:count], bounds.worst.up_to(count).expected, limits, share), bounds


@pytest.mark.parametrize("share", [None, 0.03, 0.15])
@pytest.mark.parametrize("seed", range(25))
def test_answers_are_those_of_every_speed(seed, share):
    every, count = curve(seed), (281, 141, 64)[seed % 3]
    worst = every.worst(axis=1).at(slice(count))
    between = float(np.quantile(worst.peak_force_n, (0.3, 0.6, 0.9)[seed % 3]))
    limits = [
        limit("peak_force", between),
        limit("p2_force", LOAD_N + 0.35 * (between - LOAD_N), above_kmh=90.0),
        limit("unloading", 1.6 * (between / LOAD_N - 1)),
        limit("contact_loss", 0.0),
    ]
    found, bounds = answered(every, limits, share, count)
    assert found == advise(KMH[:count], worst, limits, share)
    assert np.count_nonzero(bounds.simulated[:count]) < bounds.simulated[:count].size


def test_a_curve_that_asks_nothing_is_simulated_at_its_highest_speed_alone():
    peak_n = np.repeat(LOAD_N + 100.0 * KMH[:, None], 3, axis=1) - np.array([0.0, 5e3, 9e3])
    still = np.full_like(peak_n, 80e3)
    every = Passages(LOAD_N, peak_n, still, 0.0 * peak_n, None, None)
    _, bounds = answered(every, [limit("peak_force", 200e3)], 0.1, 142)
    assert KMH[141] == 161.0
    assert not bounds.simulated[~ON_MAP & (np.abs(KMH - 161.0) > 20)].any()
    assert bounds.simulated[141, 0]


@pytest.mark.slow
@pytest.mark.parametrize("track", ["bilbao", "bilbao-viscous", "bilbao-causal"])
@pytest.mark.parametrize("weld", ["weld-1-dip", "base.csv"])
def test_verdicts_are_those_of_every_kmh_at_every_position(track, weld):
    simulator = Simulator(simulation_settings(track=track))
    profile = read_profile(DATA / weld) if weld.endswith("csv") else shipped_profile(weld)
    every = with_every_passage(simulator, profile, simulator.force_map(profile))
    for limits in (load_limits(), crossed(every, 2)):
        found = simulator.force_map(profile, asks_of(limits))
        assert found.curve.limits_sha256 == limits.limits_sha256
        assert advice(judge(found, limits)) == advice(judge(every, limits))
        known = ~np.array(found.curve.estimated)
        np.testing.assert_array_equal(
            np.array(found.curve.peak_force_n)[known], np.array(every.curve.peak_force_n)[known]
        )
        assert known.sum() < len(known) / 2


def test_other_limits_are_answered_by_what_was_simulated():
    simulator = Simulator(simulation_settings(track="bilbao-viscous", positions=3, running="with"))
    profile, own = shipped_profile("weld-1-dip"), load_limits()
    force_map = simulator.force_map(profile, asks_of(own))
    other = crossed(force_map, 1)
    assert judge(force_map, own).advice_step_kmh == 1.0
    by_other = judge(force_map, other)
    assert by_other.advice_step_kmh == 5.0
    known = {v for v, guess in zip(force_map.curve.speeds_kmh, force_map.curve.estimated, strict=True) if not guess}
    assert {speed for band in by_other.avoid for speed in (band.from_kmh, band.to_kmh)} <= known


def test_a_weld_of_known_position_and_line_speed_is_asked_about_up_to_that_speed():
    simulator = Simulator(simulation_settings(track="bilbao-viscous", positions=5, running="with"))
    profile = shipped_profile("weld-1-dip")
    profile.line_speed_kmh, profile.weld_position_m = 122.0, 0.12
    found = simulator.force_map(profile, asks_of(load_limits())).curve
    known = [v for v, guess in zip(found.speeds_kmh, found.estimated, strict=True) if not guess]
    assert 122.0 in known
    assert set(known) >= set(simulator.settings.speeds_kmh)
    assert set(found.at_m) == {0.12}
