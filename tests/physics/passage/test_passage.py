from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid

from tests.harness.oracles import integrated_passage
from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.physics.passage import steady_state
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import TOLERANCE
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.simulation.track_file import TrackDefinition

Dip = Callable[..., WheelPath]


@pytest.mark.parametrize(
    ("track", "length_m", "depth_m", "speed_kmh", "position_m", "approach_spans"),
    [
        pytest.param("johansson-nielsen", 0.1, 0.9e-3, 40.0, 0.1, 4, id="flat in contact"),
        pytest.param("johansson-nielsen", 0.1, 0.9e-3, 150.0, 0.3, 8, id="flat with contact loss"),
        pytest.param("johansson-nielsen", 0.1, 0.9e-3, 300.0, 0.5, 12, id="flat at high speed"),
        pytest.param("bilbao-continuous", 0.048, 40e-6, 53.0, 0.0, 1, id="dip on continuous support"),
        pytest.param("bilbao", 0.048, -40e-6, 120.0, 0.2, 8, id="rise on hysteretic track"),
        pytest.param("bilbao-viscous", 0.048, 40e-6, 200.0, 0.45, 12, id="dip on viscous track"),
    ],
)
def test_passage_is_the_solution_of_its_equations(
    track: str,
    length_m: float,
    depth_m: float,
    speed_kmh: float,
    position_m: float,
    approach_spans: int,
    vehicle_tracks: dict[str, VehicleTrackModel],
    dip: Dip,
):
    vehicle_track, shape = vehicle_tracks[track], dip(length_m, depth_m)
    exact = integrated_passage(vehicle_track.model, vehicle_track.wheel, shape, speed_kmh, position_m, approach_spans)
    found = vehicle_track.peak_map(shape, [speed_kmh], [position_m])
    peak, place = exact.peak()
    assert found.peak_force_n[0, 0] == pytest.approx(peak, rel=0.002)
    assert found.peak_x_m[0, 0] == pytest.approx(place, abs=0.3e-3)
    assert found.min_force_n[0, 0] == pytest.approx(exact.force_n.min(), abs=0.002 * vehicle_track.wheel.static_load_n)
    apart = 20e-6 * np.count_nonzero(exact.force_n == 0.0)
    assert found.contact_loss_s[0, 0] == pytest.approx(apart, abs=60e-6)
    assert (found.contact_loss_s[0, 0] > 0) == (found.min_force_n[0, 0] == 0)
    for stride in (1, vehicle_track.solver.coarsest_stride(speed_kmh)):
        history = vehicle_track.history(shape, speed_kmh, position_m, stride=stride)
        common = (exact.x_m >= history.x_m[0]) & (exact.x_m <= history.x_m[-1])
        difference = np.interp(exact.x_m[common], history.x_m, history.force_n) - exact.force_n[common]
        assert np.sqrt(np.mean(difference**2)) < 0.003 * np.ptp(exact.force_n)


@pytest.fixture
def stepped(
    vehicle_tracks: dict[str, VehicleTrackModel], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[float], VehicleTrackModel]]:
    """A rig whose every step is as long as asked for."""

    def vehicle_track(step_m: float) -> VehicleTrackModel:
        monkeypatch.setattr(steady_state, "GRID_M", step_m)
        monkeypatch.setattr(steady_state, "LONGEST_STEP_M", step_m)
        monkeypatch.setattr(steady_state, "LONGEST_STEP_S", 1.0)
        return VehicleTrackModel(vehicle_tracks["johansson-nielsen"].model, vehicle_tracks["johansson-nielsen"].wheel)

    return vehicle_track


def test_steps_converge_with_second_order_while_contact_holds(stepped: Callable[[float], VehicleTrackModel], dip: Dip):
    shape = dip(0.3, 0.3e-3)
    steps = 2e-3 / 2 ** np.arange(4)
    peaks = np.array([stepped(step).peak_map(shape, [100.0], [0.2]).peak_force_n[0, 0] for step in (*steps, 0.0625e-3)])
    errors = np.abs(peaks[:-1] - peaks[-1])
    order = -np.polyfit(np.arange(4), np.log2(errors), 1)[0]
    assert 1.7 < order < 2.6
    assert errors[-1] < 1e-4 * peaks[-1]


@pytest.mark.parametrize("speed_kmh", [5.0, 80.0, 300.0])
def test_wheel_at_rest_on_continuous_support_stays_at_rest(
    speed_kmh: float,
    vehicle_tracks: dict[str, VehicleTrackModel],
    definitions: dict[str, TrackDefinition],
    smooth_rail: WheelPath,
):
    vehicle_track = vehicle_tracks["bilbao-continuous"]
    load = vehicle_track.wheel.static_load_n
    history = vehicle_track.history(smooth_rail, speed_kmh, 0.0)
    np.testing.assert_allclose(history.force_n, load, rtol=1e-9)
    exact = receptance(definitions["bilbao-continuous"].track.undamped(), [0.5], [0.0])[0, 0].real
    np.testing.assert_allclose(history.rail_m, -load * exact, rtol=1e-3)
    indentation = history.rail_m - history.wheel_m
    np.testing.assert_allclose(indentation, (load / vehicle_track.wheel.hertz_n_per_m15) ** (2 / 3), rtol=1e-6)


@pytest.mark.parametrize("track", ["bilbao", "johansson-nielsen"])
@pytest.mark.parametrize("speed_kmh", [60.0, 200.0])
def test_smooth_rail_force_repeats_with_the_span_about_the_static_load(
    track: str, speed_kmh: float, vehicle_tracks: dict[str, VehicleTrackModel], smooth_rail: WheelPath
):
    vehicle_track = vehicle_tracks[track]
    load, span = vehicle_track.wheel.static_load_n, vehicle_track.model.spacing_m
    history = vehicle_track.history(smooth_rail, speed_kmh, 0.0, until_m=3 * span)
    samples = round(span / (history.x_m[1] - history.x_m[0]))
    first, later = history.force_n[:samples], history.force_n[2 * samples : 3 * samples]
    np.testing.assert_allclose(later, first, atol=1e-4 * load)
    assert first.mean() == pytest.approx(load, rel=1e-5)
    assert np.ptp(first) > 1e-3 * load


@pytest.mark.parametrize("speed_kmh", [90.0, 250.0])
def test_impulse_of_the_unbalanced_force_is_the_change_of_momentum(
    speed_kmh: float, vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip
):
    vehicle_track = vehicle_tracks["johansson-nielsen"]
    history = vehicle_track.history(dip(0.1, 0.9e-3), speed_kmh, 0.2)
    time = history.x_m / (speed_kmh / 3.6)
    velocity = -np.gradient(history.wheel_m, time, edge_order=2)  # down
    unbalanced = vehicle_track.wheel.static_load_n - history.force_n
    exchanged = trapezoid(np.abs(unbalanced), time)
    for end in (len(time) // 4, len(time) // 2, len(time) - 1):
        impulse = trapezoid(unbalanced[: end + 1], time[: end + 1])
        assert vehicle_track.wheel.mass_kg * (velocity[end] - velocity[0]) == pytest.approx(
            impulse, abs=2e-3 * exchanged
        )


def test_contact_in_a_history_is_the_hertz_law(vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip):
    vehicle_track = vehicle_tracks["johansson-nielsen"]
    history = vehicle_track.history(dip(0.1, 0.9e-3), 200.0, 0.2)
    indentation = history.rail_m + history.irregularity_m - history.wheel_m
    exact = vehicle_track.wheel.hertz_n_per_m15 * np.maximum(indentation, 0.0) ** 1.5
    np.testing.assert_allclose(history.force_n, exact, atol=1e-3)
    assert history.force_n.min() == 0.0


def test_map_is_the_largest_of_each_history(vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip):
    vehicle_track, shape = vehicle_tracks["bilbao-viscous"], dip(0.2, 0.2e-3)
    speeds, positions = [40.0, 160.0], [0.05, 0.35]
    peak_map = vehicle_track.peak_map(shape, speeds, positions)
    for row, speed in enumerate(speeds):
        for column, position in enumerate(positions):
            history = vehicle_track.history(shape, speed, position, until_m=4.0)
            assert peak_map.peak_force_n[row, column] == pytest.approx(history.force_n.max(), rel=1e-4)
            assert peak_map.peak_x_m[row, column] == pytest.approx(history.x_m[history.force_n.argmax()], abs=1e-3)
            least = pytest.approx(history.force_n.min(), abs=TOLERANCE * history.force_n.max())
            assert peak_map.min_force_n[row, column] == least


def test_weld_one_span_on_gives_the_same_forces_one_span_on(vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip):
    vehicle_track, shape = vehicle_tracks["johansson-nielsen"], dip(0.1, 0.2e-3)
    here = vehicle_track.peak_map(shape, [120.0], [0.1])
    there = vehicle_track.peak_map(shape, [120.0], [0.1 + 2 * vehicle_track.model.spacing_m])
    np.testing.assert_allclose(there.peak_force_n, here.peak_force_n, rtol=1e-6)
    np.testing.assert_allclose(there.peak_x_m - here.peak_x_m, 2 * vehicle_track.model.spacing_m, atol=1e-4)


def test_threads_and_the_order_of_speeds_change_nothing(vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip):
    vehicle_track, shape = vehicle_tracks["bilbao"], dip(0.048, 40e-6)
    speeds = np.array([30.0, 55.0, 140.0, 290.0])
    many = vehicle_track.peak_map(shape, speeds, [0.0, 0.3])
    reversed_alone = VehicleTrackModel(vehicle_track.model, vehicle_track.wheel, threads=1).peak_map(
        shape, speeds[::-1], [0.0, 0.3]
    )
    np.testing.assert_array_equal(reversed_alone.peak_force_n[::-1], many.peak_force_n)
    np.testing.assert_array_equal(reversed_alone.peak_x_m[::-1], many.peak_x_m)


def test_each_speed_is_reported_once(vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip):
    told: list[None] = []
    vehicle_tracks["bilbao"].peak_map(
        dip(0.048, 40e-6), [50.0, 100.0, 150.0], [0.0], on_speed=lambda: told.append(None)
    )
    assert len(told) == 3


@pytest.mark.parametrize(
    ("speeds", "positions"),
    [([], [0.0]), ([80.0], []), ([0.0], [0.0]), ([80.0, -5.0], [0.0]), ([np.nan], [0.0]), ([80.0], [np.inf])],
)
def test_bad_axes_are_refused(
    speeds: list[float], positions: list[float], vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip
):
    with pytest.raises(InputError, match=r"speed|position"):
        vehicle_tracks["bilbao"].peak_map(dip(0.048, 40e-6), speeds, positions)


@pytest.mark.parametrize(("speed", "position"), [(0.0, 0.0), (-1.0, 0.0), (np.nan, 0.0), (80.0, np.nan)])
def test_bad_passage_is_refused(speed: float, position: float, vehicle_tracks: dict[str, VehicleTrackModel], dip: Dip):
    with pytest.raises(InputError, match=r"speed|position"):
        vehicle_tracks["bilbao"].history(dip(0.048, 40e-6), speed, position)


def test_growing_track_is_an_error_and_no_number(vehicle_tracks: dict[str, VehicleTrackModel], smooth_rail: WheelPath):
    model = vehicle_tracks["johansson-nielsen"].model
    first = np.arange(len(model.poles_rad_s)) == 1
    growing = replace(model, poles_rad_s=np.where(first, 30 + 400j, model.poles_rad_s))
    with pytest.raises(NumericalError, match=r"settle|finite"):
        VehicleTrackModel(growing, vehicle_tracks["johansson-nielsen"].wheel).peak_map(smooth_rail, [100.0], [0.0])


def test_wheel_knows_its_indentation_and_contact_stiffness(vehicle_tracks: dict[str, VehicleTrackModel]):
    wheel = replace(vehicle_tracks["bilbao"].wheel, static_load_n=100e3, hertz_n_per_m15=100e9, mass_kg=600.0)
    assert wheel.static_indentation_m == pytest.approx(1e-4)
    assert wheel.contact_stiffness_n_per_m == pytest.approx(1.5e9)
    omega = np.array([100.0])
    assert wheel.compliance(omega)[0] == pytest.approx(1 / 1.5e9 - 1 / 6e6)
