"""A rail's support as a chain of springs and masses in series, top down from the rail to the ground.

One spring is direct fixation, two with a sleeper between them ballasted track, three under-sleeper pads or booted
sleepers. A spring is a stiffness with a loss factor or a dashpot, or a table over frequency, as rubber is measured.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.cubics import monotone_cubics, spline
from weld_force_ros.physics.track.bending_sleeper import BendingSleeper

# Radians: what rails lose and count as causal with all the same.
_ACAUSAL_ANGLE = 0.02
_DECADES_BEYOND = 4
_POINTS_A_DECADE = 200

Rows = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Spring:
    """A spring under one rail: k (1 + i eta) + i w c."""

    stiffness_n_per_m: float
    loss_factor: float = 0.0
    damping_ns_per_m: float = 0.0

    @property
    def causal(self) -> bool:
        """Return whether damping is viscous; a loss factor has no causal impulse response."""
        return self.loss_factor == 0.0

    def dynamic_stiffness(self, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return the complex stiffness in N/m, shape of `omega` (rad/s)."""
        damping = self.stiffness_n_per_m * self.loss_factor + omega * self.damping_ns_per_m
        return np.asarray(self.stiffness_n_per_m + 1j * damping)

    def undamped(self) -> "Spring":
        """Return the same stiffness without loss."""
        return Spring(self.stiffness_n_per_m)

    def stiffer(self, factor: float) -> "Spring":
        """Return it with its stiffness multiplied; its dashpot stays."""
        return replace(self, stiffness_n_per_m=self.stiffness_n_per_m * factor)

    def scaled(self, factor: float) -> "Spring":
        """Return it with stiffness and dashpot multiplied."""
        return replace(self.stiffer(factor), damping_ns_per_m=self.damping_ns_per_m * factor)


@dataclass(frozen=True)
class TabulatedSpring:
    """A spring by a table of (Hz, N/m, loss factor), two rows or more of rising frequency.

    Stiffness and loss modulus are interpolated over log frequency by monotone cubics (Fritsch & Carlson, SIAM J. Numer.
    Anal. 17 (1980) 238) and stay constant beyond the ends. Complex frequencies continue the cubic that they are in.
    """

    rows: Rows

    @property
    def stiffness_n_per_m(self) -> float:
        """Return the stiffness of the lowest frequency, which stands for rest."""
        return self.rows[0][1]

    @property
    def causal(self) -> bool:
        """Return whether the table's loss follows from its stiffness, as Kramers and Kronig demand of what is causal.

        In the form of Bode ("Network Analysis and Feedback Amplifier Design", 1945, ch. 14): the loss angle is the
        slope of the logarithm of |k| over that of frequency, averaged with weight ln coth |u / 2|, to 0.02 rad; the
        slopes at the table's ends go on beyond them.
        """
        return _acausal_angle(self.rows) <= _ACAUSAL_ANGLE

    def dynamic_stiffness(self, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return the complex stiffness in N/m, shape of `omega` (rad/s)."""
        return _interpolation(self.rows)(np.asarray(omega, dtype=np.complex128))

    def undamped(self) -> Spring:
        """Return the stiffness of the lowest frequency without loss."""
        return Spring(self.stiffness_n_per_m)

    def stiffer(self, factor: float) -> "TabulatedSpring":
        """Return it with the table's stiffness multiplied; loss factors stay."""
        return TabulatedSpring(tuple((hz, stiffness * factor, loss) for hz, stiffness, loss in self.rows))

    def scaled(self, factor: float) -> "TabulatedSpring":
        """Return the same as `stiffer`: a table has no dashpot."""
        return self.stiffer(factor)


@dataclass(frozen=True)
class Support:
    """Springs from the rail down to the ground, and the masses between them: one fewer.

    Attributes:
        springs: the pad under the rail first, what stands on the ground last.
        masses_kg: under one rail: half a sleeper, a baseplate, a block; or a sleeper that bends, whole.
    """

    springs: tuple[Spring | TabulatedSpring, ...]
    masses_kg: tuple[float | BendingSleeper, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what is no chain."""
        if len(self.springs) != len(self.masses_kg) + 1:
            raise ValueError(f"{len(self.springs)} springs with {len(self.masses_kg)} masses between them")

    @property
    def pad(self) -> Spring | TabulatedSpring:
        """The spring under the rail."""
        return self.springs[0]

    @property
    def causal(self) -> bool:
        """Whether every spring is; a sleeper's own loss, as a rail's, is tiny and counts as if it were."""
        return all(spring.causal for spring in self.springs)

    @property
    def mass_kg(self) -> float:
        """The mass that moves under one rail."""
        return sum(mass.half_mass_kg if isinstance(mass, BendingSleeper) else mass for mass in self.masses_kg)

    def dynamic_stiffness(self, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return the dynamic stiffness seen by the rail, N/m, shape of `omega` (rad/s)."""
        pad = self.pad.dynamic_stiffness(omega)
        return _in_series(pad, self.stiffness_below_pad(omega)) if self.masses_kg else pad

    def stiffness_below_pad(self, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return the dynamic stiffness of what the pad stands on, N/m: infinite where that is the ground."""
        if not self.masses_kg:
            return np.full(np.shape(omega), np.inf + 0j)
        below = _carrying(self.masses_kg[-1], self.springs[-1].dynamic_stiffness(omega), omega)
        for spring, mass in zip(self.springs[-2:0:-1], self.masses_kg[-2::-1], strict=True):
            below = _carrying(mass, _in_series(spring.dynamic_stiffness(omega), below), omega)
        return below

    def undamped(self) -> "Support":
        """Return the same support without loss."""
        masses = tuple(mass.undamped() if isinstance(mass, BendingSleeper) else mass for mass in self.masses_kg)
        return Support(tuple(spring.undamped() for spring in self.springs), masses)

    def stiffer(self, factor: float) -> "Support":
        """Return it with the stiffness of every spring multiplied; dashpots stay."""
        return replace(self, springs=tuple(spring.stiffer(factor) for spring in self.springs))

    def with_lowest(self, factor: float) -> "Support":
        """Return it with the dynamic stiffness of the spring on the ground multiplied: 0 where nothing carries it."""
        return replace(self, springs=(*self.springs[:-1], self.springs[-1].scaled(factor)))


def _carrying(mass: float | BendingSleeper, below: ComplexArray, omega: FloatArray | ComplexArray) -> ComplexArray:
    """Return the dynamic stiffness on top of a mass, or at the seat of a sleeper, that stands on what is below."""
    if isinstance(mass, BendingSleeper):
        return mass.stiffness_at_seat(below, omega)
    return np.asarray(below - mass * omega**2)


def _in_series(upper: ComplexArray, lower: ComplexArray) -> ComplexArray:
    return np.asarray(upper * lower / (upper + lower))


@lru_cache(64)  # a search for a track tries many tables
def _interpolation(rows: Rows) -> Callable[[ComplexArray], ComplexArray]:
    """Return the complex stiffness over angular frequency: a cubic of the logarithm between rows."""
    hz, stiffness, loss = np.array(rows).T
    knots = np.log(2 * np.pi * hz)
    storage, dissipation = monotone_cubics(knots, stiffness), monotone_cubics(knots, stiffness * loss)
    cubics = storage.coefficients + 1j * dissipation.coefficients

    def at(omega: ComplexArray) -> ComplexArray:
        radius = np.log(np.maximum(np.abs(omega), np.finfo(float).tiny)).clip(knots[0], knots[-1])
        piece = np.searchsorted(knots[1:-1], radius)
        along = radius - knots[piece] + 1j * np.angle(omega)
        third, second, first, constant = cubics[:, piece]
        return np.asarray(((third * along + second) * along + first) * along + constant)

    return at


@lru_cache(64)
def _acausal_angle(rows: Rows) -> float:
    """Return by how much loss angles differ at most from Bode's, rad, over the middle half of a table's range."""
    step, decades = np.log(10) / _POINTS_A_DECADE, _DECADES_BEYOND * np.log(10)
    low, high = np.log(2 * np.pi * rows[0][0]), np.log(2 * np.pi * rows[-1][0])
    inside = np.linspace(low, high, max(int(np.ceil((high - low) / step)), 3) + 1)
    stiffness = _interpolation(rows)(np.exp(inside) + 0j)
    size = spline(inside, np.log(np.abs(stiffness)))
    grid = np.arange(low - decades, high + decades, step)
    held = grid.clip(low, high)
    rise = np.diff(size(held) + size.slope(held) * (grid - held))
    middle = (grid[1:] + grid[:-1]) / 2
    asked = inside[len(inside) // 4 : len(inside) - len(inside) // 4]
    weight = -np.log(np.tanh(np.abs(middle - asked[:, None]) / 2))
    return float(np.abs(np.angle(_interpolation(rows)(np.exp(asked) + 0j)) - weight @ rise / np.pi).max())
