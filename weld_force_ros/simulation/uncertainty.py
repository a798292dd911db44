"""Draw what is uncertain about a weld's passage at random, from a seed.

Support and contact stiffness are drawn from a few levels of equal probability that have the mean and variance of the
normal distribution of their logarithm: tables of a wheel on a track are made once a level and serve many samples.
Levels and radii are spread evenly over the samples (Latin hypercube; McKay, Beckman & Conover, Technometrics 21, 1979).
"""

import warnings
from dataclasses import dataclass

import numpy as np
import scipy  # loads its slow parts, such as stats, where they are first used
from numpy.typing import NDArray

from weld_force_ros.messages import Uncertainty
from weld_force_ros.physics.arrays import FloatArray

SUPPORT_LEVELS = 3
HERTZ_LEVELS = 5

_PER_LENGTH = 5  # grid points of noise


@dataclass(frozen=True)
class Draws:
    """Samples, each (n,): factors on nominal values, the wheel's radius, and a seed of each sample's noise."""

    support_factor: FloatArray
    hertz_factor: FloatArray
    wheel_radius_m: FloatArray
    noise_seed: NDArray[np.int64]


def draw(unknown: Uncertainty) -> Draws:
    """Return the samples of an uncertainty: the same for every weld, so that welds compare."""
    if unknown.design == "quasi-random":
        return _quasi_random(unknown)
    generator = np.random.default_rng(unknown.seed)
    count = unknown.samples

    def evenly() -> FloatArray:
        """Return one number in each n-th of 0 to 1, in random order."""
        return np.asarray((generator.permutation(count) + generator.random(count)) / count)

    def levels(deviation: float, level_count: int) -> FloatArray:
        return np.asarray(np.exp(deviation * standard_levels(level_count)[(evenly() * level_count).astype(np.int64)]))

    return Draws(
        levels(unknown.support_spread, SUPPORT_LEVELS),
        levels(unknown.hertz_spread, HERTZ_LEVELS),
        unknown.radius_low_m + (unknown.radius_high_m - unknown.radius_low_m) * evenly(),
        generator.integers(2**62, size=count),
    )


def _quasi_random(unknown: Uncertainty) -> Draws:
    """Return samples that fill support, contact and radius evenly (Sobol', scrambled), each quantity by itself too.

    Ranks of a Sobol' sequence, so that of any number of samples one lies in each n-th of a quantity.
    """
    generator = np.random.default_rng(unknown.seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that the number of samples is no power of 2
        sequence = scipy.stats.qmc.Sobol(3, seed=generator).random(unknown.samples)
    evenly = (sequence.argsort(axis=0).argsort(axis=0) + 0.5) / unknown.samples
    return Draws(
        np.asarray(np.exp(unknown.support_spread * scipy.special.ndtri(evenly[:, 0]))),
        np.asarray(np.exp(unknown.hertz_spread * scipy.special.ndtri(evenly[:, 1]))),
        unknown.radius_low_m + (unknown.radius_high_m - unknown.radius_low_m) * evenly[:, 2],
        generator.integers(2**62, size=unknown.samples),
    )


def noisy(x_m: FloatArray, z_m: FloatArray, unknown: Uncertainty, seed: int) -> FloatArray:
    """Return heights with measurement noise, (n,): correlated along the rail, zero at both ends as after levelling.

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
    smooth = scipy.ndimage.gaussian_filter1d(white, deviation)[4 * _PER_LENGTH : -4 * _PER_LENGTH]
    unit = smooth * np.sqrt(2 * deviation * np.sqrt(np.pi))
    noise = unknown.noise_m * np.interp(x_m, x_m[0] + step * np.arange(count), unit)
    level = np.interp(x_m, x_m[[0, -1]], noise[[0, -1]])
    return np.asarray(z_m + noise - level)


def standard_levels(count: int) -> FloatArray:
    """Return levels of equal probability with mean 0 and variance 1: medians of parts of the normal distribution."""
    if count == 1:
        return np.zeros(1)
    middles = scipy.special.ndtri((np.arange(count) + 0.5) / count)
    return np.asarray(middles / np.sqrt(np.mean(middles**2)))
