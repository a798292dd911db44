"""A fitted track as the compiled passages step it: linear states under a force that moves along the span.

For a force that is linear within each step, the states q under the moving contact obey exactly

    q[n+1] = E q[n] + a d[n] f[n] + b d[n+1] f[n+1],    z[n] = c[n] q[n],

with d and c the drive and shape at the contact. Without their newest force, s[n] = q[n] - b d[n] f[n], it becomes
s[n+1] = E s[n] + (E b + a) d[n] f[n] and z[n] = c[n] s[n] + gain[n] f[n]: one drive a step, and the compliance that the
contact meets within the step stands alone. Where E is diagonal, s is scaled by E b + a as well, so that the drives are
the same for every step length and speed.
"""

from typing import NamedTuple, Protocol

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray


class Propagation(NamedTuple):
    """One step of the rail's states, for each grid point of a period that the contact may stand on.

    Attributes:
        decay: (2, n_state // 2), real and imaginary part of E for states in pairs (re, im); unused if dense.
        transitions: (n_grid, n_state, n_state), E from each grid point to the next; (0, ...) where `decay` serves.
        input_scale: as `decay`, E b + a of states that are scaled by it; unused if dense.
        drives: (n_grid, n_state), (E b + a) d, or d of states that are scaled.
        shapes: (n_grid, n_state), c, or c (E b + a) of states that are scaled.
        gains: (n_grid,), m/N, c b d.
        at_rest: (n_state,), s under a unit load that rests on the first grid point.
    """

    decay: FloatArray
    input_scale: FloatArray
    transitions: FloatArray
    drives: FloatArray
    shapes: FloatArray
    gains: FloatArray
    at_rest: FloatArray


class StateModel(Protocol):
    """A fitted track that can be stepped."""

    @property
    def spacing_m(self) -> float:
        """Return the sleeper spacing."""

    @property
    def spans(self) -> int:
        """Return the number of spans that it repeats with."""

    @property
    def uniform(self) -> bool:
        """Return whether all supports are alike, so that the rail is the same in every span."""

    @property
    def opposite_m(self) -> float:
        """Return what a place x is met at against rising x, plus x."""

    def propagation(self, at_m: FloatArray, dt_s: float) -> Propagation:
        """Return a step of `dt_s` from each point of `at_m` (n_grid,), which covers a period once, to the next."""


def first_order_hold(poles: ComplexArray, dt_s: float | FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return E, a and b of q' = p q + f for f linear within a step, each shaped as `poles` (with `dt_s`).

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


def exponentials(matrices: FloatArray) -> FloatArray:
    """Return the exponentials of many small matrices, (n, m, m): Taylor series of degree 13, scaling and squaring.

    `scipy.linalg.expm` agrees to rounding but takes them one by one: tables of `rfp` over 30 times slower (SciPy 1.17).
    """
    norm = float(np.abs(matrices).sum(axis=2).max())
    halvings = max(0, int(np.ceil(np.log2(max(norm, 1e-300) / 0.5))))
    scaled = matrices / 2.0**halvings
    identity = np.eye(matrices.shape[-1])
    result = identity + scaled / 13
    for degree in range(12, 0, -1):
        result = identity + scaled @ result / degree
    for _ in range(halvings):
        result = result @ result
    return result


def dense_propagation(rates: FloatArray, inputs: FloatArray, at_rest: FloatArray) -> Propagation:
    """Return steps of z' = A z + c f whose coefficients change along the span; the rail's displacement is z[0].

    Each step takes the coefficients at its middle, its exponential is exact for those.

    Args:
        rates: (n_grid, m, m), A dt at the middle of the step from each grid point to the next.
        inputs: (n_grid, m), c dt there.
        at_rest: (m,), z under a unit load that rests on the first grid point.
    """
    steps, order = inputs.shape
    # The force and its change over the step as two more states.
    system = np.zeros((steps, order + 2, order + 2))
    system[:, :order, :order], system[:, :order, order] = rates, inputs
    system[:, order, order + 1] = 1.0
    across = exponentials(system)
    transitions = np.ascontiguousarray(across[:, :order, :order])
    new = across[:, :order, order + 1]
    old = across[:, :order, order] - new
    arriving = np.roll(new, 1, axis=0)  # of the step that ends at each grid point
    shapes = np.zeros((steps, order))
    shapes[:, 0] = 1.0
    return Propagation(
        decay=np.empty((2, 0)),
        input_scale=np.empty((2, 0)),
        transitions=transitions,
        drives=np.einsum("nij,nj->ni", transitions, arriving) + old,
        shapes=shapes,
        gains=np.ascontiguousarray(arriving[:, 0]),
        at_rest=at_rest - arriving[0],
    )
