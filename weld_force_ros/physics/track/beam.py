"""Track receptance in the frequency domain: a Timoshenko rail on periodic or continuous support, exactly.

Displacement per force, exp(+i w t), positive in the direction of the force. The rail is infinite; its supports
(`weld_force_ros.physics.track.support`) react with vertical forces only.

Periodic support is solved in closed form. The free rail answers a force with two waves, g(x) = sum_j A_j exp(-k_j |x|).
A Floquet wave of the supported rail is the sum over all supports of their reactions, each lambda times the one before,
so that geometric series give its shape in a span, and the condition at a support a quadratic equation in
cosh(mu) = (lambda + 1/lambda) / 2. The response to a force is the residue at its two decaying roots (Mead, "Wave
propagation in continuous periodic structures", J. Sound Vib. 190 (1996); Heckl, "Coupled waves on a periodically
supported Timoshenko beam", J. Sound Vib. 252 (2002)).
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.physics.arrays import ComplexArray as ComplexArray
from weld_force_ros.physics.arrays import FloatArray as FloatArray
from weld_force_ros.physics.track.outline import Dimensions
from weld_force_ros.physics.track.support import Support
from weld_force_ros.physics.track.timoshenko import BeamWaves, TimoshenkoBeam

# Strips are imported where they are used: scikit-fem and what it needs would double the time until a command starts.
if TYPE_CHECKING:
    from weld_force_ros.physics.track.waveguide_rail import FreeRail, Steel

# Low enough for inertia to vanish (some 1e-6 of the stiffness), high enough for the waves to stay distinct numbers.
STATIC_OMEGA = np.array([2 * np.pi * 0.1])
# Of strips, whose bending waves become one at rest: imaginary, where inertia stiffens by as much as 0.02 %.
_STATIC_STRIP_HZ = -1j
_MOST_REMEMBERED = 6  # of strips' waves: 13 kB a frequency


@dataclass(frozen=True)
class Rail(TimoshenkoBeam):
    """A rail as a beam."""


@dataclass(frozen=True, kw_only=True)
class StripRail(Rail):
    """A rail by finite strips; the beam's numbers serve where only a beam's can.

    Attributes:
        section: its cross-section.
        wear_m: by how much its crown is lower.
    """

    section: Dimensions
    wear_m: float = 0.0

    @property
    def steel(self) -> "Steel":
        """Return what the rail is made of."""
        from weld_force_ros.physics.track.waveguide_rail import Steel

        density = self.mass_kg_per_m / self.area_m2
        return Steel(self.youngs_modulus_pa, self.shear_modulus_pa, density)

    @property
    def free(self) -> "FreeRail":
        """Return the rail without supports; the first of its kind takes seconds."""
        from weld_force_ros.physics.track import waveguide_rail

        return waveguide_rail.rail(self.section, self.wear_m, self.steel)


@dataclass(frozen=True)
class Track:
    """A rail on supports `spacing_m` apart, or, if `continuous`, on the same supports smeared over that spacing.

    `pad_width_m` along the rail lets pads resist its rotation, on sleepers that do not rotate; of strips only.
    """

    name: str
    rail: Rail
    support: Support
    spacing_m: float
    continuous: bool = False
    pad_width_m: float = 0.0

    def undamped(self) -> "Track":
        """Return the same track without any loss."""
        return replace(self, rail=replace(self.rail, loss_factor=0.0), support=self.support.undamped())

    @property
    def causal(self) -> bool:
        """Return whether every layer of the support is."""
        return self.support.causal


def receptance(track: Track, frequency_hz: ArrayLike, at_m: ArrayLike, *, threads: int | None = None) -> ComplexArray:
    """Return the point receptance of the rail, m/N.

    Args:
        track: the track.
        frequency_hz: (n_frequency,), positive.
        at_m: (n_at,), metres after a sleeper; any real number.
        threads: see `waves`.

    Returns:
        (n_at, n_frequency).
    """
    at = np.atleast_1d(np.asarray(at_m, dtype=np.float64))
    return transfer_receptance(track, frequency_hz, at, at, threads=threads)


def transfer_receptance(
    track: Track, frequency_hz: ArrayLike, at_m: ArrayLike, force_at_m: ArrayLike, *, threads: int | None = None
) -> ComplexArray:
    """Return the receptance of the rail at `at_m` to a force at `force_at_m`, m/N.

    Args:
        track: the track.
        frequency_hz: (n_frequency,), positive.
        at_m: (n_at,), metres, 0 at a sleeper.
        force_at_m: (n_at,) or scalar, metres in the same coordinate.
        threads: see `waves`.

    Returns:
        (n_at, n_frequency).
    """
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    at, force_at = np.broadcast_arrays(
        np.atleast_1d(np.asarray(at_m, dtype=np.float64)), np.asarray(force_at_m, dtype=np.float64)
    )
    return response(waves(track, omega, threads=threads), at, force_at)


def static_compliance(track: Track, at_m: ArrayLike) -> FloatArray:
    """Return the deflection under a resting unit load, m/N, (n_at,), of the undamped track: no loss at rest."""
    at = np.atleast_1d(np.asarray(at_m, dtype=np.float64))
    return response(static_waves(track), at, at)[:, 0].real


def sections(track: Track, count: int) -> FloatArray:
    """Return `count` equidistant places over one span, m, the first over a sleeper; continuous support needs one."""
    return np.zeros(1) if track.continuous else np.arange(count) * (track.spacing_m / count)


def velocity_jump(rail: Rail) -> float:
    """Return the velocity that a unit impulse gives the rail at once, m/(N s): half the inverse shear impedance.

    The receptance tends to this over i omega at high frequency.
    """
    shear = rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2
    return float(0.5 / np.sqrt(shear * rail.mass_kg_per_m))


def pinned_pinned_hz(track: Track) -> float:
    """Return the first pinned-pinned frequency: half a bending wave between fixed sleepers, Timoshenko beam, Hz.

    The lower root of the beam's frequency equation at k = pi / spacing.
    """
    rail, k = track.rail, np.pi / track.spacing_m
    shear = rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2
    bending = rail.youngs_modulus_pa * rail.second_moment_m4
    rotary = rail.mass_kg_per_m * rail.second_moment_m4 / rail.area_m2
    # (shear k^2 - m w^2) (bending k^2 + shear - rotary w^2) = (shear k)^2
    square = np.roots(
        [
            rail.mass_kg_per_m * rotary,
            -(rail.mass_kg_per_m * (bending * k**2 + shear) + rotary * shear * k**2),
            shear * bending * k**4,
        ]
    )
    return float(np.sqrt(square.real.min()) / (2 * np.pi))


def free_decay(rail: Rail, frequency_hz: ArrayLike) -> ComplexArray:
    """Return decay constants of a free rail's waves, 1/m, (n_wave, n_frequency); imaginary of one that just travels."""
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    if isinstance(rail, StripRail):
        return rail.free.moving(omega, loss_factor=rail.loss_factor).decay
    return np.asarray(_RailWaves(rail, omega, 1.0).decay)


class Waves(Protocol):
    """The waves in which a track answers a force, for many frequencies at once: two of a beam, more of strips.

    The response at x to a force at x0 <= x is sum_i strength_i shape_i(x) shape_i(-x0).

    Attributes:
        span_m: the period.
        strength: (n_wave, n_frequency), m/N.
        multiplier: (n_wave, n_frequency), a wave's ratio from one span to the next, magnitude at most 1.
    """

    span_m: float
    strength: ComplexArray
    multiplier: ComplexArray

    def shape(self, x_m: FloatArray) -> ComplexArray:
        """Return the waves that decay towards +x: (n_wave, n_x, n_frequency)."""


def waves(track: Track, omega: FloatArray | ComplexArray, *, threads: int | None = None) -> Waves:
    """Return a track's waves.

    Args:
        track: the track.
        omega: (n_frequency,), rad/s, real part positive or zero.
        threads: that compute the waves of a rail by strips; one a core, if not given.
    """
    if isinstance(track.rail, StripRail):
        # Remembered, as fits ask for the same frequencies again and again.
        return _strip_waves(track, track.rail, np.asarray(omega, dtype=np.complex128).tobytes(), threads)
    if track.continuous:
        return _RailWaves(track.rail, omega, track.spacing_m, track.support.dynamic_stiffness(omega) / track.spacing_m)
    return _FloquetWaves(track, omega)


@lru_cache(_MOST_REMEMBERED)
def _strip_waves(track: Track, rail: StripRail, frequencies: bytes, threads: int | None) -> Waves:
    from weld_force_ros.physics.track.supported_rail import SupportedWaves, WavesAlong

    omega, loss_factor = np.frombuffer(frequencies, dtype=np.complex128), rail.loss_factor
    if track.continuous:
        foundation = track.support.dynamic_stiffness(omega) / track.spacing_m
        free = rail.free.waves(omega, foundation, loss_factor=loss_factor, threads=threads)
        return WavesAlong(free, track.spacing_m)
    pad, below = track.support.pad.dynamic_stiffness(omega), track.support.stiffness_below_pad(omega)
    free = rail.free.waves(omega, loss_factor=loss_factor, threads=threads)
    return SupportedWaves(free, track.spacing_m, pad, below, track.pad_width_m)


def static_waves(track: Track, *, threads: int | None = None) -> Waves:
    """Return the waves of a track at rest, where loss does not act: one frequency, next to zero; see `waves`."""
    omega = 2 * np.pi * np.array([_STATIC_STRIP_HZ]) if isinstance(track.rail, StripRail) else STATIC_OMEGA
    return waves(track.undamped(), omega, threads=threads)


def response(waves: Waves, at_m: FloatArray, force_at_m: FloatArray) -> ComplexArray:
    """Return the receptance at `at_m` (n_at,) to forces at `force_at_m` (n_at,), m/N, (n_at, n_frequency), of waves."""
    ahead = np.maximum(at_m, force_at_m)
    behind = np.minimum(at_m, force_at_m)  # reciprocity: the response depends on the pair only
    first_m = waves.span_m * np.floor(behind / waves.span_m)  # near waves of strips grow by many powers a span
    ahead, behind = ahead - first_m, behind - first_m
    parts = waves.strength[:, None, :] * waves.shape(ahead) * waves.shape(-behind)
    return np.asarray(parts.sum(axis=0))


class _RailWaves:
    """The rail's two waves, free or on a foundation of complex stiffness N/m^2: exp(-decay x), Re(decay) > 0."""

    def __init__(
        self, rail: Rail, omega: FloatArray | ComplexArray, span_m: float, foundation: ComplexArray | float = 0.0
    ) -> None:
        self.span_m = span_m
        waves = BeamWaves(rail, omega, foundation)
        self.decay, self.strength = waves.decay, waves.strength
        self.multiplier: ComplexArray = np.exp(-self.decay * span_m)

    def shape(self, x_m: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(-self.decay[:, None, :] * x_m[None, :, None]))


class _FloquetWaves:
    """The two decaying Floquet waves of a periodically supported rail."""

    def __init__(self, track: Track, omega: FloatArray | ComplexArray) -> None:
        self.span_m = track.spacing_m
        self.rail = _RailWaves(track.rail, omega, track.spacing_m)
        support = track.support.dynamic_stiffness(omega)
        (a1, a2), (k1, k2) = self.rail.strength, self.rail.decay * self.span_m
        c1, c2, s1, s2 = np.cosh(k1), np.cosh(k2), np.sinh(k1), np.sinh(k2)
        # 1 + support sum_j A_j s_j / (c_j - c) = 0, c = cosh(mu)
        linear = -(c1 + c2 + support * (a1 * s1 + a2 * s2))
        constant = c1 * c2 + support * (a1 * s1 * c2 + a2 * s2 * c1)
        root = np.sqrt(linear**2 / 4 - constant + 0j)
        cosh = np.stack([-linear / 2 + root, -linear / 2 - root])
        sinh = np.sqrt(cosh**2 - 1)
        sinh = np.where(np.abs(cosh - sinh) > 1, -sinh, sinh)
        self.multiplier: ComplexArray = cosh - sinh
        # d/d mu of the condition at a support, which the residue needs
        slope = support * sinh * (a1 * s1 / (c1 - cosh) ** 2 + a2 * s2 / (c2 - cosh) ** 2)
        self.strength: ComplexArray = support / slope

    def shape(self, x_m: FloatArray) -> ComplexArray:
        span = np.floor(x_m / self.span_m)
        x = (x_m - span * self.span_m)[None, :, None]
        multiplier = self.multiplier[:, None, :]
        shape = np.zeros((2, len(x_m), multiplier.shape[-1]), dtype=np.complex128)
        for decay, amplitude, step in zip(self.rail.decay, self.rail.strength, self.rail.multiplier, strict=True):
            from_behind = np.exp(-decay * x) / (1 - step / multiplier)
            from_ahead = multiplier * np.exp(-decay * (self.span_m - x)) / (1 - step * multiplier)
            shape += amplitude * (from_behind + from_ahead)
        return np.asarray(shape * multiplier ** span[None, :, None])
