"""Attribute the spread of a value over samples to the uncertain quantities."""

from collections.abc import Mapping

import numpy as np

from weld_force_ros.messages import UncertaintyResult, known
from weld_force_ros.physics.arrays import FloatArray

PLACE, REST = "position in the sleeper span", "measurement noise"
HANGING, SLEEPERS = "hanging sleepers", "stiffness from sleeper to sleeper"
SUPPORT, CONTACT, RADIUS = "support stiffness", "contact stiffness", "wheel radius"
WIDENED = 1.2
_GROUPS = 8  # of a continuous quantity, whose means are compared


def interval(values: FloatArray) -> tuple[float, float]:
    """Return 5 and 95 % of a value, the worst over positions, over samples of what is uncertain.

    Few samples, and a posterior that is too sure of short features, make quantiles too narrow: the distances from the
    median are multiplied by `WIDENED`, with which 90 % intervals of measured welds hold what they say
    (`python -m benchmarks.noise`).

    Args:
        values: (n_sample, n_position), or (n_sample, 1).
    """
    low, middle, high = np.quantile(values.max(axis=1), [0.05, 0.5, 0.95])
    return float(middle - WIDENED * (middle - low)), float(middle + WIDENED * (high - middle))


def influences(values: FloatArray, spread: UncertaintyResult) -> Mapping[str, float]:
    """Return the share of a value's variance that each uncertain quantity explains by itself; the rest is noise.

    Correlation ratios (Pearson 1905), corrected for what chance alone would explain (Kelley, Proc. Natl. Acad. Sci. 21,
    1935).

    Args:
        values: (n_sample, n_position), or (n_sample, 1).
        spread: the samples' inputs.

    Returns:
        Shares by quantity; empty if the value does not vary.
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
                (HANGING, known(spread.hanging)),
                (SLEEPERS, known(spread.sleeper_effect)),
            )
            if inputs is not None
        },
    }
    return {**shares, REST: max(0.0, 1.0 - sum(shares.values()))}


def _explained(values: FloatArray, factor: FloatArray) -> float:
    """Return the variance of values (n,) that a factor (n,) explains."""
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
