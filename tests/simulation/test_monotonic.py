"""A weld that is worse in every height never gets a milder verdict, and how a single passage may get milder."""

from itertools import pairwise

import numpy as np
import pytest

from weld_force_ros.assessment import verdict
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.measurement.synthetic_welds import population
from weld_force_ros.messages import ForceMap, Rules, WeldProfile, profile_sha256
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation.force_map_view import relevant_range
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

SCALES = (0.5, 1.0, 1.5, 2.5, 4.0)
SEVERITY = ("accept", "grind", "reject")


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(
        simulation_settings(track="bilbao-viscous", positions=4, speeds_kmh=np.arange(80.0, 161.0, 20.0).tolist())
    )


@pytest.fixture(scope="module")
def scaled(simulator: Simulator) -> list[list[ForceMap]]:
    """Maps of welds, each in its scales."""
    shapes = [(np.array(p.x_m), np.array(p.z_m)) for p in (read_profile(find(name)) for name in shipped())]
    shapes += [(weld.x_m, weld.z_m) for weld in population(8, seed=11)]
    return [
        [simulator.force_map(as_profile(x, scale * z)) for scale in SCALES if np.ptp(scale * z) < 10e-3]
        for x, z in shapes
    ]


def as_profile(x: np.ndarray, z: np.ndarray) -> WeldProfile:
    return WeldProfile(
        weld_id="scaled", source="test", x_m=x.tolist(), z_m=z.tolist(), profile_sha256=profile_sha256(x, z)
    )


def test_a_scaled_up_weld_never_gets_a_milder_verdict(scaled: list[list[ForceMap]]):
    limits = load_limits()
    decisions = set()
    for maps in scaled:
        before = [0] * 4
        for force_map in maps:
            found = {
                unknown: verdict.evaluate(relevant_range(force_map), limits.limits, Rules(unknown_position=unknown))
                for unknown in ("worst", "undecided")
            }
            now = [SEVERITY.index(place.decision) for place in found["worst"].by_position]
            assert all(a <= b for a, b in zip(before, now, strict=True))
            assert found["worst"].decision == SEVERITY[max(now)]
            assert found["undecided"].decision == (SEVERITY[now[0]] if len(set(now)) == 1 else "undecided")
            before = now
            decisions.add(found["undecided"].decision)
    assert decisions == {"accept", "grind", "reject", "undecided"}


def test_a_passage_gets_milder_only_where_the_wheel_flew_over_and_came_down_elsewhere(simulator: Simulator):
    """Deeper dips: where a passage's peak falls, by little, contact was lost on both; the landing decides the peak."""
    x = np.linspace(-0.25, 0.25, 501)
    fell = 0
    speeds = np.arange(150.0, 301.0, 10.0)
    for length_m in (0.1, 0.2, 0.3):
        peak_maps = [
            simulator.vehicle_track.peak_map(
                wheel_path_over(x, cosine_dip(x, length_m, depth), 0.45), speeds, simulator.settings.positions_m
            )
            for depth in np.arange(0.2e-3, 1.01e-3, 0.1e-3)
        ]
        for shallow, deep in pairwise(peak_maps):
            milder = deep.peak_force_n < shallow.peak_force_n
            fell += np.count_nonzero(milder)
            assert np.all(shallow.contact_loss_s[milder] > 0.0)
            assert np.all(deep.peak_force_n > 0.995 * shallow.peak_force_n)
    assert fell > 0
