"""Compiled: responses under a moving contact as sums of waves, and a passage by convolution with them."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import FAST_MATH, contact_force


@compiled(nogil=True, fastmath=FAST_MATH)
def moving_response(
    behind_re, behind_im, shape_re, shape_im, multiplier_re, multiplier_im, phase_step_re, phase_step_im, start, row
):
    """Fill `row` (n_step) with the response to a pulse at grid point `start` under a point that moves on from there.

    Sums waves over frequency: `behind` (n_wave, n_frequency) is the pulse's spectrum in each wave, `shape`
    (n_grid, n_wave, n_frequency) the waves over a span, `multiplier` (n_wave, n_frequency) their ratio from span to
    span, `phase_step` (n_frequency) the phase of one step. `behind` is changed.
    """
    grid, waves, frequencies = shape_re.shape
    phase_re, phase_im = np.ones(frequencies), np.zeros(frequencies)
    j = start
    for n in range(row.shape[0]):
        if j == grid:
            j = 0
            for i in range(waves):
                for k in range(frequencies):
                    re, im = behind_re[i, k], behind_im[i, k]
                    behind_re[i, k] = re * multiplier_re[i, k] - im * multiplier_im[i, k]
                    behind_im[i, k] = re * multiplier_im[i, k] + im * multiplier_re[i, k]
        total = 0.0
        for i in range(waves):
            for k in range(frequencies):
                re = behind_re[i, k] * shape_re[j, i, k] - behind_im[i, k] * shape_im[j, i, k]
                im = behind_re[i, k] * shape_im[j, i, k] + behind_im[i, k] * shape_re[j, i, k]
                total += re * phase_re[k] - im * phase_im[k]
        for k in range(frequencies):
            advanced = phase_re[k] * phase_step_re[k] - phase_im[k] * phase_step_im[k]
            phase_im[k] = phase_re[k] * phase_step_im[k] + phase_im[k] * phase_step_re[k]
            phase_re[k] = advanced
        row[n] = total
        j += 1


@compiled(nogil=True, fastmath=FAST_MATH)
def passage_by_convolution(rows, nodes, weights, start, at_rest, irregularity, physics, dt, result):
    """Simulate a passage from grid point `start`; the rail moves by the sum of the responses to all earlier forces.

    A pulse at grid point j answers with `weights[j] @ rows[nodes[j]]`. For the first `at_rest` steps the force is the
    static load, so that the rail has settled under a moving load; then the wheel is let go. `result`
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
