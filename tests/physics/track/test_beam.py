from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness.oracles import chain_receptance, free_euler_beam_receptance, winkler_stiffness
from weld_force_ros.physics.track.beam import (
    Track,
    pinned_pinned_hz,
    receptance,
    sections,
    static_compliance,
    transfer_receptance,
)
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import track_file

BILBAO = track_file.load("bilbao").track
CONTINUOUS = track_file.load("bilbao-continuous").track
NIELSEN = track_file.load("johansson-nielsen").track
EULER_RAIL = replace(BILBAO.rail, shear_modulus_pa=BILBAO.rail.shear_modulus_pa * 1e6, loss_factor=0.0)

frequencies = st.floats(5.0, 3000.0)
places = st.floats(-2.5, 2.5)
every_track = pytest.mark.parametrize("track", [BILBAO, CONTINUOUS, NIELSEN], ids=lambda track: track.name)


def test_shear_stiff_continuous_track_is_a_winkler_beam():
    pad, ballast = (spring.stiffness_n_per_m for spring in BILBAO.support.springs)
    foundation = pad * ballast / (pad + ballast) / BILBAO.spacing_m
    bending = EULER_RAIL.youngs_modulus_pa * EULER_RAIL.second_moment_m4
    track = replace(CONTINUOUS, rail=EULER_RAIL)
    assert 1 / static_compliance(track, [0.0])[0] == pytest.approx(winkler_stiffness(bending, foundation), rel=1e-4)


@pytest.mark.parametrize("continuous", [True, False])
def test_rail_on_vanishing_support_is_a_free_infinite_beam(continuous: bool):
    rail = replace(EULER_RAIL, loss_factor=0.02)
    track = Track("free", rail, Support((Spring(1e-3, loss_factor=0.1),)), 0.6, continuous)
    distance = np.array([0.0, 0.2, 0.7, 1.9, -1.3])
    exact = free_euler_beam_receptance(rail, 2 * np.pi * 60.0, distance)
    found = transfer_receptance(track, [60.0], 0.25 + distance, 0.25)[:, 0]
    # What is left of the difference is rotary inertia.
    np.testing.assert_allclose(found, exact, atol=0.01 * abs(exact[0]))


@pytest.mark.parametrize("track", [BILBAO, NIELSEN], ids=lambda track: track.name)
@pytest.mark.parametrize("frequency", [5.0, 60.0, 250.0, 700.0, 1060.0, 2500.0])
def test_periodic_track_equals_its_dynamic_stiffness_matrix(track: Track, frequency: float):
    at = np.array([0.21, 0.0, 0.3, 0.6, 0.9, -1.3, 2.2, 0.05])
    exact = chain_receptance(track, frequency, at, 0.21)
    found = transfer_receptance(track, [frequency], at, 0.21)[:, 0]
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max())
    assert receptance(track, [frequency], [0.21])[0, 0] == pytest.approx(exact[0], rel=1e-6)


@every_track
@given(frequency=frequencies, here=places, there=places)
def test_force_and_response_may_change_places(track: Track, frequency: float, here: float, there: float):
    forth = transfer_receptance(track, [frequency], [here], there)[0, 0]
    back = transfer_receptance(track, [frequency], [there], here)[0, 0]
    assert abs(forth - back) <= 1e-9 * abs(receptance(track, [frequency], [here])[0, 0])


@every_track
@given(frequency=frequencies, here=places, there=places, spans=st.integers(-3, 3))
def test_response_repeats_with_the_span_and_mirrors_at_a_sleeper(
    track: Track, frequency: float, here: float, there: float, spans: int
):
    shift = spans * track.spacing_m
    first = transfer_receptance(track, [frequency], [here], there)[0, 0]
    size = 1e-7 * abs(receptance(track, [frequency], [here])[0, 0])
    assert abs(transfer_receptance(track, [frequency], [here + shift], there + shift)[0, 0] - first) <= size
    assert abs(transfer_receptance(track, [frequency], [-here], -there)[0, 0] - first) <= size


@every_track
@given(frequency=frequencies, at=places)
def test_track_never_gives_energy(track: Track, frequency: float, at: float):
    assert receptance(track, [frequency], [at])[0, 0].imag <= 0.0


@every_track
def test_static_compliance_is_the_undamped_limit(track: Track):
    exact = receptance(track.undamped(), [1.0], [0.0, 0.2])[:, 0]
    np.testing.assert_allclose(static_compliance(track, [0.0, 0.2]), exact.real, rtol=1e-3)


def test_rail_over_stiff_supports_resonates_at_the_pinned_pinned_frequency():
    rigid = Support((Spring(1e12, loss_factor=1e-3),))
    track = replace(NIELSEN, support=rigid, rail=replace(NIELSEN.rail, loss_factor=1e-4))
    frequency = np.arange(850.0, 1000.0, 0.5)
    response = np.abs(receptance(track, frequency, [track.spacing_m / 2])[0])
    assert frequency[response.argmax()] == pytest.approx(pinned_pinned_hz(track), abs=1.0)


def test_sections_divide_the_span_and_a_continuous_track_needs_one():
    np.testing.assert_allclose(sections(BILBAO, 4), [0.0, 0.15, 0.3, 0.45])
    np.testing.assert_array_equal(sections(CONTINUOUS, 4), [0.0])


def test_only_dashpots_in_both_layers_are_causal():
    assert NIELSEN.causal
    assert not BILBAO.causal
    lossy = Support((Spring(1e8, loss_factor=0.1), NIELSEN.support.springs[1]), NIELSEN.support.masses_kg)
    assert not replace(NIELSEN, support=lossy).causal
