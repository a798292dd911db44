"""The oracle for local supports, against closed forms, another integrator, the reference and another program."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.harness import finite_element_peaks
from tests.harness.finite_element_passage import CONVERGED, Resolution, in_time, passage, peak
from tests.harness.finite_element_peaks import GAPS, LINEAR, Case, wheel_path
from tests.harness.finite_elements import AS_BUILT, Element, FiniteElementTrack, Supports
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.track.beam import Rail, Track, static_compliance, transfer_receptance
from weld_force_ros.simulation.track_file import TrackDefinition

viscous = pytest.mark.parametrize("name", ["bilbao-viscous", "johansson-nielsen"])
RAIL = Rail(60.21, 76.7e-4, 3038.3e-8, 210e9, 81e9, 0.4)


def lossless_rail(track: Track) -> Track:
    return replace(track, rail=replace(track.rail, loss_factor=0.0))


def test_an_element_gives_in_its_middle_as_a_clamped_beam():
    length, bending, shear = 0.6, 210e9 * 3038.3e-8, 0.4 * 81e9 * 76.7e-4
    exact = length**3 / (192 * bending) + length / (4 * shear)
    assert Element(RAIL, length).clamped_compliance(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.0, exact, 0.0])


def test_an_element_moves_freely_as_a_rigid_body_of_its_mass():
    length = 0.3
    element, total = Element(RAIL, length), 60.21 * length
    shift, turn = np.array([1.0, 0, 1, 0]), np.array([-length / 2, 1, length / 2, 1])
    assert np.abs(element.stiffness() @ np.stack([shift, turn], axis=1)).max() < 1e-6 * element.stiffness().max()
    assert shift @ element.mass() @ shift == pytest.approx(total)
    about_middle = total * (length**2 / 12 + 3038.3e-8 / 76.7e-4)
    assert turn @ element.mass() @ turn == pytest.approx(about_middle)


@viscous
@pytest.mark.parametrize("elements", [1, 5])
def test_static_deflection_is_exact_with_any_number_of_elements(
    name: str, elements: int, definitions: dict[str, TrackDefinition]
):
    track = definitions[name].track
    model = FiniteElementTrack(track, AS_BUILT, (-40, 40), elements)
    at = np.linspace(-0.2, 0.9, 8) * track.spacing_m
    np.testing.assert_allclose([model.at_rest(x, 1.0)[1] for x in at], static_compliance(track, at), rtol=5e-6)


@viscous
@pytest.mark.parametrize(
    "supports",
    [
        AS_BUILT,
        Supports(ballast={0: 0.02}),
        Supports(ballast={0: 0.0, 1: 0.3}),
        Supports(pads={1: 0.25}, ballast={0: 3.0}),
    ],
    ids=["as built", "hanging", "two", "pad"],
)
def test_receptance_is_that_of_the_periodic_track_with_its_supports_changed(
    name: str, supports: Supports, definitions: dict[str, TrackDefinition]
):
    # Sherman, Morrison and Woodbury: what the changed supports add acts on the exact periodic track.
    track = lossless_rail(definitions[name].track)
    span, x = track.spacing_m, 0.3 * track.spacing_m
    places = np.array([0.0, span])
    model = FiniteElementTrack(track, supports, (-150, 150), CONVERGED.elements)
    for hz in (15.0, 60.0, 250.0, 500.0, 850.0):
        omega = np.array([2 * np.pi * hz])

        def support(sleeper: int, omega: FloatArray = omega) -> complex:
            pad = track.support.pad.dynamic_stiffness(omega) * supports.pads.get(sleeper, 1.0)
            below = track.support.springs[-1].dynamic_stiffness(omega) * supports.ballast.get(sleeper, 1.0)
            below = below - track.support.masses_kg[0] * omega**2
            return complex((pad * below / (pad + below))[0])

        added = np.diag([support(s) - complex(track.support.dynamic_stiffness(omega)[0]) for s in (0, 1)])
        between = np.array([transfer_receptance(track, hz, places, place)[:, 0] for place in places])
        to_load = transfer_receptance(track, hz, places, x)[:, 0]
        exact = transfer_receptance(track, hz, x, x)[0, 0]
        exact -= to_load @ np.linalg.solve(np.eye(2) + added @ between, added @ to_load)
        assert abs(model.receptance(hz, x) / exact - 1) < 4e-3, hz


def integrated(
    model: FiniteElementTrack, wheel: Wheel, x_m: FloatArray, height_m: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray]:
    """Contact force and the greatest force on any ballast below a gap, by scipy's integrator on full matrices."""

    def full(lower: FloatArray) -> FloatArray:
        matrix = sum(np.diag(lower[k, : model.unknowns - k], -k) for k in range(len(lower)))
        return np.asarray(matrix + np.tril(matrix, -1).T)

    inverse, stiffness, damping = np.linalg.inv(full(model.mass)), full(model.stiffness), full(model.damping)
    ballast, n = model.track.support.springs[-1], model.unknowns
    speed, time = (x_m[1] - x_m[0]) / dt, dt * np.arange(len(x_m))

    def forces(t: float, state: FloatArray) -> tuple[float, FloatArray, list[float]]:
        unknowns, shapes, local = model.under(np.array([x_m[0] + speed * t]))
        load = np.zeros(n)
        approach = state[-2] - shapes[0] @ state[unknowns[0]] + np.interp(t, time, height_m)
        force = 0.0
        if approach > 0.0:
            # The element's own give takes a part of the approach.
            most = wheel.hertz_n_per_m15 * approach**1.5
            give = float(local[0])
            force = brentq(lambda f: f - wheel.hertz_n_per_m15 * max(approach - give * f, 0) ** 1.5, 0, most, xtol=1e-3)
        load[unknowns[0]] = force * shapes[0]
        below = []
        for sleeper, gap in model.supports.gap_m.items():
            i = model.sleeper(sleeper)
            past = state[i] - gap
            push = ballast.stiffness_n_per_m * past + ballast.damping_ns_per_m * state[n + i] if past > 0 else 0.0
            below.append(max(0.0, push))
            load[i] -= below[-1]
        return force, load, below

    def slope(t: float, state: FloatArray) -> FloatArray:
        force, load, _ = forces(t, state)
        a = inverse @ (load - stiffness @ state[:n] - damping @ state[n : 2 * n])
        return np.concatenate([state[n : 2 * n], a, [state[-1], (wheel.static_load_n - force) / wheel.mass_kg]])

    rest, rail = model.at_rest(float(x_m[0]), wheel.static_load_n)
    first = np.concatenate([rest, np.zeros(n), [rail + wheel.static_indentation_m, 0.0]])
    done = solve_ivp(
        slope, (0.0, time[-1]), first, method="DOP853", rtol=1e-6, atol=1e-10, max_step=1e-4, t_eval=time[::20]
    )
    assert done.success, done.message
    both = [forces(*row) for row in zip(done.t, done.y.T, strict=True)]
    return np.array([force for force, _, _ in both]), np.array([max(below, default=0.0) for *_, below in both])


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    "supports",
    [Supports(gap_m={0: 0.2e-3, 1: 0.5e-3})],
    ids=["two gaps"],
)
def test_steps_in_time_are_those_of_another_integrator(supports: Supports, definitions: dict[str, TrackDefinition]):
    definition = definitions["bilbao-viscous"]
    model = FiniteElementTrack(definition.track, supports, (-5, 4), 1)
    dt, speed = 5e-6, 45.0
    x = np.arange(-2.4, 1.0, speed * dt)
    path = wheel_path("rise")
    assert path is not None
    height = path.at(x - 0.25)
    force = in_time(model, definition.wheel, x, height, dt, CONVERGED.dissipation)[0]
    exact, below = integrated(model, definition.wheel, x, height, dt)
    if supports.gap_m:
        assert below.max() > 5e3  # the gap closes, or this says nothing of it
        assert below.min() == 0.0
    assert np.abs(force[::20] - exact).max() < 2e-4 * definition.wheel.static_load_n


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("name", ["johansson-nielsen"])
def test_peaks_on_the_track_as_built_are_the_references(name: str, definitions: dict[str, TrackDefinition]):
    definition = definitions[name]
    reference = GreensFunctionModel(definition.track, definition.wheel)
    for shape in ("dip", "rise"):
        path = wheel_path(shape)
        assert path is not None
        for speed in (80.0, 160.0):
            for position in (0.0, 0.5 * definition.track.spacing_m):
                own = passage(definition.track, definition.wheel, path, speed, position)
                exact = reference.history(path, speed, position, until_m=float(own.x_m[-1]))
                shown = own.x_m >= exact.x_m[0]
                rms = np.sqrt(np.mean((own.force_n[shown] - np.interp(own.x_m[shown], exact.x_m, exact.force_n)) ** 2))
                assert rms < 3e-3 * definition.wheel.static_load_n, (shape, speed, position)
                assert own.force_n[shown].max() == pytest.approx(exact.force_n.max(), rel=5e-3)


HARD = [
    Case("bilbao-viscous", "dip", "0 over 0.8 mm", 250, 0.0),
    Case("johansson-nielsen", "rise", "0 and 1 hang", 250, 0.5),
]


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("case", HARD, ids=lambda c: f"{c.track}, {c.shape}, {c.supports}")
def test_peaks_are_converged(case: Case, definitions: dict[str, TrackDefinition]):
    definition = definitions[case.track]

    def at(resolution: Resolution) -> float:
        done = passage(
            definition.track, definition.wheel, wheel_path(case.shape), case.speed_kmh,
            case.position_spans * definition.track.spacing_m, finite_element_peaks.SUPPORTS[case.supports], resolution,
        )  # fmt: skip
        return peak(done, definition.track.spacing_m).force_n

    changed = {
        "elements": replace(CONVERGED, elements=2 * CONVERGED.elements),
        "steps": replace(CONVERGED, step_s=CONVERGED.step_s / 2, step_m=CONVERGED.step_m / 2),
        "track": replace(CONVERGED, beyond_spans=2 * CONVERGED.beyond_spans),
        "lead-in": replace(CONVERGED, lead_in_spans=2 * CONVERGED.lead_in_spans, lead_in_s=2 * CONVERGED.lead_in_s),
    }
    first = at(CONVERGED)
    assert {what: at(resolution) for what, resolution in changed.items()} == {
        what: pytest.approx(first, rel=2e-3) for what in changed
    }


# Another program's peaks, kN: 24 elements a bay without the local give of the rail, on the same supports.
OTHERS = [
    ("dip", 250, 0.0, (153, 180, 174)),
    ("rise", 160, 0.25, (140, 155, 174)),
]


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("shape", "speed_kmh", "position", "peaks_kn"), OTHERS)
def test_peaks_without_local_give_are_those_of_another_program(
    shape: str,
    speed_kmh: float,
    position: float,
    peaks_kn: tuple[int, ...],
    definitions: dict[str, TrackDefinition],
    monkeypatch: pytest.MonkeyPatch,
):
    definition = definitions["bilbao-viscous"]
    monkeypatch.setattr(Element, "clamped_compliance", lambda _self, share: np.zeros(len(share)))
    where = (wheel_path(shape), speed_kmh, position * definition.track.spacing_m)
    for name, theirs in zip(("as built", "0 hangs", "0 and 1 hang"), peaks_kn, strict=True):
        done = passage(definition.track, definition.wheel, *where, LINEAR[name], replace(CONVERGED, elements=24))
        own = peak(done, definition.track.spacing_m)
        assert own.force_n / 1e3 == pytest.approx(theirs, abs=0.8)  # theirs are whole kN


def test_a_gap_acts_as_full_ballast_where_it_is_nothing_and_as_none_where_it_never_closes(
    definitions: dict[str, TrackDefinition],
):
    definition = definitions["bilbao-viscous"]
    coarse = replace(CONVERGED, elements=4)

    def force(supports: Supports) -> FloatArray:
        return passage(definition.track, definition.wheel, wheel_path("dip"), 160.0, 0.0, supports, coarse).force_n

    np.testing.assert_array_equal(force(Supports(gap_m={0: 1.0})), force(Supports(ballast={0: 0.0})))
    closed, built = force(Supports(gap_m={0: 0.0})), force(AS_BUILT)
    assert closed.max() == pytest.approx(built.max(), rel=1e-4)
    # Before and behind the wheel a sleeper lifts more from ballast that does not pull.
    assert 0.0 < np.abs(closed - built).max() < 5e-3 * definition.wheel.static_load_n
    between = force(GAPS["0 over 0.8 mm"])
    assert built.max() < between.max() < force(Supports(ballast={0: 0.0})).max()


@pytest.mark.slow
def test_the_file_holds_every_case_as_it_comes_out_again():
    held = finite_element_peaks.read()
    assert list(held) == list(finite_element_peaks.cases())
    for case in (
        Case("bilbao-viscous", "rise", "0 and 1 over 0.3 mm", 160, 0.5),
        Case("johansson-nielsen", "dip", "0 and 1 softer", 200, 0.75),
    ):
        fresh = finite_element_peaks.computed(case)
        assert fresh.force_n == pytest.approx(held[case].force_n, abs=6)
        assert fresh.at_m == pytest.approx(held[case].at_m, abs=0.6e-3)
        assert fresh.least_n == pytest.approx(held[case].least_n, abs=6)
