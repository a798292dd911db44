"""All compiled code: a wheel rolling over a track of common poles, plain float64 arrays and scalars.

Positive down. States of the rail are the real and imaginary parts of q_k, q_k' = p_k q_k + f, side by side; the rail's
displacement under the wheel is `shape[j] @ states` at grid point j of the span. A step advances the linear states
exactly for a force that changes linearly within it (first-order hold) and solves the contact for the force at its end:

    delta = delta_free - compliance f,    f = hertz max(delta, 0)^(3/2)

which has one root; with u = sqrt(delta) it is a cubic that Newton's method descends from above without a branch.
"""

import numpy as np
from numba import njit

# Reassociation lets sums vectorise; NaN and infinity keep their meaning, as they are how a failure shows.
_FAST = {"reassoc", "contract", "arcp", "nsz"}
_NEWTON_STEPS = 6


@njit(cache=True, nogil=True, fastmath=_FAST, inline="always")
def contact_force(free, compliance, hertz):
    """Root of f = hertz (free - compliance f)^(3/2); zero where `free` is not positive."""
    if free <= 0.0:
        return 0.0
    # u^2 + a u^3 = free, convex and increasing for u > 0: Newton descends monotonically from any upper bound.
    a = compliance * hertz
    u = min(np.sqrt(free), np.cbrt(free / a)) if a > 0.0 else np.sqrt(free)
    for _ in range(_NEWTON_STEPS):
        u -= (u * u * (1.0 + a * u) - free) / (u * (2.0 + 3.0 * a * u))
    return hertz * u * u * u


@njit(cache=True, nogil=True, fastmath=_FAST, inline="always")
def _step(rail, wheel, shape, gain, coefficients, irregularity, physics, dt):
    """Advance `rail` (2K,) and `wheel` (displacement, velocity, force) by one step; returns the force at its end."""
    mass, load, hertz = physics[0], physics[1], physics[2]
    pairs = rail.shape[0] // 2
    old = wheel[2]
    free_rail = 0.0
    for k in range(pairs):
        re, im = rail[2 * k], rail[2 * k + 1]
        free_re = coefficients[0, k] * re - coefficients[1, k] * im + coefficients[2, k] * old
        free_im = coefficients[0, k] * im + coefficients[1, k] * re + coefficients[3, k] * old
        rail[2 * k], rail[2 * k + 1] = free_re, free_im
        free_rail += shape[2 * k] * free_re + shape[2 * k + 1] * free_im
    free_wheel = wheel[0] + dt * (wheel[1] + dt * (0.5 * load - old / 3.0) / mass)
    own = dt * dt / (6.0 * mass)
    force = contact_force(free_wheel - free_rail - irregularity, gain + own, hertz)
    for k in range(pairs):
        rail[2 * k] += coefficients[4, k] * force
        rail[2 * k + 1] += coefficients[5, k] * force
    wheel[0] = free_wheel - own * force
    wheel[1] += dt * (load - 0.5 * (old + force)) / mass
    wheel[2] = force
    return force


@njit(cache=True, nogil=True, fastmath=_FAST)
def approach(rail, wheel, shapes, gains, coefficients, stride, physics, dt, tolerance, most_spans, states):
    """Roll over smooth rail, span by span, until the force repeats; the last span's states are kept.

    `rail`, `wheel`: state at grid point 0, changed in place. `states` (n_grid // stride, 2K + 3): state at each point
    of the last span. Returns the number of spans, or -1 if the force does not settle.
    """
    points = states.shape[0]
    grid = shapes.shape[0]
    for span in range(most_spans):
        change = 0.0
        for n in range(points):
            if span > 0:
                change = max(change, abs(states[n, -1] - wheel[2]))
            states[n, :-3] = rail
            states[n, -3:] = wheel
            j = ((n + 1) * stride) % grid
            _step(rail, wheel, shapes[j], gains[j], coefficients, 0.0, physics, dt)
        if not np.isfinite(wheel[2]):
            return -1
        if span > 0 and change < tolerance:
            return span + 1
    return -1


@njit(cache=True, nogil=True, fastmath=_FAST)
def peak_of_passage(rail, wheel, shapes, gains, coefficients, start, stride, irregularity, physics, dt, result):
    """Roll from grid point `start` over `irregularity` (one value a step, the first at the start).

    `result`: peak force, its place in steps from the start, least force, time without contact. The peak is the vertex
    of the parabola through the highest sample and its neighbours.
    """
    grid = shapes.shape[0]
    force = wheel[2]
    before = force
    peak, place, least, apart = force, 0.0, force, 0
    highest = force
    j = start % grid
    for n in range(1, irregularity.shape[0]):
        j += stride
        if j >= grid:
            j -= grid
        after = _step(rail, wheel, shapes[j], gains[j], coefficients, irregularity[n], physics, dt)
        if force >= highest and force >= after and force > before:
            highest = force
            curvature = before - 2.0 * force + after
            offset = 0.5 * (before - after) / curvature
            peak = force - 0.25 * (before - after) * offset
            place = n - 1 + offset
        least = min(least, after)
        if after == 0.0:
            apart += 1
        before, force = force, after
    result[0], result[1], result[2], result[3] = peak, place, least, apart * dt


@njit(cache=True, nogil=True, fastmath=_FAST)
def history_of_passage(rail, wheel, shapes, gains, coefficients, start, stride, irregularity, physics, dt, result):
    """The same passage step by step: `result` (n, 3) gets force, wheel and rail displacement, the start included."""
    grid = shapes.shape[0]
    for n in range(irregularity.shape[0]):
        j = (start + n * stride) % grid
        if n > 0:
            _step(rail, wheel, shapes[j], gains[j], coefficients, irregularity[n], physics, dt)
        result[n, 0], result[n, 1] = wheel[2], wheel[0]
        displacement = 0.0
        for k in range(rail.shape[0]):
            displacement += shapes[j, k] * rail[k]
        result[n, 2] = displacement


@njit(cache=True, nogil=True, fastmath=_FAST)
def peaks_at_speed(states, shapes, gains, coefficients, starts, lengths, stride, irregularities, physics, dt, results):
    """Every passage of one speed: position i starts at grid point `starts[i]` in the periodic state over smooth rail.

    `irregularities` (n_position, n_longest); `results` (n_position, 4).
    """
    for i in range(starts.shape[0]):
        state = states[(starts[i] // stride) % states.shape[0]]
        rail, wheel = state[:-3].copy(), state[-3:].copy()
        peak_of_passage(
            rail, wheel, shapes, gains, coefficients, starts[i], stride, irregularities[i, : lengths[i]],
            physics, dt, results[i],
        )  # fmt: skip
