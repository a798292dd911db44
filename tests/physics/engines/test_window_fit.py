"""Passages over supports that differ: both engines against finite elements, which share nothing with them."""

import numpy as np
import pytest

from benchmarks.supports import error, local_supports, model
from tests.harness.finite_element_peaks import Case, read, wheel_path
from weld_force_ros.physics.engines.window_fit import fit_window
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.simulation import fit_store


@pytest.mark.parametrize(
    ("track", "name", "rms", "largest"),
    [("johansson-nielsen", "0 hangs", 0.003, 0.01), ("bilbao-viscous", "0 and 1 hang", 0.01, 0.03)],
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
