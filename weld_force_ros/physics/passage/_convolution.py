"""Compiled: responses under a moving contact as sums of waves, and a passage by convolution with them."""

from typing import NamedTuple

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import FAST_MATH, contact_force


class Gaps(NamedTuple):
    """Sleepers that hang over their ballast until they have come down by a gap.

    Attributes:
        responses: (n_gap, n_node, n_lag), m/N, displacement of the sleeper after a unit pulse of contact force at a
            node, and of a contact there after one on the sleeper.
        mutual: (n_gap, n_gap, n_lag), m/N, of a sleeper after a unit pulse on a sleeper.
        stiffness: (n_gap,), N/m, of the ballast.
        damping: (n_gap,), Ns/m, of the ballast.
        gap_m: (n_gap,).
    """

    responses: np.ndarray
    mutual: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    gap_m: np.ndarray


class MovingSupports(NamedTuple):
    """Supports that differ from the track's, as a moving contact feels them in a window.

    Attributes:
        first: grid point, from sleeper 0 on, at which the window begins.
        nodes: (n_grid, 4), which rows make the response at each grid point of the window.
        weights: (n_grid, 4), and how much of each.
        drive: (n_support, n_node, n_lag), a support's upward force on the rail, step by step after a unit pulse.
        motion: (n_support, n_node, n_lag), m/N, displacement of the contact after a unit pulse at a support.
        gaps: those that hang over a gap.
    """

    first: int
    nodes: np.ndarray
    weights: np.ndarray
    drive: np.ndarray
    motion: np.ndarray
    gaps: Gaps


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


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _drive_supports(supports: MovingSupports, force, n, g, reactions):
    """Add what supports do after a pulse of contact force at step n, grid point g of the window, from then on."""
    for s in range(supports.drive.shape[0]):
        for q in range(supports.nodes.shape[1]):
            scale = supports.weights[g, q] * force
            row = supports.drive[s, supports.nodes[g, q]]
            for m in range(row.shape[0]):
                reactions[s, n + m] += scale * row[m]


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _rest_on_ballast(gaps: Gaps, n, dt, down, resting):
    """Let sleepers rest at step n where they have come down by their gap: `resting` is what ballast carries.

    `down` (n_gap, n_step) is how far they came down but for what their ballast carries within this step; spring and
    dashpot of the ballast act while pressed, by the step's end.
    """
    for s in range(gaps.gap_m.shape[0]):
        last = down[s, n - 1] if n > 0 else 0.0
        rate = gaps.stiffness[s] + gaps.damping[s] / dt
        force = rate * (down[s, n] - gaps.gap_m[s]) - gaps.damping[s] / dt * (last - gaps.gap_m[s])
        force /= 1.0 + rate * gaps.mutual[s, s, 0]
        if force <= 0.0 or down[s, n] <= gaps.gap_m[s]:
            continue
        resting[s, n] = force
        for other in range(gaps.gap_m.shape[0]):
            row = gaps.mutual[other, s]
            for m in range(min(row.shape[0], down.shape[1] - n)):
                down[other, n + m] -= force * row[m]


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _move(gaps: Gaps, nodes, weights, force, n, g, down):
    """Add to how far sleepers come down what a pulse of contact force at step n does from the next step on."""
    for s in range(gaps.gap_m.shape[0]):
        for q in range(nodes.shape[1]):
            scale = weights[g, q] * force
            row = gaps.responses[s, nodes[g, q]]
            for m in range(1, min(row.shape[0], down.shape[1] - n)):
                down[s, n + m] += scale * row[m]


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _moved_by_supports(supports: MovingSupports, n, g, reactions, resting):
    """Return the displacement of the contact at grid point g of the window by what supports did until step n."""
    moved = 0.0
    for s in range(supports.gaps.gap_m.shape[0]):
        for q in range(supports.nodes.shape[1]):
            row = supports.gaps.responses[s, supports.nodes[g, q]]
            total = 0.0
            for m in range(min(row.shape[0], n + 1)):
                total += row[m] * resting[s, n - m]
            moved -= supports.weights[g, q] * total
    for s in range(supports.motion.shape[0]):
        for q in range(supports.nodes.shape[1]):
            row = supports.motion[s, supports.nodes[g, q]]
            total = 0.0
            for m in range(min(row.shape[0], n + 1)):
                total += row[m] * reactions[s, n - m]
            moved -= supports.weights[g, q] * total
    return moved


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _compliance_by_supports(supports: MovingSupports, g):
    """Return how far supports that answer within the step move the contact at grid point g, per force there."""
    moved = 0.0
    for s in range(supports.motion.shape[0]):
        drive, motion = 0.0, 0.0
        for q in range(supports.nodes.shape[1]):
            drive += supports.weights[g, q] * supports.drive[s, supports.nodes[g, q], 0]
            motion += supports.weights[g, q] * supports.motion[s, supports.nodes[g, q], 0]
        moved -= drive * motion
    return moved


@compiled(nogil=True, fastmath=FAST_MATH)
def passage_by_convolution(
    rows, nodes, weights, supports: MovingSupports, start, at_rest, irregularity, physics, dt, result
):
    """Simulate a passage from grid point `start`; the rail moves by the sum of the responses to all earlier forces.

    A pulse at grid point j answers with `weights[j] @ rows[nodes[j]]`, and by way of the supports that differ. For the
    first `at_rest` steps the force is the static load, so that the rail has settled under a moving load; then the wheel
    is let go. `result` (n_step, 3): force, wheel and rail displacement, positive down.
    """
    mass, load, hertz = physics[0], physics[1], physics[2]
    steps, grid, memory = irregularity.shape[0], weights.shape[0], rows.shape[1]
    answer = np.zeros(steps + memory)
    reactions = np.zeros((supports.drive.shape[0], steps + memory))
    down = np.zeros((supports.gaps.gap_m.shape[0], steps + memory))
    resting = np.zeros((supports.gaps.gap_m.shape[0], steps))
    own = dt * dt / (6.0 * mass)
    wheel, velocity, force = 0.0, 0.0, load
    j, in_window = start % grid, supports.weights.shape[0]
    for n in range(steps):
        here = 0.0
        for q in range(weights.shape[1]):
            here += weights[j, q] * rows[nodes[j, q], 0]
        g = start + n - supports.first
        _rest_on_ballast(supports.gaps, n, dt, down, resting)
        if 0 <= g < in_window:
            answer[n] += _moved_by_supports(supports, n, g, reactions, resting)
            here += _compliance_by_supports(supports, g)
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
            if 0 <= g < in_window:
                _drive_supports(supports, force, n, g, reactions)
                _move(supports.gaps, supports.nodes, supports.weights, force, n, g, down)
            for q in range(weights.shape[1]):
                scale = weights[j, q] * force
                row = rows[nodes[j, q]]
                for m in range(1, memory):
                    answer[n + m] += scale * row[m]
        j += 1
        if j == grid:
            j = 0
