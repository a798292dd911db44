"""Compiled: passages at sixteen speeds and two places side by side, on one grid: a lane each. Common poles only."""

from typing import NamedTuple

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import (
    CHECK_EVERY_STEPS,
    FAST_MATH,
    QUIET,
    Filters,
    copy,
    extremes,
    filtered_transient_decayed,
    transient_decayed,
    vertex,
)
from weld_force_ros.physics.passage._simd import (
    LANES,
    SPEEDS,
    any_greater,
    double,
    load,
    load_two,
    magnitude,
    multiply_add,
    single,
    splat,
    spread_four,
    spread_two,
    square_root,
    store,
    where_greater,
)

# Rows of the working array that lanes are checked by.
_TOP_BEFORE, _TOP, _TOP_AFTER, _PLACE, _STEPS_APART, _SECOND_DIFFERENCE, _LEAST, _TRANSIENT, _LOUD = range(9)
_WHEEL = 9
_ROWS = 12
_HARDLY_IN_CONTACT_N = 1.0


class SpeedBlocks(NamedTuple):
    """Blocks of sixteen speeds.

    Attributes:
        decay: (n_block, 2, n_mode, LANES), E.
        input_scale: as `decay`, takes a drive to the shape.
        drives: (n_grid, n_state), of all speeds.
        gains: (n_block, n_grid, SPEEDS).
        smooth_n: (n_block, n_grid, SPEEDS), force on smooth rail.
        windows: (n_block, LANES), steps through which a transient has to have decayed.
        run_outs: (n_block, LANES), most steps behind the weld.
        dt_s: (n_block, LANES).
        span: steps from sleeper to sleeper.
    """

    decay: np.ndarray
    input_scale: np.ndarray
    drives: np.ndarray
    gains: np.ndarray
    smooth_n: np.ndarray
    windows: np.ndarray
    run_outs: np.ndarray
    dt_s: np.ndarray
    span: int


class PlacePairs(NamedTuple):
    """Pairs of places, each at a block of speeds.

    Attributes:
        speed_blocks: (n_pair,), which block.
        initial_states: (n_pair, n_state + 3, LANES), where the passages start.
        starts: (n_pair, 2), grid point.
        ends: (n_pair, 2), steps until the weld is behind.
        irregularity_m: (n_row, n), from the start on, zero beyond.
        rows: (n_pair, 4), of the irregularity that each quarter of the lanes meets.
    """

    speed_blocks: np.ndarray
    initial_states: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    irregularity_m: np.ndarray
    rows: np.ndarray


@compiled(nogil=True, fastmath=FAST_MATH)
def _advance_filters(filters: Filters, departures, filtered, levels, speed_block, j, k):
    """Take the filters of a speed block over the last steps, since the last check, to grid points j and k.

    All steps of one mode before the next, as so long its numbers stay in registers. Flat arrays of lanes: `departures`
    from the smooth rail's force, with the one before these steps; `filtered` and `levels`, each filter's states and
    five levels (see `_scalar_passage._add_level`), are moved on.
    """
    n_filters, n_modes, grid = filters.decay.shape[2], filters.decay.shape[3], filters.smooth_n.shape[2]
    decays, shapes, gains, smooth = (
        filters.decay.ravel(), filters.shapes.ravel(), filters.gains.ravel(), filters.smooth_n.ravel()
    )  # fmt: skip
    zero, block = splat(0.0), np.empty(CHECK_EVERY_STEPS * LANES)
    first, first_other = (j - CHECK_EVERY_STEPS + 1) % grid, (k - CHECK_EVERY_STEPS + 1) % grid
    for q in range(n_filters):
        row = speed_block * n_filters + q
        gain, at, at_other = load(gains, row), first, first_other
        for n in range(CHECK_EVERY_STEPS):
            settled = load_two(smooth, row * grid + at, row * grid + at_other)
            store(block, n, multiply_add(gain, load(departures, n + 1), settled))
            at = at + 1 if at + 1 < grid else 0
            at_other = at_other + 1 if at_other + 1 < grid else 0
        for p in range(n_modes * q, n_modes * q + n_modes):
            real = 2 * n_filters * n_modes * speed_block + p
            imag = n_filters * n_modes * (2 * speed_block + 1) + p
            decay_re, decay_im, shape_re = load(decays, real), load(decays, imag), load(shapes, real)
            minus_decay_im, minus_shape_im = zero - decay_im, zero - load(shapes, imag)
            re, im = load(filtered, 2 * p), load(filtered, 2 * p + 1)
            for n in range(CHECK_EVERY_STEPS):
                new_re = multiply_add(decay_re, re, multiply_add(minus_decay_im, im, load(departures, n)))
                im = multiply_add(decay_re, im, decay_im * re)
                re = new_re
                store(block, n, multiply_add(shape_re, re, multiply_add(minus_shape_im, im, load(block, n))))
            store(filtered, 2 * p, re)
            store(filtered, 2 * p + 1, im)
        _add_levels(levels, q, block)


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _add_levels(levels, q, block):
    """Move filter q's levels on by the samples of `block`."""
    before, level, top_before = load(levels, 5 * q), load(levels, 5 * q + 1), load(levels, 5 * q + 2)
    top, top_after = load(levels, 5 * q + 3), load(levels, 5 * q + 4)
    for n in range(CHECK_EVERY_STEPS):
        after = load(block, n)
        top_before = where_greater(level, top, before, top_before)
        top_after = where_greater(level, top, after, top_after)
        top = where_greater(level, top, level, top)
        before, level = level, after
    store(levels, 5 * q, before)
    store(levels, 5 * q + 1, level)
    store(levels, 5 * q + 2, top_before)
    store(levels, 5 * q + 3, top)
    store(levels, 5 * q + 4, top_after)


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _advance_rail(
    rail, force, irregularity, decays, input_scales, real_row, imag_row, drives, n_state, j, k, j_ahead, k_ahead
):
    """Take the rail's states a step on.

    Return the sums of their real and imaginary parts, which the displacement is the difference of, the first with
    the irregularity added.
    """
    zero = splat(0.0)
    displacement_re, displacement_im = irregularity, zero
    for p in range(n_state // 2):
        re, im = load(rail, 2 * p), load(rail, 2 * p + 1)
        decay_re, decay_im = load(decays, real_row + p), load(decays, imag_row + p)
        scale_re, scale_im = load(input_scales, real_row + p), load(input_scales, imag_row + p)
        here_re = spread_two(drives, j * n_state + 2 * p, k * n_state + 2 * p)
        here_im = spread_two(drives, j * n_state + 2 * p + 1, k * n_state + 2 * p + 1)
        there_re = spread_two(drives, j_ahead * n_state + 2 * p, k_ahead * n_state + 2 * p)
        there_im = spread_two(drives, j_ahead * n_state + 2 * p + 1, k_ahead * n_state + 2 * p + 1)
        new_re = multiply_add(decay_re, re, multiply_add(zero - decay_im, im, here_re * force))
        new_im = multiply_add(decay_re, im, multiply_add(decay_im, re, here_im * force))
        store(rail, 2 * p, new_re)
        store(rail, 2 * p + 1, new_im)
        shape_re = multiply_add(scale_re, there_re, (zero - scale_im) * there_im)
        shape_im = multiply_add(scale_re, there_im, scale_im * there_re)
        displacement_re = multiply_add(shape_re, new_re, displacement_re)
        displacement_im = multiply_add(shape_im, new_im, displacement_im)
    return displacement_re, displacement_im


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _square_root_of_indentation(gap, stiffness):
    """Return u of u^2 + stiffness u^3 = gap, as `_contact.contact_force` has it.

    The first guess and its improvement are in single precision, the last two steps with the slope known by then.
    """
    one = splat(1.0)
    one_single, two_single, three_single = single(one), single(splat(2.0)), single(splat(3.0))
    gap_single, stiffness_single = single(gap), single(stiffness)
    guess = square_root(
        gap_single / multiply_add(stiffness_single, square_root(gap_single), one_single)
    ) + single(splat(1e-30))  # fmt: skip
    for _ in range(3):
        bent = stiffness_single * guess
        inverse = one_single / (guess * multiply_add(three_single, bent, two_single))
        guess = guess - (guess * guess * (one_single + bent) - gap_single) * inverse
    root, slope = double(guess), double(inverse)
    for _ in range(2):
        root = root - (root * root * multiply_add(stiffness, root, one) - gap) * slope
    return root


@compiled(nogil=True, fastmath=FAST_MATH)
def _note_extremes(forces, departures, smooth, working, grid_row, n_grid, j, k, first):
    """Take the extremes in `working` over the last steps, since the last check.

    Peaks, and steps without contact, are looked for one by one where a step among them can be one: in few.

    Args:
        forces: flat, of lanes: two before these steps, and theirs.
        departures: from the smooth rail's force, one before these steps, and theirs, which are filled in.
        smooth: flat, of half the lanes.
        working: whose rows are moved on.
        grid_row: first row of the span in `smooth`.
        n_grid: rows of the span.
        j: grid point before these steps, of half of the lanes.
        k: of the other half.
        first: number of steps before these.

    Returns:
        The largest departure of these steps.
    """
    before, force = load(forces, 0), load(forces, 1)
    highest, least, two = force, load(working, _LEAST), splat(2.0)
    second_difference, swing = load(working, _SECOND_DIFFERENCE), splat(0.0)
    for n in range(CHECK_EVERY_STEPS):
        after = load(forces, n + 2)
        highest = where_greater(force, highest, force, highest)
        least = where_greater(least, after, after, least)
        difference = magnitude(before - two * force + after)
        second_difference = where_greater(difference, second_difference, difference, second_difference)
        j = j + 1 if j + 1 < n_grid else 0
        k = k + 1 if k + 1 < n_grid else 0
        departure = after - load_two(smooth, grid_row + j, grid_row + k)
        store(departures, n + 1, departure)
        amplitude = magnitude(departure)
        swing = where_greater(amplitude, swing, amplitude, swing)
        before, force = force, after
    store(working, _LEAST, least)
    store(working, _SECOND_DIFFERENCE, second_difference)
    transient = load(working, _TRANSIENT)
    store(working, _TRANSIENT, where_greater(swing, transient, swing, transient))
    if any_greater(highest, load(working, _TOP)):
        _note_tops(forces, working, first)
    if any_greater(splat(_HARDLY_IN_CONTACT_N), least):
        _count_apart(forces, working)
    return swing


@compiled(nogil=True, fastmath=FAST_MATH)
def _note_tops(forces, working, first):
    before, force = load(forces, 0), load(forces, 1)
    top_before, top, top_after = load(working, _TOP_BEFORE), load(working, _TOP), load(working, _TOP_AFTER)
    place = load(working, _PLACE)
    for n in range(CHECK_EVERY_STEPS):
        after = load(forces, n + 2)
        top_before = where_greater(force, top, before, top_before)
        top_after = where_greater(force, top, after, top_after)
        place = where_greater(force, top, splat(float(first + n)), place)
        top = where_greater(force, top, force, top)
        before, force = force, after
    store(working, _TOP_BEFORE, top_before)
    store(working, _TOP, top)
    store(working, _TOP_AFTER, top_after)
    store(working, _PLACE, place)


@compiled(nogil=True, fastmath=FAST_MATH)
def _count_apart(forces, working):
    steps_apart, zero, one = load(working, _STEPS_APART), splat(0.0), splat(1.0)
    for n in range(CHECK_EVERY_STEPS):
        steps_apart = steps_apart + where_greater(load(forces, n + 2), zero, zero, one)
    store(working, _STEPS_APART, steps_apart)


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _write_extremes(lane, working, dt, row):
    peak, offset = vertex(
        working[_TOP_BEFORE * LANES + lane], working[_TOP * LANES + lane], working[_TOP_AFTER * LANES + lane]
    )
    row[0], row[1] = peak, working[_PLACE * LANES + lane] + offset
    row[2], row[3] = working[_LEAST * LANES + lane], working[_STEPS_APART * LANES + lane] * dt
    row[4] = working[_SECOND_DIFFERENCE * LANES + lane]


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _write_end(lane, n, working, filtered, levels, n_filters, row):
    row[5] = n
    if not np.isfinite(working[_WHEEL * LANES + lane]):
        row[0] = np.nan
    if n_filters > 0:
        for q in range(n_filters):
            top_at = (5 * q + 3) * LANES + lane
            row[6 + q] = vertex(levels[top_at - LANES], levels[top_at], levels[top_at + LANES])[0]
        for p in range(filtered.shape[0] // LANES):
            row[6 + n_filters + p] = filtered[p * LANES + lane]
        for s in range(3):
            row[s - 3] = working[(_WHEEL + s) * LANES + lane]


@compiled(nogil=True, fastmath=FAST_MATH)
def peaks_in_lanes(pairs: PlacePairs, blocks: SpeedBlocks, filters: Filters, physics, negligible_n, results):
    """Simulate passages as `_scalar_passage.peaks_at_speed` does, with its results: (n_pair, LANES, 6 + n_end)."""
    n_grid, n_state = blocks.drives.shape
    n_modes, irregular = n_state // 2, pairs.irregularity_m.shape[1]
    decays, input_scales = blocks.decay.ravel(), blocks.input_scale.ravel()
    drives, gain_rows, smooth_rows = blocks.drives.ravel(), blocks.gains.ravel(), blocks.smooth_n.ravel()
    irregularities, all_dts, filter_rows = pairs.irregularity_m.ravel(), blocks.dt_s.ravel(), filters.smooth_n.ravel()
    n_filters = filters.decay.shape[2]
    filtered, levels = np.empty(2 * n_filters * filters.decay.shape[3] * LANES), np.empty(5 * n_filters * LANES)
    departures, forces = np.empty((CHECK_EVERY_STEPS + 1) * LANES), np.empty((CHECK_EVERY_STEPS + 2) * LANES)
    smooth_high, smooth_low = np.empty(LANES), np.empty(LANES)
    rail, working = np.empty(n_state * LANES), np.empty(_ROWS * LANES)
    next_checks, quiet_checks = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    active, ended = np.empty(LANES, np.bool_), np.empty(LANES, np.bool_)
    zero = splat(0.0)
    half, third = splat(0.5), splat(1.0 / 3.0)
    load_n, hertz = splat(physics[1]), splat(physics[2])
    for i in range(pairs.speed_blocks.shape[0]):
        block = pairs.speed_blocks[i]
        real_row, imag_row, grid_row = 2 * n_modes * block, (2 * block + 1) * n_modes, n_grid * block
        dt = load(all_dts, block)
        dt_over_mass = dt / splat(physics[0])
        own = dt * dt_over_mass * splat(1.0 / 6.0)
        for speed in range(SPEEDS):
            high, low = extremes(blocks.smooth_n[block, :, speed])
            smooth_high[speed], smooth_high[speed + SPEEDS] = high, high
            smooth_low[speed], smooth_low[speed + SPEEDS] = low, low
        initial = pairs.initial_states[i].ravel()
        copy(initial[: n_state * LANES], rail)
        wheel, velocity, force = load(initial, n_state), load(initial, n_state + 1), load(initial, n_state + 2)
        for s in range(_ROWS):
            store(working, s, zero)
        for s in (_TOP_BEFORE, _TOP, _TOP_AFTER, _LEAST):
            store(working, s, force)
        store(forces, CHECK_EVERY_STEPS, force)
        store(forces, CHECK_EVERY_STEPS + 1, force)
        for lane in range(LANES):
            next_checks[lane] = pairs.ends[i, lane // SPEEDS] + blocks.windows[block, lane]
            quiet_checks[lane] = next_checks[lane]
            if n_filters == 0:
                quiet_checks[lane] -= blocks.windows[block, lane] - blocks.windows[block, lane] // 2
            active[lane], ended[lane] = True, False
        n_active = LANES
        j, k = pairs.starts[i, 0] % n_grid, pairs.starts[i, 1] % n_grid
        row_a, row_b, row_c, row_d = pairs.rows[i, 0], pairs.rows[i, 1], pairs.rows[i, 2], pairs.rows[i, 3]
        filtered[:] = 0.0
        for q in range(n_filters):
            row = (block * n_filters + q) * n_grid
            for s in range(5):
                store(levels, 5 * q + s, load_two(filter_rows, row + j, row + k))
        store(departures, 0, force - load_two(smooth_rows, grid_row + j, grid_row + k))
        n = 0
        while n_active > 0:
            copy(forces[CHECK_EVERY_STEPS * LANES :], forces[: 2 * LANES])
            j_first, k_first = j, k
            for m in range(CHECK_EVERY_STEPS):
                n += 1
                j_ahead = j + 1 if j + 1 < n_grid else 0
                k_ahead = k + 1 if k + 1 < n_grid else 0
                irregularity = zero
                if n < irregular:
                    irregularity = spread_four(
                        irregularities, row_a * irregular + n, row_b * irregular + n, row_c * irregular + n,
                        row_d * irregular + n,
                    )  # fmt: skip
                displacement_re, displacement_im = _advance_rail(
                    rail, force, irregularity, decays, input_scales, real_row, imag_row, drives, n_state, j, k, j_ahead,
                    k_ahead,
                )  # fmt: skip
                free_wheel = multiply_add(
                    dt, multiply_add(dt_over_mass, half * load_n - third * force, velocity), wheel
                )  # fmt: skip
                gap = free_wheel - displacement_re + displacement_im
                gap = where_greater(gap, zero, gap, zero)
                stiffness = (load_two(gain_rows, grid_row + j_ahead, grid_row + k_ahead) + own) * hertz
                root = _square_root_of_indentation(gap, stiffness)
                after = where_greater(gap, zero, hertz * root * root * root, zero)
                wheel = free_wheel - own * after
                velocity = multiply_add(dt_over_mass, load_n - half * (force + after), velocity)
                store(forces, m + 2, after)
                force = after
                j, k = j_ahead, k_ahead
            swing = _note_extremes(
                forces, departures, smooth_rows, working, grid_row, n_grid, j_first, k_first, n - CHECK_EVERY_STEPS
            )
            store(working, _WHEEL, wheel)
            store(working, _WHEEL + 1, velocity)
            store(working, _WHEEL + 2, force)
            if n_filters > 0:
                _advance_filters(filters, departures, filtered, levels, block, j, k)
                copy(departures[CHECK_EVERY_STEPS * LANES :], departures[:LANES])
            else:
                rise = load(working, _TOP) - load(smooth_high, 0)
                fall = load(smooth_low, 0) - load(working, _LEAST)
                audible = splat(QUIET) * where_greater(rise, fall, fall, rise)
                audible = where_greater(audible, splat(negligible_n), audible, zero)
                store(working, _LOUD, where_greater(audible, swing, load(working, _LOUD), splat(float(n))))
            for lane in range(LANES):
                if not active[lane] or n < quiet_checks[lane]:
                    continue
                end, window, quiet = pairs.ends[i, lane // SPEEDS], blocks.windows[block, lane], False
                if n_filters == 0:
                    quiet_from = max(end, int(working[_LOUD * LANES + lane])) + window // 2
                    quiet = n >= quiet_from
                    if not quiet and n < next_checks[lane]:
                        quiet_checks[lane] = min(quiet_from, next_checks[lane])
                        continue
                seen = working[_TRANSIENT * LANES + lane]
                a_span_behind, run_out_over = n >= end + blocks.span, n >= end + blocks.run_outs[block, lane]
                decayed = quiet or transient_decayed(
                    seen, working[_TOP * LANES + lane], working[_LEAST * LANES + lane], smooth_high[lane],
                    smooth_low[lane], negligible_n, a_span_behind,
                )  # fmt: skip
                if not ended[lane] and (decayed or run_out_over):
                    ended[lane] = True
                    _write_extremes(lane, working, blocks.dt_s[block, lane], results[i, lane])
                for q in range(n_filters):
                    highest, floor = levels[(5 * q + 3) * LANES + lane], filters.floors_n[block, q, lane]
                    decayed = decayed and filtered_transient_decayed(seen, highest, floor, negligible_n, a_span_behind)
                if ended[lane] and (decayed or run_out_over):
                    active[lane] = False
                    n_active -= 1
                    _write_end(lane, n, working, filtered, levels, n_filters, results[i, lane])
                else:
                    next_checks[lane] = n + window
                    quiet_checks[lane] = n + 1 if n_filters == 0 else next_checks[lane]
                    working[_TRANSIENT * LANES + lane] = 0.0
