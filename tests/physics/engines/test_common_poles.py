import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from weld_force_ros.physics.engines.common_poles import (
    ORDERS,
    PoleModel,
    common_poles,
    default_fit,
    fit_frequencies,
    fit_track,
    relative_error,
)
from weld_force_ros.physics.track.beam import Rail, Track, receptance, static_compliance
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.sampling import supported
from weld_force_ros.simulation.track_file import TrackDefinition

every_track = pytest.mark.parametrize("name", track_file.shipped())


@st.composite
def rational_receptances(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Well separated damped pairs in the band, and residues of three sections."""
    pairs = draw(st.integers(1, 4))
    frequency = np.geomspace(60.0, 1800.0, pairs) * (1 + 0.2 * draw(st.floats(-1.0, 1.0)))
    damping = np.array(draw(st.lists(st.floats(0.02, 0.3), min_size=pairs, max_size=pairs)))
    poles = 2 * np.pi * frequency * (-damping + 1j * np.sqrt(1 - damping**2))
    angle = np.array(draw(st.lists(st.floats(-0.5, 0.5), min_size=3 * pairs, max_size=3 * pairs))).reshape(3, pairs)
    return poles, 1e-6 * np.exp(1j * (angle - np.pi / 2))


@given(rational_receptances())
def test_known_poles_are_recovered(case: tuple[np.ndarray, np.ndarray]):
    poles, residues = case
    frequency = fit_frequencies()
    s = 2j * np.pi * frequency
    h = residues @ (1 / (s - poles[:, None])) + residues.conj() @ (1 / (s - poles.conj()[:, None]))
    found = common_poles(frequency, h, 1 / np.abs(h), 2 * len(poles))
    np.testing.assert_allclose(found, poles, rtol=1e-8)


@given(
    pad=st.floats(60.0, 800.0),
    pad_loss=st.floats(0.1, 0.5),
    ballast=st.floats(20.0, 200.0),
    ballast_damping=st.floats(10.0, 300.0),
    sleeper=st.floats(60.0, 200.0),
    order=st.integers(4, 9),
)
@settings(max_examples=6)
def test_any_tracks_poles_are_stable_and_its_static_deflection_exact(
    pad: float, pad_loss: float, ballast: float, ballast_damping: float, sleeper: float, order: int
):
    rail = Rail(60.21, 76.7e-4, 3038.3e-8, 210e9, 81e9, 0.4, 0.01)
    springs = Spring(pad * 1e6, pad_loss), Spring(ballast * 1e6, 0.0, ballast_damping * 1e3)
    track = Track("any", rail, Support(springs, (sleeper,)), 0.6)
    model = fit_track(track, lambda omega: 1e-9 - 1 / (600.0 * omega**2) + 0j, order, section_count=6)
    assert model.order == order
    assert np.all(model.poles_rad_s.real < 0)
    np.testing.assert_allclose(
        model.static_compliance(model.section_m), static_compliance(track, model.section_m), rtol=1e-3
    )


@every_track
def test_shipped_fit_belongs_to_the_shipped_track_and_comes_out_again(
    name: str, definitions: dict[str, TrackDefinition]
):
    definition = definitions[name]
    shipped = fit_store.fitted(definition)
    assert shipped.key == fit_store.key_of(definition)
    fresh = fit_track(definition.track, definition.wheel.compliance, shipped.order)
    frequency, at = np.geomspace(5.0, 2500.0, 80), np.linspace(0.0, definition.track.spacing_m, 9)
    np.testing.assert_allclose(fresh.receptance(frequency, at), shipped.model().receptance(frequency, at), rtol=1e-4)
    assert shipped.error == pytest.approx(
        relative_error(fresh, definition.track, definition.wheel.compliance), rel=0.01
    )


@every_track
def test_shipped_fit_is_stable_and_settles_at_the_exact_deflection(name: str, definitions: dict[str, TrackDefinition]):
    model, track = fit_store.fitted(definitions[name]).model(), definitions[name].track
    assert np.all(model.poles_rad_s.real < 0)
    at = np.linspace(0.0, track.spacing_m, 101)
    # Between sections: the kink over a sleeper, the sharper the stiffer the track.
    np.testing.assert_allclose(model.static_compliance(at), static_compliance(track, at), rtol=1.5e-3)


@pytest.mark.parametrize("name", ["johansson-nielsen", "bilbao-viscous"])
def test_shipped_fit_of_a_causal_track_is_within_half_a_percent(name: str, definitions: dict[str, TrackDefinition]):
    definition = definitions[name]
    model = fit_store.fitted(definition).model()
    frequency, at = np.geomspace(5.0, 2500.0, 150), np.linspace(0.0, definition.track.spacing_m, 23)
    exact = receptance(definition.track, frequency, at)
    seen = exact + definition.wheel.compliance(2 * np.pi * frequency)
    error = np.abs(model.receptance(frequency, at) - exact) / np.abs(seen)
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert error.max() < 0.03


def test_default_order_is_the_lowest_where_more_poles_hardly_help(definitions: dict[str, TrackDefinition]):
    # A loss factor is not causal: no order is good enough, and the paper's eight are as good as ten.
    definition = definitions["bilbao-continuous"]
    compliance = definition.wheel.compliance
    chosen, more = default_fit(definition.track, compliance), fit_track(definition.track, compliance, 10)
    assert chosen.order == fit_store.fitted(definition).order == 8
    chosen_error, more_error = (relative_error(fit, definition.track, compliance) for fit in (chosen, more))
    assert more_error > 0.75 * chosen_error > 0.75 * 0.005


def test_model_is_the_transform_of_a_real_impulse_response(definitions: dict[str, TrackDefinition]):
    model = fit_store.fitted(definitions["johansson-nielsen"]).model()
    t = np.arange(0.0, 0.5, 5e-6)
    impulse = model.pair_weight * model.residues[3] @ np.exp(np.outer(model.poles_rad_s, t))
    for frequency in (20.0, 110.0, 300.0):
        transform = trapezoid(impulse.real * np.exp(-2j * np.pi * frequency * t), t)
        assert model.receptance(frequency, model.section_m[3])[0, 0] == pytest.approx(transform, rel=1e-3)
    np.testing.assert_allclose(
        model.receptance([-50.0, -500.0], [0.1]), model.receptance([50.0, 500.0], [0.1]).conj(), rtol=1e-12
    )


def test_residues_pass_through_the_sections_and_close_smoothly_round_the_span(
    definitions: dict[str, TrackDefinition],
):
    model = fit_store.fitted(definitions["johansson-nielsen"]).model()
    span = model.spacing_m
    np.testing.assert_allclose(model.residues_at(model.section_m + 3 * span), model.residues, rtol=1e-9, atol=1e-18)
    before, at, after = model.residues_at([-1e-6, 0.0, 1e-6])
    size = np.abs(model.residues).max()
    assert np.abs(after - before).max() < 1e-3 * size
    assert np.abs(after - 2 * at + before).max() < 1e-8 * size


def test_order_counts_a_pair_as_two_states():
    model = PoleModel(np.array([-3.0 + 0j, -1 + 5j]), np.ones((1, 2), complex), np.zeros(1), 0.6)
    assert model.order == 3
    # 1/3 from the real pole, 2 Re(1 / (1 - 5i)) = 2/26 from the pair
    assert model.static_compliance(0.1)[0] == pytest.approx(1 / 3 + 2 / 26)


def test_a_causal_track_gets_its_best_order_where_none_is_good_enough():
    """Of this one ten poles bring a fifteenth of the error of eight, sixteen take six sevenths of it away."""
    definition = supported(track_file.load("bilbao-viscous"), 1.38)
    compliance = definition.wheel.compliance
    chosen = default_fit(definition.track, compliance)
    errors = [relative_error(fit_track(definition.track, compliance, order), definition.track, compliance)
              for order in ORDERS]  # fmt: skip
    assert errors[1] > 0.75 * errors[0] > 0.02
    assert min(errors) > 0.005
    assert relative_error(chosen, definition.track, compliance) == pytest.approx(min(errors))
