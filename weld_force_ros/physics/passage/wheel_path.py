"""From a weld profile to what the wheel's centre does over it.

The profile is joined to the rail where its ends do not lie at zero, and resampled; the wheel's centre
follows the upper envelope of wheel circles resting on the profile,

    r(x) = max_s [ z(x + s) - (R - sqrt(R^2 - s^2)) ],   z and r positive up,

a grey dilation of the profile by the wheel's circle (paper, section 2.3 after Wu & Thompson 2002). Where the profile
is sharper than the wheel, the wheel bridges it. A wheel of radius 0 follows the profile as it stands.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # loads its slow parts, such as ndimage, where they are first used
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.cubics import PiecewiseCubic, monotone_cubics, spline
from weld_force_ros.physics.passage import _sampled_path

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

    @cached_property
    def mirrored(self) -> "WheelPath":
        """Return the path as it is met in the opposite direction."""
        return WheelPath(-self.end_m, self.height_m[::-1].copy(), self.conditioning)

    def at(self, x_m: FloatArray) -> FloatArray:
        """Return the height at any distances from the weld's centre, shape of `x_m`: cubic spline, zero outside."""
        inside = (x_m > self.start_m) & (x_m < self.end_m)
        return np.where(inside, self.cubics(np.clip(x_m, self.start_m, self.end_m)), 0.0)

    @cached_property
    def cubics(self) -> PiecewiseCubic:
        """Return the height between the samples."""
        return spline(self.start_m + RESAMPLED_STEP_M * np.arange(len(self.height_m)), self.height_m)


def wheel_path_over(
    x_m: FloatArray, z_m: FloatArray, wheel_radius_m: float, patch_half_length_m: float = 0.0
) -> WheelPath:
    """Return the wheel centre's path over a profile.

    Args:
        x_m: (n,), increasing, 0 at the weld's centre.
        z_m: (n,), positive up.
        wheel_radius_m: rolling radius; 0: no circle rolls.
        patch_half_length_m: of the contact patch, over which the heights are averaged; 0: the contact is a point.
    """
    x, z, join = joined(np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64))
    reach = _reach(float(np.ptp(z)), wheel_radius_m)
    reach += patch_half_length_m
    grid = _grid(x, reach)
    surface = _resampled(x, z, grid)
    notes = (*join, f"resampled to {RESAMPLED_STEP_M * 1e3:g} mm by shape-preserving cubics")
    if patch_half_length_m > 0.0:
        surface = averaged_over_patch(surface, RESAMPLED_STEP_M, patch_half_length_m)
        notes += (f"averaged over a contact patch {2e3 * patch_half_length_m:.3g} mm long",)
    rolled = f"rolled over by a wheel of radius {wheel_radius_m:g} m" if wheel_radius_m else "followed as it stands"
    notes += (rolled,)
    return WheelPath(float(grid[0]), dilated_by_wheel(surface, RESAMPLED_STEP_M, wheel_radius_m), notes)


def underside(x_m: FloatArray, z_m: FloatArray, wheel_radius_m: float) -> FloatArray:
    """Return how deep a wheel that rolls over a profile reaches at its samples, (n,): above the rail where it bridges.

    The closing of the profile by the wheel's circle; what lies below it no wheel of that radius sees.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up.
        wheel_radius_m: rolling radius; 0: no circle rolls, and nothing is bridged.
    """
    x, z, _ = joined(x_m, z_m)
    reach = _reach(float(np.ptp(z)), wheel_radius_m)
    grid = _grid(x, reach)
    surface = _resampled(x, z, grid)
    circle = _circle(reach, RESAMPLED_STEP_M, wheel_radius_m)
    path = dilated_by_wheel(surface, RESAMPLED_STEP_M, wheel_radius_m)
    deepest = scipy.ndimage.grey_erosion(path, footprint=np.ones(len(circle)), structure=circle, mode="nearest")
    return np.asarray(z_m + np.maximum(0.0, np.interp(x_m, grid, deepest - surface)))


class WheelPathRoller:
    """Rolls wheels over samples of one profile, as `wheel_path_over` does; compiled, in a tenth of its time.

    Args:
        x_m: (n,), increasing, 0 at the weld's centre; of all samples.
        z_m: (n_sample, n), positive up.
        wheel_radius_m: (n_sample,).
        patch_half_length_m: of the contact patch, as `wheel_path_over` takes it.
    """

    def __init__(
        self, x_m: FloatArray, z_m: FloatArray, wheel_radius_m: FloatArray, patch_half_length_m: float = 0.0
    ) -> None:
        # An end that lies at zero in every sample needs no ramp; in the others a ramp from zero is level.
        ends = np.abs(z_m[:, [0, -1]]).max(axis=0)
        self._x_m = joined(x_m, np.concatenate([ends[:1], np.zeros(len(x_m) - 2), ends[1:]]))[0]
        self._z_m = np.hstack([z_m[:, :1] * _ease()[::-1] * (ends[0] > 0), z_m, z_m[:, -1:] * _ease() * (ends[1] > 0)])
        self._z_m = self._z_m[:, (0 if ends[0] > 0 else 100) : (None if ends[1] > 0 else -100)]
        self._radii_m = wheel_radius_m
        self._patch_m = patch_half_length_m
        if patch_half_length_m > 0.0:
            weight = _patch_weight(RESAMPLED_STEP_M, patch_half_length_m)
            self._weight = weight[len(weight) // 2 :]
        self._reaches_m = [_reach(float(np.ptp(z)), radius) for z, radius in zip(self._z_m, self._radii_m, strict=True)]
        beyond = max(self._reaches_m) + patch_half_length_m
        self._grid_m = _grid(self._x_m, beyond)
        self.start_m = float(self._grid_m[0])

    def heights(self, samples: NDArray[np.intp]) -> FloatArray:
        """Return heights of the wheel's centre over some samples, (n, n_height), `RESAMPLED_STEP_M` from `start_m`."""
        paths = np.empty((len(samples), len(self._grid_m)))
        _sampled_path.resample_monotone(self._x_m, self._z_m[samples], self._grid_m, paths)
        for path, sample in zip(paths, samples.tolist(), strict=True):
            if self._patch_m > 0.0:
                _sampled_path.average(np.pad(path, len(self._weight) - 1), self._weight, path)
            radius = float(self._radii_m[sample])
            circle = _circle(self._reaches_m[sample], RESAMPLED_STEP_M, radius)
            half = len(circle) // 2
            _sampled_path.dilate(np.pad(path, half, mode="edge"), half, circle, radius, RESAMPLED_STEP_M, path)
        return paths


def averaged_over_patch(surface_m: FloatArray, step_m: float, half_length_m: float) -> FloatArray:
    """Return equidistant heights averaged over the contact patch, same shape.

    The weight is 1 - (s/a)^2 over the half length a: Hertz' pressure in an elliptic patch, summed across the rail.
    """
    return np.asarray(np.convolve(surface_m, _patch_weight(step_m, half_length_m), mode="same"))


def _patch_weight(step_m: float, half_length_m: float) -> FloatArray:
    half = int(np.floor(half_length_m / step_m))
    s = step_m * np.arange(-half, half + 1)
    weight = np.maximum(1 - (s / half_length_m) ** 2, 0.0)
    return np.asarray(weight / weight.sum())


def dilated_by_wheel(surface_m: FloatArray, step_m: float, wheel_radius_m: float) -> FloatArray:
    """Return the dilation of equidistant heights by the wheel's circle, same shape."""
    circle = _circle(_reach(float(np.ptp(surface_m)), wheel_radius_m), step_m, wheel_radius_m)
    if len(circle) == 1:
        return np.array(surface_m)
    padded, dilated = np.pad(surface_m, len(circle) // 2, mode="edge"), np.full(len(surface_m), -np.inf)
    for first, lift in enumerate(circle.tolist()):
        np.maximum(dilated, padded[first : first + len(dilated)] + lift, out=dilated)
    return dilated


def _circle(reach_m: float, step_m: float, wheel_radius_m: float) -> FloatArray:
    """Return heights of the wheel's underside, negative, about its lowest point."""
    half = int(np.ceil(reach_m / step_m))
    s = step_m * np.arange(-half, half + 1)
    return np.asarray(np.sqrt(wheel_radius_m**2 - s**2) - wheel_radius_m)


def _grid(x_m: FloatArray, reach_m: float) -> FloatArray:
    """Return whole steps that hold a profile and what a wheel reaches beyond it."""
    first = np.floor((x_m[0] - reach_m) / RESAMPLED_STEP_M) - 2
    last = np.ceil((x_m[-1] + reach_m) / RESAMPLED_STEP_M) + 2
    return np.asarray(np.arange(first, last + 1) * RESAMPLED_STEP_M)


def _resampled(x_m: FloatArray, z_m: FloatArray, grid_m: FloatArray) -> FloatArray:
    """Return a profile on a grid, zero outside, by shape-preserving cubics: no peak that was not measured."""
    inside = (grid_m >= x_m[0]) & (grid_m <= x_m[-1])
    return np.where(inside, monotone_cubics(x_m, z_m)(np.clip(grid_m, x_m[0], x_m[-1])), 0.0)


def _reach(height_m: float, wheel_radius_m: float) -> float:
    """Return how far ahead of its lowest point a wheel can touch something `height_m` high."""
    height = min(height_m, 0.5 * wheel_radius_m)
    return float(np.sqrt(2 * wheel_radius_m * height - height**2))


def joined(x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return the profile with half-cosine ramps to zero wherever an end does not lie there."""
    ramp, ease = _ramp(), _ease()
    notes: tuple[str, ...] = ()
    if z_m[0] != 0.0:
        x_m, z_m = np.append(x_m[0] - JOIN_LENGTH_M * ramp[::-1], x_m), np.append(z_m[0] * ease[::-1], z_m)
        notes += (f"joined to the rail over {JOIN_LENGTH_M:g} m before its first sample",)
    if z_m[-1] != 0.0:
        x_m, z_m = np.append(x_m, x_m[-1] + JOIN_LENGTH_M * ramp), np.append(z_m, z_m[-1] * ease)
        notes += (f"joined to the rail over {JOIN_LENGTH_M:g} m after its last sample",)
    return x_m, z_m, notes


def _ramp() -> FloatArray:
    return np.linspace(0.0, 1.0, 101)[1:]


def _ease() -> FloatArray:
    return np.asarray(0.5 * (1 + np.cos(np.pi * _ramp())))
