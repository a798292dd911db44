"""A chain of springs and masses against its own equations, solved otherwise, and receptances that others published."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.physics.track.support import Spring, Support, TabulatedSpring
from weld_force_ros.studies.benchmark_study import PublishedSupport, rolland

PAD = Spring(120e6, 0.2, 3e3)
UNDER_SLEEPER = Spring(90e6, 0.0, 40e3)
BALLAST = Spring(60e6, 1.0)
RUBBER = TabulatedSpring(((10.0, 80e6, 0.10), (100.0, 95e6, 0.16), (1000.0, 130e6, 0.25)))
CHAINS = [
    Support((PAD,)),
    Support((PAD, BALLAST), (150.0,)),
    Support((PAD, UNDER_SLEEPER, BALLAST), (150.0, 400.0)),
    Support((RUBBER, UNDER_SLEEPER, BALLAST), (12.0, 0.0)),
    Support((PAD, RUBBER, UNDER_SLEEPER, BALLAST), (8.0, 150.0, 300.0)),
]
OMEGA = 2 * np.pi * np.array([1.0, 17.0, 73.0, 310.0, 1234.0, 5000.0])


def by_its_equations(support: Support, omega: float) -> complex:
    """Force on the top of the chain for a unit motion there, from its dynamic stiffness matrix."""
    count = len(support.springs)  # degrees of freedom: the rail's foot, and each mass
    matrix = np.diag(np.array([0.0, *support.masses_kg]) * -(omega**2)).astype(complex)
    for i, spring in enumerate(support.springs):
        ends = slice(i, i + 2) if i + 1 < count else slice(i, i + 1)
        coupling = np.array([[1.0, -1.0], [-1.0, 1.0]])[: ends.stop - i, : ends.stop - i]
        matrix[ends, ends] += complex(spring.dynamic_stiffness(np.array(omega))) * coupling
    unit = np.eye(count)[0]
    return complex(1 / np.linalg.solve(matrix, unit)[0])


@pytest.mark.parametrize("support", CHAINS, ids=["one", "two", "three", "in series", "four"])
def test_chain_is_what_its_stiffness_matrix_says(support: Support):
    exact = np.array([by_its_equations(support, omega) for omega in OMEGA])
    np.testing.assert_allclose(support.dynamic_stiffness(OMEGA), exact, rtol=1e-9)


@pytest.mark.parametrize("support", CHAINS[:4])
def test_resting_load_sees_the_springs_in_series(support: Support):
    compliance = sum(1 / spring.stiffness_n_per_m for spring in support.springs)
    found = support.undamped().dynamic_stiffness(np.array([1e-9]))[0]
    assert found.real == pytest.approx(1 / compliance, rel=1e-14)
    assert found.imag == 0.0


def test_what_the_pad_stands_on_is_the_chain_below_it_and_rigid_ground_under_one_layer():
    three = CHAINS[2]
    lower = Support(three.springs[1:], three.masses_kg[1:])
    expected = lower.dynamic_stiffness(OMEGA) - three.masses_kg[0] * OMEGA**2
    np.testing.assert_allclose(three.stiffness_below_pad(OMEGA), expected, rtol=1e-14)
    assert np.all(np.isinf(CHAINS[0].stiffness_below_pad(OMEGA)))


def test_lowest_spring_scales_alone():
    three = CHAINS[2]
    softer = three.with_lowest(0.25)
    assert softer.springs == (PAD, UNDER_SLEEPER, Spring(15e6, 1.0))
    hanging = three.with_lowest(0.0)
    # Only masses are left below: m2 free on the under-sleeper pad, by hand.
    k, u = PAD.dynamic_stiffness(OMEGA), UNDER_SLEEPER.dynamic_stiffness(OMEGA)
    free = -400.0 * OMEGA**2
    below = u * free / (u + free) - 150.0 * OMEGA**2
    np.testing.assert_allclose(hanging.dynamic_stiffness(OMEGA), k * below / (k + below), rtol=1e-12)
    dashpot = Support((Spring(50e6, 0.0, 80e3),)).with_lowest(0.5)
    assert dashpot.springs == (Spring(25e6, 0.0, 40e3),)
    assert Support((RUBBER,)).with_lowest(0.5).springs[0].rows[1] == (100.0, 47.5e6, 0.16)


def test_stiffer_supports_keep_their_dashpots():
    stiffer = CHAINS[3].stiffer(1.2)
    assert stiffer.springs[1] == Spring(90e6 * 1.2, 0.0, 40e3)
    assert stiffer.springs[0].dynamic_stiffness(OMEGA) == pytest.approx(1.2 * RUBBER.dynamic_stiffness(OMEGA))


def test_table_gives_its_rows_and_stays_beyond_them():
    hz = np.array([row[0] for row in RUBBER.rows])
    found = RUBBER.dynamic_stiffness(2 * np.pi * hz)
    np.testing.assert_allclose(found, [k * (1 + 1j * eta) for _, k, eta in RUBBER.rows], rtol=1e-12)
    below, above = RUBBER.dynamic_stiffness(2 * np.pi * np.array([0.0, 9000.0]))
    assert below == pytest.approx(80e6 * (1 + 0.10j))
    assert above == pytest.approx(130e6 * (1 + 0.25j))


@given(hz=st.floats(10.0, 1000.0))
def test_table_never_leaves_the_values_of_its_rows(hz: float):
    found = complex(RUBBER.dynamic_stiffness(np.array(2 * np.pi * hz)))
    assert found.real * (1 + 1e-12) >= 80e6
    assert found.real <= 130e6 * (1 + 1e-12)


def power_law(exponent: float) -> TabulatedSpring:
    """k (i w)^a: causal, its loss angle is a pi / 2 at every frequency (Bagley & Torvik, J. Rheol. 27 (1983) 201)."""
    hz = np.geomspace(1.0, 5000.0, 15)
    angle = exponent * np.pi / 2
    stiffness = 50e6 * (2 * np.pi * hz) ** exponent * np.cos(angle)
    return TabulatedSpring(
        tuple((float(f), float(k), float(np.tan(angle))) for f, k in zip(hz, stiffness, strict=True))
    )


def zener(relaxation_s: float) -> TabulatedSpring:
    """A spring beside a spring and dashpot in series: causal."""
    hz = np.geomspace(1.0, 5000.0, 40)
    s = 2j * np.pi * hz * relaxation_s
    k = 80e6 + 60e6 * s / (1 + s)
    return TabulatedSpring(
        tuple((float(f), float(one.real), float(one.imag / one.real)) for f, one in zip(hz, k, strict=True))
    )


@pytest.mark.parametrize("rubber", [power_law(0.05), power_law(0.2), zener(1e-3), zener(1e-2)])
def test_table_of_a_causal_material_is_causal_and_not_without_its_rise(rubber: TabulatedSpring):
    assert rubber.causal
    level = TabulatedSpring(tuple((hz, 80e6, loss) for hz, _, loss in rubber.rows))
    assert not level.causal
    lossless = TabulatedSpring(tuple((hz, k, 0.0) for hz, k, _ in rubber.rows))
    assert not lossless.causal


def test_table_continues_to_complex_frequencies_as_its_material_does():
    rubber, s = power_law(0.2), np.array([30.0 + 2000.0j, 36.8 + 400.0j, 50.0 + 90.0j])
    np.testing.assert_allclose(rubber.dynamic_stiffness(s / 1j), 50e6 * s**0.2, rtol=2e-3)


def test_a_chain_that_does_not_close_is_refused():
    with pytest.raises(ValueError, match="2 springs with 2 masses"):
        Support((PAD, BALLAST), (100.0, 100.0))


@pytest.mark.parametrize("published", rolland().supports, ids=lambda published: published.layers)
def test_receptance_of_one_and_of_two_layers_is_that_of_rolland(published: PublishedSupport):
    hz = np.array(rolland().frequency_hz)
    track = rolland().track(published)
    mobility = np.abs(receptance(track, hz, [0.0])[0]) * 2 * np.pi * hz
    np.testing.assert_allclose(mobility, published.mobility_m_per_ns, rtol=1e-3)
    # The comparison can fail: a tenth more pad is seen.
    other = replace(track, support=track.support.stiffer(1.1))
    found = np.abs(receptance(other, hz, [0.0])[0]) * 2 * np.pi * hz
    assert np.abs(found / published.mobility_m_per_ns - 1).max() > 1e-2
