"""Draw the geometries that a weld's measurement allows: the posterior of the estimate that a profile carries.

The instrument's own form error, which no estimate takes out, is drawn beside it: a Gaussian process along the rail.
"""

import numpy as np
from msgspec import UnsetType

from weld_force_ros.messages import FormError, WeldProfile, known
from weld_force_ros.physics.analysis import adaptive_spline
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.cubics import spline

_DRAWN = 32  # for a standard deviation
_KNOTS_PER_LENGTH = 5  # of a form error, with a cubic between them
_FORM_STREAM = 1  # of the seed: the noise's own draws stay what they are


def sampled_geometries(profile: WeldProfile, samples: int, seed: int) -> FloatArray | None:
    """Return geometries that the measurement allows, all equally likely, (samples, n) at the profile's positions.

    Each is levelled between its ends like the estimate. None: how the profile was measured is not known.

    Args:
        profile: of the weld.
        samples: how many.
        seed: of the drawing.
    """
    if isinstance(profile.noise, UnsetType):
        return None
    x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
    posterior, error = _posterior(profile, samples, seed), known(profile.noise.form_error)
    if posterior is None and error is None:
        return np.tile(z_m, (samples, 1))
    if posterior is None:
        drawn = np.tile(z_m, (samples, 1))
    else:
        drawn = np.array([np.interp(x_m, posterior.x_m, one) for one in posterior.samples_m])
    if error is not None:
        drawn = drawn + _form_errors(x_m, error, samples, seed)
    ends = drawn[:, [0, -1]]
    share = (x_m - x_m[0]) / (x_m[-1] - x_m[0])
    offset = np.array([[z_m[0], z_m[-1]]]) - ends
    return np.asarray(drawn + offset[:, :1] * (1 - share) + offset[:, 1:] * share)


def _form_errors(x_m: FloatArray, error: FormError, samples: int, seed: int) -> FloatArray:
    """Return form errors, (samples, n): correlated by exp(-(d/length)^2) over a distance d along the rail."""
    count = int(np.ceil((x_m[-1] - x_m[0]) / error.length_m * _KNOTS_PER_LENGTH)) + 4
    knots = np.linspace(x_m[0], x_m[-1], count)
    correlation = np.exp(-(((knots[:, None] - knots) / error.length_m) ** 2))
    values, vectors = np.linalg.eigh(correlation)
    white = np.random.default_rng([seed, _FORM_STREAM]).standard_normal((samples, count))
    at_knots = error.deviation_m * (white * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(spline(knots, at_knots.T)(x_m).T)


def standard_deviation(profile: WeldProfile) -> FloatArray | None:
    """Return the standard deviation of an estimated geometry at the profile's positions, m; None of an exact one.

    Of geometries that are levelled between their ends, as the estimate is: it is zero there.
    """
    if isinstance(profile.measured_x_m, UnsetType):
        return None
    drawn = sampled_geometries(profile, _DRAWN, 1)
    return None if drawn is None else np.asarray(np.sqrt(np.mean((drawn - np.array(profile.z_m)) ** 2, axis=0)))


def _posterior(profile: WeldProfile, samples: int, seed: int) -> adaptive_spline.Estimate | None:
    measured, noise = known(profile.measured_x_m), known(profile.noise)
    if measured is None or noise is None or noise.noise_m == 0.0:
        return None
    x_m, z_m = np.array(measured), np.array(known(profile.measured_z_m))
    return adaptive_spline.estimate(
        x_m,
        z_m,
        resolution_m=known(noise.resolution_m) or 0.0,
        noise_m=noise.noise_m if noise.stated else None,
        set_aside=np.flatnonzero(np.isin(x_m, noise.outliers_m)).tolist(),
        samples=samples,
        seed=seed,
    )
