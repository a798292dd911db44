"""The lumped wheel and its contact."""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class Wheel:
    """Half a wheelset as a lumped mass under its static load, and its contact: eq. (4) and (5) of the paper.

    Attributes:
        mass_kg: unsprung.
        static_load_n: static wheel load.
        radius_m: of the circle that rolls over the rail; 0: none does, the contact follows the rail as it stands.
        hertz_n_per_m15: Hertz constant.
    """

    mass_kg: float
    static_load_n: float
    radius_m: float
    hertz_n_per_m15: float

    @property
    def static_indentation_m(self) -> float:
        """Return the approach of wheel and rail at rest."""
        return float((self.static_load_n / self.hertz_n_per_m15) ** (2 / 3))

    @property
    def contact_stiffness_n_per_m(self) -> float:
        """Return the slope of the Hertz law at the static load."""
        return float(1.5 * self.hertz_n_per_m15 ** (2 / 3) * self.static_load_n ** (1 / 3))

    def compliance(self, omega: FloatArray) -> ComplexArray:
        """Return the contact spring and free wheel in series with the track as an irregularity meets them, m/N."""
        return np.asarray(1 / self.contact_stiffness_n_per_m - 1 / (self.mass_kg * omega**2), dtype=np.complex128)
