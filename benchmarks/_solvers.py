"""Compiled: the passages' equations for general solvers, a Runge-Kutta method, and the processor's most."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import FAST_MATH, vertex
from weld_force_ros.physics.passage._simd import load, multiply_add, store


@compiled(nogil=True, fastmath=FAST_MATH)
def rate(time, state, poles_re, poles_im, shapes, grid_m, pieces, piece_m, from_x, to_first, speed, physics, slope):
    """Time derivative of (rail states, wheel, velocity) of common poles: what the steps solve, for general solvers.

    `shapes` (n_grid, 2 n_pole), real and imaginary parts, is read linearly between grid points from `from_x`; the
    irregularity (positive down) is the cubic `pieces` (4, n) of length `piece_m`, the first `to_first` after the start.
    """
    grid = shapes.shape[0]
    place = (from_x + speed * time) / grid_m
    base = np.floor(place)
    part = place - base
    j = int(base) % grid
    k = (j + 1) % grid
    pairs = poles_re.shape[0]
    displacement = 0.0
    for i in range(pairs):
        re = (1.0 - part) * shapes[j, 2 * i] + part * shapes[k, 2 * i]
        im = (1.0 - part) * shapes[j, 2 * i + 1] + part * shapes[k, 2 * i + 1]
        slope[2 * i], slope[2 * i + 1] = re, im
        displacement += re * state[2 * i] - im * state[2 * i + 1]
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
        slope[2 * i] = poles_re[i] * re - poles_im[i] * im + slope[2 * i] * force
        slope[2 * i + 1] = poles_re[i] * im + poles_im[i] * re + slope[2 * i + 1] * force
    slope[2 * pairs] = state[2 * pairs + 1]
    slope[2 * pairs + 1] = (physics[1] - force) / physics[0]
    return force


@compiled(nogil=True, fastmath=FAST_MATH)
def peak_by_runge_kutta(
    state, dt, steps, poles_re, poles_im, shapes, grid_m, pieces, piece_m, from_x, to_first, speed, physics
):
    """Return the peak force of `rate` by the classical fourth-order method in small steps."""
    size = state.shape[0]
    y, z = state.copy(), np.empty(size)
    slopes = np.empty((4, size))
    before, force, peak = 0.0, 0.0, 0.0
    for n in range(steps):
        time = n * dt
        after = rate(
            time, y, poles_re, poles_im, shapes, grid_m, pieces, piece_m, from_x, to_first, speed, physics, slopes[0]
        )
        if n > 1 and force >= before and force >= after and force > peak:
            peak = vertex(before, force, after)[0]
        before, force = force, after
        for k in range(1, 4):
            part = dt if k == 3 else 0.5 * dt
            for i in range(size):
                z[i] = y[i] + part * slopes[k - 1, i]
            rate(
                time + part, z, poles_re, poles_im, shapes, grid_m, pieces, piece_m, from_x, to_first, speed, physics,
                slopes[k],
            )  # fmt: skip
        for i in range(size):
            y[i] += dt / 6.0 * (slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i])
    return peak


@compiled(nogil=True, fastmath=FAST_MATH)
def multiply_adds(numbers, rounds):
    """Compute four chains of multiply-adds of `LANES` in registers: the most that one core can do."""
    factor, term = load(numbers, 0), load(numbers, 1)
    a, b, c, d = load(numbers, 2), load(numbers, 3), load(numbers, 4), load(numbers, 5)
    for _ in range(rounds):
        a, b = multiply_add(a, factor, term), multiply_add(b, factor, term)
        c, d = multiply_add(c, factor, term), multiply_add(d, factor, term)
    store(numbers, 2, a + b + c + d)
