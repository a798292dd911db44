"""Layers found from receptances whose layers are known, with noise and without."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.track.beam import Track, receptance
from weld_force_ros.physics.track.identification import (
    Damping,
    Identified,
    MeasuredReceptance,
    deviation,
    identify,
    misfit,
)
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import track_file

TRACK = track_file.load("bilbao-viscous").track
HZ = np.arange(30.0, 1500.0, 6.0)
BOTH = np.array([0.0, 0.5])


def measured(track: Track, noise: float = 0.0, seed: int = 0, at_spans: np.ndarray = BOTH) -> MeasuredReceptance:
    exact = receptance(track, HZ, track.spacing_m * at_spans)
    random = np.random.default_rng(seed).normal(size=(2, *exact.shape)) * noise / np.sqrt(2)
    return MeasuredReceptance(HZ, at_spans, exact * (1 + random[0] + 1j * random[1]))


def found(data: MeasuredReceptance, damping: Damping = "dashpot", find_sleeper: bool = True) -> Identified:
    return identify(
        data, TRACK.rail, TRACK.spacing_m, half_sleeper_kg=150.0, find_sleeper=find_sleeper, damping=damping
    )


@settings(max_examples=15, deadline=None)
@given(
    st.floats(60e6, 1200e6), st.floats(20e6, 300e6), st.floats(0.1, 0.5), st.floats(0.3, 1.2), st.floats(100, 200),
    st.sampled_from(["dashpot", "loss-factor"]), st.sampled_from([(0.0,), (0.5,), (0.0, 0.5)]),
)  # fmt: skip
def test_layers_of_an_exact_receptance_are_found(
    pad: float, ballast: float, pad_loss: float, ballast_loss: float, mass: float, damping: Damping,
    at_spans: tuple[float, ...],
):  # fmt: skip
    if damping == "dashpot":
        springs = (
            Spring(pad, 0.0, pad_loss * pad / (2 * np.pi * 500)),
            Spring(ballast, 0.0, ballast_loss * ballast / (2 * np.pi * 100)),
        )
    else:
        springs = (Spring(pad, pad_loss), Spring(ballast, ballast_loss))
    track = replace(TRACK, support=Support(springs, (mass,)))
    own = found(measured(track, at_spans=np.array(at_spans)), damping).track.support
    assert own.masses_kg[0] == pytest.approx(mass, rel=1e-4)
    for one, true in zip(own.springs, springs, strict=True):
        assert one.stiffness_n_per_m == pytest.approx(true.stiffness_n_per_m, rel=1e-4)
        assert one.loss_factor == pytest.approx(true.loss_factor, rel=1e-4)
        assert one.damping_ns_per_m == pytest.approx(true.damping_ns_per_m, rel=1e-4)


def test_standard_errors_are_how_far_estimates_scatter():
    true = [348.6e6, 50e6, 30.5e3, 106e3, 162.0]
    assert TRACK.support.springs == (Spring(true[0], 0.0, true[2]), Spring(true[1], 0.0, true[3]))
    off = []
    for seed in range(40):
        estimates = found(measured(TRACK, 0.1, seed)).estimates
        off.append([np.log(e.value / t) / e.standard_error for e, t in zip(estimates, true, strict=True)])
    scatter = np.sqrt(np.mean(np.square(off), axis=0))  # of 40 normal numbers: 0.78 to 1.22 in 19 of 20
    assert np.all((scatter > 0.7) & (scatter < 1.35))


def test_scatter_and_misfit_are_the_noise():
    data = measured(TRACK, 0.05)
    own = found(data)
    assert own.scatter == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(misfit(data, own.track), 0.05, rtol=0.1)
    np.testing.assert_allclose(np.exp(deviation(data, own.track)), 1, atol=0.3)
    assert np.isnan(misfit(data.within(1.0, 2.0), own.track)).all()


def test_what_a_measurement_does_not_tell_is_said():
    high = measured(TRACK, 0.05).within(900.0, 1500.0)  # above all that ballast does
    own = {one.name: one for one in found(high, find_sleeper=False).estimates}
    assert own["pad_n_per_m"].standard_error < 0.05
    ballast = own["ballast_n_per_m"]
    assert ballast.at_bound or ballast.standard_error > 0.3


def test_too_few_values_are_refused():
    with pytest.raises(NumericalError, match="cannot tell 5 parameters"):
        found(measured(TRACK, at_spans=np.array([0.0])).within(30.0, 37.0))
