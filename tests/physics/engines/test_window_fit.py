"""Passages over supports that differ: both engines against finite elements, which share nothing with them."""

import numpy as np
import pytest

from benchmarks.supports import error, local_supports, model
from tests.harness.finite_element_peaks import Case, read, wheel_path
from weld_force_ros.messages import parse_support
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.engines.window_fit import fit_window
from weld_force_ros.physics.engines.window_signs import with_signs
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange, transfer_receptance
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.track_at_weld import TracksAtWelds

WORST = ("johansson-nielsen", "0 and 1 hang")


@pytest.mark.parametrize(
    ("track", "name", "rms", "largest"),
    [
        ("johansson-nielsen", "0 hangs", 0.003, 0.01),
        ("johansson-nielsen", "0 and 1 hang", 0.01, 0.035),
        ("bilbao-viscous", "0 and 1 hang", 0.01, 0.03),
    ],
)
def test_common_poles_agree_with_finite_elements(track, name, rms, largest):
    cases = [case for case in read() if case.track == track and case.supports == name]
    fitted = model(track, name, reference=False)
    errors = np.array([error(fitted, case) for case in cases])
    assert len(errors) == 45
    assert np.sqrt(np.mean(errors**2)) < rms
    assert np.abs(errors).max() < largest


@pytest.mark.long
@pytest.mark.slow
def test_the_error_that_maps_state_is_what_finite_elements_say_within_a_factor_of_two():
    definition, supports = track_file.load("johansson-nielsen"), local_supports("0 and 1 hang")
    fit = fit_store.fitted_moving_window(definition, supports)
    fitted, static_n = VehicleTrackModel(fit.model(), definition.wheel), definition.wheel.static_load_n
    cases = {
        case: found for case, found in read().items() if (case.track, case.supports) == WORST and case.shape != "smooth"
    }
    exact_n = np.array([found.force_n for found in cases.values()])
    found_n = exact_n * (1 + np.array([error(fitted, case) for case in cases]))
    off = np.linalg.norm(found_n - exact_n) / np.linalg.norm(exact_n - static_n)
    assert 0.5 * off < fit.error < 2 * off
    settings = simulation_settings(track="johansson-nielsen", speeds_kmh=[160.0], positions=1)
    states = parse_support("0=0.02,1=0.02")
    assert TracksAtWelds(definition, settings).supported(tuple(states)).fit_error == fit.error


def test_a_shape_changes_sign_between_sleepers_that_hang():
    """Against the exact receptance from one to the other, near the frequency at which the rail rocks on both."""
    definition, supports = track_file.load("johansson-nielsen"), local_supports("0 and 1 hang")
    track, wheel = definition.track, definition.wheel
    plain = fit_window(track, supports, wheel.compliance, 16)
    signed = with_signs(plain, track, supports, wheel)
    frequency, at = np.linspace(115.0, 130.0, 7), np.array([0.0, track.spacing_m])
    exact = transfer_receptance(track, supports, frequency, at[1:], at[0])[0]

    def share_found(model: PoleModel) -> float:
        shapes, s = model.shapes_at(at), 2j * np.pi * frequency[:, None]
        residues = 0.5 * model.pair_weight * shapes[0] * shapes[1]
        found = (residues / (s - model.poles_rad_s) + residues.conj() / (s - model.poles_rad_s.conj())).sum(axis=1)
        return float(np.vdot(exact, found).real / np.vdot(exact, exact).real)

    assert 0.6 < share_found(signed) < 1.4
    assert share_found(plain) < 0.1
    places = track.spacing_m * np.linspace(-1.0, 2.0, 13)
    np.testing.assert_array_equal(signed.residues_at(places), plain.residues_at(places))
    there = signed.shapes_at(signed.opposite_m - places)
    here = signed.shapes_at(places)
    np.testing.assert_allclose(there * there[0], here * here[0], rtol=0.02, atol=1e-3 * np.abs(here).max() ** 2)


def test_signs_stay_where_shapes_have_no_nodes(definitions):
    definition, supports = definitions["johansson-nielsen"], local_supports("0 hangs")
    plain = fit_window(definition.track, supports, definition.wheel.compliance, 16)
    assert with_signs(plain, definition.track, supports, definition.wheel).nodes == ()


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("name", ["0 and 1 over 0.3 mm"])  # all: `python -m benchmarks.supports --reference`
def test_reference_agrees_with_finite_elements(name):
    exact = model("bilbao-viscous", name, reference=True)
    errors = [error(exact, Case("bilbao-viscous", shape, name, 160.0, 0.0)) for shape in ("dip", "rise")]
    assert np.abs(errors).max() < 0.01


def test_the_mirror_image_is_that_of_mirrored_supports(definitions):
    definition = definitions["johansson-nielsen"]
    track, stated = definition.track, local_supports("1 without ballast")
    one = fit_window(track, stated, definition.wheel.compliance, 16)
    other = fit_window(track, stated.mirrored, definition.wheel.compliance, 16)
    places, frequency = np.array([-0.5, 0.1, 0.65, 1.4]), np.array([30.0, 90.0, 300.0, 800.0])
    np.testing.assert_allclose(
        one.receptance(frequency, one.image_m + places), other.receptance(frequency, places), rtol=5e-3
    )
    np.testing.assert_allclose(
        one.receptance(frequency, one.opposite_m - places), one.receptance(frequency, places), rtol=1e-3
    )


def test_supports_that_are_as_usual_give_the_usual_forces(definitions):
    definition = definitions["johansson-nielsen"]
    usual = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
    window = VehicleTrackModel(
        fit_window(definition.track, LocalSupports.of([SupportChange(0)]), definition.wheel.compliance, 16),
        definition.wheel,
    )
    speeds, at_m = [60.0, 140.0, 250.0], [0.0, 0.2, 0.5]
    for shape in ("dip", "rise"):
        path = wheel_path(shape)
        ours, theirs = (one.peak_map(path, speeds, at_m).peak_force_n for one in (window, usual))
        np.testing.assert_allclose(ours, theirs, rtol=5e-3)  # two fits of the same track


def test_fewer_starts_do_not_change_a_passage(definitions):
    definition = definitions["johansson-nielsen"]
    fit = fit_window(definition.track, local_supports("0 hangs"), definition.wheel.compliance, 16)
    window = VehicleTrackModel(fit, definition.wheel)
    assert window.solver.grid % window.solver.start_every == 0
    path = wheel_path("dip")
    peak = window.peak_map(path, [160.0], [0.3]).peak_force_n[0, 0]
    assert window.history(path, 160.0, 0.3, until_m=3.0).force_n.max() == pytest.approx(peak, rel=1e-3)
