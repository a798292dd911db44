"""Passages over supports that differ: both engines against finite elements, which share nothing with them."""

import numpy as np
import pytest

from tests.harness.finite_element_peaks import GAPS, SUPPORTS, Case, read, wheel_path
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.engines.window_fit import fit_window
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.simulation import fit_store

FLAT = WheelPath(0.0, np.zeros(9))


def supports(name: str) -> LocalSupports:
    stated = SUPPORTS[name]
    below = [SupportChange(sleeper, below=share) for sleeper, share in stated.ballast.items()]
    return LocalSupports.of(below + [SupportChange(sleeper, gap_m=gap_m) for sleeper, gap_m in stated.gap_m.items()])


def error(model: VehicleTrackModel | GreensFunctionModel, case: Case, span_m: float) -> float:
    """Return by how much the peak differs from that of finite elements, as a share."""
    path = wheel_path(case.shape) or FLAT
    found = model.peak_map(path, [case.speed_kmh], [case.position_spans * span_m])
    return float(found.peak_force_n[0, 0] / read()[case].force_n - 1)


@pytest.mark.parametrize(
    ("track", "name", "rms", "largest"),
    [("johansson-nielsen", "0 hangs", 0.003, 0.01), ("bilbao-viscous", "0 and 1 hang", 0.01, 0.03)],
)
def test_common_poles_agree_with_finite_elements(definitions, track, name, rms, largest):
    definition = definitions[track]
    fit = fit_store.fitted_window(definition, supports(name))
    model = VehicleTrackModel(fit.model(), definition.wheel)
    cases = [case for case in read() if case.track == track and case.supports == name]
    errors = np.array([error(model, case, definition.track.spacing_m) for case in cases])
    assert len(errors) == 45
    assert np.sqrt(np.mean(errors**2)) < rms
    assert np.abs(errors).max() < largest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["0 and 1 hang", *GAPS])
def test_reference_agrees_with_finite_elements(definitions, name):
    definition = definitions["bilbao-viscous"]
    model = GreensFunctionModel(definition.track, definition.wheel, supports(name))
    cases = [Case("bilbao-viscous", shape, name, 160.0, 0.0) for shape in ("dip", "rise")]
    errors = [error(model, case, definition.track.spacing_m) for case in cases]
    assert np.abs(errors).max() < 0.01


def test_the_mirror_image_is_that_of_mirrored_supports(definitions):
    definition = definitions["johansson-nielsen"]
    track, stated = definition.track, supports("1 without ballast")
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
        ours, theirs = (model.peak_map(path, speeds, at_m).peak_force_n for model in (window, usual))
        np.testing.assert_allclose(ours, theirs, rtol=5e-3)  # two fits of the same track


def test_fewer_starts_do_not_change_a_passage(definitions):
    definition = definitions["johansson-nielsen"]
    model = VehicleTrackModel(
        fit_window(definition.track, supports("0 hangs"), definition.wheel.compliance, 16), definition.wheel
    )
    assert model.solver.grid % model.solver.start_every == 0
    path = wheel_path("dip")
    peak = model.peak_map(path, [160.0], [0.3]).peak_force_n[0, 0]
    assert model.history(path, 160.0, 0.3, until_m=3.0).force_n.max() == pytest.approx(peak, rel=1e-3)
