"""A sleeper that bends against closed forms, finite elements of its own and what must hold for anything passive."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track.bending_sleeper import BendingSleeper
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.physics.track.timoshenko import TimoshenkoBeam
from weld_force_ros.simulation import track_file

CONCRETE = TimoshenkoBeam(110.0, 451.6e-4, 12167e-8, 46.3e9, 19.3e9, 0.851, 0.016)
B91 = BendingSleeper(CONCRETE, 2.6, 1.507)
BALLAST = Spring(50e6, 0.3, 40e3)
HZ = np.array([5.0, 60.0, 130.0, 250.0, 600.0, 700.0, 1500.0, 3000.0])
OMEGA = 2 * np.pi * HZ


def of_elements(sleeper: BendingSleeper, below: complex, omega: float, elements: int) -> complex:
    """Dynamic stiffness at a seat by cubic elements of half the sleeper, mirrored at its middle.

    Each element is exact for a resting Timoshenko beam; mass and bed act by the same shapes of its displacement and
    rotation, integrated by Gauss' rule.
    """
    beam, half, seat = sleeper.beam, sleeper.length_m / 2, sleeper.seats_m / 2
    nodes = np.concatenate([np.linspace(0, seat, elements), np.linspace(seat, half, elements)[1:]])
    loss = 1 + 1j * beam.loss_factor
    bending = beam.youngs_modulus_pa * beam.second_moment_m4
    shear = beam.shear_coefficient * beam.shear_modulus_pa * beam.area_m2
    spread = 2 * below / sleeper.length_m if sleeper.bed == "spread" else 0.0
    matrix = np.zeros((2 * len(nodes), 2 * len(nodes)), dtype=complex)
    for i, length in enumerate(np.diff(nodes)):
        own = slice(2 * i, 2 * i + 4)
        phi = 12 * bending / (shear * length**2)
        matrix[own, own] += (
            loss
            * bending
            / (length**3 * (1 + phi))
            * np.array(
                [
                    [12, 6 * length, -12, 6 * length],
                    [6 * length, (4 + phi) * length**2, -6 * length, (2 - phi) * length**2],
                    [-12, -6 * length, 12, -6 * length],
                    [6 * length, (2 - phi) * length**2, -6 * length, (4 + phi) * length**2],
                ]
            )
        )
        at, weights = np.polynomial.legendre.leggauss(5)
        for s, weight in zip((at + 1) / 2, weights / 2 * length, strict=True):
            down = np.array(
                [
                    1 - 3 * s**2 + 2 * s**3 + phi * (1 - s),
                    length * (s - 2 * s**2 + s**3 + phi / 2 * (s - s**2)),
                    3 * s**2 - 2 * s**3 + phi * s,
                    length * (-(s**2) + s**3 - phi / 2 * (s - s**2)),
                ]
            ) / (1 + phi)
            turned = np.array(
                [
                    6 / length * (s**2 - s),
                    1 - 4 * s + 3 * s**2 + phi * (1 - s),
                    6 / length * (s - s**2),
                    -2 * s + 3 * s**2 + phi * s,
                ]
            ) / (1 + phi)
            carried = spread - beam.mass_kg_per_m * omega**2
            rotary = beam.mass_kg_per_m * beam.second_moment_m4 / beam.area_m2 * omega**2
            matrix[own, own] += weight * (carried * np.outer(down, down) - rotary * np.outer(turned, turned))
    if sleeper.bed == "seats":
        matrix[2 * elements - 2, 2 * elements - 2] += below
    free = np.delete(np.arange(len(matrix)), 1)  # the middle does not turn
    unit = (free == 2 * elements - 2).astype(complex)
    return complex(1 / np.linalg.solve(matrix[np.ix_(free, free)], unit)[unit.argmax()])


def by_finite_elements(sleeper: BendingSleeper, below: ComplexArray) -> ComplexArray:
    """Extrapolate to elements of no length (Richardson): their error goes with its square."""
    coarse, fine = (
        np.array([of_elements(sleeper, one, omega, n) for one, omega in zip(below, OMEGA, strict=True)])
        for n in (40, 80)
    )
    return np.asarray((4 * fine - coarse) / 3)


@pytest.mark.parametrize("bed", ["spread", "seats"])
def test_sleeper_answers_as_finite_elements_of_it_do(bed: str):
    sleeper = replace(B91, bed=bed)
    below = BALLAST.dynamic_stiffness(OMEGA)
    exact = by_finite_elements(sleeper, below)
    np.testing.assert_allclose(sleeper.stiffness_at_seat(below, OMEGA), exact, rtol=3e-4)


@pytest.mark.parametrize("bed", ["spread", "seats"])
def test_a_stiff_one_is_half_its_mass_on_its_bed(bed: str):
    stiff = replace(CONCRETE, youngs_modulus_pa=46.3e15, shear_modulus_pa=19.3e15)
    below = BALLAST.dynamic_stiffness(OMEGA)
    found = replace(B91, beam=stiff, bed=bed).stiffness_at_seat(below, OMEGA)
    np.testing.assert_allclose(found, below - 143.0 * OMEGA**2, rtol=2e-3)


def resonances_hz(sleeper: BendingSleeper, upto_hz: float) -> FloatArray:
    def stiffness(hz: float) -> float:
        return float(sleeper.stiffness_at_seat(np.zeros(1), 2 * np.pi * np.array([hz]))[0].real)

    hz = np.arange(20.0, upto_hz, 1.0)
    values = np.array([stiffness(one) for one in hz])
    change = np.flatnonzero((values[:-1] < 0) & (values[1:] > 0) | (values[:-1] > 0) & (values[1:] < 0))
    roots = [brentq(stiffness, hz[i], hz[i + 1]) for i in change]
    return np.array([root for root in roots if abs(stiffness(root)) < 1e6])  # poles change sign, too


def test_a_slender_one_rings_at_the_frequencies_of_a_free_beam():
    # Free-free Euler-Bernoulli beam, even modes: tan(b / 2) + tanh(b / 2) = 0, b = 4.73004, 10.99561.
    slender = replace(CONCRETE, second_moment_m4=1e-8, loss_factor=0.0)
    stiffness = slender.youngs_modulus_pa * slender.second_moment_m4 / slender.mass_kg_per_m
    euler_hz = np.array([4.73004074, 10.99560784]) ** 2 / (2 * np.pi * 2.6**2) * np.sqrt(stiffness)
    longer = replace(B91, beam=replace(slender, youngs_modulus_pa=46.3e9 * 1e4))  # as slender, a hundred times faster
    shear_too = replace(longer, beam=replace(longer.beam, shear_modulus_pa=19.3e13))
    np.testing.assert_allclose(resonances_hz(shear_too, 700.0)[:2], 100 * euler_hz, rtol=1e-3)


def test_b91_is_softer_than_its_mass_by_what_others_found():
    # Undamped finite elements of the project had 0.65 at 250 Hz and 6.4 at 700 Hz.
    omega = 2 * np.pi * np.array([250.0, 700.0])
    free = B91.undamped().stiffness_at_seat(np.zeros(2), omega)
    np.testing.assert_allclose((-143.0 * omega**2 / free).real, [0.65, 6.4], rtol=0.06)


beams = st.builds(
    TimoshenkoBeam,
    st.floats(30, 200), st.floats(0.02, 0.08), st.floats(2e-5, 4e-4), st.floats(5e9, 60e9), st.floats(0.5e9, 25e9),
    st.floats(0.5, 1.0), st.floats(0.0, 0.1),
)  # fmt: skip


@given(
    beams, st.floats(2.0, 3.0), st.floats(1.0, 1.9), st.sampled_from(["spread", "seats"]), st.floats(0.1, 6000.0),
    st.floats(0.0, 3e8), st.floats(0.01, 2.0),
)  # fmt: skip
def test_no_sleeper_gives_energy(
    beam: TimoshenkoBeam, length_m: float, seats_m: float, bed: str, hz: float, bed_n_per_m: float, loss: float
):
    omega = 2 * np.pi * np.array([hz])
    below = bed_n_per_m * np.array([1 + 1j * loss])
    found = BendingSleeper(beam, length_m, seats_m, bed).stiffness_at_seat(below, omega)
    assert np.isfinite(found[0])
    assert found[0].imag >= -1e-6 * abs(found[0])


def test_a_chain_with_it_is_that_chain():
    usp = Spring(90e6, 0.0, 40e3)
    chain = Support((Spring(120e6, 0.2), usp, BALLAST), (B91, 300.0))
    lowest = BALLAST.dynamic_stiffness(OMEGA) - 300.0 * OMEGA**2
    beneath = usp.dynamic_stiffness(OMEGA) * lowest / (usp.dynamic_stiffness(OMEGA) + lowest)
    pad = 120e6 * (1 + 0.2j)
    seat = by_finite_elements(B91, beneath)
    np.testing.assert_allclose(chain.dynamic_stiffness(OMEGA), pad * seat / (pad + seat), rtol=3e-4)
    assert chain.mass_kg == pytest.approx(443.0)


def test_at_rest_nothing_is_lost():
    still = Support((Spring(120e6, 0.2), BALLAST), (B91,)).undamped()
    found: ComplexArray = still.dynamic_stiffness(2 * np.pi * np.array([0.1]))
    assert abs(found[0].imag) < 1e-9 * found[0].real


def test_file_states_the_whole_sleeper():
    text = track_file.load("bilbao-viscous").text
    start, end = text.index("  half_sleeper_mass_kg"), text.index("  ballast:")
    sleeper = (
        "  sleeper: {mass_kg: 286, length_m: 2.6, seat_spacing_m: 1.507, area_cm2: 451.6, second_moment_cm4: 12167,"
        " youngs_modulus_gpa: 46.3, shear_modulus_gpa: 19.3, shear_coefficient: 0.851, loss_factor: 0.016}\n"
    )
    (read,) = track_file.parse(text[:start] + sleeper + text[end:], "mine").track.support.masses_kg
    assert isinstance(read, BendingSleeper)
    assert (read.length_m, read.seats_m, read.bed) == (2.6, 1.507, "spread")
    assert read.beam == replace(CONCRETE, mass_kg_per_m=pytest.approx(110.0), area_m2=pytest.approx(451.6e-4),
                                second_moment_m4=pytest.approx(12167e-8), youngs_modulus_pa=pytest.approx(46.3e9),
                                shear_modulus_pa=pytest.approx(19.3e9))  # fmt: skip
