"""Curves simulated where the worst can be are those of every speed and position."""

import numpy as np
import pytest

from weld_force_ros.assessment.speed_advice import advise
from weld_force_ros.measurement.profile_file import shipped, shipped_profile
from weld_force_ros.measurement.synthetic_welds import population
from weld_force_ros.messages import Limit, SpeedCurve, WeldProfile, profile_sha256
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.worst_places import possibly_worst

KMH = np.arange(20.0, 301.0)


def welds() -> list[WeldProfile]:
    synthetic = []
    for weld in list(population(4, seed=11))[1:]:  # the first loses contact, which the bundled flat does
        x, z = weld.x_m.tolist(), weld.z_m.tolist()
        sha = profile_sha256(x, z)
        synthetic.append(WeldProfile(weld_id=weld.weld_id, source="seed 11", x_m=x, z_m=z, profile_sha256=sha))
    return [*map(shipped_profile, shipped()), *synthetic]


@pytest.mark.long
@pytest.mark.slow
def test_the_curve_is_that_of_every_speed_and_position():
    simulator = Simulator(simulation_settings(track="bilbao-viscous", running="with"))
    for profile in welds():
        path = simulator.wheel_path(profile)
        everywhere = simulator.vehicle_track.peak_map(path, KMH, simulator.settings.positions_m, low_passed=True)
        expected = Passages.of_peak_map(everywhere, simulator.settings.static_load_n).worst(axis=1)
        curve = simulator.force_map(profile).curve
        assert isinstance(curve, SpeedCurve)
        found = Passages.of_message(curve, simulator.settings.static_load_n, KMH.shape)
        for name, values in found.columns.items():
            tolerance = 1e-4 if name == "contact_loss_s" else 0.1 if name == "min_force_n" else 0.0
            np.testing.assert_allclose(values, expected.columns[name], rtol=1e-3, atol=tolerance, err_msg=name)
        for share in (0.3, 0.7, 0.95):
            most_n = float(np.quantile(expected.peak_force_n, share)) + 0.123
            limits = [Limit(name="peak_force", limit=most_n, reject_limit=2 * most_n, unit="N", source="test")]
            permitted = [advise(KMH, passages, limits).permitted_speed_kmh for passages in (found, expected)]
            assert permitted[0] == permitted[1]


def passages(peak_n: np.ndarray) -> Passages:
    still = np.zeros_like(peak_n)
    return Passages(100e3, peak_n, still + 100e3, still, None, None)


def test_straight_lines_leave_only_the_uppermost_place_and_bends_the_next():
    speeds = np.array([20.0, 25.0, 30.0, 35.0])
    lines = 100e3 + 1e3 * np.array([0.0, 10.0, 11.0]) + 100.0 * speeds[:, None]
    between = np.array([22.0, 27.0, 33.0])
    peaks = possibly_worst(passages(lines), speeds, between)
    assert peaks.tolist() == [[False, False, True]] * 3
    lines[2] += 2e3  # second differences of 4 kN: twice three quarters of it reach the places up to 6 kN below
    assert possibly_worst(passages(lines), speeds, between).tolist() == [[False, True, True]] * 3


def test_speeds_far_apart_tell_nothing_about_what_is_between():
    speeds, peaks = np.array([20.0, 25.0, 45.0, 50.0]), 100e3 + 1e3 * np.arange(3.0) + np.zeros((4, 1))
    assert possibly_worst(passages(peaks), speeds, np.array([22.0, 30.0])).tolist() == [
        [False, False, True],
        [True, True, True],
    ]
    assert possibly_worst(passages(peaks[:2]), speeds[:2], np.array([22.0])).all()


def test_a_passage_does_not_depend_on_which_others_are_simulated():
    simulator = Simulator(simulation_settings(track="bilbao-viscous", running="with"))
    vehicle_track = simulator.vehicle_track
    assert isinstance(vehicle_track, VehicleTrackModel)
    path = simulator.wheel_path(shipped_profile("weld-1-dip"))
    speeds, positions = np.arange(60.0, 80.0), np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    selected = np.random.default_rng(5).random((len(speeds), len(positions))) > 0.6
    some = vehicle_track.peak_map(path, speeds, positions, low_passed=True, selected=selected)
    every = vehicle_track.peak_map(path, speeds, positions, low_passed=True)
    for name in ("peak_force_n", "peak_x_m", "min_force_n", "contact_loss_s"):
        np.testing.assert_array_equal(getattr(some, name)[selected], getattr(every, name)[selected])
        assert np.isnan(getattr(some, name)[~selected]).all()
