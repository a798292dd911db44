"""Common poles that change with speed: the `common-poles` engine where point receptances do not say enough.

A contact that moves on finds, t after it pushed at x', the track's response at x' + v t. Here that is

    h(x' + v t, x'; t) = sum_k a_k(v) phi_k(x' + v t) phi_k(x') exp(p_k(v) t),

with shapes phi_k along the rail that do not change with speed. Poles do: a wave that runs with the contact is heard at
another frequency (Doppler), and one that leaves it dies out earlier. Logarithm of the decay, frequency and strength
a_k change with the square of speed, as the track looks alike in both directions. Decays are positive at every speed.

A shape need not repeat with the span: the standing wave between sleepers (pinned-pinned) has opposite signs in spans
that are neighbours. The point receptance, which has its square, does not show that.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.common_poles import in_pairs
from weld_force_ros.physics.passage.state_space import Propagation, first_order_hold

SPEED_M_S = 350 / 3.6
"""At which the changes with speed are stated, and up to which they are fitted."""


class Symmetry(IntEnum):
    """How a shape continues beyond a sleeper and beyond mid-span; by symmetry of the track there is nothing else."""

    ALIKE = 0
    """Even about both: repeats with every span."""
    NODE_AT_SLEEPERS = 1
    """Odd about sleepers, even about mid-span: opposite signs in neighbouring spans."""
    NODE_AT_MID_SPAN = 2
    """Even about sleepers, odd about mid-span: likewise."""


@dataclass(frozen=True)
class MovingPoleModel:
    """A periodic track as common poles that change with speed.

    Attributes:
        rates: (n,), ln(decay) + i frequency, decay in 1/s and frequency in rad/s, at rest; frequency 0 is a real pole.
        rate_changes: (n,), by how much they differ at `SPEED_M_S`.
        strengths: (n,), at rest; 1, or -1 for real poles.
        strength_changes: (n,), by how much they differ at `SPEED_M_S`.
        series: (n, n_term), coefficients of the shapes, in cosines (sines for nodes at sleepers) along the rail.
        symmetries: (n,), of `Symmetry`.
        spacing_m: from sleeper to sleeper.
    """

    rates: ComplexArray
    rate_changes: ComplexArray
    strengths: FloatArray
    strength_changes: ComplexArray
    series: ComplexArray
    symmetries: NDArray[np.intp]
    spacing_m: float
    _grids: dict[bytes, FloatArray] = field(default_factory=dict, repr=False, compare=False)

    @property
    def order(self) -> int:
        """Return the number of states: two for a conjugate pair, one for a real pole."""
        return int(np.sum(np.where(self.real, 1, 2)))

    @property
    def real(self) -> NDArray[np.bool_]:
        """Return which poles are real, (n,)."""
        return np.asarray(self.rates.imag == 0)

    @property
    def pair_weight(self) -> FloatArray:
        """Return 2 for a pole of a conjugate pair, 1 for a real one, (n,)."""
        return np.where(self.real, 1.0, 2.0)

    @property
    def spans(self) -> int:
        """Return the number of spans that shapes repeat with."""
        return 2 if np.any(self.symmetries != Symmetry.ALIKE) else 1

    @property
    def uniform(self) -> bool:
        """Return that all supports are alike."""
        return True

    @property
    def opposite_m(self) -> float:
        """Return what a place x is met at against rising x, plus x."""
        return self.spacing_m

    def poles_at(self, speed_m_s: float) -> ComplexArray:
        """Return the poles at a speed, rad/s, (n,)."""
        rates = self.rates + (speed_m_s / SPEED_M_S) ** 2 * self.rate_changes
        return np.asarray(-np.exp(rates.real) + 1j * rates.imag)

    def strengths_at(self, speed_m_s: float) -> ComplexArray:
        """Return the strengths at a speed, (n,)."""
        return np.asarray(self.strengths + (speed_m_s / SPEED_M_S) ** 2 * self.strength_changes)

    def wavenumbers(self, pole: int) -> FloatArray:
        """Return those of the terms of a pole's shape, rad/m, (n_term,)."""
        first = 0 if self.symmetries[pole] == Symmetry.ALIKE else 1
        return np.pi / self.spacing_m * (first + 2 * np.arange(self.series.shape[1]))

    def terms_at(self, pole: int, at_m: FloatArray) -> FloatArray:
        """Return the terms of a pole's shape, (n_at, n_term)."""
        phase = np.outer(at_m, self.wavenumbers(pole))
        return np.sin(phase) if self.symmetries[pole] == Symmetry.NODE_AT_SLEEPERS else np.cos(phase)

    def shapes_at(self, at_m: ArrayLike) -> ComplexArray:
        """Return the shapes, (n_at, n)."""
        at = np.atleast_1d(np.asarray(at_m, dtype=np.float64))
        return np.stack([self.terms_at(k, at) @ series for k, series in enumerate(self.series)], axis=1)

    def propagation(self, at_m: FloatArray, dt_s: float) -> Propagation:
        """Return a step of `dt_s` of the states q_k' = p_k q_k + phi_k f; see `physics.passage.state_space`."""
        speed = (at_m[1] - at_m[0]) / dt_s
        poles, strengths = self.poles_at(speed), self.strengths_at(speed)
        decay, old, new = first_order_hold(poles, dt_s)
        within = decay * new + old
        key = at_m.tobytes()
        if key not in self._grids:
            self._grids[key] = in_pairs(np.sqrt(self.pair_weight) * self.shapes_at(at_m))
        drives = self._grids[key]
        shapes = drives[:, ::2] + 1j * drives[:, 1::2]
        scale = strengths * within
        return Propagation(
            decay=np.stack([decay.real, decay.imag]),
            input_scale=np.stack([scale.real, scale.imag]),
            transitions=np.empty((0, 2 * len(decay), 2 * len(decay))),
            drives=drives,
            shapes=in_pairs((shapes * scale).conj()),
            gains=(strengths * shapes**2 * new).real.sum(axis=1),
            at_rest=in_pairs(-shapes[0] * (1 / poles + new) / within),
        )

    def receptance(self, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray:
        """Return the fitted point receptance, m/N, (n_at, n_frequency)."""
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        poles, residues = self.poles_at(0.0), 0.5 * self.pair_weight * self.strengths * self.shapes_at(at_m) ** 2
        return np.asarray(residues @ (1 / (s - poles[:, None])) + residues.conj() @ (1 / (s - poles.conj()[:, None])))

    def static_compliance(self, at_m: ArrayLike) -> FloatArray:
        """Return the deflection under a resting unit load, m/N, (n_at,)."""
        residues = self.strengths * self.shapes_at(at_m) ** 2
        return np.asarray((residues / -self.poles_at(0.0)).real @ self.pair_weight)
