"""Moving Green's functions: converged, exact where a closed form exists, and equal to poles on a rational track."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.random_tracks import random_tracks
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.engines import greens_function
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file

pytestmark = pytest.mark.slow

SMOOTH = WheelPath(0.0, np.zeros(9))


def cosine(length_m: float, depth_m: float) -> WheelPath:
    x = np.linspace(-length_m / 2, length_m / 2, 401)
    return wheel_path_over(x, cosine_dip(x, length_m, depth_m), 0.45)


SHAPES = [cosine(0.1, 0.9e-3), cosine(0.048, 40e-6), cosine(1.0, 0.2e-3)]


def model_of(name: str) -> GreensFunctionModel:
    definition = track_file.load(name)
    return GreensFunctionModel(definition.track, definition.wheel)


def peaks(model: GreensFunctionModel) -> np.ndarray:
    return np.array([peak_map.peak_force_n for peak_map in model.peak_maps(SHAPES, [240.0], [0.05])])


@pytest.fixture(scope="module")
def model() -> GreensFunctionModel:
    """Remembers the responses at a speed, which take longest."""
    return model_of("johansson-nielsen")


@pytest.fixture(scope="module")
def converged(model) -> np.ndarray:
    return peaks(model)


@pytest.mark.long
@pytest.mark.parametrize(
    ("constant", "factor"), [("STEP_M", 0.5), ("NODE_M", 0.5), ("BAND_HZ", 1.5), ("MEMORY_S", 1.5)]
)
def test_refining_changes_no_peak_by_more_than_three_tenths_of_a_per_cent(monkeypatch, converged, constant, factor):
    monkeypatch.setattr(greens_function, constant, factor * getattr(greens_function, constant))
    np.testing.assert_allclose(peaks(model_of("johansson-nielsen")), converged, rtol=3e-3)


@pytest.mark.long
def test_a_longer_lead_in_changes_no_peak_by_more_than_three_tenths_of_a_per_cent(monkeypatch, converged):
    monkeypatch.setattr(greens_function, "LEAD_IN_S", 1.5 * greens_function.LEAD_IN_S)
    np.testing.assert_allclose(peaks(model_of("johansson-nielsen")), converged, rtol=3e-3)


@pytest.mark.long
def test_the_force_on_smooth_rail_repeats_from_span_to_span_on_little_damping():
    """A wheel that is let go bounces at some 35 Hz there, for longer than the lead-in of other tracks."""
    definition = random_tracks()[3]
    history = GreensFunctionModel(definition.track, definition.wheel).history(SMOOTH, 192.0, 0.0, until_m=2.5)
    span = definition.track.spacing_m
    first = np.linspace(history.x_m[0], history.x_m[0] + span, 50)
    force = [np.interp(first + spans * span, history.x_m, history.force_n) for spans in (0, 1, 2)]
    np.testing.assert_allclose(force[1], force[0], atol=2e-3 * definition.wheel.static_load_n)
    np.testing.assert_allclose(force[2], force[0], atol=2e-3 * definition.wheel.static_load_n)
    assert np.ptp(force[0]) > 0.02 * definition.wheel.static_load_n


def test_halving_the_time_step_at_low_speed_changes_no_peak_by_more_than_three_tenths_of_a_per_cent(monkeypatch):
    definition = track_file.load("johansson-nielsen")
    vehicle_track = GreensFunctionModel(definition.track, definition.wheel)
    coarse = vehicle_track.peak_map(SHAPES[0], [60.0], [0.3]).peak_force_n
    monkeypatch.setattr(greens_function, "STEP_S", greens_function.STEP_S / 2)
    np.testing.assert_allclose(vehicle_track.peak_map(SHAPES[0], [60.0], [0.3]).peak_force_n, coarse, rtol=3e-3)


def test_a_slow_wheel_on_continuous_support_rests_in_the_winkler_hollow():
    """Closed form: an undamped constant load far below the critical speed deflects the rail as at rest."""
    definition = track_file.load("bilbao-continuous")
    history = GreensFunctionModel(definition.track, definition.wheel).history(SMOOTH, 60.0, 0.0)
    rail, load = definition.track.rail, definition.wheel.static_load_n
    pad, ballast = (spring.stiffness_n_per_m for spring in definition.track.support.springs)
    foundation = pad * ballast / (pad + ballast) / definition.track.spacing_m
    bending = rail.youngs_modulus_pa * rail.second_moment_m4
    shear = rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2
    # Timoshenko beam on a Winkler bed: k^4 shear bending - k^2 bending foundation + foundation shear = 0.
    roots = np.roots([shear * bending, -bending * foundation, foundation * shear]) ** 0.5
    first, second = roots[roots.real > 0]
    amplitude = [(shear - bending * a**2) / (2 * a * shear * bending * (b**2 - a**2))
                 for a, b in ((first, second), (second, first))]  # fmt: skip
    np.testing.assert_allclose(history.force_n, load, rtol=2e-3)
    np.testing.assert_allclose(-history.rail_m, load * sum(amplitude).real, rtol=5e-3)


def test_both_engines_agree_on_a_track_that_is_exactly_rational(monkeypatch):
    """Two damped oscillators side by side, the same everywhere: nothing is left to a fit."""
    poles = np.array([-300.0 + 1900.0j, -1500.0 + 5200.0j])
    residues = np.array([[-3.0e-6j, -1.0e-6j]])

    def response(s: np.ndarray) -> np.ndarray:
        return (
            residues[0][:, None] / (s - poles[:, None]) + residues[0].conj()[:, None] / (s - poles.conj()[:, None])
        ).sum(0)

    def waves(track, omega, *, threads=None):
        h = response(1j * np.asarray(omega))
        return SimpleNamespace(
            strength=np.stack([h, 0 * h]),
            multiplier=np.ones((2, len(h))),
            shape=lambda x: np.ones((2, len(x), len(h)), complex),
        )

    monkeypatch.setattr(greens_function.beam, "waves", waves)
    monkeypatch.setattr(greens_function.beam, "velocity_jump", lambda rail: 0.0)
    track = track_file.load("bilbao-continuous").track
    monkeypatch.setattr(type(track), "causal", True)
    wheel = Wheel(600.0, 1e5, 0.45, 93.7e9)
    model = PoleModel(poles, residues, np.zeros(1), track.spacing_m)
    slow, quick = GreensFunctionModel(track, wheel), VehicleTrackModel(model, wheel)
    for shape in SHAPES[:2]:
        ours, theirs = (
            vehicle_track.peak_map(shape, [40.0, 150.0], [0.3]).peak_force_n for vehicle_track in (slow, quick)
        )
        np.testing.assert_allclose(ours, theirs, rtol=3e-3)


def test_common_poles_follow_the_reference_on_a_causal_track(converged):
    definition = track_file.load("johansson-nielsen")
    vehicle_track = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
    fitted = np.array([vehicle_track.peak_map(shape, [240.0], [0.05]).peak_force_n for shape in SHAPES])
    np.testing.assert_allclose(fitted, converged, rtol=1.2e-2)


def test_the_given_number_of_threads_is_used_and_changes_nothing(workers_of_pools, monkeypatch):
    monkeypatch.setattr(greens_function, "NODE_M", 0.1)  # six of sixty responses are enough for three threads
    definition = track_file.load("johansson-nielsen")
    found = []
    for count in (1, 3):
        model = GreensFunctionModel(definition.track, definition.wheel, threads=count)
        found.append((model.peak_map(SHAPES[0], [240.0], [0.05, 0.3]), model.history(SHAPES[0], 240.0, 0.05)))
    assert workers_of_pools == [3, 3]
    (one_map, one_history), (many_map, many_history) = found
    np.testing.assert_array_equal(one_map.peak_force_n, many_map.peak_force_n)
    np.testing.assert_array_equal(one_history.force_n, many_history.force_n)
