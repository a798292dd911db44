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


@njit(cache=True, nogil=True, fastmath=_FAST)
def moving_response(
    behind_re, behind_im, shape_re, shape_im, multiplier_re, multiplier_im, turn_re, turn_im, start, row
):
    """Response, step by step, under a point that leaves grid point `start` with the force pulse it gave there.

    Sums waves over frequency: `behind` (2, n_frequency) is the pulse's spectrum in each wave, `shape`
    (n_grid, 2, n_frequency) the waves over a span, `multiplier` (2, n_frequency) their ratio from span to span, `turn`
    (n_frequency) the phase of one step. `behind` is changed; `row` (n_step) gets the response.
    """
    grid, _, frequencies = shape_re.shape
    phase_re, phase_im = np.ones(frequencies), np.zeros(frequencies)
    j = start
    for n in range(row.shape[0]):
        if j == grid:
            j = 0
            for i in range(2):
                for k in range(frequencies):
                    re, im = behind_re[i, k], behind_im[i, k]
                    behind_re[i, k] = re * multiplier_re[i, k] - im * multiplier_im[i, k]
                    behind_im[i, k] = re * multiplier_im[i, k] + im * multiplier_re[i, k]
        total = 0.0
        for k in range(frequencies):
            re = (
                behind_re[0, k] * shape_re[j, 0, k] - behind_im[0, k] * shape_im[j, 0, k]
                + behind_re[1, k] * shape_re[j, 1, k] - behind_im[1, k] * shape_im[j, 1, k]
            )  # fmt: skip
            im = (
                behind_re[0, k] * shape_im[j, 0, k] + behind_im[0, k] * shape_re[j, 0, k]
                + behind_re[1, k] * shape_im[j, 1, k] + behind_im[1, k] * shape_re[j, 1, k]
            )  # fmt: skip
            total += re * phase_re[k] - im * phase_im[k]
            turned = phase_re[k] * turn_re[k] - phase_im[k] * turn_im[k]
            phase_im[k] = phase_re[k] * turn_im[k] + phase_im[k] * turn_re[k]
            phase_re[k] = turned
        row[n] = total
        j += 1


@njit(cache=True, nogil=True, fastmath=_FAST)
def passage_by_convolution(rows, nodes, weights, start, at_rest, irregularity, physics, dt, result):
    """Roll from grid point `start`; the rail's displacement is the sum of the responses to all earlier forces.

    A pulse at grid point j answers with `weights[j] @ rows[nodes[j]]`. For the first `at_rest` steps the force is the
    static load, so that the rail knows a load that has always rolled; then the wheel is let go. `result`
    (n_step, 3): force, wheel and rail displacement, positive down.
    """
    mass, load, hertz = physics[0], physics[1], physics[2]
    steps, grid, memory = irregularity.shape[0], weights.shape[0], rows.shape[1]
    answer = np.zeros(steps + memory)
    own = dt * dt / (6.0 * mass)
    wheel, velocity, force = 0.0, 0.0, load
    j = start % grid
    for n in range(steps):
        here = 0.0
        for q in range(weights.shape[1]):
            here += weights[j, q] * rows[nodes[j, q], 0]
        if n < at_rest:
            wheel = answer[n] + here * load + (load / hertz) ** (2.0 / 3.0) + irregularity[n]
        else:
            free = wheel + dt * (velocity + dt * (0.5 * load - force / 3.0) / mass)
            old = force
            force = contact_force(free - answer[n] - irregularity[n], here + own, hertz)
            wheel = free - own * force
            velocity += dt * (load - 0.5 * (old + force)) / mass
        result[n, 0], result[n, 1], result[n, 2] = force, wheel, answer[n] + here * force
        if force != 0.0:
            for q in range(weights.shape[1]):
                scale = weights[j, q] * force
                row = rows[nodes[j, q]]
                for m in range(1, memory):
                    answer[n + m] += scale * row[m]
        j += 1
        if j == grid:
            j = 0


@njit(cache=True, nogil=True, fastmath=_FAST)
def rate(time, state, poles_re, poles_im, shapes, grid_m, pieces, piece_m, from_x, to_first, speed, physics, slope):
    """Time derivative of (rail states, wheel, velocity): the equations that `_step` solves, for general solvers.

    `shapes` is read linearly between grid points from `from_x`; the irregularity (positive down) is the cubic
    `pieces` (4, n) of length `piece_m`, the first `to_first` ahead of the start.
    """
    grid = shapes.shape[0]
    place = (from_x + speed * time) / grid_m
    base = np.floor(place)
    part = place - base
    j = int(base) % grid
    k = (j + 1) % grid
    pairs = poles_re.shape[0]
    displacement = 0.0
    for i in range(2 * pairs):
        displacement += ((1.0 - part) * shapes[j, i] + part * shapes[k, i]) * state[i]
    ahead = (speed * time - to_first) / piece_m
    irregularity = 0.0
    if 0.0 <= ahead < pieces.shape[1]:
        n = int(ahead)
        s = (ahead - n) * piece_m
        irregularity = ((pieces[0, n] * s + pieces[1, n]) * s + pieces[2, n]) * s + pieces[3, n]
    indentation = max(state[2 * pairs] - displacement - irregularity, 0.0)
    force = physics[2] * indentation * np.sqrt(indentation)
    for i in range(pairs):
        re, im = state[2 * i], state[2 * i + 1]
        slope[2 * i] = poles_re[i] * re - poles_im[i] * im + force
        slope[2 * i + 1] = poles_re[i] * im + poles_im[i] * re
    slope[2 * pairs] = state[2 * pairs + 1]
    slope[2 * pairs + 1] = (physics[1] - force) / physics[0]
    return force
