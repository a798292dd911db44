"""Find where the weld lies in a record that does not say so."""

import numpy as np

from weld_force_ros.physics.arrays import FloatArray

_NEAR_MIDDLE_M = 0.02  # not told from the middle
_NEAR_ZERO_M = 0.25  # of the instrument's zero, which is laid on the weld


def chosen_centre(x_m: FloatArray, z_m: FloatArray) -> tuple[float, str]:
    """Return the weld's centre and by what it was chosen.

    A record on both sides of zero has its own zero, on which the instrument was set; it is the centre if the defect
    lies within 0.25 m of it. Any other is centred on the defect: the mean place of its slopes, weighted by their
    squares, which a step in level does not draw to an end. One within 20 mm of the record's middle is taken for the
    middle.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), levelled between the ends.
    """
    first, last = float(x_m[0]), float(x_m[-1])
    middle = (first + last) / 2
    slope = np.gradient(z_m, x_m)
    weight = slope**2 * (slope**2 > 0.05 * float(np.max(slope**2)))
    defect = float(np.average(x_m, weights=weight)) if weight.any() else None
    has_zero = first < -0.2 * (last - first) and last > 0.2 * (last - first)
    if has_zero and (defect is None or abs(defect) <= _NEAR_ZERO_M):
        return 0.0, "the record's own zero"
    if defect is None or abs(defect - middle) <= _NEAR_MIDDLE_M:
        return middle, "the middle of the range"
    return round(defect, 3), "the defect, as no centre is stated"


def levelled(x_m: FloatArray, z_m: FloatArray) -> FloatArray:
    """Return heights (n,) less the line between the two ends."""
    return np.asarray(z_m - np.interp(x_m, x_m[[0, -1]], z_m[[0, -1]]))
