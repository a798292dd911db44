"""What is not known of a weld's passage, drawn at random from a seed, and what a result varies with.

Support and contact stiffness are drawn from a few levels of equal probability that have the mean and variance of the
normal distribution of their logarithm: tables of a wheel on a track are made once a level and serve many samples.
Levels and radii are spread evenly over the samples (Latin hypercube; McKay, Beckman & Conover, Technometrics 21, 1979).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.stats import norm

from weld_force_ros.messages import Spread, Uncertainty
from weld_force_ros.physics.arrays import FloatArray

SUPPORT_LEVELS = 3
HERTZ_LEVELS = 5

PLACE, SUPPORT, CONTACT, RADIUS = "place in the sleeper span", "support stiffness", "contact stiffness", "wheel radius"
REST = "measurement noise"
_GROUPS = 8  # of a continuous quantity, whose means are compared
_PER_LENGTH = 5  # grid points of noise


@dataclass(frozen=True)
class Draws:
    """Samples, each (n,): factors on nominal values, the wheel's radius, and a seed of each sample's noise."""

    support_factor: FloatArray
    hertz_factor: FloatArray
    wheel_radius_m: FloatArray
    noise_seed: NDArray[np.int64]


def draw(unknown: Uncertainty) -> Draws:
    """The samples of an uncertainty; the same for every weld, so that welds compare."""
    generator = np.random.default_rng(unknown.seed)
    count = unknown.samples

    def evenly() -> FloatArray:
        """Once in each n-th of 0 to 1, in random order."""
        return np.asarray((generator.permutation(count) + generator.random(count)) / count)

    def levels(deviation: float, level_count: int) -> FloatArray:
        return np.asarray(np.exp(deviation * _standard_levels(level_count)[(evenly() * level_count).astype(np.int64)]))

    return Draws(
        levels(unknown.support_spread, SUPPORT_LEVELS),
        levels(unknown.hertz_spread, HERTZ_LEVELS),
        unknown.radius_low_m + (unknown.radius_high_m - unknown.radius_low_m) * evenly(),
        generator.integers(2**62, size=count),
    )


def noisy(x_m: FloatArray, z_m: FloatArray, unknown: Uncertainty, seed: int) -> FloatArray:
    """Heights as they might have been, (n,): noise correlated along the rail, zero at both ends as after levelling.

    Args:
        x_m: (n,), increasing.
        z_m: (n,).
        unknown: whose `noise_m` and `noise_length_m` count.
        seed: of this sample.
    """
    step = unknown.noise_length_m / _PER_LENGTH
    count = int(np.ceil((x_m[-1] - x_m[0]) / step)) + 1
    white = np.random.default_rng(seed).standard_normal(count + 8 * _PER_LENGTH)
    # The correlation of smoothed white noise falls to 1/e over twice the smoothing's deviation.
    deviation = _PER_LENGTH / 2
    smooth = gaussian_filter1d(white, deviation)[4 * _PER_LENGTH : -4 * _PER_LENGTH]
    unit = smooth * np.sqrt(2 * deviation * np.sqrt(np.pi))
    noise = unknown.noise_m * np.interp(x_m, x_m[0] + step * np.arange(count), unit)
    level = np.interp(x_m, x_m[[0, -1]], noise[[0, -1]])
    return np.asarray(z_m + noise - level)


def influences(values: FloatArray, spread: Spread) -> Mapping[str, float]:
    """Share of a value's variance that goes with each unknown quantity by itself; the rest is noise and interplay.

    Correlation ratios (Pearson 1905), corrected for what chance alone would explain (Kelley, Proc. Natl. Acad. Sci. 21,
    1935).

    Args:
        values: (n_sample, n_position), or (n_sample, 1).
        spread: the samples' inputs.

    Returns:
        Nothing if the value does not vary.
    """
    total = float(np.var(values))
    if total <= (1e-9 * float(np.abs(values).max(initial=0.0))) ** 2:
        return {}
    of_samples = values.mean(axis=1)
    shares = {
        PLACE: float(np.var(values.mean(axis=0))) / total,
        **{
            name: _explained(of_samples, np.array(inputs)) / total
            for name, inputs in (
                (SUPPORT, spread.support_factor),
                (CONTACT, spread.hertz_factor),
                (RADIUS, spread.wheel_radius_m),
            )
        },
    }
    return {**shares, REST: max(0.0, 1.0 - sum(shares.values()))}


def _explained(values: FloatArray, factor: FloatArray) -> float:
    """Variance of values (n,) that goes with a factor (n,)."""
    levels = np.unique(factor)
    if len(levels) > _GROUPS:
        levels = np.quantile(factor, np.arange(_GROUPS) / _GROUPS)
    group = np.searchsorted(levels, factor, side="right") - 1
    count = np.bincount(group, minlength=len(levels))
    means = np.bincount(group, values, minlength=len(levels)) / np.maximum(count, 1)
    within = float(np.mean((values - means[group]) ** 2))
    free = len(values) - int(np.count_nonzero(count))
    if free <= 0:
        return 0.0
    total = float(np.var(values))
    return max(0.0, total - within * (len(values) - 1) / free)


def _standard_levels(count: int) -> FloatArray:
    """Levels of equal probability with mean 0 and variance 1, as the normal distribution's middles lie."""
    if count == 1:
        return np.zeros(1)
    middles = norm.ppf((np.arange(count) + 0.5) / count)
    return np.asarray(middles / np.sqrt(np.mean(middles**2)))
