"""The lumped wheel and its contact."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from weld_force_ros.physics.arrays import ComplexArray, FloatArray

RAIL_CROWN_RADIUS_M = 0.3
"""Transverse radius of a rail head's middle, new 60E1; the half length changes by 10 % between 0.2 and 0.5 m."""
_YOUNG_PA, _POISSON = 210e9, 0.3


@dataclass(frozen=True)
class Wheel:
    """Half a wheelset as a lumped mass under its static load, and its contact: eq. (4) and (5) of the paper."""

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

    def contact_half_length_m(self, crown_radius_m: float = RAIL_CROWN_RADIUS_M) -> float:
        """Return the half length along the rail of the contact ellipse under the static load.

        Hertz' theory for a wheel that is straight across, on a rail that is straight along (Johnson, Contact Mechanics,
        1985, section 4.2): the ratio of the half axes follows from the ratio of the curvatures, the size from the load.

        Args:
            crown_radius_m: transverse radius of the rail head.
        """
        along, across = 1 / self.radius_m, 1 / crown_radius_m

        def curvature_ratio(minor_over_major: float) -> float:
            e2 = 1 - minor_over_major**2
            k, e = float(ellipk(e2)), float(ellipe(e2))
            return (e / minor_over_major**2 - k) / (k - e)

        flatter, sharper = sorted((along, across))
        if sharper <= flatter * (1 + 1e-9):
            ratio, e2 = 1.0, 0.0
        else:
            ratio = float(brentq(lambda r: curvature_ratio(r) - sharper / flatter, 1e-3, 1 - 1e-9))
            e2 = 1 - ratio**2
        # Johnson (4.26): with c^2 = a b, c^3 = (3 P Re / 4 E*) F1^3 and F1^3 = (4 / pi e^2) (b/a)^1.5 sqrt(...).
        modulus = _YOUNG_PA / (2 * (1 - _POISSON**2))
        effective_radius = 1 / np.sqrt(along * across)
        shape = 1.0 if e2 == 0.0 else _ellipse_factor(ratio)
        mean_half_axis = (0.75 * self.static_load_n * effective_radius / modulus) ** (1 / 3) * shape
        major, minor = mean_half_axis / np.sqrt(ratio), mean_half_axis * np.sqrt(ratio)
        return float(major if along < across else minor)

    def compliance(self, omega: FloatArray) -> ComplexArray:
        """Return the contact spring and free wheel in series with the track as an irregularity meets them, m/N."""
        return np.asarray(1 / self.contact_stiffness_n_per_m - 1 / (self.mass_kg * omega**2), dtype=np.complex128)


def _ellipse_factor(minor_over_major: float) -> float:
    """Return F1 of Johnson's (4.26): how much larger the mean half axis is than that of a circle of contact."""
    e2 = 1 - minor_over_major**2
    k, e = float(ellipk(e2)), float(ellipe(e2))
    product = (e / minor_over_major**2 - k) * (k - e)
    return float((4 / (np.pi * e2) * minor_over_major**1.5 * np.sqrt(product)) ** (1 / 3))
