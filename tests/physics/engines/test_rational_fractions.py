import json
import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from weld_force_ros.errors import InputError
from weld_force_ros.physics.engines import common_poles
from weld_force_ros.physics.engines.common_poles import PoleModel, fit_frequencies
from weld_force_ros.physics.engines.rational_fractions import RfpModel, fit_sections, smooth_rail
from weld_force_ros.physics.engines.rational_search import VARIABLES, FitTask, Front, Population, Progress, search
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.track import beam
from weld_force_ros.simulation.track_file import TrackDefinition

FREQUENCY = fit_frequencies()


@st.composite
def rational_sections(draw: st.DrawFn) -> tuple[int, np.ndarray, np.ndarray]:
    """Degree, and poles and residues of three sections: each with its own well separated poles, real ones if odd."""
    degree = draw(st.integers(4, 12))
    pairs = degree // 2
    part = st.lists(st.floats(-1.0, 1.0), min_size=3 * pairs, max_size=3 * pairs)
    offset, damping, angle = (np.array(draw(part)).reshape(3, pairs) for _ in range(3))
    frequency = np.geomspace(60.0, 1800.0, pairs) * (1 + 0.05 * offset)
    ratio = 0.05 + 0.04 * damping
    p = 2 * np.pi * frequency * (-ratio + 1j * np.sqrt(1 - ratio**2))
    r = 1e-6 * np.exp(1j * (0.4 * angle - np.pi / 2))
    p, r = np.concatenate([p, p.conj()], axis=1), np.concatenate([r, r.conj()], axis=1)
    if degree % 2:
        p = np.concatenate([p, np.full((3, 1), -2 * np.pi * 400.0)], axis=1)
        r = np.concatenate([r, np.full((3, 1), 2e-6)], axis=1)
    return degree, p, r


def partial_fractions(frequency: np.ndarray, p: np.ndarray, r: np.ndarray) -> np.ndarray:
    return np.sum(r[:, :, None] / (2j * np.pi * frequency - p[:, :, None]), axis=1)


def model_of(a: np.ndarray, b: np.ndarray) -> RfpModel:
    return RfpModel(a, b, 0.6)


@given(rational_sections())
@settings(max_examples=10)
def test_known_rational_functions_are_recovered(case: tuple[int, np.ndarray, np.ndarray]):
    degree, p, r = case
    h = partial_fractions(FREQUENCY, p, r)
    static = np.sum(-r / p, axis=1).real
    model = model_of(*fit_sections(FREQUENCY, h, 1 / np.abs(h), static, degree))
    other = np.geomspace(3.0, 2600.0, 97)  # not the fitted frequencies
    expected = partial_fractions(other, p, r)
    np.testing.assert_allclose(model.receptance(other, model.section_m), expected, rtol=1e-8)


noisy = st.tuples(st.integers(4, 12), st.integers(0, 2**32 - 1), st.floats(0.0, 3.0))


@given(noisy)
@example((7, 0, 3.0))
@settings(max_examples=30)
def test_unstable_poles_are_never_returned_and_the_static_compliance_is_exact(case: tuple[int, int, float]):
    degree, seed, noise = case
    rng = np.random.default_rng(seed)
    frequency = fit_frequencies()[::4]
    shape = (2, len(frequency))
    h = 1e-8 * (1 / (1 + 1j * frequency / 300.0) + noise * (rng.normal(size=shape) + 1j * rng.normal(size=shape)))
    static = 1e-8 * rng.uniform(0.5, 2.0, 2)
    a, b = fit_sections(frequency, h, 1 / np.abs(h), static, degree)
    for row in a:
        assert np.all(np.roots(np.append(1.0, row)).real < 0)
    np.testing.assert_allclose(b[:, -1] / a[:, -1], static, rtol=1e-12)


def test_a_tie_leads_all_sections_to_one_denominator():
    p = 2 * np.pi * np.array([[-20 + 300j, -20 - 300j, -60 + 900j, -60 - 900j]]) * np.array([[1.0], [1.1]])
    r = np.full_like(p, 1e-6)
    r.imag[:, 0::2], r.imag[:, 1::2] = -1e-6, 1e-6
    h = partial_fractions(FREQUENCY, p, r)
    static = np.sum(-r / p, axis=1).real
    spread = []
    for tie in (0.0, 0.3, 3.0, 1e5):
        a, b = fit_sections(FREQUENCY, h, 1 / np.abs(h), static, 4, regularisation=tie)
        spread.append(np.ptp(a / a.mean(axis=0), axis=0).max())
        np.testing.assert_allclose(b[:, -1] / a[:, -1], static, rtol=1e-12)
    assert spread[0] == pytest.approx(2 * (1.1**4 - 1) / (1.1**4 + 1), rel=1e-6)  # a_4 is the product of all poles
    assert spread == sorted(spread, reverse=True)
    assert spread[-1] < 1e-6


@given(rational_sections())
def test_state_space_answers_as_the_fraction_does(case: tuple[int, np.ndarray, np.ndarray]):
    degree, p, _ = case
    scale = 2 * np.pi * 500.0
    a = np.stack([np.poly(row / scale).real[1:] for row in p])
    b = 1e-8 * np.cos(np.arange(a.size)).reshape(a.shape)
    model = RfpModel(a, b, 0.6, scale)
    at = np.array([0.0, 0.13, 0.2, 0.59])
    rates, inputs = model.state_space(at)
    for frequency in (15.0, 240.0, 1900.0):
        s = 2j * np.pi * frequency / scale
        states = np.linalg.solve(s * np.eye(degree) - rates, inputs[:, :, None].astype(complex))[:, 0, 0]
        np.testing.assert_allclose(model.receptance(frequency, at)[:, 0], states, rtol=1e-7)
    rest = model.at_rest(at)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", rates, rest), -inputs, rtol=1e-9, atol=1e-9 * np.abs(rest).max())
    np.testing.assert_allclose(rest[:, 0], model.static_compliance(at), rtol=1e-12)


def test_inputs_follow_equation_3c():
    # z'' + 3 z' + 2 z = 5 f' + 7 f: c1 = 5, c2 = 7 - 3 * 5
    rates, inputs = model_of(np.array([[3.0, 2.0]]), np.array([[5.0, 7.0]])).state_space(0.0)
    np.testing.assert_array_equal(rates[0], [[0.0, 1.0], [-2.0, -3.0]])
    np.testing.assert_array_equal(inputs[0], [5.0, -8.0])
    # c3 = b3 - a2 c1 - a1 c2 = 11 - 2 * 5 - 3 * (-8)
    _, inputs = model_of(np.array([[3.0, 2.0, 1.0]]), np.array([[5.0, 7.0, 11.0]])).state_space(0.0)
    np.testing.assert_array_equal(inputs[0], [5.0, -8.0, 25.0])


def test_coefficients_are_linear_between_sections_and_repeat_with_the_span():
    model = RfpModel(np.array([[1.0, 4.0], [2.0, 8.0], [4.0, 6.0]]), np.ones((3, 2)), 0.6)
    np.testing.assert_allclose(model.section_m, [0.0, 0.2, 0.4])
    a, b = model.coefficients_at([0.0, 0.1, 0.2, 0.55, -0.05, 0.6, 1.3])
    np.testing.assert_allclose(
        a, [[1.0, 4.0], [1.5, 6.0], [2.0, 8.0], [1.75, 4.5], [1.75, 4.5], [1.0, 4.0], [1.5, 6.0]]
    )
    np.testing.assert_allclose(b, 1.0)


def test_variation_is_the_relative_slope_along_the_span():
    # Both coefficients alternate by +-1 about 10 over four sections: a slope of 4 * 2 a span, RMS sqrt(101).
    alternating = 10.0 + np.array([1.0, -1.0, 1.0, -1.0])[:, None] * np.ones(2)
    assert model_of(alternating, 1e-9 * alternating).variation == pytest.approx(8 / np.sqrt(101))
    assert model_of(alternating[:1], alternating[:1]).variation == 0.0


def test_growth_of_constant_coefficients_is_the_slowest_mode_over_a_span():
    model = RfpModel(np.array([[0.5, 2.0, 0.3, 0.4]] * 3), np.array([[2e-9, 5e-9, 3e-9, 4e-9]] * 3), 0.6)
    mass, stiffness, speed = 600.0, 1.3e9, 50.0
    rail, inputs = model.state_space(0.0)
    closed = np.zeros((6, 6))
    closed[:4, :4] = model.scale_rad_s * rail[0]
    closed[:4, 0] -= model.scale_rad_s * stiffness * inputs[0]
    closed[:4, 4] += model.scale_rad_s * stiffness * inputs[0]
    closed[4, 5] = 1.0
    closed[5, 0], closed[5, 4] = stiffness / mass, -stiffness / mass
    slowest = np.linalg.eigvals(closed).real.max()
    steady_state = smooth_rail(model, mass, stiffness, [3.6 * speed, 36.0])
    np.testing.assert_allclose(steady_state.growth, np.exp(slowest * 0.6 / np.array([speed, 10.0])), rtol=1e-6)
    np.testing.assert_allclose(steady_state.swing, 0.0, atol=1e-9)


@pytest.mark.parametrize(("depth", "damping"), [(0.3, 0.02), (0.3, 0.07), (0.15, 0.05)])
def test_growth_shows_parametric_resonance(depth: float, damping: float):
    # Mathieu: stiffness modulated by `depth` at twice the natural frequency grows by exp(pi (depth / 4 - damping)) each
    # half period. A force of the wheel does not reach a rail without inputs.
    omega = 2 * np.pi * 100.0
    phase = 2 * np.pi * np.arange(60) / 60
    a = np.stack([np.full(60, 2 * damping), 1 + depth * np.cos(phase)], axis=1)
    model = RfpModel(a, np.zeros((60, 2)), 0.6, omega)
    in_step = 0.6 / (np.pi / omega) * 3.6
    growth = smooth_rail(model, 600.0, 1e6, [in_step, 0.6 * in_step]).growth
    # The wheel on its undamped contact alone neither grows nor decays.
    assert growth[0] == pytest.approx(max(1.0, np.exp(np.pi * (depth / 4 - damping))), rel=0.01)
    assert growth[1] == pytest.approx(1.0, rel=1e-6)


def test_smooth_rail_agrees_with_a_general_solver():
    scale, mass, stiffness, speed, span = 2 * np.pi * 80.0, 600.0, 1e9, 40.0, 0.6
    middle = np.minimum(np.arange(8), 8 - np.arange(8))[:, None] / 4
    model = RfpModel(
        np.array([0.6, 1.0]) * (1 - 0.15 * middle), 1e-9 * np.array([2.0, 9.0]) * (1 + middle), span, scale
    )

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        rail, inputs = model.state_space(speed * t)
        states = y.reshape(5, -1)
        force = stiffness * (states[2] - states[0])
        slope = scale * (rail[0] @ states[:2] + inputs[0][:, None] * force)
        return np.concatenate([slope, [states[3], (states[4] - force) / mass, 0 * force]]).ravel()

    knots = np.linspace(0.0, span / speed, 9)
    sample = np.linspace(0.0, span / speed, 400)
    passed = [np.eye(5)]
    for begin, end in pairwise(knots):  # the slope of the coefficients is broken at sections
        at = np.append(sample[(sample > begin) & (sample < end)], end)
        piece = solve_ivp(rate, (begin, end), passed[-1].ravel(), t_eval=at, rtol=1e-9, atol=1e-13)
        passed += list(piece.y.T.reshape(-1, 5, 5))
    span_matrix = passed[-1][:4, :4]
    start = np.append(np.linalg.solve(np.eye(4) - span_matrix, passed[-1][:4, 4]), 1.0)
    states = np.stack(passed) @ start
    force = stiffness * (states[:, 2] - states[:, 0])
    steady_state = smooth_rail(model, mass, stiffness, [3.6 * speed], steps_per_section=32)
    assert steady_state.growth[0] == pytest.approx(np.abs(np.linalg.eigvals(span_matrix)).max(), rel=1e-3)
    assert steady_state.swing[0] == pytest.approx(np.ptp(force), rel=1e-2)
    coarse = smooth_rail(model, mass, stiffness, [3.6 * speed])
    assert coarse.growth[0] == pytest.approx(steady_state.growth[0], rel=1e-2)


def test_passages_are_those_of_the_same_fraction_as_common_poles(definitions: dict[str, TrackDefinition], dip):
    wheel = definitions["bilbao-viscous"].wheel
    p = 2 * np.pi * np.array([-50.0 + 80.0j, -90.0 + 510.0j])
    r = 1e-9 * np.array([500.0 - 1500.0j, 300.0 - 4000.0j])
    common = PoleModel(p, r[None], np.zeros(1), 0.6)
    scale = 2 * np.pi * 500.0
    full = np.concatenate([p, p.conj()]) / scale
    residues = np.concatenate([r, r.conj()]) / scale
    b = sum(residues[k] * np.poly(np.delete(full, k)) for k in range(4))
    fraction = RfpModel(np.poly(full).real[None, 1:], b.real[None], 0.6, scale)
    over = dip(0.1, 0.5e-3)
    speeds, positions = [40.0, 120.0, 250.0], [0.0, 0.25]
    expected = VehicleTrackModel(common, wheel).peak_map(over, speeds, positions).peak_force_n
    found = VehicleTrackModel(fraction, wheel).peak_map(over, speeds, positions).peak_force_n
    np.testing.assert_allclose(found, expected, rtol=2e-4)


@pytest.fixture(scope="module")
def viscous(definitions: dict[str, TrackDefinition]) -> FitTask:
    definition = definitions["johansson-nielsen"]
    return FitTask(definition.track, definition.wheel)


@pytest.fixture(scope="module")
def small(definitions: dict[str, TrackDefinition]) -> FitTask:
    definition = definitions["johansson-nielsen"]
    return FitTask(definition.track, definition.wheel, degree=4, section_count=5)


@pytest.fixture(scope="module")
def found(viscous: FitTask) -> Front:
    return search(viscous, seed=3, population=8, generations=3)


def test_the_front_beats_relative_weights_in_both_objectives(found: Front, viscous: FitTask):
    error, variation = found.unweighted
    assert np.any((found.error < error) & (found.variation < variation))
    plain = viscous.unweighted_fit()
    assert variation == plain.variation
    assert np.all(np.diff(found.error) > 0)
    assert np.all(np.diff(found.variation) < 0)


def test_the_front_is_what_its_genes_give(found: Front, viscous: FitTask, definitions: dict[str, TrackDefinition]):
    definition = definitions["johansson-nielsen"]
    for i in (0, found.chosen, len(found.error) - 1):
        model = viscous.fit_at(found.decision_vectors[i])
        assert model.variation == pytest.approx(found.variation[i], rel=1e-9)
        assert common_poles.relative_error(model, definition.track, definition.wheel.compliance) == pytest.approx(
            found.error[i], rel=1e-9
        )


def test_the_chosen_is_the_farthest_below_the_line_of_the_feasible(found: Front, viscous: FitTask):
    ends = np.array([[found.error[0], found.variation[0]], [found.error[-1], found.variation[-1]]])
    along = ends[1] - ends[0]
    scaled = (np.stack([found.error, found.variation], axis=1) - ends[0]) / np.abs(along)
    below = -(scaled @ [1.0, 1.0]) / np.sqrt(2)
    assert viscous.is_feasible(viscous.fit_at(found.decision_vectors[found.chosen]))
    for better in np.flatnonzero(below > below[found.chosen] + 1e-12):
        assert not viscous.is_feasible(viscous.fit_at(found.decision_vectors[better]))


def test_the_chosen_fit_is_symmetric_stable_and_rests_at_the_exact_deflection(
    found: Front, viscous: FitTask, definitions: dict[str, TrackDefinition]
):
    model, exact = viscous.fit_at(found.decision_vectors[found.chosen]), definitions["johansson-nielsen"].track
    assert (model.order, len(model.section_m)) == (8, 15)
    at = np.linspace(0.0, exact.spacing_m, 121)
    assert np.all(model.poles(at).real < 0)
    np.testing.assert_allclose(
        model.static_compliance(model.section_m), beam.static_compliance(exact, model.section_m), rtol=1e-9
    )
    np.testing.assert_allclose(model.static_compliance(at), beam.static_compliance(exact, at), rtol=5e-3)
    frequency = np.geomspace(5.0, 2500.0, 50)
    np.testing.assert_allclose(model.receptance(frequency, at), model.receptance(frequency, -at), rtol=1e-9)
    assert np.all(smooth_rail(model, 593.0, 1.3e9, np.arange(10.0, 301.0, 29.0), steps_per_section=16).growth < 1)


def test_a_fit_that_would_not_stay_bounded_is_not_held(definitions: dict[str, TrackDefinition]):
    definition = definitions["bilbao"]
    task = FitTask(definition.track, definition.wheel)
    free, tied = (task.fit_at(np.append(np.zeros(VARIABLES - 1), tie)) for tie in (-30.0, 3.0))
    assert smooth_rail(free, definition.wheel.mass_kg, definition.wheel.contact_stiffness_n_per_m, 300.0).growth[0] > 1
    assert not task.is_feasible(free)
    assert task.is_feasible(tied)


def test_a_resumed_search_ends_as_an_uninterrupted_one(small: FitTask):
    reported: list[Progress] = []
    whole = search(small, seed=5, population=6, generations=4, on_generation=reported.append)
    assert [p.population.generation for p in reported] == [1, 2, 3, 4]
    kept = json.loads(json.dumps(reported[1].population.decision_vectors.tolist()))
    resumed = search(small, seed=5, generations=4, resume_from=Population(2, np.array(kept)))
    for name in ("decision_vectors", "error", "variation"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
    assert resumed.chosen == whole.chosen
    assert reported[-1].least_error == whole.error[0]
    assert reported[-1].least_variation == whole.variation[-1]


def test_a_search_repeats_with_its_seed_and_leaves_the_global_random_numbers_alone(small: FitTask):
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    first, again, other = (search(small, seed=seed, population=6, generations=2) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.decision_vectors, again.decision_vectors)
    assert not np.array_equal(first.decision_vectors, other.decision_vectors)
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


def test_continuous_support_needs_one_section(definitions: dict[str, TrackDefinition]):
    definition = definitions["bilbao-continuous"]
    task = FitTask(definition.track, definition.wheel, degree=6)
    found = search(task, population=6, generations=2)
    model = task.fit_at(found.decision_vectors[found.chosen])
    assert len(model.section_m) == 1
    assert found.variation.tolist() == [0.0]
    assert found.error[0] < found.unweighted[0]


def test_what_cannot_be_searched_is_refused(small: FitTask, definitions, monkeypatch: pytest.MonkeyPatch):
    definition = definitions["bilbao"]
    for wrong in ({"degree": 3}, {"degree": 13}, {"section_count": 2}):
        with pytest.raises(InputError, match="use a degree from 4 to 12 and at least 3 sections"):
            FitTask(definition.track, definition.wheel, **wrong)
    with pytest.raises(InputError, match="use at least 4"):
        search(small, population=3, generations=1)
    for genes in (np.zeros((6, 3)), np.full((6, VARIABLES), np.nan), np.zeros(VARIABLES)):
        with pytest.raises(InputError, match="start the search anew"):
            search(small, resume_from=Population(1, genes))
    monkeypatch.setitem(sys.modules, "pymoo.algorithms.moo.nsga2", None)
    with pytest.raises(InputError, match="needs pymoo; pip install"):
        search(small, population=4, generations=1)
