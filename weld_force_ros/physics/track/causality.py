"""How much of a receptance no model in time can reproduce.

A loss factor makes stiffness complex at every frequency alike; the impulse response of such a track begins before the
impulse. A model in time answers afterwards only. What lies before is measured here: its share of the energy, and the
error that leaving it out makes in the receptance.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.cubics import spline
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import StripRail, Track

_STEP_HZ = 1.0
_EVERY = 4
_BAND_HZ = 12_000.0
_JUMP_DECAY_RAD_S = 2 * np.pi * 1000.0


@dataclass(frozen=True)
class Acausal:
    """The part of a response that precedes the impulse, at one point of the rail.

    Attributes:
        energy_share: of the impulse response's energy, at negative time.
        frequency_hz: (n,).
        exact: (n,), the receptance, m/N.
        causal: (n,), the receptance of the response cut at the impulse, m/N.
    """

    energy_share: float
    frequency_hz: FloatArray
    exact: ComplexArray
    causal: ComplexArray

    def floor(self, contact_compliance: Callable[[FloatArray], ComplexArray], band_hz: tuple[float, float]) -> float:
        """Return the RMS over a band of |causal - exact| / |exact + c|: about the error floor of models in time.

        Not a strict bound: a model may distribute the same error otherwise over frequency.
        """
        inside = (self.frequency_hz >= band_hz[0]) & (self.frequency_hz <= band_hz[1])
        seen = self.exact + contact_compliance(2 * np.pi * self.frequency_hz)
        # Equal weight per octave, as the errors of the fits have it.
        weight = inside / self.frequency_hz
        return float(np.sqrt(np.sum(weight * np.abs((self.causal - self.exact) / seen) ** 2) / np.sum(weight)))


def _receptance(track: Track, frequency: FloatArray, at_m: float, threads: int | None) -> ComplexArray:
    """Return the point receptance (n,); by strips, milliseconds a frequency, interpolated between every few."""
    if not isinstance(track.rail, StripRail):
        return np.asarray(beam.receptance(track, frequency, at_m)[0])
    knots = np.append(frequency[::_EVERY], frequency[-1])
    return np.asarray(spline(knots, beam.receptance(track, knots, at_m, threads=threads)[0])(frequency))


def acausal(track: Track, at_m: float, *, threads: int | None = None) -> Acausal:
    """Split the point receptance at `at_m` metres after a sleeper at the impulse; `threads` as of `beam.waves`."""
    frequency = _STEP_HZ * np.arange(int(_BAND_HZ / _STEP_HZ) + 1)
    exact = np.append(beam.static_compliance(track, at_m) + 0j, _receptance(track, frequency[1:], at_m, threads))
    # The jump of the rail's velocity under a force falls as 1 / omega only: exactly causal, it stays out of the cut.
    jump = beam.velocity_jump(track.rail) / (2j * np.pi * frequency + _JUMP_DECAY_RAD_S)
    taper = 0.5 + 0.5 * np.cos(np.pi * np.clip(5 * frequency / _BAND_HZ - 4, 0.0, 1.0))
    response = np.fft.irfft(taper * (exact - jump))
    before = response[len(response) // 2 :].copy()
    response[len(response) // 2 :] = 0.0
    causal = np.fft.rfft(response) + jump
    share = float(np.sum(before**2) / np.sum(np.fft.irfft(taper * exact) ** 2))
    used = (frequency > 0.0) & (frequency < 0.5 * _BAND_HZ)
    return Acausal(share, frequency[used], exact[used], causal[used])
