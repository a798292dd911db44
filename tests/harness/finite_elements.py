"""An oracle for local supports: a length of track by finite elements.

It shares no code with the receptances or the engines. Rail: Timoshenko elements of two nodes with the exact static
shape functions and a consistent mass with rotary inertia (Friedman and Kosmatka, Computers & Structures 47 (1993) 473).
Each sleeper is a mass between pad and ballast, spring and dashpot each. Displacements are positive down.

Within an element the rail below the wheel gives as the shape functions say plus as an element clamped at both ends
does at rest: all that a static load does is then exact for any number of elements, and few of them converge.

Viscous tracks only. The rail's loss factor becomes damping proportional to stiffness, equal to it at `RAIL_LOSS_HZ`; to
leave it out changes peaks on tracks of 0.01 by up to 0.2 %.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded, solve_banded

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track.beam import Rail, Track

RAIL_LOSS_HZ = 1000.0
BAND = 4
"""How far apart coupled unknowns can be: the next node's rotation, with a sleeper between."""


@dataclass(frozen=True)
class Supports:
    """What differs at single sleepers; sleeper 0 is at x = 0, the next at one span.

    Attributes:
        ballast: factor on stiffness and damping; 0: none.
        gap_m: between sleeper and ballast in the unloaded track, whose own weight is ignored. The ballast acts
            below it by the same spring and dashpot, and never pulls.
        pads: factor on stiffness and damping.
    """

    ballast: Mapping[int, float] = field(default_factory=dict)
    gap_m: Mapping[int, float] = field(default_factory=dict)
    pads: Mapping[int, float] = field(default_factory=dict)

    @property
    def first(self) -> int:
        """Return the first sleeper that differs, or 0."""
        return min([*self.ballast, *self.gap_m, *self.pads], default=0)


AS_BUILT = Supports()


class Element:
    """A Timoshenko element: displacement and rotation at either node, (w0, phi0, w1, phi1)."""

    def __init__(self, rail: Rail, length_m: float) -> None:
        self.length_m = length_m
        self._rail = rail
        self._bending = rail.youngs_modulus_pa * rail.second_moment_m4
        self._shear = rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2

    def _softness(self, length_m: ArrayLike) -> FloatArray:
        return np.asarray(12 * self._bending / (self._shear * np.square(length_m)))

    def stiffness(self) -> FloatArray:
        """Return the stiffness, (4, 4)."""
        length, phi = self.length_m, float(self._softness(self.length_m))
        near, far = (4 + phi) * length**2, (2 - phi) * length**2
        rows = [
            [12, 6 * length, -12, 6 * length],
            [6 * length, near, -6 * length, far],
            [-12, -6 * length, 12, -6 * length],
            [6 * length, far, -6 * length, near],
        ]
        return self._bending / (length**3 * (1 + phi)) * np.array(rows)

    def mass(self) -> FloatArray:
        """Return the consistent mass with rotary inertia, (4, 4)."""
        rail = self._rail
        points, weights = np.polynomial.legendre.leggauss(4)  # exact to degree 7, of 6
        share = 0.5 + 0.5 * points
        rotary = rail.mass_kg_per_m * rail.second_moment_m4 / rail.area_m2
        w, turn = self.shapes(share), self.rotations(share)
        half = 0.5 * self.length_m * weights
        return np.asarray(rail.mass_kg_per_m * (w.T * half) @ w + rotary * (turn.T * half) @ turn)

    def shapes(self, share: FloatArray) -> FloatArray:
        """Return displacements at a share of the length, (n, 4)."""
        s, length, phi = share, self.length_m, self._softness(self.length_m)
        columns = [
            1 - 3 * s**2 + 2 * s**3 + phi * (1 - s),
            length * (s - 2 * s**2 + s**3 + phi / 2 * (s - s**2)),
            3 * s**2 - 2 * s**3 + phi * s,
            length * (-(s**2) + s**3 + phi / 2 * (s**2 - s)),
        ]
        return np.stack(columns, axis=-1) / (1 + phi)

    def rotations(self, share: FloatArray) -> FloatArray:
        """Return rotations at a share of the length, (n, 4)."""
        s, phi = share, self._softness(self.length_m)
        bow = 6 / self.length_m * (s**2 - s)
        columns = [bow, 1 - 4 * s + 3 * s**2 + phi * (1 - s), -bow, 3 * s**2 - 2 * s + phi * s]
        return np.stack(columns, axis=-1) / (1 + phi)

    def clamped_compliance(self, share: FloatArray) -> FloatArray:
        """Return the static deflection below a unit load at a share of the length, both nodes held, (n,), m/N."""
        result = np.zeros(len(share))
        within = (share > 1e-9) & (share < 1 - 1e-9)
        behind, ahead = self.length_m * share[within], self.length_m * (1 - share[within])
        a, b = (self._bending / (part**3 * (1 + self._softness(part))) for part in (behind, ahead))
        push = 12 * (a + b)
        mixed = 6 * (b * ahead - a * behind)
        turn = (4 + self._softness(behind)) * a * behind**2 + (4 + self._softness(ahead)) * b * ahead**2
        result[within] = turn / (push * turn - mixed**2)
        return result


class FiniteElementTrack:
    """A length of track by finite elements.

    Unknowns run along the track: displacement and rotation of each node, and at a sleeper then the sleeper's own.
    Matrices are symmetric, by their lower bands: (`BAND` + 1, n), [k, j] is the entry of row j + k, column j.

    Args:
        track: with viscous damping, on discrete supports.
        supports: what differs at single sleepers; the ballast of those over a gap is left to the passage.
        sleepers: number of the first and of the last; the rail ends at these.
        elements: a bay.
    """

    def __init__(self, track: Track, supports: Supports, sleepers: tuple[int, int], elements: int) -> None:
        if track.continuous or not track.causal:
            raise ValueError("finite elements are of discrete supports with viscous damping")
        self.track, self.supports, self._elements = track, supports, elements
        self.first_m = sleepers[0] * track.spacing_m
        self.element = Element(track.rail, track.spacing_m / elements)
        bays = sleepers[1] - sleepers[0]
        self._node_start = np.array([2 * n + (n + elements - 1) // elements for n in range(bays * elements + 1)])
        self._sleepers = range(sleepers[0], sleepers[1] + 1)
        self.unknowns = int(self._node_start[-1]) + 3
        self.stiffness, self.damping, self.mass = (np.zeros((BAND + 1, self.unknowns)) for _ in range(3))
        self._add_rail()
        self._add_supports()

    def _add_rail(self) -> None:
        stiffness, mass = self.element.stiffness(), self.element.mass()
        loss_s = self.track.rail.loss_factor / (2 * np.pi * RAIL_LOSS_HZ)
        behind, ahead = self._node_start[:-1], self._node_start[1:]
        unknowns = np.stack([behind, behind + 1, ahead, ahead + 1])
        for row in range(4):
            for column in range(row + 1):
                place = (unknowns[row] - unknowns[column], unknowns[column])
                np.add.at(self.stiffness, place, stiffness[row, column])
                np.add.at(self.damping, place, loss_s * stiffness[row, column])
                np.add.at(self.mass, place, mass[row, column])

    def _add_supports(self) -> None:
        pad, ballast = self.track.support.springs
        for sleeper in self._sleepers:
            own, rail = self.sleeper(sleeper), self.sleeper(sleeper) - 2
            of_pad = self.supports.pads.get(sleeper, 1.0)
            of_ballast = 0.0 if sleeper in self.supports.gap_m else self.supports.ballast.get(sleeper, 1.0)
            self.mass[0, own] += self.track.support.masses_kg[0]
            for matrix, above, below in (
                (self.stiffness, pad.stiffness_n_per_m, ballast.stiffness_n_per_m),
                (self.damping, pad.damping_ns_per_m, ballast.damping_ns_per_m),
            ):
                matrix[0, rail] += of_pad * above
                matrix[2, rail] -= of_pad * above
                matrix[0, own] += of_pad * above + of_ballast * below

    def sleeper(self, number: int) -> int:
        """Return the unknown of a sleeper."""
        return int(self._node_start[(number - self._sleepers[0]) * self._elements]) + 2

    def under(self, x_m: FloatArray) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Return what a load on the rail at `x_m` meets: unknowns and shapes, (n, 4), and local compliance, (n,)."""
        along = (x_m - self.first_m) / self.element.length_m
        element = np.clip(np.floor(along).astype(np.int64), 0, len(self._node_start) - 2)
        behind, ahead = self._node_start[element], self._node_start[element + 1]
        share = along - element
        unknowns = np.stack([behind, behind + 1, ahead, ahead + 1], axis=1)
        return unknowns, self.element.shapes(share), self.element.clamped_compliance(share)

    def at_rest(self, x_m: float, load_n: float) -> tuple[FloatArray, float]:
        """Return all unknowns and the rail's displacement below a load that rests at `x_m`."""
        unknowns, shapes, local = self.under(np.array([x_m]))
        load = np.zeros(self.unknowns)
        load[unknowns[0]] = load_n * shapes[0]
        u = cho_solve_banded((cholesky_banded(self.stiffness, lower=True), True), load)
        return u, float(shapes[0] @ u[unknowns[0]] + local[0] * load_n)

    def receptance(self, frequency_hz: float, x_m: float) -> complex:
        """Return the rail's displacement per force at `x_m`, m/N."""
        omega = 2 * np.pi * frequency_hz
        band = self.stiffness + 1j * omega * self.damping - omega**2 * self.mass
        unknowns, shapes, local = self.under(np.array([x_m]))
        load = np.zeros(self.unknowns)
        load[unknowns[0]] = shapes[0]
        return complex(
            shapes[0] @ _solved_symmetric(np.asarray(band, dtype=np.complex128), load)[unknowns[0]] + local[0]
        )


def _solved_symmetric(lower: ComplexArray, load: FloatArray) -> ComplexArray:
    n = lower.shape[1]
    full = np.zeros((2 * BAND + 1, n), dtype=np.complex128)
    full[BAND:] = lower
    for k in range(1, BAND + 1):
        full[BAND - k, k:] = lower[k, : n - k]
    return np.asarray(solve_banded((BAND, BAND), full, load))
