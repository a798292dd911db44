"""Estimate a weld's geometry and the noise of its measurement together, and draw geometries that the samples allow.

Measured heights are the geometry plus independent noise, z = f(x) + e, e ~ N(0, s^2 + q^2 / 12) with q the resolution
in which the file was written (a rounded value is off by q / sqrt(12) in the mean: Sheppard 1898; Widrow & Kollar,
"Quantization Noise", 2008).

The geometry is a cubic spline with equidistant coefficients (P-spline: Eilers & Marx, Statistical Science 11, 1996;
with independent second differences it is the smoothing spline of Wahba, Annals of Statistics 13, 1985, in the
stochastic form of Kohn & Ansley, SIAM J. Sci. Stat. Comput. 8, 1987). Its curvature is a first-order autoregressive
process: white over more than the length `ell`, smooth below. How strong it is varies along the rail, as a weld's
zone is rougher than the rail beside it: the logarithm of the level is linear between knots and a Gaussian process
of its own (adaptive smoothing: Ruppert & Carroll, Aust. N. Z. J. Stat. 42, 2000; Lang & Brezger, J. Comput. Graph.
Stat. 13, 2004; Krivobokova, Crainiceanu & Kauermann, J. Comput. Graph. Stat. 17, 2008). It saturates where the rail
would curve more than a wheel, which could not feel it.

With the level, ell and s given, the geometry is Gaussian with a precision of bandwidth 3; line and level have no
prior, so that the likelihood is the restricted one (REML). Its gradient needs the covariance within the band alone
(Takahashi, Fagan & Chen 1973; Erisman & Tinney, CACM 18, 1975). Level, ell and s are found at the largest posterior
density by BFGS, and drawn about there by Hamiltonian Monte Carlo in the coordinates of the Hessian (Duane et al.,
Phys. Lett. B 195, 1987; Neal 2011), so that what is drawn carries their uncertainty, too. All of it is O(samples).

Wrong samples are set aside where the rest predicts something else so surely that a blunder is likelier.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import scipy  # loads its slow parts, such as linalg, where they are first used
from numpy.typing import NDArray

from weld_force_ros.physics.analysis._adaptive_spline import (
    BURN,
    SKIP,
    climb,
    fill_gram,
    hamiltonian,
    hessian,
    log_density,
    propagate,
)
from weld_force_ros.physics.arrays import FloatArray

_Integers: TypeAlias = NDArray[np.int64]

# Units within: mm along the rail, um of height.
_MIN_STEP, _MAX_STEP = 2.5, 5.0  # of coefficients
_KNOT = 30.0  # of the level
_LEVEL_MEAN, _LEVEL_COMMON, _LEVEL_LOCAL, _LEVEL_LENGTH = -3.0, 3.0, 6.0, 60.0  # log of um^2 / mm^3
_NOISE_MEAN, _NOISE_SPREAD = np.log(8.0), 1.5  # log of um
_LENGTH_MEAN, _LENGTH_SPREAD = np.log(8.0), 0.6  # log of mm
_LEAST_VARIANCE = 1e-3  # um^2
_BLUNDER_LOG_DENSITY = -np.log(1e3) - np.log(1e3)  # one in a thousand samples, anywhere within a millimetre
_BLUNDER_END = np.log(1e3 / 30)  # there rather one in thirty
_FEWEST_RIGHT = 8  # samples for each wrong one
_ROUNDED, _LEAST_ROUNDED = 0.3, 0.05  # noise over resolution
_ROUNDS, _SWEEPS = 5, 4
_STATED_SPREAD = 0.02  # of the logarithm of a stated noise


@dataclass(frozen=True)
class Estimate:
    """A weld's geometry as estimated from noisy samples.

    Attributes:
        x_m: (n,), equidistant from the first sample to the last.
        geometry_m: (n,), heights at the most probable hyperparameters.
        deviation_m: (n,), standard deviation of the heights at the most probable hyperparameters.
        samples_m: (count, n), heights that the measurement allows, all equally likely.
        noise_m: standard deviation of the noise, rounding included.
        noise_range_m: 5 and 95 % of it.
        set_aside: numbers of the samples that were taken for wrong.
    """

    x_m: FloatArray
    geometry_m: FloatArray
    deviation_m: FloatArray
    samples_m: FloatArray
    noise_m: float
    noise_range_m: tuple[float, float]
    set_aside: tuple[int, ...]
    log_density: float = field(repr=False)
    level: FloatArray = field(repr=False)


def estimate(
    x_m: FloatArray,
    z_m: FloatArray,
    *,
    resolution_m: float,
    noise_m: float | None = None,
    set_aside: Sequence[int] | None = None,
    samples: int = 0,
    seed: int = 0,
    spacing_m: float = 1e-3,
) -> Estimate:
    """Estimate the geometry of a weld and the noise of its measurement.

    Args:
        x_m: (n,), increasing, need not be equidistant.
        z_m: (n,), positive up.
        resolution_m: step in which the heights were written; 0: none.
        noise_m: standard deviation of the noise where it is known.
        set_aside: numbers of the samples that are known to be wrong; looked for if not given.
        samples: how many geometries are drawn.
        seed: of the drawing.
        spacing_m: of the result.
    """
    x, z = np.asarray(x_m, dtype=np.float64) * 1e3, np.asarray(z_m, dtype=np.float64) * 1e6
    few = max(1, min(5, len(x) // 4))
    line = np.interp(x, x[[0, -1]], [np.median(z[:few]), np.median(z[-few:])])
    problem = _Problem(x, z - line, resolution_m * 1e6, None if noise_m is None else noise_m * 1e6)
    used: FloatArray = np.ones(len(x))
    used[list(set_aside or ())] = 0.0
    best, density = problem.most_probable(used)
    if set_aside is None:
        used, best, density = _without_blunders(problem, used, best, density)
    if resolution_m and noise_m is None and np.exp(best[-2]) < _ROUNDED * problem.resolution:
        best = problem.within_steps(best, used)
    drawn, curves = problem.draw(best, samples, np.random.default_rng(seed))
    centre, deviation = problem.posterior(best)
    count = round((x[-1] - x[0]) / (spacing_m * 1e3)) + 1
    fine = np.linspace(x[0], x[-1], count)
    heights = problem.heights(np.vstack([centre, curves]), fine) + np.interp(fine, x, line)
    noise = problem.noise(drawn if samples else best[None])
    low, middle, high = np.quantile(noise, [0.05, 0.5, 0.95])
    return Estimate(
        fine * 1e-3,
        heights[0] * 1e-6,
        np.sqrt(problem.heights_variance(deviation, fine)) * 1e-6,
        heights[1:] * 1e-6,
        float(middle) * 1e-6,
        (float(low) * 1e-6, float(high) * 1e-6),
        tuple(np.flatnonzero(used == 0).tolist()),
        density,
        best,
    )


class _Problem:
    """Holds the samples of a weld and the arrays in which their likelihood is computed."""

    def __init__(self, x: FloatArray, z: FloatArray, resolution: float, noise: float | None) -> None:
        self.x, self.z = x, z
        length = x[-1] - x[0]
        cells = int(np.ceil(length / np.clip(np.median(np.diff(x)), _MIN_STEP, _MAX_STEP) - 1e-6))
        self.step, self.first = length / cells, x[0]
        self.size = cells + 3
        self.resolution = resolution
        self.total_noise: float | None = None
        self.floor = resolution**2 / 12 + _LEAST_VARIANCE
        self.cell, self.weight = _basis(x, self.first, self.step, cells)
        knots = max(3, round(length / _KNOT) + 1)
        self.knots = knots
        knot_x = np.linspace(x[0], x[-1], knots)
        place = np.clip((np.arange(self.size - 2) * self.step) / (knot_x[1] - knot_x[0]), 0.0, knots - 1.0)
        self.knot = np.minimum(place.astype(np.int64), knots - 2)
        self.share = place - self.knot
        self.mean = np.array([_LEVEL_MEAN] * knots + [_NOISE_MEAN, _LENGTH_MEAN])
        self.covariance = np.zeros((knots + 2, knots + 2))
        apart = np.abs(knot_x[:, None] - knot_x)
        self.covariance[:knots, :knots] = _LEVEL_COMMON**2 + _LEVEL_LOCAL**2 * np.exp(-apart / _LEVEL_LENGTH)
        self.covariance[knots, knots], self.covariance[-1, -1] = _NOISE_SPREAD**2, _LENGTH_SPREAD**2
        self.is_noise_stated = noise is not None
        if noise is not None:
            own = np.sqrt(max(noise**2 - self.floor, 0.01 * noise**2, _LEAST_VARIANCE))
            self.mean[knots], self.covariance[knots, knots] = np.log(own), _STATED_SPREAD**2
        self.precision = np.linalg.inv(self.covariance)
        n = self.size
        self.gram, self.moment = np.empty((n, 4)), np.empty(n)
        self.work = (np.empty(n - 2), np.empty(n - 2), np.empty((n, 4)), np.empty(n), np.empty((n, 4)))
        self.sums = np.empty(4)  # z'z is kept for the gradient by the noise

    def use(self, used: FloatArray) -> None:
        """Take the samples that are not set aside."""
        squares, count = fill_gram(self.cell, self.weight, used, self.z, self.gram, self.moment)
        self.sums[:] = squares, count, self.step, self.floor
        self.data = (self.cell, self.weight, used, self.z)

    def within_steps(self, best: FloatArray, used: FloatArray) -> FloatArray:
        """Return the best hyperparameters where rounding outweighs the noise, as intervals that hold the geometry.

        Rounding a smooth rail makes stairs, not white noise. Each sample says that geometry and noise lie within half a
        step of it; expectation propagation (Minka 2001) puts a Gaussian for that, with which the rest goes on.
        """
        reported, step = self.z, self.resolution
        noise = float(np.clip(np.exp(best[-2]), _LEAST_ROUNDED * step, None))
        precision = used / self.floor
        scaled = precision * reported
        best = best.copy()
        best[: self.knots] = np.minimum(best[: self.knots], _LEVEL_MEAN)
        best[-2] = self.mean[-2] = -12.0  # all of the noise is in the samples' own precision
        self.floor = 1.0
        tight = np.empty(len(best))
        for _ in range(_ROUNDS):
            for _ in range(_SWEEPS):
                self.z = np.divide(scaled, precision, out=np.zeros_like(scaled), where=precision > 0)
                self.use(precision)
                log_density(best, tight, True, *self._arguments)
                propagate(
                    self.cell, self.weight, self.work[3], self.work[4], reported, used, step, noise, precision, scaled
                )
            self.z = np.divide(scaled, precision, out=np.zeros_like(scaled), where=precision > 0)
            best, _ = self.most_probable(precision, best)
        self.total_noise = float(np.hypot(noise, step / np.sqrt(12.0)))
        return best

    def noise(self, parameters: FloatArray) -> FloatArray:
        """Return the noise's standard deviation, rounding included."""
        if self.total_noise is not None:
            return np.full(len(parameters), self.total_noise)
        return np.asarray(np.sqrt(np.exp(2 * parameters[:, -2]) + self.floor))

    @property
    def _arguments(self) -> tuple[object, ...]:
        given = (self.sums, self.gram, self.moment, self.data, self.knot, self.share)
        return (*given, self.mean, self.precision, self.work)

    def most_probable(self, used: FloatArray, start: FloatArray | None = None) -> tuple[FloatArray, float]:
        """Return the hyperparameters at the largest posterior density, and its logarithm."""
        self.use(used)
        if start is None:
            start = self.mean.copy()
            start[: self.knots] = 0.0  # rough everywhere: from there a rough place is not overlooked
            if not self.is_noise_stated:
                third = np.diff(self.z[used > 0], 3)
                guess = np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0)
                start[-2] = np.log(np.clip(guess, 0.5, 100.0))
        best, density = climb(start, 0.3 * self.covariance, 80, 1e-2, *self._arguments)
        return best, float(density)

    def metric(self, best: FloatArray) -> FloatArray:
        """Return the matrix from standard normal numbers to hyperparameters about the best."""
        # That of numpy hands small matrices to threads, which takes ten times as long.
        values, vectors = scipy.linalg.eigh(hessian(best, *self._arguments), driver="evd")
        return np.ascontiguousarray(vectors / np.sqrt(np.maximum(values, 0.03)))

    def posterior(self, best: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and banded covariance of the coefficients."""
        log_density(best, np.empty(len(best)), True, *self._arguments)
        return self.work[3].copy(), self.work[4].copy()

    def draw(self, best: FloatArray, count: int, generator: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return hyperparameters and, twice as many, coefficients, drawn from the posterior: antithetic in pairs."""
        pairs = (count + 1) // 2
        parameters, coefficients = np.empty((pairs, len(best))), np.empty((2 * pairs, self.size))
        if count:
            rounds = BURN + pairs * SKIP
            white = generator.standard_normal((pairs, self.size))
            hamiltonian(
                best, self.metric(best), generator.standard_normal((rounds, len(best))), generator.random(rounds),
                generator.random(rounds), parameters, coefficients, white, *self._arguments,
            )  # fmt: skip
        return parameters, coefficients[:count]

    def heights(self, coefficients: FloatArray, x: FloatArray) -> FloatArray:
        """Return splines at any places."""
        cell, weight = _basis(x, self.first, self.step, self.size - 3)
        return np.asarray(sum(coefficients[:, cell + k] * weight[:, k] for k in range(4)))

    def heights_variance(self, covariance: FloatArray, x: FloatArray) -> FloatArray:
        """Return the variance of the spline at any places from the banded covariance of its coefficients."""
        cell, weight = _basis(x, self.first, self.step, self.size - 3)
        result = np.zeros(len(x))
        for p in range(4):
            for q in range(p, 4):
                result += (1 if p == q else 2) * weight[:, p] * weight[:, q] * covariance[cell + p, q - p]
        return result


def _without_blunders(
    problem: _Problem, used: FloatArray, best: FloatArray, density: float, most: int = 6
) -> tuple[FloatArray, FloatArray, float]:
    """Set samples aside, one group after the other, as long as the likelihood says that they are wrong."""
    for _ in range(most):
        found = None
        for group in _suspects(problem, used):
            trial = used.copy()
            trial[group] = 0.0
            parameters, value = problem.most_probable(trial)
            ends = (0 in group) + (len(used) - 1 in group)
            gain = value + len(group) * _BLUNDER_LOG_DENSITY + ends * _BLUNDER_END - density
            if gain > 0 and (found is None or gain > found[0]):
                found = gain, trial, parameters, value
        if found is None:
            break
        _, used, best, density = found
    problem.use(used)
    return used, best, density


def _suspects(problem: _Problem, used: FloatArray) -> list[list[int]]:
    """Return the samples, or runs at the ends, that differ most from what their neighbours say."""
    kept = np.flatnonzero(used > 0)
    z = problem.z[kept]
    n = len(z)
    if n < 12:
        return []
    off = np.empty(n)
    off[2:-2] = z[2:-2] - (4 * (z[1:-3] + z[3:-1]) - z[:-4] - z[4:]) / 6
    # At the ends by lines through the next four, whose error is larger.
    for at, near in ((0, z[1:5]), (1, z[2:6]), (n - 1, z[-2:-6:-1]), (n - 2, z[-3:-7:-1])):
        off[at] = (z[at] - (near[0] + near[1] + near[2] - near[3]) / 2) / 1.2
    # A wrong sample stands out from both sides; at an edge of the rail it does not.
    beside = np.stack([z[:-4], z[1:-3], z[3:-1], z[4:]])
    out = np.full(n, np.inf)
    out[2:-2] = np.maximum(z[2:-2] - beside.max(axis=0), beside.min(axis=0) - z[2:-2])
    scale = 1.4826 * np.median(np.abs(off)) + np.sqrt(problem.floor) * 0.5
    order = [int(i) for i in np.argsort(-np.abs(off)) if abs(off[i]) > 3.5 * scale and out[i] > 0.3 * abs(off[i])]
    groups = [[int(kept[i])] for i in order[:6]]
    inner = [i for i in order if 1 < i < n - 2]
    if 1 < len(inner) <= n // _FEWEST_RIGHT:  # each of several hides behind the others: they look like noise
        groups.append(sorted(int(kept[i]) for i in inner))
    groups += [[int(kept[e])] for e in (0, -1) if abs(off[e]) > 2 * scale and [int(kept[e])] not in groups]
    for run in (2, 3):  # a probe that still settles
        groups += [kept[:run].tolist()] if np.any(np.abs(off[:2]) > 3.5 * scale) else []
        groups += [kept[-run:].tolist()] if np.any(np.abs(off[-2:]) > 3.5 * scale) else []
    return groups


def _basis(x: FloatArray, first: float, step: float, cells: int) -> tuple[_Integers, FloatArray]:
    """Return the first of four B-splines at every place, and their values, (n, 4)."""
    place = (x - first) / step
    cell = np.clip(place.astype(np.int64), 0, cells - 1)
    a = place - cell
    b = 1 - a
    return cell, np.column_stack([b**3, 3 * a**3 - 6 * a**2 + 4, 3 * b**3 - 6 * b**2 + 4, a**3]) / 6
