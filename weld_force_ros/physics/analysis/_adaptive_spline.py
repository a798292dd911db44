"""Compiled: the likelihood of an adaptive spline's hyperparameters, its gradient, and draws from the posterior.

Bands: `factor[i, k]` is row i of a Cholesky factor k to the left of its diagonal, `z[i, k]` the covariance of
coefficients i and i + k. See `adaptive_spline` for the model.
"""

import math

import numpy as np

from weld_force_ros.physics._numba_cache import compiled

# No promise that nothing is NaN: that is tested for.
_jit = compiled(fastmath={"reassoc", "contract", "nsz", "arcp", "afn"}, error_model="numpy")

LEVEL_MOST = 3.0  # log of um^2 / mm^3: the rail would curve more than a wheel
BURN, SKIP, LEAPS, LEAP = 4, 2, 4, 0.65  # the longest leap; shorter ones are mixed in, lest a chain sticks


@_jit
def fill_gram(cell, weight, used, z, gram, moment):
    """Fill in the banded cross products of the basis and its products with the heights; return z'z and the count."""
    gram[:] = 0.0
    moment[:] = 0.0
    squares = count = 0.0
    for i in range(len(cell)):
        if used[i] > 0:
            count += 1
            squares += used[i] * z[i] * z[i]
            for p in range(4):
                moment[cell[i] + p] += used[i] * weight[i, p] * z[i]
                for q in range(p + 1):
                    gram[cell[i] + p, p - q] += used[i] * weight[i, p] * weight[i, q]
    return squares, count


@_jit
def propagate(cell, basis, mean, covariance, reported, used, step, noise, precision, scaled):
    """Refine each sample's Gaussian in place, so that mean and variance are those within its interval."""
    for i in range(len(cell)):
        if used[i] <= 0:
            continue
        m = v = 0.0
        for p in range(4):
            m += basis[i, p] * mean[cell[i] + p]
            for q in range(p + 1):
                v += (1.0 if p == q else 2.0) * basis[i, p] * basis[i, q] * covariance[cell[i] + q, p - q]
        rest = 1 / v - precision[i]
        if not rest > 0:
            continue
        cavity = 1 / rest
        centre = cavity * (m / v - scaled[i])
        total = cavity + noise * noise
        root = np.sqrt(total)
        sign = 1.0
        d = (reported[i] - centre) / root
        if d < 0:
            d, sign = -d, -1.0
        half = 0.5 * step / root
        a, b = d - half, d + half
        mass = 0.5 * (math.erfc(a * 0.7071067811865476) - math.erfc(b * 0.7071067811865476))
        if mass > 1e-200:
            fa = math.exp(-0.5 * a * a) * 0.3989422804014327
            fb = math.exp(-0.5 * b * b) * 0.3989422804014327
            first = (fa - fb) / mass
            second = (a * fa - b * fb) / mass - first * first
        else:
            first, second = a, -1 + 1 / (a * a)
        new_mean = centre + sign * cavity / root * first
        new_variance = cavity + cavity * cavity / total * second
        if not new_variance > 1e-9 * cavity:
            new_variance = 1e-9 * cavity
        target = max(1 / new_variance - rest, 1e-8)
        target_scaled = new_mean * (target + rest) - centre * rest
        precision[i] += 0.6 * (target - precision[i])
        scaled[i] += 0.6 * (target_scaled - scaled[i])


@_jit
def _factor(phi, step, inverse, log_variance, variance, sums, gram, moment, data, factor, mean):
    """Factorise the coefficients' precision, compute their mean; return the log likelihood.

    `factor[i, k]` is L[i, i - k]; its diagonal is kept inverted.
    """
    n = len(moment)
    h2 = 1 / (step * step)
    weight = 1 / variance
    for i in range(n):
        for k in range(4):
            factor[i, k] = gram[i, k] * weight
    value = 0.5 * sums[1] * (np.log(weight) - 1.8378770664093453)
    for r in range(n - 2):
        iv = inverse[r] * h2 * h2
        value -= 0.5 * log_variance[r]
        if r == 0:
            s0, s1, s2 = 0.0, 1.0, -2.0
        else:
            s0, s1, s2 = -phi, 1 + 2 * phi, -2 - phi
            factor[r - 1, 0] += iv * s0 * s0
            factor[r, 1] += iv * s0 * s1
            factor[r + 1, 2] += iv * s0 * s2
            factor[r + 2, 3] += iv * s0
        factor[r, 0] += iv * s1 * s1
        factor[r + 1, 0] += iv * s2 * s2
        factor[r + 2, 0] += iv
        factor[r + 1, 1] += iv * s1 * s2
        factor[r + 2, 1] += iv * s2
        factor[r + 2, 2] += iv * s1
    product = 1.0
    for i in range(n):
        l1 = l2 = l3 = 0.0
        t = moment[i] * weight
        if i >= 3:
            l3 = factor[i, 3] * factor[i - 3, 0]
            t -= l3 * mean[i - 3]
        if i >= 2:
            l2 = (factor[i, 2] - l3 * factor[i - 2, 1]) * factor[i - 2, 0]
            t -= l2 * mean[i - 2]
        if i >= 1:
            l1 = (factor[i, 1] - l3 * factor[i - 1, 2] - l2 * factor[i - 1, 1]) * factor[i - 1, 0]
            t -= l1 * mean[i - 1]
        pivot = factor[i, 0] - l1 * l1 - l2 * l2 - l3 * l3
        if not pivot > 0:
            return -1e300
        product *= pivot
        if product > 1e200 or product < 1e-200:
            value -= 0.5 * np.log(product)
            product = 1.0
        l0 = 1 / np.sqrt(pivot)
        factor[i, 0], factor[i, 1], factor[i, 2], factor[i, 3] = l0, l1, l2, l3
        t *= l0
        mean[i] = t
    _solve_transposed(factor, mean)
    cell, basis, used, z = data
    squares = 0.0
    for i in range(len(cell)):
        off = z[i]
        for k in range(4):
            off -= basis[i, k] * mean[cell[i] + k]
        squares += used[i] * off * off
    squares *= weight
    before = 0.0
    for r in range(n - 2):
        curvature = (mean[r] - 2 * mean[r + 1] + mean[r + 2]) * h2
        e = curvature - phi * before
        squares += e * e * inverse[r]
        before = curvature
    # Not as z'z - z'f, whose difference rounding would decide.
    return value - 0.5 * np.log(product) - 0.5 * squares


@_jit
def _solve_transposed(factor, t):
    """Solve L' x = t in place."""
    n = len(t)
    x1 = x2 = x3 = 0.0
    for i in range(n - 1, -1, -1):
        s = t[i]
        if i + 1 < n:
            s -= factor[i + 1, 1] * x1
        if i + 2 < n:
            s -= factor[i + 2, 2] * x2
        if i + 3 < n:
            s -= factor[i + 3, 3] * x3
        x3, x2, x1 = x2, x1, s * factor[i, 0]
        t[i] = x1


@_jit
def _banded_covariance(factor, z):
    """Fill in z[i, k], the covariance of coefficients i and i + k, from the precision's factor."""
    n = len(factor)
    z11 = z12 = z13 = z22 = z23 = z33 = 0.0
    for i in range(n - 1, -1, -1):
        l0 = factor[i, 0]
        a1 = factor[i + 1, 1] * l0 if i + 1 < n else 0.0
        a2 = factor[i + 2, 2] * l0 if i + 2 < n else 0.0
        a3 = factor[i + 3, 3] * l0 if i + 3 < n else 0.0
        c1 = -(a1 * z11 + a2 * z12 + a3 * z13)
        c2 = -(a1 * z12 + a2 * z22 + a3 * z23)
        c3 = -(a1 * z13 + a2 * z23 + a3 * z33)
        c0 = l0 * l0 - (a1 * c1 + a2 * c2 + a3 * c3)
        z[i, 0], z[i, 1], z[i, 2], z[i, 3] = c0, c1, c2, c3
        z33, z23, z22, z13, z12, z11 = z22, z12, z11, c2, c1, c0


@_jit
def log_density(u, gradient, wanted, sums, gram, moment, data, knot, share, prior_mean, prior_precision, work):
    """Return the log posterior density of hyperparameters: level at the knots, log noise, log length; and its gradient.

    The gradient is the posterior mean of the complete data's (Fisher's identity).
    """
    inverse, log_variance, factor, mean, z = work
    step, floor = sums[2], sums[3]
    knots, n = len(u) - 2, len(moment)
    for i in range(len(u)):
        if not abs(u[i]) < 40:
            return -1e300
    own = np.exp(2 * u[knots])
    variance = own + floor
    ell = np.exp(u[knots + 1])
    if not 0.5 < ell < 150.0:
        return -1e300
    phi = np.exp(-step / ell)
    base = np.log((1 - phi) ** 2 / step)
    level, slope = np.empty(knots), np.empty(knots)
    for k in range(knots):
        under = LEVEL_MOST - u[k]
        level[k] = base + LEVEL_MOST - np.log1p(np.exp(-abs(under))) - max(under, 0.0)
        slope[k] = 1 / (1 + np.exp(-under))
    for r in range(n - 2):
        log_variance[r] = (1 - share[r]) * level[knot[r]] + share[r] * level[knot[r] + 1]
    log_variance[0] -= np.log(1 - phi * phi)
    for r in range(n - 2):
        inverse[r] = np.exp(-log_variance[r])
    likelihood = _factor(phi, step, inverse, log_variance, variance, sums, gram, moment, data, factor, mean)
    quadratic = 0.0
    for i in range(len(u)):
        t = 0.0
        for j in range(len(u)):
            t += prior_precision[i, j] * (u[j] - prior_mean[j])
        gradient[i] = -t
        quadratic += t * (u[i] - prior_mean[i])
    if not likelihood > -1e299 or not wanted:
        return likelihood - 0.5 * quadratic
    _banded_covariance(factor, z)
    h4 = 1 / step**4
    by_phi = 0.0
    s0, s1, s2 = -phi, 1 + 2 * phi, -2 - phi
    for r in range(n - 2):
        if r == 0:
            e = mean[0] - 2 * mean[1] + mean[2]
            square = e * e + z[0, 0] + 4 * z[1, 0] + z[2, 0] - 4 * z[0, 1] + 2 * z[0, 2] - 4 * z[1, 1]
            ratio = square * h4 * inverse[r]
            by_phi -= (ratio - 1) / (1 - phi * phi)
        else:
            z00, z01, z02, z03 = z[r - 1, 0], z[r - 1, 1], z[r - 1, 2], z[r - 1, 3]
            z11, z12, z13, z22, z23, z33 = z[r, 0], z[r, 1], z[r, 2], z[r + 1, 0], z[r + 1, 1], z[r + 2, 0]
            before = mean[r - 1] - 2 * mean[r] + mean[r + 1]
            e = s0 * mean[r - 1] + s1 * mean[r] + s2 * mean[r + 1] + mean[r + 2]
            # Covariance of e with each of the four coefficients.
            c0 = s0 * z00 + s1 * z01 + s2 * z02 + z03
            c1 = s0 * z01 + s1 * z11 + s2 * z12 + z13
            c2 = s0 * z02 + s1 * z12 + s2 * z22 + z23
            c3 = s0 * z03 + s1 * z13 + s2 * z23 + z33
            ratio = (e * e + s0 * c0 + s1 * c1 + s2 * c2 + c3) * h4 * inverse[r]
            by_phi += (e * before + c0 - 2 * c1 + c2) * h4 * inverse[r] - (ratio - 1) / (1 - phi)
        part = 0.5 * (ratio - 1)
        gradient[knot[r]] += (1 - share[r]) * part * slope[knot[r]]
        gradient[knot[r] + 1] += share[r] * part * slope[knot[r] + 1]
    gradient[knots + 1] += by_phi * phi * step / ell
    residual = sums[0]
    for i in range(n):
        residual += gram[i, 0] * (mean[i] * mean[i] + z[i, 0]) - 2 * moment[i] * mean[i]
        for k in range(1, min(i, 3) + 1):
            residual += 2 * gram[i, k] * (mean[i] * mean[i - k] + z[i - k, k])
    gradient[knots] += (residual / variance - sums[1]) * own / variance
    return likelihood - 0.5 * quadratic


@compiled(inline="always")
def _yes():
    return bool(1)  # not a literal, for which `log_density` would be compiled once more


@_jit
def climb(
    u, inverse_hessian, rounds, tolerance,
    sums, gram, moment, data, knot, share, prior_mean, prior_precision, work,
):  # fmt: skip
    """Maximise the log density from u by BFGS with backtracking."""
    gradient, other = np.empty(len(u)), np.empty(len(u))
    h = inverse_hessian.copy()
    value = log_density(u, gradient, _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work)
    for _ in range(rounds):
        direction = h @ gradient
        rise = direction @ gradient
        if rise < tolerance:
            break
        stride = min(1.0, 3.0 / np.max(np.abs(direction)))
        found = False
        trial, trial_value = u, value
        for _ in range(10):
            trial = u + stride * direction
            trial_value = log_density(
                trial, other, _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work
            )
            if trial_value > value + 1e-4 * stride * rise:
                found = True
                break
            stride *= 0.35
        if not found:
            break
        s, y = trial - u, gradient - other
        sy = s @ y
        if sy > 1e-10:
            hy = h @ y
            stretch = (1 + (y @ hy) / sy) / sy
            for i in range(len(s)):  # `np.outer` takes seconds to compile
                for j in range(len(s)):
                    h[i, j] += stretch * s[i] * s[j] - (hy[i] * s[j] + s[i] * hy[j]) / sy
        u, value = trial, trial_value
        gradient[:] = other
    return u, value


@_jit
def hessian(u, sums, gram, moment, data, knot, share, prior_mean, prior_precision, work):
    """Return the negative Hessian of the log density by differences of the gradient."""
    n = len(u)
    at, beside, result = np.empty(n), np.empty(n), np.empty((n, n))
    log_density(u, at, _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work)
    for i in range(n):
        step = 0.02 if i == n - 2 else 0.1
        moved = u.copy()
        moved[i] += step
        log_density(moved, beside, _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work)
        result[i] = (at - beside) / step
    return 0.5 * (result + result.T)


@_jit
def hamiltonian(
    centre, metric, momenta, uniform, shortening, parameters, coefficients, white,
    sums, gram, moment, data, knot, share, prior_mean, prior_precision, work,
):  # fmt: skip
    """Draw hyperparameters and, with each, coefficients; return the share of proposals that were accepted."""
    factor, mean = work[2], work[3]
    back = np.ascontiguousarray(metric.T)
    at, gradient = np.zeros(len(centre)), np.empty(len(centre))
    value = log_density(
        centre, gradient, _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work
    )
    force = back @ gradient
    accepted, drawn = 0, 0
    for number in range(len(momenta)):
        momentum = momenta[number].copy()
        energy = value - 0.5 * (momentum @ momentum)
        leap = LEAP * (1 - 0.75 * shortening[number])
        trial, push, trial_value = at.copy(), force.copy(), value
        for _ in range(LEAPS):
            momentum += 0.5 * leap * push
            trial += leap * momentum
            u = centre + metric @ trial
            trial_value = log_density(
                u, gradient, _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work
            )
            if not trial_value > -1e299:
                break
            push = back @ gradient
            momentum += 0.5 * leap * push
        if trial_value > -1e299 and np.log(uniform[number]) < trial_value - 0.5 * (momentum @ momentum) - energy:
            at, force, value = trial, push, trial_value
            accepted += 1
        if number >= BURN and (number - BURN) % SKIP == SKIP - 1:
            u = centre + metric @ at
            log_density(
                u, gradient, not _yes(), sums, gram, moment, data, knot, share, prior_mean, prior_precision, work
            )
            parameters[drawn] = u
            departure = white[drawn].copy()
            _solve_transposed(factor, departure)
            for i in range(len(mean)):  # an antithetic pair
                coefficients[2 * drawn, i] = mean[i] + departure[i]
                coefficients[2 * drawn + 1, i] = mean[i] - departure[i]
            drawn += 1
    return accepted / len(momenta)
