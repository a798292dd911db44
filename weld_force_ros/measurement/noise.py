"""Estimate a weld's geometry from what an instrument wrote: wrong samples set aside, noise and rounding taken out."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from weld_force_ros.errors import ProfileError
from weld_force_ros.physics.analysis import adaptive_spline
from weld_force_ros.physics.arrays import FloatArray

METHOD = "adaptive spline"
MOST_WRONG = 0.05
"""Share of samples that may be set aside: of a record with more, nobody knows which are right."""
LARGEST_NOISE_M = 100e-6
"""Beyond it the heights are not those of a rail (judgement); those in whole tenths of a millimetre scatter by 29 um."""
_NAMED = 5


@dataclass(frozen=True)
class Estimate:
    """A weld's geometry as estimated from noisy samples.

    Attributes:
        x_m: (n,), every millimetre or closer, from the first sample to the last.
        z_m: (n,), heights.
        noise_m: standard deviation of the noise, rounding included.
        outliers_m: positions of the samples that were set aside.
        notes: what was done, a line each.
    """

    x_m: FloatArray
    z_m: FloatArray
    noise_m: float
    outliers_m: FloatArray
    notes: list[str] = field(default_factory=list)


def estimate(x_m: FloatArray, z_m: FloatArray, *, resolution_m: float = 0.0, noise_m: float | None = None) -> Estimate:
    """Estimate the geometry of a weld and the noise of its measurement.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up.
        resolution_m: step in which the heights were written; 0: none.
        noise_m: standard deviation of the noise where it is known.

    Raises:
        ProfileError: too many samples are wrong.
    """
    found = adaptive_spline.estimate(x_m, z_m, resolution_m=resolution_m, noise_m=noise_m)
    wrong = list(found.set_aside)
    if noise_m is None and found.noise_m > LARGEST_NOISE_M:
        raise ProfileError(
            f"heights scatter by {found.noise_m * 1e6:.0f} um about any rail",
            "measure again, check z_unit and which column is z, or state the noise",
        )
    if len(wrong) > max(3, MOST_WRONG * len(x_m)):
        raise ProfileError(
            f"{len(wrong)} of {len(x_m)} heights fit no rail", "measure again, or check which column is z"
        )
    how = "as stated" if noise_m is not None else "estimated"
    notes = [f"measurement noise of {found.noise_m * 1e6:.2g} um ({how}) taken out by an adaptive spline"]
    if wrong:
        notes.insert(0, _set_aside(x_m, z_m, found, wrong))
    return Estimate(found.x_m, found.geometry_m, found.noise_m, x_m[wrong], notes)


def _set_aside(x_m: FloatArray, z_m: FloatArray, found: adaptive_spline.Estimate, wrong: Sequence[int]) -> str:
    off_um = (z_m - np.interp(x_m, found.x_m, found.geometry_m)) * 1e6
    named = [f"{off_um[i]:+.3g} um at x = {x_m[i] * 1e3:.5g} mm from the record's begin" for i in wrong[:_NAMED]]
    more = f" and {len(wrong) - _NAMED} more" if len(wrong) > _NAMED else ""
    return f"{len(wrong)} wrong sample{'s' * (len(wrong) > 1)} set aside: {', '.join(named)}{more}"
