"""Steps by their error, ends by the transient: what a map saves changes nothing that matters."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage import _scalar_passage, batch, speed_tables, steady_state
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import TOLERANCE, _finer
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file


def vehicle_track(name: str, threads: int | None = None) -> VehicleTrackModel:
    definition = track_file.load(name)
    return VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel, threads=threads)


def cosine(length_m: float, depth_m: float) -> WheelPath:
    x = np.linspace(-length_m / 2, length_m / 2, 401)
    return wheel_path_over(x, cosine_dip(x, length_m, depth_m), 0.45)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["bilbao", "bilbao-viscous", "johansson-nielsen"]),
    speed_kmh=st.floats(15.0, 320.0),
    position_m=st.floats(0.0, 0.6),
    length_m=st.floats(0.04, 0.6),
    depth_um=st.integers(-400, 900),
)
def test_peaks_are_those_of_the_shortest_steps_and_a_long_run_out(
    monkeypatch, name, speed_kmh, position_m, length_m, depth_um
):
    shape = cosine(length_m, depth_um * 1e-6)
    found = vehicle_track(name).peak_map(shape, [speed_kmh], [position_m])
    with monkeypatch.context() as patient:
        patient.setattr(steady_state, "LONGEST_STEP_M", steady_state.GRID_M)
        patient.setattr(speed_tables, "TRANSIENT_WINDOW_S", 0.5)
        patient.setattr(speed_tables, "RUN_OUT_S", 0.5)
        exact = vehicle_track(name).peak_map(shape, [speed_kmh], [position_m])
    peak = exact.peak_force_n[0, 0]
    assert found.peak_force_n[0, 0] == pytest.approx(peak, rel=2 * TOLERANCE)
    assert found.min_force_n[0, 0] == pytest.approx(exact.min_force_n[0, 0], abs=4 * TOLERANCE * peak)


@pytest.mark.skipif(not batch.USE_SIMD, reason="steps are those of lanes")
@pytest.mark.parametrize("depth_um", [0, 1, 30, 200])
def test_a_passage_without_filters_ends_sooner_and_finds_the_same(monkeypatch, depth_um):
    steps: list[np.ndarray] = []
    simulated = batch.SimdBatch._simulate

    def noted(self, *arguments):
        results = simulated(self, *arguments)
        steps.append(results[..., 5])
        return results

    monkeypatch.setattr(batch.SimdBatch, "_simulate", noted)
    track, shape = vehicle_track("bilbao", threads=1), cosine(0.25, depth_um * 1e-6)
    speeds, positions = np.arange(60.0, 140.0, 5.0), [0.0, 0.2]
    plain = track.peak_map(shape, speeds, positions)
    filtered = track.peak_map(shape, speeds, positions, low_passed=True)
    for name in ("peak_force_n", "peak_x_m", "min_force_n", "contact_loss_s"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(filtered, name))
    own, through_filters = steps[0].sum(), steps[len(steps) // 2].sum()
    assert own < 0.8 * through_filters if depth_um > 100 else own <= through_filters


def test_a_sharp_shape_is_simulated_in_shorter_steps_than_a_smooth_one(monkeypatch):
    strides: list[int] = []
    made = batch.make_batch

    def noted(solver, speeds_kmh, stride):
        strides.append(stride)
        return made(solver, speeds_kmh, stride)

    monkeypatch.setattr("weld_force_ros.physics.passage.peak_map.make_batch", noted)
    vehicle_track("bilbao").peak_map(cosine(0.6, 0.2e-3), [100.0], [0.1])
    assert strides == [8]
    strides.clear()
    vehicle_track("bilbao").peak_map(cosine(0.1, 0.9e-3), [100.0], [0.1])
    assert strides[0] == 8
    assert strides[-1] == 1


def test_many_welds_beside_each_other_are_each_weld_alone():
    speeds, positions = [40.0, 90.0, 200.0], [0.0, 0.25, 0.4]
    welds = [cosine(length, depth) for length in (0.05, 0.2) for depth in (-1e-4, 1e-4, 5e-4)]
    together = list(vehicle_track("bilbao", threads=2).peak_maps(iter(welds), speeds, positions))
    assert len(together) == len(welds)
    for weld, peak_map in zip(welds, together, strict=True):
        alone = vehicle_track("bilbao", threads=1).peak_map(weld, speeds, positions)
        np.testing.assert_array_equal(peak_map.peak_force_n, alone.peak_force_n)
        np.testing.assert_array_equal(peak_map.peak_x_m, alone.peak_x_m)


def test_welds_are_taken_only_as_they_are_needed():
    taken: list[int] = []

    def welds():
        for number in range(1000):
            taken.append(number)
            yield cosine(0.05, 1e-5)

    first = next(vehicle_track("bilbao", threads=2).peak_maps(welds(), [100.0], [0.0]))
    assert first.peak_force_n.shape == (1, 1)
    assert len(taken) < 50


def test_bad_axes_of_many_welds_are_refused():
    with pytest.raises(InputError, match="speed"):
        next(vehicle_track("bilbao").peak_maps([cosine(0.05, 1e-5)], [-1.0], [0.0]))


def test_more_speeds_than_roll_together_come_out_in_their_order():
    speeds = np.linspace(300.0, 20.0, 150)
    many = vehicle_track("bilbao-continuous").peak_map(cosine(0.05, 4e-5), speeds, [0.0])
    few = vehicle_track("bilbao-continuous").peak_map(cosine(0.05, 4e-5), speeds[[3, 77, 149]], [0.0])
    np.testing.assert_array_equal(many.peak_force_n[[3, 77, 149]], few.peak_force_n)


@given(
    first_m=st.floats(-0.7, 0.7),
    step_m=st.floats(1e-4, 3e-3),
    heights=st.lists(st.floats(-1e-3, 1e-3), min_size=4, max_size=60),
)
def test_sampled_is_the_spline_inside_and_zero_outside(first_m, step_m, heights):
    piece_m = 2.5e-4
    knots = 0.1 + piece_m * np.arange(len(heights))
    spline = CubicSpline(knots, heights)
    rows = np.empty((1, 50))
    _scalar_passage.sampled(spline.c, piece_m, knots[0], np.array([first_m]), step_m, rows)
    at = first_m + step_m * np.arange(50)
    clear = np.abs(at[:, None] - knots[[0, -1]]).min(axis=1) > 1e-9
    expected = np.where((at > knots[0]) & (at < knots[-1]), spline(at), 0.0)
    np.testing.assert_allclose(rows[0, clear], expected[clear], atol=1e-9)


def test_results_that_are_not_finite_ask_for_no_finer_steps_and_warn_of_nothing():
    """Whoever asked for the map refuses them."""
    results = np.array([[np.inf] * 6, [np.nan] * 6])
    assert _finer(4, results, TOLERANCE).tolist() == [0, 0]
