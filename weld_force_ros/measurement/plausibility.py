"""Refuse a measured geometry that no rail weld can have: another unit, another column, a probe that did not move.

The bounds are of measured records. A computed shape, which states `noise: none`, is not held to them.
"""

import numpy as np

from weld_force_ros.errors import ProfileError
from weld_force_ros.physics.arrays import FloatArray

LEAST_AMPLITUDE_M = 2e-6
"""Heights of a metre of rail span more, even of a well ground one (judgement, no standard)."""
LEAST_LENGTH_M = 0.25
"""A weld and its heat-affected rail."""
STEEPEST_LINE = 0.02
"""Slope of the line that is taken off: an instrument lies on the rail, so its line does not climb 20 mm in a metre."""
STEEPEST_STEP = 0.15
"""Slope between samples: a wheel of 0.46 m radius touches no steeper flank of anything under 5 mm high."""
CLEAR_SLOPE, CLEAR_HEIGHT_M = 2e-3, 5e-5
"""A weld of less is not told from what noise leaves: where it lies in the record cannot be said."""
LEAST_BESIDE_M = 0.12
"""Rail on either side of a weld: a dip of 300 mm is whole with 150 mm."""


def check_measured(x_m: FloatArray, z_m: FloatArray, *, x_unit: str, z_unit: str) -> None:
    """Refuse heights that are not those of a weld, before anything is taken off or smoothed.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up.
        x_unit: that was stated, for the message.
        z_unit: that was stated, for the message.

    Raises:
        ProfileError: says what no rail can have, and what to check.
    """
    length = float(x_m[-1] - x_m[0])
    if length < LEAST_LENGTH_M:
        raise ProfileError(
            f"the record is {length * 1e3:.3g} mm long, a weld and its rail take {LEAST_LENGTH_M * 1e3:g} mm",
            f"check x_unit (stated: {x_unit}); a computed shape states `noise: none`",
        )
    if np.ptp(z_m) == 0.0:
        raise ProfileError("all heights are equal", "check that the probe moved, and which column is z")
    robust = float(np.median(np.diff(z_m)) / np.median(np.diff(x_m)))
    slope = float((np.median(z_m[-5:]) - np.median(z_m[:5])) / (x_m[-3] - x_m[2]))
    if min(abs(slope), max(abs(robust), 0.5 * abs(slope))) > STEEPEST_LINE:
        raise ProfileError(
            f"heights climb {abs(slope) * 1e3:.3g} mm in a metre, no straightedge lies like that",
            f"check z_unit (stated: {z_unit}) and which column is z",
        )
    level = z_m - (z_m[0] + slope * (x_m - x_m[0]))
    if np.ptp(level) < LEAST_AMPLITUDE_M:
        raise ProfileError(
            f"heights span {np.ptp(level) * 1e6:.2g} um, no rail is so even",
            f"check z_unit (stated: {z_unit}); heights are probably in another unit",
        )


def check_estimate(x_m: FloatArray, z_m: FloatArray, *, x_unit: str, z_unit: str) -> None:
    """Refuse an estimated geometry, levelled and without wrong samples, that no rail can have.

    Raises:
        ProfileError: it is too steep, or the record ends within the weld.
    """
    steps = np.abs(np.diff(z_m) / np.diff(x_m))
    if steps.max() > STEEPEST_STEP:
        at = int(steps.argmax())
        raise ProfileError(
            f"heights change by {abs(z_m[at + 1] - z_m[at]) * 1e3:.3g} mm over {(x_m[at + 1] - x_m[at]) * 1e3:.3g} mm "
            f"at x = {x_m[at]:.3f} m, steeper than a wheel can touch",
            f"check x_unit and z_unit (stated: {x_unit}, {z_unit}) and which column is z",
        )
    weight = np.gradient(z_m - np.median(np.gradient(z_m, x_m)) * x_m, x_m) ** 2
    place_m = float(np.average(x_m, weights=weight)) if weight.any() else float(np.mean(x_m))
    is_clear = steps.max() > CLEAR_SLOPE and np.ptp(z_m) > CLEAR_HEIGHT_M
    if is_clear and not x_m[0] + LEAST_BESIDE_M <= place_m <= x_m[-1] - LEAST_BESIDE_M:
        raise ProfileError(
            f"the record {'begins' if place_m < np.mean(x_m) else 'ends'} within the weld, or less than "
            f"{LEAST_BESIDE_M * 1e3:g} mm beside it",
            "measure on to level rail; perhaps the file is not complete",
        )
