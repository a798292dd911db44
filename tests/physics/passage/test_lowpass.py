"""Greatest low-passed forces are those of SciPy's filters on the whole force history."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt, sosfilt_zi

from weld_force_ros.errors import NumericalError
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.analysis.peaks import p1_p2
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage import batch
from weld_force_ros.physics.passage.lowpass import BETWEEN_RESONANCES_HZ, CUTOFFS_HZ, low_pass, low_passed
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store

SETTLING_S = 0.4
AFTER_S = 0.2


def cosine(length_m: float, depth_m: float) -> WheelPath:
    x = np.linspace(-length_m / 2, length_m / 2, 401)
    return wheel_path_over(x, cosine_dip(x, length_m, depth_m), 0.45)


def filtered_history(
    vehicle_track: VehicleTrackModel, shape: WheelPath, speed_kmh: float, position_m: float
) -> np.ndarray:
    """Greatest through SciPy's filters of the passage in the shortest steps, after long settling on smooth rail."""
    speed, span, load = speed_kmh / 3.6, vehicle_track.model.spacing_m, vehicle_track.wheel.static_load_n
    history = vehicle_track.history(
        shape, speed_kmh, position_m, until_m=position_m + shape.end_m + max(AFTER_S * speed, span)
    )
    smooth = vehicle_track.solver.steady_state(speed_kmh, 1).smooth_n
    first, dt = round(history.x_m[0] / vehicle_track.solver.grid_m), vehicle_track.solver.grid_m / speed
    spans = int(np.ceil(SETTLING_S * speed / span))
    force = np.concatenate([np.tile(np.roll(smooth, -first), spans), history.force_n])
    sections = [butter(4, cutoff, fs=1 / dt, output="sos") for cutoff in CUTOFFS_HZ]
    seen = [sosfilt(sos, force, zi=load * sosfilt_zi(sos))[0][spans * len(smooth) :].max() for sos in sections]
    return np.array(seen)


def columns(peak_map: PeakMap) -> list[np.ndarray]:
    return [peak_map.peak_force_n, peak_map.peak_x_m, peak_map.min_force_n, peak_map.contact_loss_s]


def through(peak_map: PeakMap) -> np.ndarray:
    assert peak_map.low_passed_n is not None
    return peak_map.low_passed_n


@pytest.fixture(scope="module")
def rational(definitions) -> VehicleTrackModel:
    """The `rfp` engine."""
    definition = definitions["johansson-nielsen"]
    return VehicleTrackModel(fit_store.fitted(definition, "rfp").model(), definition.wheel)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["bilbao", "bilbao-viscous", "bilbao-continuous", "johansson-nielsen"]),
    speed_kmh=st.floats(15.0, 350.0),
    position_m=st.floats(-0.6, 0.6),
    length_m=st.floats(0.03, 0.8),
    depth_um=st.integers(-1000, 1500),
)
def test_the_greatest_is_that_of_the_filtered_history(vehicle_tracks, name, speed_kmh, position_m, length_m, depth_um):
    vehicle_track, shape = vehicle_tracks[name], cosine(length_m, depth_um * 1e-6)
    found = through(vehicle_track.peak_map(shape, [speed_kmh], [position_m], low_passed=True))[:, 0, 0]
    exact = filtered_history(vehicle_track, shape, speed_kmh, position_m)
    # An echo below two ten thousandths of the static load is not waited for.
    np.testing.assert_allclose(found, exact, atol=4e-4 * vehicle_track.wheel.static_load_n)


@pytest.mark.parametrize(
    ("length_m", "depth_m", "speed_kmh", "position_m"),
    [
        pytest.param(0.1458, -0.2e-3, 185.1, 0.346, id="the next sleepers add to the echo"),
        pytest.param(0.0954, 10e-6, 219.4, 0.412, id="hardly more than smooth rail"),
        pytest.param(0.05, -0.2e-3, 80.0, 0.2, id="a long echo, greatest at 20 Hz after the passage"),
    ],
)
def test_a_lightly_damped_track_is_listened_to_long_enough(vehicle_tracks, length_m, depth_m, speed_kmh, position_m):
    vehicle_track, shape = vehicle_tracks["johansson-nielsen"], cosine(length_m, depth_m)
    found = through(vehicle_track.peak_map(shape, [speed_kmh], [position_m], low_passed=True))[:, 0, 0]
    exact = filtered_history(vehicle_track, shape, speed_kmh, position_m)
    np.testing.assert_allclose(found, exact, atol=4e-4 * vehicle_track.wheel.static_load_n)


@pytest.mark.parametrize("speed_kmh", [40.0, 200.0])
@pytest.mark.parametrize("shape", [cosine(0.1, 0.5e-3), cosine(0.4, -0.3e-3)])
def test_dense_states_are_filtered_alike(rational, shape, speed_kmh):
    found = through(rational.peak_map(shape, [speed_kmh], [0.2], low_passed=True))[:, 0, 0]
    exact = filtered_history(rational, shape, speed_kmh, 0.2)
    np.testing.assert_allclose(found, exact, atol=4e-4 * rational.wheel.static_load_n)


@pytest.mark.parametrize("name", ["bilbao", "johansson-nielsen"])
def test_asking_changes_nothing_else(vehicle_tracks, monkeypatch, name):
    speeds, positions, shape = np.arange(20.0, 320.0, 23.0), [0.0, 0.2, 0.5], cosine(0.1, 0.9e-3)
    plain, asked = (
        vehicle_tracks[name].peak_map(shape, speeds, positions, low_passed=asking) for asking in (False, True)
    )
    assert plain.low_passed_n is None
    assert through(asked).shape == (len(CUTOFFS_HZ), len(speeds), len(positions))
    for before, after in zip(columns(plain), columns(asked), strict=True):
        np.testing.assert_array_equal(before, after)
    monkeypatch.setattr(batch, "USE_SIMD", False)
    vehicle_track = VehicleTrackModel(vehicle_tracks[name].model, vehicle_tracks[name].wheel)
    plain, one_by_one = (
        vehicle_track.peak_map(shape, speeds, positions, low_passed=asking) for asking in (False, True)
    )
    for before, after in zip(columns(plain), columns(one_by_one), strict=True):
        np.testing.assert_array_equal(before, after)
    np.testing.assert_allclose(through(asked), through(one_by_one), rtol=1e-9)


def test_neither_company_nor_order_nor_other_welds_matter(vehicle_tracks):
    speeds, positions = np.arange(20.0, 300.0, 11.0), np.arange(5) * 0.12
    welds = [cosine(0.1, 0.3e-3), cosine(0.5, -0.3e-3)]
    together = list(vehicle_tracks["bilbao"].peak_maps(welds, speeds, positions, low_passed=True))
    for weld, peak_map in zip(welds, together, strict=True):
        backwards = vehicle_tracks["bilbao"].peak_map(weld, speeds[::-1], positions[::-1], low_passed=True)
        alone = vehicle_tracks["bilbao"].peak_map(weld, speeds[3:4], positions[2:3], low_passed=True)
        np.testing.assert_array_equal(through(peak_map), through(backwards)[:, ::-1, ::-1])
        np.testing.assert_array_equal(through(peak_map)[:, 3:4, 2:3], through(alone))


def test_a_passage_that_does_not_stay_finite_is_an_error(vehicle_tracks):
    heights = np.zeros(400)
    heights[100:300] = 1e250
    with pytest.raises(NumericalError, match="finite"):
        vehicle_tracks["bilbao"].peak_map(WheelPath(-200 * RESAMPLED_STEP_M, heights), [100.0], [0.0], low_passed=True)


@pytest.mark.parametrize("shape", [cosine(0.1, 0.9e-3), cosine(0.6, 0.8e-3)])
def test_common_poles_follow_the_reference(vehicle_tracks, definitions, shape):
    definition = definitions["bilbao-viscous"]
    exact = GreensFunctionModel(definition.track, definition.wheel).peak_map(shape, [160.0], [0.2], low_passed=True)
    fitted = vehicle_tracks["bilbao-viscous"].peak_map(shape, [160.0], [0.2], low_passed=True)
    np.testing.assert_allclose(through(fitted), through(exact), atol=0.01 * definition.wheel.static_load_n)


def test_the_reference_filters_its_history(definitions):
    definition = definitions["bilbao-viscous"]
    vehicle_track, shape = GreensFunctionModel(definition.track, definition.wheel), cosine(0.1, 0.5e-3)
    plain, asked = (vehicle_track.peak_map(shape, [200.0], [0.1], low_passed=asking) for asking in (False, True))
    assert plain.low_passed_n is None
    for before, after in zip(columns(plain), columns(asked), strict=True):
        np.testing.assert_array_equal(before, after)
    assert (definition.wheel.static_load_n < through(asked)).all()
    assert (through(asked)[:, 0, 0] < asked.peak_force_n[0, 0]).all()


@pytest.mark.parametrize("periods", [1, 3, 8, 25])
@pytest.mark.parametrize("dt", [30e-6, 120e-6])
def test_a_sine_leaves_with_the_amplitude_of_butterworth(periods, dt):
    """|H|^2 = 1 / (1 + (f / cutoff)^8), less what the straight lines between the samples of a sine lack."""
    count = 4000
    load, sine = 1e5, 1e4 * np.sin(2 * np.pi * periods * np.arange(count) / count)
    wheel = np.stack([np.zeros(count), np.zeros(count), load + sine], axis=1)
    frequency = periods / (count * dt)
    found = low_pass(np.array([dt]), wheel[None], 600.0, CUTOFFS_HZ).smooth_n[0]  # the response to a force that repeats
    expected = 1e4 / np.sqrt(1 + (frequency / np.array(CUTOFFS_HZ)) ** 8) * np.sinc(frequency * dt) ** 2
    np.testing.assert_allclose(np.ptp(found, axis=1) / 2, expected, rtol=2e-4, atol=1e-4)
    np.testing.assert_allclose(found.mean(axis=1), load, rtol=1e-12)


def test_a_step_overshoots_as_butterworth_of_the_fourth_order():
    """By 10.8 per cent, as tables of filters have it."""
    force = np.where(np.arange(20000) < 1000, 1e5, 2e5)
    for filtered in low_passed(force, 50e-6):
        np.testing.assert_allclose(filtered[:1000], 1e5)
        assert filtered.max() == pytest.approx(2e5 + 0.1083 * 1e5, abs=50.0)
        assert filtered[-1] == pytest.approx(2e5, rel=1e-6)


def test_p2_is_what_the_first_filter_leaves(vehicle_tracks):
    """`p1_p2` filters without delay and twice: close for a slow impact, at the same frequency."""
    vehicle_track, shape = vehicle_tracks["bilbao"], cosine(0.6, 0.8e-3)
    history = vehicle_track.history(shape, 120.0, 0.2, until_m=3.0)
    p2 = p1_p2(history.x_m / (120.0 / 3.6), history.force_n, 0.2 / (120.0 / 3.6)).p2_n
    first = through(vehicle_track.peak_map(shape, [120.0], [0.2], low_passed=True))[0, 0, 0]
    assert CUTOFFS_HZ[0] == BETWEEN_RESONANCES_HZ
    assert first == pytest.approx(p2, rel=0.05)
