"""Detect welds in a stretch of running surface: places that stand out of the roughness about them.

The heights are filtered by wavelets of several lengths, fourth derivatives of a Gaussian, that answer to dips and
protrusions from about `SHORTEST_M` to `LONGEST_M` long and to no slope or long curve. Each answer is measured in
standard deviations of the same wavelet's answers over the rail run before (by their median size, which a weld among
them hardly moves): whatever spectrum the roughness has is taken off. The largest over the wavelets is the score.

A score depends on the rail from a little over `RUNNING_M` before its place to `SETTLED_M` after it, on nothing farther
away: what is found in the rail that a stream keeps is what is found in the whole run. In the first `RUNNING_M` of what
is given, the level is that of these metres.
"""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import scipy  # loads its slow parts, such as signal, where they are first used
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import FloatArray

SHORTEST_M, LONGEST_M = 0.05, 0.6
THRESHOLD = 5.0
APART_M = 1.0
RUNNING_M = 20.0
LEAST_M = 3.0  # of rail to tell a level from

_GRID_M = 5e-3
_HOP_M = 0.5  # from one level to the next
_LENGTH_PER_SIGMA = 4.0  # of the cosine dip that a wavelet shows best (3.8) over roughness of the ISO 3095 slope
_SIGMAS_M = np.geomspace(SHORTEST_M, LONGEST_M, 8) / _LENGTH_PER_SIGMA
_FOURTH_DIFFERENCE = (1.0, -4.0, 6.0, -4.0, 1.0)  # exactly zero for cubics, as a sampled derivative is not
_TRUNCATED = 5.0  # standard deviations of the Gaussian
SETTLED_M = APART_M + _TRUNCATED * float(_SIGMAS_M[-1]) + 3 * _GRID_M
_LEAST_LEVEL_M = 1e-7  # of a rail made by hand without roughness; under what instruments resolve
_MEDIAN_SIZE = NormalDist().inv_cdf(0.75)  # of a normal variable, in standard deviations


@dataclass(frozen=True)
class DetectedWeld:
    """A weld detected in the rail.

    Attributes:
        centre_m: where it stands out, in the stretch's own chainage.
        score: by how many standard deviations of the roughness.
    """

    centre_m: float
    score: float


def detect(x_m: ArrayLike, z_m: ArrayLike) -> list[DetectedWeld]:
    """Return the welds in a stretch of rail, in order of their places, no two nearer than `APART_M`.

    In a stream, those within `SETTLED_M` of the stretch's end may still move. Short of `LEAST_M` nothing is found.

    Args:
        x_m: (n,) chainages, increasing by 5 mm at most.
        z_m: (n,) heights, positive up.

    Raises:
        InputError: samples that are not as stated.
    """
    x, z = _checked(x_m, z_m)
    if len(x) == 0 or x[-1] - x[0] < LEAST_M:
        return []
    # A grid that does not depend on where the stretch begins.
    grid = _GRID_M * np.arange(np.ceil(x[0] / _GRID_M - 1e-6), np.floor(x[-1] / _GRID_M + 1e-6) + 1)
    score = scores(grid, np.interp(grid, x, z))
    peaks, _ = scipy.signal.find_peaks(score, height=THRESHOLD, distance=round(APART_M / _GRID_M))
    return [DetectedWeld(_centre_m(grid, score, int(peak)), float(score[peak])) for peak in peaks]


def scores(grid_m: FloatArray, z_m: FloatArray) -> FloatArray:
    """Return by how many standard deviations each place of a grid stands out, (n,)."""
    standing_out: FloatArray = np.max([_standing_out(grid_m, z_m, float(sigma_m)) for sigma_m in _SIGMAS_M], axis=0)
    return standing_out


def _standing_out(grid_m: FloatArray, z_m: FloatArray, sigma_m: float) -> FloatArray:
    sigma = sigma_m / _GRID_M
    fourth = np.convolve(z_m, _FOURTH_DIFFERENCE, mode="same")
    answer = sigma**4 * np.abs(scipy.ndimage.gaussian_filter1d(fourth, sigma, truncate=_TRUNCATED))
    edge = int(np.ceil(_TRUNCATED * sigma)) + len(_FOURTH_DIFFERENCE) // 2
    answer[:edge] = answer[len(answer) - edge :] = 0.0  # what is not measured is not level
    standing_out: FloatArray = answer / _running_level(grid_m, answer, edge)
    return standing_out


def _running_level(grid_m: FloatArray, answer: FloatArray, edge: int) -> FloatArray:
    """Return the standard deviation of answers over the metres before each place, (n,), constant from hop to hop."""
    hop = np.floor(grid_m / _HOP_M + 1e-6).astype(np.int64)
    running = round(RUNNING_M / _GRID_M)
    levels = []
    for begin in np.flatnonzero(np.diff(hop, prepend=hop[0] - 1)).tolist():
        last = min(max(begin, running + edge), len(answer) - edge)
        levels.append(np.median(answer[max(last - running, edge) : last]) / _MEDIAN_SIZE)
    level: FloatArray = np.maximum(levels, _LEAST_LEVEL_M)[hop - hop[0]]
    return level


def _centre_m(grid_m: FloatArray, score: FloatArray, peak: int) -> float:
    """Return the middle of what stands out at least half as much as the peak, within half the least distance."""
    half = round(APART_M / 2 / _GRID_M)
    near = slice(max(peak - half, 0), peak + half + 1)
    weight = np.where(score[near] >= max(score[peak] / 2, THRESHOLD), score[near], 0.0)
    return float(np.average(grid_m[near], weights=weight))


def _checked(x_m: ArrayLike, z_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
    x, z = np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64)
    steps = np.diff(x) if x.ndim == 1 else np.array([np.nan])
    shaped = x.ndim == 1 and x.shape == z.shape and bool(np.all(np.isfinite(z)))
    if not (shaped and bool(np.all((steps > 0) & (steps <= _GRID_M + 1e-7)))):
        raise InputError(
            "the stretch is not of finite heights at chainages that increase by 5 mm at most",
            "take stretches without gaps, as the stream's are",
        )
    return x, z
