"""Common poles that change with speed: transforms, least squares, shipped fits, and random tracks by the reference."""

from dataclasses import replace

import numpy as np
import pytest

from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.physics.engines import moving_fit
from weld_force_ros.physics.engines.greens_function import DEFLECTIONS, GreensFunctionModel, MovingReceptance
from weld_force_ros.physics.engines.moving_fit import Target
from weld_force_ros.physics.engines.moving_poles import MovingPoleModel, Symmetry
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.track import beam
from weld_force_ros.simulation import fit_store, track_file

SPAN = 0.6
AT = SPAN / 16 * (np.arange(16) + 0.25)
FREQUENCY = moving_fit._FREQUENCIES


def a_model() -> MovingPoleModel:
    """Return one with a real pole and a pair of each symmetry, their shapes of three terms."""
    rng = np.random.default_rng(5)
    series = 3e-4 * (rng.normal(size=(4, 3)) + 1j * rng.normal(size=(4, 3))) * [1.0, 0.2, 0.05]
    series[0] = series[0].real
    return MovingPoleModel(
        rates=np.log([400.0, 150.0, 90.0, 260.0]) + 1j * np.array([0.0, 500.0, 6700.0, 1900.0]),
        rate_changes=np.array([0.3, -0.2 + 30j, 0.1 - 90j, 0.4 + 60j]),
        strengths=np.array([-1.0, 1.0, 1.0, 1.0]),
        strength_changes=np.array([0.1, 0.2 - 0.1j, -0.1 + 0.3j, 0.05j]),
        series=series,
        symmetries=np.array([Symmetry.ALIKE, Symmetry.ALIKE, Symmetry.NODE_AT_SLEEPERS, Symmetry.NODE_AT_MID_SPAN]),
        spacing_m=SPAN,
    )


def response(model: MovingPoleModel, speed: float, from_m: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the displacement of a contact, t after its impulse at each place, as the module's formula has it."""
    poles, weights = model.poles_at(speed), model.strengths_at(speed) * model.pair_weight
    terms = model.shapes_at((from_m[:, None] + speed * t).ravel()).reshape(len(from_m), len(t), -1)
    return (weights * terms * model.shapes_at(from_m)[:, None] * np.exp(np.outer(t, poles))).real.sum(axis=2)


def found_by(model: MovingPoleModel, speed: float) -> MovingReceptance:
    """Return its transforms by quadrature in time: Simpson's rule in steps of 20 us."""
    t = 2e-5 * np.arange(8001)
    simpson = 2e-5 / 3 * np.concatenate([[1], np.tile([4, 2], 4000)[:-1], [1]])
    spectra = (response(model, speed, AT, t) * simpson) @ np.exp(-2j * np.pi * np.outer(t, FREQUENCY))
    through = SPAN / DEFLECTIONS * np.arange(DEFLECTIONS)
    deflection = np.array([(_heard(model, speed, x, t) * simpson).sum() for x in through])
    return MovingReceptance(speed, AT, spectra, deflection)


def _heard(model: MovingPoleModel, speed: float, x: float, t: np.ndarray) -> np.ndarray:
    """Return what a contact at x hears of impulses t before, where it was then."""
    poles, weights = model.poles_at(speed), model.strengths_at(speed) * model.pair_weight
    terms = model.shapes_at(x - speed * t) * model.shapes_at(x)
    return (weights * terms * np.exp(np.outer(t, poles))).real.sum(axis=1)


def target_of(model: MovingPoleModel) -> Target:
    definition = track_file.load("bilbao-viscous")
    found = tuple(found_by(model, speed) for speed in (0.0, 30.0, 80.0))
    size = [np.full((16, len(FREQUENCY)), 1 / np.sqrt(np.mean(np.abs(one.receptance) ** 2))) for one in found]
    heavy = [np.full(24, 1 / np.abs(one.deflection).max()) for one in found]
    return Target(definition.track, definition.wheel, found, tuple(size), tuple(heavy))


def test_transforms_are_those_of_the_response_in_time():
    model = a_model()
    target = target_of(model)
    assert target.error(model) < 1e-4
    assert target.error(replace(model, rates=model.rates + 0.01)) > 3e-3
    assert target.error(replace(model, strengths=1.01 * model.strengths)) > 3e-3


def test_least_squares_find_a_known_model_from_a_nearby_one():
    model = a_model()
    target = target_of(model)
    away = replace(
        model, rates=model.rates + np.array([0.1, 0.05 + 9j, -0.1 + 20j, 0.1]), series=0.95 * model.series,
        rate_changes=0 * model.rate_changes, strength_changes=0 * model.strength_changes,
    )  # fmt: skip
    found = moving_fit.refined(away, target)
    assert target.error(found) < 0.02 * target.error(away)
    np.testing.assert_allclose(found.poles_at(0.0)[1:], model.poles_at(0.0)[1:], rtol=0.01)


def test_a_pole_without_damping_gets_some_at_every_speed():
    model = replace(a_model(), rates=np.array([2.0, -40 + 500j, -40 + 6700j, -40 + 60000j]))
    bounded = moving_fit._bounded(replace(model, rate_changes=model.rate_changes - 30.0))
    for speed in np.linspace(0.0, 350 / 3.6, 20):
        poles = bounded.poles_at(speed)
        assert np.all(-poles.real[1:] >= 0.0039 * np.abs(bounded.rates.imag[1:]))


MOVING = [name for name in track_file.shipped() if track_file.load(name).moving]


@pytest.mark.parametrize("name", MOVING)
def test_shipped_fits_are_stable_at_every_speed_and_settle_at_the_exact_deflection(name: str):
    definition, told = track_file.load(name), list[str]()
    fit = fit_store.fitted_moving(definition, on_fit=told.append)
    assert not told
    assert moving_fit.RESOLUTION < fit.error < 0.013
    model = fit.model()
    if isinstance(model, MovingPoleModel):
        poles = np.stack([model.poles_at(speed) for speed in np.linspace(0.0, 350 / 3.6, 50)])
        assert poles.real.max() < 0
    # Where poles move with speed, peaks decide, which a constant deflection hardly changes.
    at = definition.track.spacing_m * np.linspace(0, 1, 21)
    np.testing.assert_allclose(model.static_compliance(at), beam.static_compliance(definition.track, at), rtol=4e-3)


def test_signs_are_right_beyond_a_sleeper():
    """Against exact transfer receptances over a sleeper about the pinned-pinned frequency, which no residue shows."""
    definition = track_file.load("bilbao-viscous")
    model, usual = fit_store.fitted_moving(definition).model(), fit_store.fitted(definition).model()
    frequency = np.linspace(1040.0, 1090.0, 11)
    at = definition.track.spacing_m * np.array([0.75, 1.25])
    exact = beam.transfer_receptance(definition.track, frequency, at[1:], at[0])[0]

    def share_found(poles: np.ndarray, weights: np.ndarray, shapes: np.ndarray) -> float:
        residues, s = 0.5 * weights * shapes[0] * shapes[1], 2j * np.pi * frequency[:, None]
        found = (residues / (s - poles) + residues.conj() / (s - poles.conj())).sum(axis=1)
        return float(np.vdot(exact, found).real / np.vdot(exact, exact).real)

    assert share_found(model.poles_at(0.0), model.pair_weight * model.strengths, model.shapes_at(at)) > 0.1
    assert share_found(usual.poles_rad_s, usual.pair_weight, usual.shapes_at(at)) < -0.8


@pytest.mark.slow
def test_a_long_dip_at_300_kmh_is_that_of_the_reference():
    """What point receptances missed by 2.3 %; `python -m benchmarks.random_tracks` has thirty tracks and six speeds."""
    definition, weld = track_file.load("bilbao-viscous"), shipped_profile("weld-3-long-ground-dip")
    path = wheel_path_over(np.array(weld.x_m), np.array(weld.z_m), definition.wheel.radius_m)
    positions = definition.track.spacing_m * np.array([0.0, 0.25, 0.5, 0.75])
    exact = GreensFunctionModel(definition.track, definition.wheel).peak_map(path, [300.0], positions).peak_force_n
    moving, usual = (
        VehicleTrackModel(fit.model(), definition.wheel).peak_map(path, [300.0], positions).peak_force_n / exact - 1
        for fit in (fit_store.fitted_moving(definition), fit_store.fitted(definition))
    )
    assert np.abs(moving).max() < 0.005
    assert np.abs(usual).max() > 0.02


@pytest.mark.parametrize(
    ("first_off", "second_off", "taken"), [(0.017, 0.0, "first"), (0.019, 0.017, "second"), (0.019, 0.019, "usual")]
)
def test_a_fit_that_is_farther_off_between_its_speeds_is_made_there_too_or_not_taken(
    monkeypatch: pytest.MonkeyPatch, first_off: float, second_off: float, taken: str
) -> None:
    """As of two of thirty random tracks (`benchmarks.random_tracks`), whose fits have resonances of their own there."""
    speeds, whole = moving_fit.SPEEDS_KMH, moving_fit.SPEEDS_KMH + moving_fit.BETWEEN_KMH
    off = {
        ("usual", speeds): 0.02, ("usual", whole): 0.02,
        ("first", speeds): 0.005, ("first", whole): first_off,
        ("second", speeds): 0.007, ("second", whole): second_off,
    }  # fmt: skip
    names = {speeds: "first", whole: "second"}
    monkeypatch.setattr(moving_fit, "GreensFunctionModel", lambda *_, **__: None)
    monkeypatch.setattr(moving_fit.Target, "of", lambda _, speeds_kmh: names[speeds_kmh])
    monkeypatch.setattr(moving_fit, "start", lambda *_: None)
    monkeypatch.setattr(moving_fit, "refined", lambda _, target: target)
    monkeypatch.setattr(moving_fit._Trial, "off", lambda _, model, speeds_kmh: off[model, speeds_kmh])
    found, error = moving_fit.moving_fit(None, None, "usual")  # type: ignore[arg-type]
    assert found == taken
    assert error == pytest.approx(np.hypot(off[taken, speeds], moving_fit.RESOLUTION))
