"""Waves of an infinite Timoshenko beam, free or on a foundation: what rails and sleepers are made of here."""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class TimoshenkoBeam:
    """A beam of one cross-section; `loss_factor` acts on bending and shear."""

    mass_kg_per_m: float
    area_m2: float
    second_moment_m4: float
    youngs_modulus_pa: float
    shear_modulus_pa: float
    shear_coefficient: float
    loss_factor: float = 0.0


class BeamWaves:
    """The two waves that a point force sends out: displacement sum_j strength_j exp(-decay_j |x|), Re(decay) > 0.

    Args:
        beam: infinite.
        omega: (n_frequency,), rad/s.
        foundation: complex stiffness beneath it, N/m^2, (n_frequency,) or one.

    Attributes:
        decay: (2, n_frequency), 1/m; imaginary of a wave that just travels.
        strength: (2, n_frequency), m/N.
        curvature: (2, n_frequency), 1/m^2: derivative of the section's rotation per displacement, which the bending
            moment follows.
    """

    def __init__(
        self, beam: TimoshenkoBeam, omega: FloatArray | ComplexArray, foundation: ComplexArray | float = 0.0
    ) -> None:
        loss = 1 + 1j * beam.loss_factor
        shear = beam.shear_coefficient * beam.shear_modulus_pa * beam.area_m2 * loss
        bending = beam.youngs_modulus_pa * beam.second_moment_m4 * loss
        inertia = beam.mass_kg_per_m * omega**2 - foundation
        rotary = beam.mass_kg_per_m * beam.second_moment_m4 / beam.area_m2 * omega**2
        # exp(-k x): shear bending k^4 + (shear rotary + bending inertia) k^2 + inertia (rotary - shear) = 0
        half = (shear * rotary + bending * inertia) / (2 * shear * bending)
        root = np.sqrt(half**2 - inertia * (rotary - shear) / (shear * bending) + 0j)
        square = np.stack([-half + root, -half - root])
        decay = np.sqrt(square)
        # An undamped travelling wave has no real part: the root that radiates away is +i |k| (phase lag with distance).
        lossless = np.abs(decay.real) <= 1e-9 * np.abs(decay)
        self.decay = np.where(lossless, 1j * np.abs(decay.imag), np.where(decay.real < 0, -decay, decay))
        other = square[::-1]
        self.strength: ComplexArray = (shear - rotary - bending * square) / (
            2 * self.decay * shear * bending * (other - square)
        )
        self.curvature: ComplexArray = square + inertia / shear
