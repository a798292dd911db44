"""Waves of a rail on discrete supports, from those of the free rail: a periodic structure of several coupled waves.

A pad of some width is a row of springs on a sleeper that does not rotate, and so resists the rail's rotation. A support
scatters waves: what arrives, right- and left-going amplitudes a and b, drives reactions r of its
springs, and these send waves out. From one support to the next a wave decays by exp(-kappa span), so that Floquet waves
are the solutions of

    lambda (A - S_rl E B) = S_rr E A,    lambda S_ll E B = B - S_lr E A,

with A what leaves a support and B what leaves the next one backwards. No term grows, however fast a wave decays.

Waves that die out within a span do not couple supports. They make the foot softer where it is held, add to the shapes
of Floquet waves near the supports and to the response near the force.
"""

import numpy as np
import scipy  # loads its slow parts, such as linalg, where they are first used

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track.waveguide_rail import COUPLED, FreeWaves

_SPRINGS = 4  # of a pad


class SupportedWaves:
    """See `weld_force_ros.physics.track.beam.Waves`: Floquet waves first, then those that end near the force.

    Args:
        free: waves of the free rail.
        span_m: from support to support.
        pad: (n_frequency,), dynamic stiffness of a pad, N/m.
        below: (n_frequency,), of what is beneath it.
        pad_width_m: along the rail.
    """

    def __init__(
        self, free: FreeWaves, span_m: float, pad: ComplexArray, below: ComplexArray, pad_width_m: float
    ) -> None:
        self.span_m, self._free = span_m, free
        places, shares = np.polynomial.legendre.leggauss(_SPRINGS if pad_width_m else 1)
        self._places = places * pad_width_m / 2
        self._reaction = self._reactions(pad, below, shares / 2)
        near = free.decay[:COUPLED]
        found = [self._floquet(n) for n in range(free.decay.shape[1])]
        self._ahead, self._back, floquet = (np.stack(parts, axis=-1) for parts in zip(*found, strict=True))
        # (n_near, n_floquet, n_frequency) amplitudes: leaving a support, and coming back from the next one
        reach = np.exp(-near * span_m)[:, None]
        between = (free.norm[:COUPLED, None] * reach * (self._ahead**2 - self._back**2)).sum(axis=0)
        self.multiplier: ComplexArray = np.concatenate([floquet, np.exp(-free.decay[COUPLED:] * span_m)])
        self.strength: ComplexArray = np.concatenate([floquet / between, 1 / free.norm[COUPLED:]])

    def _reactions(self, pad: ComplexArray, below: ComplexArray, shares: FloatArray) -> ComplexArray:
        """Return the reactions (n_place, n_place, n_frequency) of springs to the foot's motion without them."""
        one = np.eye(len(shares))
        together = np.outer(shares, shares)
        stiffness = pad * (one * shares)[..., None] - pad**2 / (pad + below) * together[..., None]
        own = self._free.foot_foot(np.abs(self._places[:, None] - self._places))
        k, g = np.moveaxis(stiffness, -1, 0), np.moveaxis(own, -1, 0)
        return np.moveaxis(np.linalg.solve(one + k @ g, k), 0, -1)

    def _floquet(self, n: int) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return amplitudes (n_near, n_floquet) ahead and back, and multipliers (n_floquet,), at one frequency."""
        decay, foot, norm = (array[:COUPLED, n] for array in (self._free.decay, self._free.foot, self._free.norm))
        reach = np.exp(-decay * self.span_m)
        lags, leads = (np.exp(sign * decay[:, None] * self._places) for sign in (-1, 1))
        one = np.eye(len(decay))

        def scattered(out: ComplexArray, arriving: ComplexArray) -> ComplexArray:
            return np.asarray((foot / norm)[:, None] * (out @ self._reaction[..., n] @ arriving.T) * foot * reach)

        zero = np.zeros_like(one)
        right = one * reach - scattered(leads, lags), scattered(leads, leads)
        left = scattered(lags, lags), one * reach - scattered(lags, leads)
        # Amplitudes count where they leave: ahead from a support, back from the next one.
        values, vectors = scipy.linalg.eig(
            np.block([[right[0], zero], [left[0], one]]), np.block([[one, right[1]], [zero, left[1]]])
        )
        size = np.where(np.isfinite(values), np.abs(values), np.inf)
        chosen = np.argsort(size)[: len(decay)]
        vectors = vectors[:, chosen]
        return vectors[: len(decay)], vectors[len(decay) :], values[chosen]

    def shape(self, x_m: FloatArray) -> ComplexArray:
        """Return the the waves that decay towards +x: (n_wave, n_x, n_frequency)."""
        free = self._free
        span = np.rint(x_m / self.span_m)
        x = x_m - span * self.span_m  # from the nearest support
        floquet = self.multiplier[:COUPLED]
        decay, foot = free.decay[:COUPLED, None], free.foot[:COUPLED, None]
        reach = np.exp(-decay * self.span_m)
        arriving = reach * self._ahead / floquet, reach * self._back  # (n_near, n_floquet, n_frequency)
        held = self._places[:, None, None, None]
        motion = (foot * (arriving[0] * np.exp(-decay * held) + arriving[1] * np.exp(decay * held))).sum(axis=1)
        reaction = -np.einsum("pqf,qif->pif", self._reaction, motion)  # (n_place, n_floquet, n_frequency)
        shapes = np.zeros((COUPLED, len(x), floquet.shape[1]), dtype=np.complex128)
        for m in range(COUPLED):
            turned = free.decay[m] * x[:, None]
            shapes += arriving[0][m][:, None] * (free.head[m] * np.exp(-turned))
            shapes += arriving[1][m][:, None] * (free.head[m] * np.exp(turned))
        for place, force in zip(self._places, reaction, strict=True):
            shapes += force[:, None] * free.head_foot(np.abs(x - place))
        shapes *= floquet[:, None] ** span[None, :, None]
        return np.concatenate([shapes, _shapes(free.head[COUPLED:], free.decay[COUPLED:], x_m)])


class WavesAlong:
    """Waves of a rail on a foundation: see `weld_force_ros.physics.track.beam.Waves`."""

    def __init__(self, free: FreeWaves, span_m: float) -> None:
        self.span_m, self._free = span_m, free
        self.strength: ComplexArray = 1 / free.norm
        self.multiplier: ComplexArray = np.exp(-free.decay * span_m)

    def shape(self, x_m: FloatArray) -> ComplexArray:
        """Return the the waves that decay towards +x: (n_wave, n_x, n_frequency)."""
        return _shapes(self._free.head, self._free.decay, x_m)


def _shapes(head: ComplexArray, decay: ComplexArray, x_m: FloatArray) -> ComplexArray:
    return np.asarray(head[:, None] * np.exp(-decay[:, None] * x_m[:, None]))
