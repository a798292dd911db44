"""The causal track nearest to one with loss factors: causal by its impulse response, passive, as stiff, and near."""

import numpy as np
import pytest

from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.causal_twin import causal_twin
from weld_force_ros.physics.track.causality import acausal
from weld_force_ros.simulation import track_file

BILBAO = track_file.load("bilbao")
OMEGA = 2 * np.pi * np.geomspace(0.5, 1e4, 200)


@pytest.fixture(scope="module")
def twin():
    return causal_twin(BILBAO.track, BILBAO.wheel.compliance)


def test_it_answers_after_the_impulse(twin):
    before, after = (acausal(track, 0.3).energy_share for track in (BILBAO.track, twin.track))
    assert before > 0.02
    assert after < 1e-4
    assert twin.track.causal


def test_it_gains_no_energy_and_sinks_as_far_at_rest(twin):
    for spring in twin.track.support.springs:
        stiffness = spring.dynamic_stiffness(OMEGA)
        assert np.all(stiffness.imag > 0)
        assert np.all(np.diff(stiffness.real) > 0)  # loss makes stiffness rise
    rest = [beam.static_compliance(track, 0.3)[0] for track in (BILBAO.track, twin.track)]
    assert rest[1] == pytest.approx(rest[0], rel=1e-5)


def test_its_difference_is_that_of_the_receptances_and_less_than_dashpots_make(twin):
    at = np.linspace(0.0, 0.3, 5)
    exact = beam.receptance(BILBAO.track, twin.frequency_hz, at)
    seen = np.abs(exact + BILBAO.wheel.compliance(2 * np.pi * twin.frequency_hz))

    def rms(track: beam.Track) -> np.ndarray:
        off = np.abs(beam.receptance(track, twin.frequency_hz, at) - exact) / seen
        return np.asarray(np.sqrt(np.mean(off**2, axis=0)))

    np.testing.assert_allclose(twin.difference, rms(twin.track), rtol=1e-6)
    viscous = track_file.load("bilbao-viscous").track  # dashpots that lose as much at the track's resonances
    assert np.mean(twin.difference**2) < 0.5 * np.mean(rms(viscous) ** 2)


def test_stiffness_stays_where_it_is_asked_to():
    found = causal_twin(BILBAO.track, BILBAO.wheel.compliance, at_hz=100.0)
    for old, new in zip(BILBAO.track.support.springs, found.track.support.springs, strict=True):
        at_100 = new.dynamic_stiffness(np.array([200 * np.pi]))[0]
        assert at_100.real == pytest.approx(old.stiffness_n_per_m, rel=1e-3)  # between rows of the table


def test_a_causal_track_is_its_own_twin():
    viscous = track_file.load("bilbao-viscous")
    found = causal_twin(viscous.track, viscous.wheel.compliance)
    assert found.track == viscous.track
    assert found.difference.max() == 0.0
