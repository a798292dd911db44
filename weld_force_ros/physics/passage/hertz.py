"""Hertz' contact of wheel and rail, from their radii of curvature (Johnson, Contact Mechanics, 1985, section 4.2).

The ratio of the ellipse's half axes follows from the ratio of the curvatures, their size from the load. The approach
goes with the load to the power of 2/3, which makes the constant of F = C approach^1.5 one of the radii alone.
"""

from dataclasses import dataclass

import numpy as np

RAIL_CROWN_RADIUS_M = 0.3
"""Transverse radius of a rail head's middle, new 60E1; the half length changes by 10 % between 0.2 and 0.5 m."""
CROWN_RADII_M = (0.05, 2.0)
"""What the transverse radius of a rail head can be, worn ones included."""
_LEAST_RELATIVE_CURVATURE = 0.02
_MODULUS_PA = 210e9 / (2 * (1 - 0.3**2))  # E* of steel on steel


@dataclass(frozen=True)
class ContactRadii:
    """Radii of curvature of a wheel on a rail that is straight along.

    Attributes:
        wheel_m: rolling radius.
        crown_m: transverse radius of the rail head.
        wheel_transverse_m: of the wheel's tread; infinite: it is straight across; negative: hollow.
    """

    wheel_m: float
    crown_m: float = RAIL_CROWN_RADIUS_M
    wheel_transverse_m: float = np.inf

    @property
    def touch_in_a_point(self) -> bool:
        """Return whether the contact is an ellipse: not where the tread is as hollow as the crown is round."""
        return self.wheel_transverse_m != 0.0 and self.across_per_m > _LEAST_RELATIVE_CURVATURE / self.crown_m

    @property
    def along_per_m(self) -> float:
        """Return the sum of curvatures along the rail."""
        return 1 / self.wheel_m

    @property
    def across_per_m(self) -> float:
        """Return the sum of curvatures across the rail."""
        return 1 / self.crown_m + 1 / self.wheel_transverse_m

    @property
    def hertz_n_per_m15(self) -> float:
        """Return the Hertz constant C of F = C approach^1.5: Johnson's (4.26c) with p0 = 3 F / (2 pi a b)."""
        major_m = self._half_axes_m(1.0)[0]
        approach_m = 3 * _elliptic_integrals(self._minor_over_major())[0] / (2 * np.pi * major_m * _MODULUS_PA)
        return float(approach_m**-1.5)

    def half_length_m(self, load_n: float) -> float:
        """Return the half length along the rail of the contact ellipse under a load."""
        major_m, minor_m = self._half_axes_m(load_n)
        return float(major_m if self.along_per_m < self.across_per_m else minor_m)

    def _half_axes_m(self, load_n: float) -> tuple[float, float]:
        # Johnson (4.26): with c^2 = a b, c^3 = (3 P Re / 4 E*) F1^3 and F1^3 = (4 / pi e^2) (b/a)^1.5 sqrt(...).
        ratio = self._minor_over_major()
        effective_radius = 1 / np.sqrt(self.along_per_m * self.across_per_m)
        shape = 1.0 if ratio == 1.0 else _ellipse_factor(ratio)
        mean_half_axis = (0.75 * load_n * effective_radius / _MODULUS_PA) ** (1 / 3) * shape
        return mean_half_axis / np.sqrt(ratio), mean_half_axis * np.sqrt(ratio)

    def _minor_over_major(self) -> float:
        flatter, sharper = sorted((self.along_per_m, self.across_per_m))
        if sharper <= flatter * (1 + 1e-9):
            return 1.0
        least, most = 1e-3, 1.0  # of which it halves the range: a root search of SciPy's costs more to import
        while least < (ratio := (least + most) / 2) < most:
            if _curvature_ratio(ratio) > sharper / flatter:
                least = ratio
            else:
                most = ratio
        return ratio


def _curvature_ratio(minor_over_major: float) -> float:
    k, e = _elliptic_integrals(minor_over_major)
    return (e / minor_over_major**2 - k) / (k - e)


def _ellipse_factor(minor_over_major: float) -> float:
    """Return F1 of Johnson's (4.26): how much larger the mean half axis is than that of a circle of contact."""
    e2 = 1 - minor_over_major**2
    k, e = _elliptic_integrals(minor_over_major)
    product = (e / minor_over_major**2 - k) * (k - e)
    return float((4 / (np.pi * e2) * minor_over_major**1.5 * np.sqrt(product)) ** (1 / 3))


def _elliptic_integrals(minor_over_major: float) -> tuple[float, float]:
    """Return the complete integrals K and E of an ellipse: by Gauss' means, as SciPy's cost more to import.

    K = pi / (2 M(1, b)) and E = K (1 - sum of 2^(n-1) c_n^2) of the means a_n, b_n, c_n (Abramowitz & Stegun, 17.6).
    """
    a, b = 1.0, minor_over_major
    share, missing = 0.5, 0.5 * (1 - minor_over_major**2)
    while a - b > 1e-8 * a:  # each step squares it
        a, b, c = (a + b) / 2, float(np.sqrt(a * b)), (a - b) / 2
        share *= 2
        missing += share * c**2
    a = (a + b) / 2
    k = float(np.pi / (2 * a))
    return k, float(k * (1 - missing))
