"""Supports that differ, against a rail on many springs solved as one system, and limits known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from weld_force_ros.physics.track import beam, local_support
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.simulation import track_file

TRACK = track_file.load("bilbao-viscous").track
FREQUENCY_HZ = np.array([12.0, 60.0, 130.0, 400.0, 900.0])
AT_M, FORCE_AT_M = np.array([-0.7, 0.1, 0.3, 0.9]), np.array([0.45, 0.1, -0.2, 2.0])
CHANGES = [SupportChange(0, below=0.02), SupportChange(1, pad=0.0), SupportChange(3, below=4.0, pad=0.5)]


def as_one_system(track: Track, changes: list[SupportChange], many: int = 90) -> np.ndarray:
    """Return the receptance (n_at, n_frequency) of a free rail on finitely many springs, by their reactions."""
    omega = 2 * np.pi * FREQUENCY_HZ
    waves = beam._RailWaves(track.rail, omega, track.spacing_m)

    def free(x: np.ndarray) -> np.ndarray:
        return np.einsum("jf,jxyf->xyf", waves.strength, np.exp(-waves.decay[:, None, None] * np.abs(x)[..., None]))

    sleepers = np.arange(-many, many + 1)
    own_pad, ballast = (spring.dynamic_stiffness(omega) for spring in track.support.springs)
    inertia = track.support.masses_kg[0] * omega**2
    stiffness = np.tile(own_pad * (ballast - inertia) / (own_pad + ballast - inertia), (len(sleepers), 1))
    for change in changes:
        pad, below = change.pad * own_pad, change.below * ballast - inertia
        stiffness[change.sleeper + many] = pad * below / (pad + below)
    places = sleepers * track.spacing_m
    own, driven = free(places[:, None] - places), free(places[:, None] - FORCE_AT_M)
    seen, direct = free(AT_M[:, None] - places), free((AT_M - FORCE_AT_M)[:, None])[:, 0]
    found = np.empty((len(AT_M), len(omega)), dtype=np.complex128)
    for f in range(len(omega)):
        system = np.eye(len(places)) + own[..., f] * stiffness[:, f]
        moved = np.linalg.solve(system, driven[..., f])
        found[:, f] = direct[:, f] - np.einsum("ax,x,xa->a", seen[..., f], stiffness[:, f], moved)
    return found


@pytest.mark.parametrize("changes", [CHANGES[:1], CHANGES[1:2], CHANGES])
def test_transfer_receptance_is_that_of_a_rail_on_many_springs(changes):
    found = local_support.transfer_receptance(TRACK, LocalSupports.of(changes), FREQUENCY_HZ, AT_M, FORCE_AT_M)
    np.testing.assert_allclose(found, as_one_system(TRACK, changes), rtol=1e-6)


@settings(max_examples=25, deadline=None)
@given(
    sleepers=st.sets(st.integers(-4, 5), min_size=1, max_size=4),
    below=st.floats(0.0, 5.0),
    pad=st.floats(0.01, 5.0),
    at_m=st.floats(-2.0, 2.0),
    force_at_m=st.floats(-2.0, 2.0),
)
def test_a_force_and_a_place_can_be_exchanged(sleepers, below, pad, at_m, force_at_m):
    supports = LocalSupports.of(SupportChange(sleeper, below, pad) for sleeper in sleepers)
    there = local_support.transfer_receptance(TRACK, supports, FREQUENCY_HZ, at_m, force_at_m)
    back = local_support.transfer_receptance(TRACK, supports, FREQUENCY_HZ, force_at_m, at_m)
    np.testing.assert_allclose(there, back, rtol=1e-8)
    point = local_support.receptance(TRACK, supports, FREQUENCY_HZ, at_m)
    assert np.all(point.imag < 0), "a track takes energy from a force on it, and gives none"


def test_supports_that_are_as_usual_change_nothing():
    supports = LocalSupports.of(SupportChange(sleeper) for sleeper in (-1, 0, 2))
    found = local_support.receptance(TRACK, supports, FREQUENCY_HZ, AT_M)
    np.testing.assert_allclose(found, beam.receptance(TRACK, FREQUENCY_HZ, AT_M), rtol=1e-12)


def test_a_share_that_tends_to_zero_tends_to_a_sleeper_that_hangs_free():
    free = local_support.receptance(TRACK, LocalSupports.of([SupportChange(0, below=0.0)]), FREQUENCY_HZ, AT_M)
    errors = [
        np.abs(local_support.receptance(TRACK, LocalSupports.of([SupportChange(0, share)]), FREQUENCY_HZ, AT_M) - free)
        for share in (1e-2, 1e-4)
    ]
    np.testing.assert_allclose(errors[1], errors[0] / 100, rtol=0.05)


def test_at_rest_a_missing_support_is_made_up_for_by_its_neighbours():
    """Statics of the rail as a beam on springs: reactions of all supports carry the load, whichever are there."""
    supports = LocalSupports.of([SupportChange(0, pad=0.0)])
    softer = local_support.static_compliance(TRACK, supports, [0.0])[0]
    usual = beam.static_compliance(TRACK, [0.0])[0]
    rigid = TRACK.undamped().support.dynamic_stiffness(beam.STATIC_OMEGA)[0].real
    # The change by one spring taken away, from the deflection there alone: h / (1 - k h).
    assert softer == pytest.approx(usual / (1 - rigid * usual), rel=1e-6)


def test_against_rising_x_sleeper_1_is_the_last_before_the_weld():
    mirrored = LocalSupports.of([SupportChange(0, 0.1), SupportChange(2, 0.5, 2.0)]).mirrored
    assert mirrored.changes == (SupportChange(-1, 0.5, 2.0), SupportChange(1, 0.1))
