"""Compiled: passages one after the other, for rail states of any kind.

The rail's states stand at a grid point of the span together with the force there; a step takes them to the next point
(`weld_force_ros.physics.passage.state_space`) and solves the contact for the force at its end.
"""

from typing import NamedTuple

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import (
    CHECK_EVERY_STEPS,
    FAST_MATH,
    QUIET,
    Filters,
    contact_force,
    copy,
    extremes,
    filtered_transient_decayed,
    transient_decayed,
    vertex,
)
from weld_force_ros.physics.passage.state_space import Propagation


class Passages(NamedTuple):
    """Passages of one speed; each starts at a grid point in the periodic state on smooth rail.

    Attributes:
        initial_states: (n_passage, n_state + 3), that state: rail, displacement, velocity and force of the wheel.
        starts: (n_passage,), the grid point.
        ends: (n_passage,), steps until the weld is behind.
        irregularity_m: (n_passage, n), from the start on, zero beyond.
    """

    initial_states: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    irregularity_m: np.ndarray


class SmoothRail(NamedTuple):
    """The smooth-rail force that a passage is compared with, and how long it continues behind the weld.

    Attributes:
        force_n: (n_grid,), force on smooth rail.
        negligible_n: a transient below it is not waited for.
        span: steps from sleeper to sleeper.
        window: steps through which a transient has to have decayed.
        run_out: most steps behind the weld.
    """

    force_n: np.ndarray
    negligible_n: float
    span: int
    window: int
    run_out: int


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _advance(rail, scratch, drive, force, decay, transitions, j):
    """Take the states to the next grid point, without the force that will act there."""
    if transitions.shape[0] == 0:
        for k in range(decay.shape[1]):
            re, im = rail[2 * k], rail[2 * k + 1]
            rail[2 * k] = decay[0, k] * re - decay[1, k] * im + drive[2 * k] * force
            rail[2 * k + 1] = decay[0, k] * im + decay[1, k] * re + drive[2 * k + 1] * force
    else:
        for i in range(rail.shape[0]):
            total = drive[i] * force
            for k in range(rail.shape[0]):
                total += transitions[j, i, k] * rail[k]
            scratch[i] = total
        copy(scratch, rail)


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _close_step(rail, wheel, shape, gain, irregularity, physics, dt):
    """Solve the contact at the end of a step: move `wheel` (displacement, velocity, force), return the force."""
    mass, load, hertz = physics[0], physics[1], physics[2]
    old = wheel[2]
    displacement = 0.0
    for i in range(rail.shape[0]):
        displacement += shape[i] * rail[i]
    free = wheel[0] + dt * (wheel[1] + dt * (0.5 * load - old / 3.0) / mass)
    own = dt * dt / (6.0 * mass)
    force = contact_force(free - displacement - irregularity, gain + own, hertz)
    wheel[0] = free - own * force
    wheel[1] += dt * (load - 0.5 * (old + force)) / mass
    wheel[2] = force
    return force


@compiled(nogil=True, fastmath=FAST_MATH)
def settle_to_periodic(rail, wheel, step: Propagation, physics, dt, tolerance, most_spans, states):
    """Step over smooth rail, span by span, until the force repeats; the last span's states are kept.

    `rail`, `wheel`: state at grid point 0, changed in place. `states` (n_grid, n_state + 3): state at each point of the
    last span. Return the number of spans, or -1 if the force does not settle.
    """
    grid = step.drives.shape[0]
    scratch = np.empty_like(rail)
    for span in range(most_spans):
        change = 0.0
        for j in range(grid):
            if span > 0:
                change = max(change, abs(states[j, -1] - wheel[2]))
            copy(rail, states[j, :-3])
            copy(wheel, states[j, -3:])
            ahead = j + 1 if j + 1 < grid else 0
            _advance(rail, scratch, step.drives[j], wheel[2], step.decay, step.transitions, j)
            _close_step(rail, wheel, step.shapes[ahead], step.gains[ahead], 0.0, physics, dt)
        if not np.isfinite(wheel[2]):
            return -1
        if span > 0 and change < tolerance:
            return span + 1
    return -1


@compiled(nogil=True, fastmath=FAST_MATH)
def sampled(pieces, piece_m, first_m, firsts_m, step_m, rows):
    """Fill `rows` (n_row, n) with values of a cubic spline, zero outside, each row from its `firsts_m` (n_row,) on.

    `pieces` (4, n): coefficients of pieces of equal length from `first_m` on, as of `scipy.interpolate.PPoly`.
    """
    for i in range(rows.shape[0]):
        for n in range(rows.shape[1]):
            place = (firsts_m[i] + n * step_m - first_m) / piece_m
            value = 0.0
            if 0.0 < place < pieces.shape[1]:
                piece = int(place)
                s = (place - piece) * piece_m
                value = ((pieces[0, piece] * s + pieces[1, piece]) * s + pieces[2, piece]) * s + pieces[3, piece]
            rows[i, n] = value


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _add_level(levels, after):
    """Move `levels` on by a sample: the last two; the highest that another follows, and both its neighbours."""
    if levels[1] > levels[3]:
        levels[2], levels[3], levels[4] = levels[0], levels[1], after
    levels[0], levels[1] = levels[1], after


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _advance_filters(filters, filtered, levels, j, departure, departure_after):
    """Take the filters to grid point j, where the force departs from smooth rail's by `departure_after`."""
    n_modes = filters.decay.shape[2]
    for q in range(filters.gains.shape[0]):
        level = filters.smooth_n[q, j] + filters.gains[q] * departure_after
        for m in range(n_modes):
            p = 2 * (n_modes * q + m)
            re, im = filtered[p], filtered[p + 1]
            filtered[p] = filters.decay[0, q, m] * re - filters.decay[1, q, m] * im + departure
            filtered[p + 1] = filters.decay[0, q, m] * im + filters.decay[1, q, m] * re
            level += filters.shapes[0, q, m] * filtered[p] - filters.shapes[1, q, m] * filtered[p + 1]
        _add_level(levels[q], level)


@compiled(nogil=True, fastmath=FAST_MATH)
def peaks_at_speed(passages: Passages, step: Propagation, smooth: SmoothRail, filters: Filters, physics, dt, results):
    """Simulate passages of one speed.

    A passage ends when one of the windows that follow on each other behind the weld has seen the transient decay, at
    the latest after the longest run-out. Without filters it ends as soon as any half a window has seen it at half that
    level; with them it goes on until they show nothing more, its other results unchanged.

    `results` (n_passage, 6 + n_end): peak force, its place in steps from the start, least force, time without contact,
    largest second difference of the force, number of steps; with filters, n_end = n_filter + 2 n_filter n_mode + 3: the
    greatest of each, their states at the end, and the wheel there (displacement, velocity, force).
    """
    grid, irregular = step.drives.shape[0], passages.irregularity_m.shape[1]
    n_filters, n_modes = filters.gains.shape[0], filters.decay.shape[2]
    filtered, levels = np.empty(2 * n_filters * n_modes), np.empty((n_filters, 5))
    smooth_high, smooth_low = extremes(smooth.force_n)
    for i in range(passages.starts.shape[0]):
        j = passages.starts[i] % grid
        rail, wheel = passages.initial_states[i, :-3].copy(), passages.initial_states[i, -3:].copy()
        scratch = np.empty_like(rail)
        force = before = top = top_before = top_after = least = wheel[2]
        place, steps_apart, second_difference, transient, swing, loud = 0, 0, 0.0, 0.0, 0.0, passages.ends[i]
        filtered[:] = 0.0
        for q in range(n_filters):
            levels[q, :] = filters.smooth_n[q, j]
        departure = force - smooth.force_n[j]
        next_check = passages.ends[i] + smooth.window
        ended = False
        n = 0
        while True:
            n += 1
            _advance(rail, scratch, step.drives[j], force, step.decay, step.transitions, j)
            j = j + 1 if j + 1 < grid else 0
            irregularity = passages.irregularity_m[i, n] if n < irregular else 0.0
            after = _close_step(rail, wheel, step.shapes[j], step.gains[j], irregularity, physics, dt)
            if force > top:
                top_before, top, top_after, place = before, force, after, n - 1
            least = min(least, after)
            if after == 0.0:
                steps_apart += 1
            departure_after = after - smooth.force_n[j]
            _advance_filters(filters, filtered, levels, j, departure, departure_after)
            departure = departure_after
            swing = max(swing, abs(departure))
            second_difference = max(second_difference, abs(before - 2.0 * force + after))
            before, force = force, after
            if n % CHECK_EVERY_STEPS > 0:
                continue
            transient = max(transient, swing)
            audible = QUIET * min(top - smooth_high, smooth_low - least)
            if audible <= smooth.negligible_n or swing >= audible:
                loud = max(loud, n)
            swing = 0.0
            quiet = n_filters == 0 and n >= loud + smooth.window // 2
            if quiet or n >= next_check:
                a_span_behind = n >= passages.ends[i] + smooth.span
                run_out_over = n >= passages.ends[i] + smooth.run_out
                decayed = quiet or transient_decayed(
                    transient, top, least, smooth_high, smooth_low, smooth.negligible_n, a_span_behind
                )
                if not ended and (decayed or run_out_over):
                    ended = True
                    peak, offset = vertex(top_before, top, top_after)
                    results[i, 0], results[i, 1], results[i, 2] = peak, place + offset, least
                    results[i, 3], results[i, 4] = steps_apart * dt, second_difference
                for q in range(n_filters):
                    decayed = decayed and filtered_transient_decayed(
                        transient, levels[q, 3], filters.floors_n[q], smooth.negligible_n, a_span_behind
                    )
                if ended and (decayed or run_out_over):
                    break
                next_check, transient = n + smooth.window, 0.0
        results[i, 5] = n
        if not np.isfinite(wheel[0]):
            results[i, 0] = np.nan
        if n_filters > 0:
            for q in range(n_filters):
                results[i, 6 + q] = vertex(levels[q, 2], levels[q, 3], levels[q, 4])[0]
            copy(filtered, results[i, 6 + n_filters : -3])
            copy(wheel, results[i, -3:])


@compiled(nogil=True, fastmath=FAST_MATH)
def history_of_passage(rail, wheel, step: Propagation, start, irregularity, physics, dt, result):
    """Simulate one passage: `result` (n, 3) gets force, wheel and rail displacement at the start and of every step."""
    grid = step.drives.shape[0]
    scratch = np.empty_like(rail)
    j = start % grid
    for n in range(irregularity.shape[0]):
        if n > 0:
            _advance(rail, scratch, step.drives[j], wheel[2], step.decay, step.transitions, j)
            j = j + 1 if j + 1 < grid else 0
            _close_step(rail, wheel, step.shapes[j], step.gains[j], irregularity[n], physics, dt)
        result[n, 0], result[n, 1] = wheel[2], wheel[0]
        displacement = step.gains[j] * wheel[2]
        for i in range(rail.shape[0]):
            displacement += step.shapes[j, i] * rail[i]
        result[n, 2] = displacement
