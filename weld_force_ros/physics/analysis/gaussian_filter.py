"""Take short waves out of a profile by the Gaussian profile filter of ISO 16610-21."""

import numpy as np
import scipy  # loads ndimage where it is first used
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M

_DEVIATION = np.sqrt(np.log(2) / 2) / np.pi
"""Of the filter's weights, in wavelengths: waves of the cut-off length keep half their amplitude."""


def smoothed(x_m: ArrayLike, z_m: ArrayLike, wavelength_m: float) -> FloatArray:
    """Return heights without waves that are much shorter than a wavelength, (n,).

    The weights are ISO 16610-21's, without phase: a wave of the cut-off length keeps half its amplitude, one of half
    that length 6 %, of twice that length 84 %. Beyond its ends the rail goes on at their height.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), heights.
        wavelength_m: the cut-off length, positive.

    Raises:
        InputError: not such a length.
    """
    if not np.isfinite(wavelength_m) or wavelength_m <= 0:
        raise InputError(f"wavelength_m is {wavelength_m:g}", "give the length of the waves to keep, in metres")
    x, z = np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64)
    grid = np.linspace(x[0], x[-1], max(2, round((x[-1] - x[0]) / RESAMPLED_STEP_M) + 1))
    deviation = _DEVIATION * wavelength_m / (grid[1] - grid[0])
    filtered = scipy.ndimage.gaussian_filter1d(np.interp(grid, x, z), deviation, mode="nearest", truncate=6.0)
    return np.asarray(np.interp(x, grid, filtered))
