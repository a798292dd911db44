"""A fitted track as the kernel steps it: linear states under a force that moves along the span.

For a force that is linear within each step, the states q under the moving contact obey exactly

    q[n+1] = E q[n] + a d[n] f[n] + b d[n+1] f[n+1],    z[n] = c[n] q[n],

with d and c the drive and shape at the contact. Without their newest force, s[n] = q[n] - b d[n] f[n], it becomes
s[n+1] = E s[n] + (E b + a) d[n] f[n] and z[n] = c[n] s[n] + gain[n] f[n]: one drive a step, and the compliance that the
contact meets within the step stands alone.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from weld_force_ros.core.track import Complex, Real


@dataclass(frozen=True)
class Propagation:
    """One step of the rail's states, for each grid point of a span that the contact may stand on.

    Attributes:
        decay: (2, n_state // 2), real and imaginary part of E for states in pairs (re, im); unused if dense.
        transitions: (n_grid, n_state, n_state), E from each grid point to the next; (0, ...) where `decay` serves.
        drives: (n_grid, n_state), (E b + a) d.
        shapes: (n_grid, n_state), c.
        gains: (n_grid,), m/N, c b d.
        at_rest: (n_state,), s under a unit load that rests on the first grid point.
    """

    decay: Real
    transitions: Real
    drives: Real
    shapes: Real
    gains: Real
    at_rest: Real


class StateModel(Protocol):
    """A fitted track that can be stepped."""

    @property
    def spacing_m(self) -> float:
        """The span that it repeats with."""

    def propagation(self, at_m: Real, dt_s: float) -> Propagation:
        """A step of `dt_s` from each point of `at_m` (n_grid,), which covers a span once, to the next."""


def first_order_hold(poles: Complex, dt_s: float) -> tuple[Complex, Complex, Complex]:
    """E, a and b of q' = p q + f for f linear within a step, each of the shape of `poles`.

    E = exp(z), a = dt (phi1 - phi2), b = dt phi2 with phi1 = (E - 1) / z, phi2 = (E - 1 - z) / z^2, z = p dt.
    """
    z = poles * dt_s
    # By their series where the difference would cancel.
    small = np.abs(z) < 0.05
    safe = np.where(small, 1.0, z)
    phi1 = np.where(small, 1 + z / 2 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6)))), np.expm1(safe) / safe)
    phi2 = np.where(
        small,
        0.5 * (1 + z / 3 * (1 + z / 4 * (1 + z / 5 * (1 + z / 6 * (1 + z / 7))))),
        (np.expm1(safe) - safe) / safe**2,
    )
    return np.exp(z), dt_s * (phi1 - phi2), dt_s * phi2
