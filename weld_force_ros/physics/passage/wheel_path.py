"""From a weld profile to what the wheel's centre does over it.

The profile is joined to the rail where its ends do not lie at zero, and resampled; the wheel's centre
follows the upper envelope of wheel circles resting on the profile,

    r(x) = max_s [ z(x + s) - (R - sqrt(R^2 - s^2)) ],   z and r positive up,

a grey dilation of the profile by the wheel's circle (paper, section 2.3 after Wu & Thompson 2002). Where the profile
is sharper than the wheel, the wheel bridges it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import grey_dilation

from weld_force_ros.physics.arrays import FloatArray

RESAMPLED_STEP_M = 0.25e-3
JOIN_LENGTH_M = 0.5


@dataclass(frozen=True)
class WheelPath:
    """Height of the wheel's centre over its height on smooth rail, m, positive up; zero outside the samples.

    Attributes:
        start_m: first sample's distance from the weld's centre.
        height_m: (n,), `RESAMPLED_STEP_M` apart; zero at both ends.
        conditioning: what was done to the profile, in words.
    """

    start_m: float
    height_m: FloatArray
    conditioning: tuple[str, ...] = ()

    @property
    def end_m(self) -> float:
        """Return the last sample's distance from the weld's centre."""
        return self.start_m + RESAMPLED_STEP_M * (len(self.height_m) - 1)

    @cached_property
    def nonzero_extent_m(self) -> tuple[float, float]:
        """Return where the height begins and ends to differ from zero; the first sample twice if nowhere."""
        uneven = np.flatnonzero(self.height_m)
        first, last = (uneven[0] - 1, uneven[-1] + 1) if len(uneven) else (0, 0)
        return self.start_m + RESAMPLED_STEP_M * max(first, 0), self.start_m + RESAMPLED_STEP_M * last

    def at(self, x_m: FloatArray) -> FloatArray:
        """Return the height at any distances from the weld's centre, shape of `x_m`: cubic spline, zero outside."""
        inside = (x_m > self.start_m) & (x_m < self.end_m)
        return np.where(inside, self.spline(np.clip(x_m, self.start_m, self.end_m)), 0.0)

    @cached_property
    def spline(self) -> CubicSpline:
        """Return the the height between the samples."""
        return CubicSpline(self.start_m + RESAMPLED_STEP_M * np.arange(len(self.height_m)), self.height_m)


def wheel_path_over(x_m: FloatArray, z_m: FloatArray, wheel_radius_m: float) -> WheelPath:
    """Return the wheel centre's path over a profile.

    Args:
        x_m: (n,), increasing, 0 at the weld's centre.
        z_m: (n,), positive up.
        wheel_radius_m: rolling radius.
    """
    x, z, join = joined(np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64))
    reach = _reach(float(np.ptp(z)), wheel_radius_m)
    first = np.floor((x[0] - reach) / RESAMPLED_STEP_M) - 2
    last = np.ceil((x[-1] + reach) / RESAMPLED_STEP_M) + 2
    grid = np.arange(first, last + 1) * RESAMPLED_STEP_M
    # Shape-preserving cubic: no overshoot between samples, so no peak that was not measured.
    inside = (grid >= x[0]) & (grid <= x[-1])
    surface = np.where(inside, PchipInterpolator(x, z)(np.clip(grid, x[0], x[-1])), 0.0)
    notes = (*join, f"resampled to {RESAMPLED_STEP_M * 1e3:g} mm by shape-preserving cubics",
             f"rolled over by a wheel of radius {wheel_radius_m:g} m")  # fmt: skip
    return WheelPath(float(grid[0]), dilated_by_wheel(surface, RESAMPLED_STEP_M, wheel_radius_m), notes)


def dilated_by_wheel(surface_m: FloatArray, step_m: float, wheel_radius_m: float) -> FloatArray:
    """Return the dilation of equidistant heights by the wheel's circle, same shape."""
    half = int(np.ceil(_reach(float(np.ptp(surface_m)), wheel_radius_m) / step_m))
    if half == 0:
        return np.array(surface_m)
    s = step_m * np.arange(-half, half + 1)
    circle = np.sqrt(wheel_radius_m**2 - s**2) - wheel_radius_m
    dilated: FloatArray = grey_dilation(surface_m, footprint=np.ones(len(s)), structure=circle, mode="nearest")
    return dilated


def _reach(height_m: float, wheel_radius_m: float) -> float:
    """Return how far ahead of its lowest point a wheel can touch something `height_m` high."""
    height = min(height_m, 0.5 * wheel_radius_m)
    return float(np.sqrt(2 * wheel_radius_m * height - height**2))


def joined(x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return the profile with half-cosine ramps to zero wherever an end does not lie there."""
    ramp = np.linspace(0.0, 1.0, 101)[1:]
    ease = 0.5 * (1 + np.cos(np.pi * ramp))
    notes: tuple[str, ...] = ()
    if z_m[0] != 0.0:
        x_m, z_m = np.append(x_m[0] - JOIN_LENGTH_M * ramp[::-1], x_m), np.append(z_m[0] * ease[::-1], z_m)
        notes += (f"joined to the rail over {JOIN_LENGTH_M:g} m before its first sample",)
    if z_m[-1] != 0.0:
        x_m, z_m = np.append(x_m, x_m[-1] + JOIN_LENGTH_M * ramp), np.append(z_m, z_m[-1] * ease)
        notes += (f"joined to the rail over {JOIN_LENGTH_M:g} m after its last sample",)
    return x_m, z_m, notes
