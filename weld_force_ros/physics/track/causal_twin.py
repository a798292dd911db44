"""Find the causal track nearest to one with loss factors, which answers before it is pushed.

Loss that follows from a stiffness which rises with frequency is causal. A chain of Maxwell elements beside a spring,
k (1 + sum_j g_j i w / (w_j + i w)) with g_j >= 0, is that and passive as well, and as general as relaxation is (Ferry,
"Viscoelastic Properties of Polymers", 1980, ch. 3). The g_j of all layers are found together by least squares, so that
the receptance comes as near to the given one as the contact sees it. A loss factor that is the same at all frequencies
would ask of the ballast a stiffness that doubles with every few octaves; the nearest track gives up some of either.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.support import Spring, TabulatedSpring

BAND_HZ = (5.0, 2500.0)
_FREQUENCIES, _SECTIONS = 200, 5
_RELAXATIONS_HZ = np.geomspace(3.0, 6000.0, 8)
_TABLE_HZ = np.geomspace(0.1, 2e4, 81)
_LOG_START, _LOG_BOUNDS = -2.0, (-9.0, 5.0)  # of the g_j
_MOST_STEPS = 60


@dataclass(frozen=True)
class CausalTwin:
    """The causal track nearest to another.

    Attributes:
        track: with tables over frequency in place of the springs that were not causal.
        frequency_hz: (n,), of the comparison.
        difference: (n,), RMS over the span of |h - h of the other| / |h of the other + c|, with c the compliance of
            contact and wheel: about the relative difference of the forces that an irregularity makes.
    """

    track: Track
    frequency_hz: FloatArray
    difference: FloatArray


def causal_twin(
    track: Track, contact_compliance: Callable[[FloatArray], ComplexArray], *, at_hz: float = 0.0
) -> CausalTwin:
    """Find the causal track nearest to one with loss factors.

    Args:
        track: on a rail that is a beam.
        contact_compliance: c(omega), m/N.
        at_hz: where the springs' stiffness stays what it is; at rest, so that the rail sinks as far under a train.

    Raises:
        NumericalError: nothing finite was found.
    """
    frequency = np.linspace(np.sqrt(BAND_HZ[0]), np.sqrt(BAND_HZ[1]), _FREQUENCIES) ** 2
    at_m = np.linspace(0.0, track.spacing_m / 2, 1 if track.continuous else _SECTIONS)
    exact = beam.receptance(track, frequency, at_m)
    seen = np.abs(exact + contact_compliance(2 * np.pi * frequency))
    replaced = [number for number, spring in enumerate(track.support.springs) if not spring.causal]

    def twin(logs: FloatArray) -> Track:
        springs = list(track.support.springs)
        for number, strengths in zip(replaced, np.exp(logs).reshape(-1, len(_RELAXATIONS_HZ)), strict=True):
            springs[number] = _relaxing(springs[number], strengths, at_hz)
        return replace(track, support=replace(track.support, springs=tuple(springs)))

    def differences(logs: FloatArray) -> FloatArray:
        off = (beam.receptance(twin(logs), frequency, at_m) - exact) / seen
        return np.concatenate([off.real.ravel(), off.imag.ravel()])

    start = np.full(len(replaced) * len(_RELAXATIONS_HZ), _LOG_START)
    found = least_squares(differences, start, bounds=_LOG_BOUNDS, max_nfev=_MOST_STEPS) if replaced else None
    if found is not None and not np.isfinite(found.cost):
        raise NumericalError("no causal track was found near this one; check its numbers")
    best = start if found is None else found.x
    off = differences(best).reshape(2, len(at_m), -1)
    return CausalTwin(twin(best), frequency, np.sqrt(np.mean(off[0] ** 2 + off[1] ** 2, axis=0)))


def _relaxing(spring: Spring | TabulatedSpring, strengths: FloatArray, at_hz: float) -> TabulatedSpring:
    """Return a spring with Maxwell elements, whose stiffness at a frequency is that of another."""
    like = spring.undamped().stiffness_n_per_m
    if at_hz > 0:
        like = float(spring.dynamic_stiffness(np.array([2 * np.pi * at_hz])).real[0])
    elastic = like / float(_chain(np.array([at_hz]), strengths).real[0])
    stiffness = elastic * _chain(_TABLE_HZ, strengths)
    rows = zip(_TABLE_HZ.tolist(), stiffness.real.tolist(), (stiffness.imag / stiffness.real).tolist(), strict=True)
    return TabulatedSpring(tuple(rows))


def _chain(frequency_hz: FloatArray, strengths: FloatArray) -> ComplexArray:
    turned = 1j * frequency_hz[:, None] / _RELAXATIONS_HZ
    return np.asarray(1 + (turned / (1 + turned)) @ strengths)
