"""Compiled: passages at eight speeds of each of four places side by side: a lane each. Common poles only."""

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
    PLACES,
    SPEEDS,
    any_greater,
    double,
    load,
    load_four,
    magnitude,
    multiply_add,
    single,
    splat,
    spread_four,
    square_root,
    store,
    where_greater,
)
from weld_force_ros.physics.passage._simd_filters import advance_filters
from weld_force_ros.physics.passage._simd_places import (
    CHUNK,
    ahead,
    four_from,
    put_in_lanes,
    put_side_by_side,
    row_of,
    rows_of,
    slots_of,
    take_up,
)

# Rows of the working array that lanes are checked by.
_TOP_BEFORE, _TOP, _TOP_AFTER, _PLACE, _STEPS_APART, _SECOND_DIFFERENCE, _LEAST, _TRANSIENT, _LOUD = range(9)
_WHEEL = 9
_ROWS = 12
_HARDLY_IN_CONTACT_N = 1.0


class SpeedRows(NamedTuple):
    """Tables with a row a speed.

    Attributes:
        decay: (n_speed, 2, n_mode), E.
        input_scale: as `decay`, takes a drive to the shape.
        drives: (n_grid, n_state), of all speeds.
        gains: (n_speed, n_grid).
        smooth_n: (n_speed, n_grid), force on smooth rail.
        windows: (n_speed,), steps through which a transient has to have decayed.
        run_outs: (n_speed,), most steps behind the weld.
        dt_s: (n_speed,).
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


class Octets(NamedTuple):
    """Eight speeds each at a place; four at a time fill the lanes.

    Attributes:
        speeds: (n_octet, SPEEDS), rows of the tables; the number of octets is a multiple of four.
        initial_states: (n_octet / 4, n_state + 3, LANES), where the passages start.
        starts: (n_octet,), grid point.
        ends: (n_octet,), steps until the weld is behind.
        irregularity_m: (n_row, n), from the start on, zero beyond.
        rows: (n_octet,), of the irregularity.
    """

    speeds: np.ndarray
    initial_states: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    irregularity_m: np.ndarray
    rows: np.ndarray


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _advance_rail(rail, force, irregularity, decays, input_scales, drives, n_state, here, there):
    """Take the rail's states a step on.

    Return the sums of their real and imaginary parts, which the displacement is the difference of, the first with
    the irregularity added.
    """
    zero, n_modes = splat(0.0), n_state // 2
    displacement_re, displacement_im = irregularity, zero
    for p in range(n_modes):
        re, im = load(rail, 2 * p), load(rail, 2 * p + 1)
        decay_re, decay_im = load(decays, p), load(decays, n_modes + p)
        scale_re, scale_im = load(input_scales, p), load(input_scales, n_modes + p)
        here_re = spread_four(drives, row_of(here, n_state, 2 * p))
        here_im = spread_four(drives, row_of(here, n_state, 2 * p + 1))
        there_re = spread_four(drives, row_of(there, n_state, 2 * p))
        there_im = spread_four(drives, row_of(there, n_state, 2 * p + 1))
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
def _note_extremes(forces, working, first):
    """Take the extremes in `working` over the last steps, since the last check.

    Peaks, and steps without contact, are looked for one by one where a step among them can be one: in few.

    Args:
        forces: flat, of lanes: two before these steps, and theirs.
        working: whose rows are moved on.
        first: number of steps before these.
    """
    before, force = load(forces, 0), load(forces, 1)
    highest, least, minus_two = force, load(working, _LEAST), splat(-2.0)
    second_difference = load(working, _SECOND_DIFFERENCE)
    for n in range(CHECK_EVERY_STEPS):
        after = load(forces, n + 2)
        highest = where_greater(force, highest, force, highest)
        least = where_greater(least, after, after, least)
        difference = magnitude(multiply_add(minus_two, force, before) + after)
        second_difference = where_greater(difference, second_difference, difference, second_difference)
        before, force = force, after
    store(working, _LEAST, least)
    store(working, _SECOND_DIFFERENCE, second_difference)
    if any_greater(highest, load(working, _TOP)):
        _note_tops(forces, working, first)
    if any_greater(splat(_HARDLY_IN_CONTACT_N), least):
        _count_apart(forces, working)


@compiled(nogil=True, fastmath=FAST_MATH)
def _note_departures(forces, departures, smooth, working, slots, n_grid, at):
    """Take the departures from the smooth rail's force over the last steps, and the transient in `working`.

    A loop of its own: in one with `_note_extremes`, more is kept than there are registers, and steps wait for memory.

    Args:
        forces: flat, of lanes: two before these steps, and theirs.
        departures: one before these steps, and theirs, which are filled in.
        smooth: flat, of four slots.
        working: whose row is moved on.
        slots: those of the four places.
        n_grid: rows of the span.
        at: four grid points before these steps.

    Returns:
        The largest departure of these steps.
    """
    swing = splat(0.0)
    for n in range(CHECK_EVERY_STEPS):
        at = ahead(at, n_grid)
        departure = load(forces, n + 2) - load_four(smooth, rows_of(slots, n_grid, at))
        store(departures, n + 1, departure)
        amplitude = magnitude(departure)
        swing = where_greater(amplitude, swing, amplitude, swing)
    transient = load(working, _TRANSIENT)
    store(working, _TRANSIENT, where_greater(swing, transient, swing, transient))
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
def peaks_in_lanes(octets: Octets, tables: SpeedRows, filters: Filters, physics, negligible_n, results):
    """Simulate passages as `_scalar_passage.peaks_at_speed` does, with its results: (n_octet, SPEEDS, 6 + n_end)."""
    n_grid, n_state = tables.drives.shape
    irregular = octets.irregularity_m.shape[1]
    drives, irregularities = tables.drives.ravel(), octets.irregularity_m.ravel()
    n_filters = filters.decay.shape[2]
    n_filter_modes = n_filters * filters.decay.shape[3]
    gains, smooth = np.empty(n_grid * LANES), np.empty(n_grid * LANES)
    at_hand, speeds = np.full(LANES, -1), np.empty(LANES, np.int64)
    filtered, levels = np.empty(2 * n_filter_modes * LANES), np.empty(5 * n_filters * LANES)
    decays, input_scales, dts = np.empty(n_state * LANES), np.empty(n_state * LANES), np.empty(LANES)
    own_filters = Filters(
        np.empty(2 * n_filter_modes * LANES), np.empty(2 * n_filter_modes * LANES), np.empty(n_filters * LANES),
        np.empty(n_filters * n_grid * LANES), np.empty(n_filters * LANES),
    )  # fmt: skip
    along = tables.gains.ravel(), tables.smooth_n.ravel(), filters.smooth_n.ravel()
    side_by_side = gains, smooth, own_filters.smooth_n
    is_there = np.zeros((PLACES, max(1, n_grid // CHUNK)), np.bool_)
    departures, forces = np.empty((CHECK_EVERY_STEPS + 1) * LANES), np.empty((CHECK_EVERY_STEPS + 2) * LANES)
    smooth_high, smooth_low = np.empty(LANES), np.empty(LANES)
    rail, working = np.empty(n_state * LANES), np.empty(_ROWS * LANES)
    next_checks, quiet_checks = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    active, ended = np.empty(LANES, np.bool_), np.empty(LANES, np.bool_)
    zero = splat(0.0)
    half, third = splat(0.5), splat(1.0 / 3.0)
    load_n, hertz = splat(physics[1]), splat(physics[2])
    for i in range(octets.initial_states.shape[0]):
        first = PLACES * i
        copy(octets.speeds[first : first + PLACES].ravel(), speeds)
        slots, rows = slots_of(speeds), four_from(octets.rows, first)
        take_up(speeds, slots, at_hand, is_there)
        put_in_lanes(tables.decay, speeds, decays)
        put_in_lanes(tables.input_scale, speeds, input_scales)
        put_in_lanes(tables.dt_s, speeds, dts)
        put_in_lanes(filters.decay, speeds, own_filters.decay)
        put_in_lanes(filters.shapes, speeds, own_filters.shapes)
        put_in_lanes(filters.gains, speeds, own_filters.gains)
        put_in_lanes(filters.floors_n, speeds, own_filters.floors_n)
        dt = load(dts, 0)
        dt_over_mass = dt / splat(physics[0])
        own = dt * dt_over_mass * splat(1.0 / 6.0)
        for lane in range(LANES):
            smooth_high[lane], smooth_low[lane] = extremes(tables.smooth_n[speeds[lane]])
        initial = octets.initial_states[i].ravel()
        copy(initial[: n_state * LANES], rail)
        wheel, velocity, force = load(initial, n_state), load(initial, n_state + 1), load(initial, n_state + 2)
        for s in range(_ROWS):
            store(working, s, zero)
        for s in (_TOP_BEFORE, _TOP, _TOP_AFTER, _LEAST):
            store(working, s, force)
        store(forces, CHECK_EVERY_STEPS, force)
        store(forces, CHECK_EVERY_STEPS + 1, force)
        for lane in range(LANES):
            window = tables.windows[speeds[lane]]
            next_checks[lane] = octets.ends[first + lane // SPEEDS] + window
            quiet_checks[lane] = next_checks[lane]
            if n_filters == 0:
                quiet_checks[lane] -= window - window // 2
            active[lane], ended[lane] = True, False
        n_active = LANES
        here = (
            octets.starts[first] % n_grid, octets.starts[first + 1] % n_grid, octets.starts[first + 2] % n_grid,
            octets.starts[first + 3] % n_grid,
        )  # fmt: skip
        put_side_by_side(along, n_grid, at_hand, slots, here, 0, is_there, side_by_side)
        filtered[:] = 0.0
        for q in range(n_filters):
            settled = load_four(own_filters.smooth_n, rows_of(row_of(slots, n_filters, q), n_grid, here))
            for s in range(5):
                store(levels, 5 * q + s, settled)
        store(departures, 0, force - load_four(smooth, rows_of(slots, n_grid, here)))
        n = 0
        while n_active > 0:
            copy(forces[CHECK_EVERY_STEPS * LANES :], forces[: 2 * LANES])
            before = here
            if n % CHUNK == 0:
                put_side_by_side(along, n_grid, at_hand, slots, here, CHUNK, is_there, side_by_side)
            for m in range(CHECK_EVERY_STEPS):
                n += 1
                there = ahead(here, n_grid)
                # What needs no rail comes before it: the step waits for the contact's roots and quotients.
                free_wheel = multiply_add(
                    dt, multiply_add(dt_over_mass, half * load_n - third * force, velocity), wheel
                )  # fmt: skip
                stiffness = (load_four(gains, rows_of(slots, n_grid, there)) + own) * hertz
                irregularity = zero
                if n < irregular:
                    irregularity = spread_four(irregularities, row_of(rows, irregular, n))
                displacement_re, displacement_im = _advance_rail(
                    rail, force, irregularity, decays, input_scales, drives, n_state, here, there
                )
                gap = free_wheel - displacement_re + displacement_im
                gap = where_greater(gap, zero, gap, zero)
                root = _square_root_of_indentation(gap, stiffness)
                after = where_greater(gap, zero, hertz * root * root * root, zero)
                wheel = free_wheel - own * after
                velocity = multiply_add(dt_over_mass, load_n - half * (force + after), velocity)
                store(forces, m + 2, after)
                force, here = after, there
            _note_extremes(forces, working, n - CHECK_EVERY_STEPS)
            swing = _note_departures(forces, departures, smooth, working, slots, n_grid, before)
            store(working, _WHEEL, wheel)
            store(working, _WHEEL + 1, velocity)
            store(working, _WHEEL + 2, force)
            if n_filters > 0:
                advance_filters(own_filters, n_filters, n_grid, departures, filtered, levels, slots, before)
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
                octet, speed = first + lane // SPEEDS, lane % SPEEDS
                end, window, quiet = octets.ends[octet], tables.windows[speeds[lane]], False
                if n_filters == 0:
                    quiet_from = max(end, int(working[_LOUD * LANES + lane])) + window // 2
                    quiet = n >= quiet_from
                    if not quiet and n < next_checks[lane]:
                        quiet_checks[lane] = min(quiet_from, next_checks[lane])
                        continue
                seen = working[_TRANSIENT * LANES + lane]
                a_span_behind, run_out_over = n >= end + tables.span, n >= end + tables.run_outs[speeds[lane]]
                decayed = quiet or transient_decayed(
                    seen, working[_TOP * LANES + lane], working[_LEAST * LANES + lane], smooth_high[lane],
                    smooth_low[lane], negligible_n, a_span_behind,
                )  # fmt: skip
                if not ended[lane] and (decayed or run_out_over):
                    ended[lane] = True
                    _write_extremes(lane, working, dts[lane], results[octet, speed])
                for q in range(n_filters):
                    highest, floor = levels[(5 * q + 3) * LANES + lane], own_filters.floors_n[q * LANES + lane]
                    decayed = decayed and filtered_transient_decayed(seen, highest, floor, negligible_n, a_span_behind)
                if ended[lane] and (decayed or run_out_over):
                    active[lane] = False
                    n_active -= 1
                    _write_end(lane, n, working, filtered, levels, n_filters, results[octet, speed])
                else:
                    next_checks[lane] = n + window
                    quiet_checks[lane] = n + 1 if n_filters == 0 else next_checks[lane]
                    working[_TRANSIENT * LANES + lane] = 0.0
