"""All compiled code: a wheel rolling over a fitted track, plain float64 arrays and scalars.

Positive down. The rail's states stand at a grid point of the span together with the force there; a step takes them to
the next point (`weld_force_ros.physics.passage.state_space`) and solves the contact for the force at its end:

    delta = delta_free - compliance f,    f = hertz max(delta, 0)^(3/2)

which has one root; with u = sqrt(delta) it is a cubic that Newton's method descends from above without a branch.
"""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._simd import (
    LANES,
    SPEEDS,
    double,
    load,
    load_two,
    magnitude,
    multiply_add,
    single,
    splat,
    spread_two,
    square_root,
    store,
    where_greater,
)

# Reassociation lets sums vectorise; NaN and infinity keep their meaning, as they are how a failure shows.
_FAST = {"reassoc", "contract", "arcp", "nsz"}
_NEWTON_STEPS = 6
_LOOK = 16  # steps between two looks whether a passage may end
_FADED = 0.5


@compiled(nogil=True, fastmath=_FAST, inline="always")
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


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _copy(source, target):
    """`target[:] = source`, for which Numba would compile seconds of code that words an error of shapes."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _range(values):
    """Highest and least; NumPy's own take a second to compile."""
    high, low = values[0], values[0]
    for value in values:
        high, low = max(high, value), min(low, value)
    return high, low


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _advance(rail, spare, drive, force, decay, transitions, j):
    """States of the next grid point, without the force that will act there; `spare` is room for them."""
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
            spare[i] = total
        _copy(spare, rail)


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _meet(rail, wheel, shape, gain, irregularity, physics, dt):
    """Contact at the end of a step: moves `wheel` (displacement, velocity, force), returns the force."""
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


@compiled(nogil=True, fastmath=_FAST)
def settle_to_periodic(
    rail, wheel, decay, transitions, drives, shapes, gains, physics, dt, tolerance, most_spans, states
):
    """Roll over smooth rail, span by span, until the force repeats; the last span's states are kept.

    `rail`, `wheel`: state at grid point 0, changed in place. `states` (n_grid, n_state + 3): state at each point of the
    last span. Returns the number of spans, or -1 if the force does not settle.
    """
    grid = drives.shape[0]
    spare = np.empty_like(rail)
    for span in range(most_spans):
        change = 0.0
        for j in range(grid):
            if span > 0:
                change = max(change, abs(states[j, -1] - wheel[2]))
            _copy(rail, states[j, :-3])
            _copy(wheel, states[j, -3:])
            ahead = j + 1 if j + 1 < grid else 0
            _advance(rail, spare, drives[j], wheel[2], decay, transitions, j)
            _meet(rail, wheel, shapes[ahead], gains[ahead], 0.0, physics, dt)
        if not np.isfinite(wheel[2]):
            return -1
        if span > 0 and change < tolerance:
            return span + 1
    return -1


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _faded(echo, highest, least, smooth_high, smooth_low, negligible, a_span_behind):
    """Whether an echo of this amplitude can no longer change the extremes, or only by a negligible force."""
    if echo <= _FADED * min(highest - smooth_high, smooth_low - least):
        return True
    # The smooth rail's own extremes may be the passage's: they come once a span.
    return a_span_behind and echo <= negligible


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _beneath(echo, top, floor, negligible, a_span_behind):
    """`_faded` for a filter that an echo passes: it has only a highest level, to compare with its smooth rail's."""
    return echo <= _FADED * (top - floor) or (a_span_behind and echo <= negligible)


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _vertex(before, top, after):
    """Of the parabola through a highest sample and its neighbours: value, and place in steps from the sample."""
    bend = before - 2.0 * top + after
    if after > top or bend == 0.0:
        return top, 0.0
    offset = 0.5 * (before - after) / bend
    return top - 0.25 * (before - after) * offset, offset


@compiled(nogil=True, fastmath=_FAST, inline="always")
def _top(levels, after):
    """Moves `levels` on by a sample: the last two; the highest yet that another follows, and both its neighbours."""
    if levels[1] > levels[3]:
        levels[2], levels[3], levels[4] = levels[0], levels[1], after
    levels[0], levels[1] = levels[1], after


@compiled(nogil=True, fastmath=_FAST)
def sampled(pieces, piece_m, first_m, firsts_m, step_m, rows):
    """Values of a cubic spline, zero outside, along rows that begin at `firsts_m` (n_row,): `rows` (n_row, n).

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


@compiled(nogil=True, fastmath=_FAST)
def peaks_at_speed(
    beginnings, decay, transitions, drives, shapes, gains, starts, ends, window, run_out, smooth, negligible,
    irregularities, physics, dt, filter_decay, filter_shapes, filter_gains, filter_smooth, filter_floors, results,
):  # fmt: skip
    """Every passage of one speed; position i starts at grid point `starts[i]` in the periodic state over smooth rail.

    `beginnings` (n_position, n_state + 3): that state. A passage's weld is behind after `ends[i]` steps; it ends when a
    `window` of steps has seen the echo fade, at the latest after `run_out` steps more. `smooth` (n_grid,): the force on
    smooth rail; an echo below `negligible` (N) is not waited for. `irregularities` (n_position, n): from the start on,
    zero beyond. Filters as `physics.passage.lowpass.LowPass` has them: `filter_decay` and `filter_shapes`
    (2, n_filter, n_pole), `filter_gains` and `filter_floors` (n_filter,), `filter_smooth` (n_filter, n_grid). A passage
    goes on for them, its other results unchanged.

    `results` (n_position, 6 + n_end): peak force, its place in steps from the start, least force, time without contact,
    largest second difference of the force, steps rolled; with filters, n_end = n_filter + 2 n_filter n_pole + 3: the
    greatest of each, their states at the end, and the wheel there (displacement, velocity, force).
    """
    grid, irregular = drives.shape[0], irregularities.shape[1]
    filters, modes = filter_gains.shape[0], filter_decay.shape[2]
    filtered, levels = np.empty(2 * filters * modes), np.empty((filters, 5))
    smooth_high, smooth_low = _range(smooth)
    for i in range(starts.shape[0]):
        j = starts[i] % grid
        rail, wheel = beginnings[i, :-3].copy(), beginnings[i, -3:].copy()
        spare = np.empty_like(rail)
        force = before = top = top_before = top_after = least = wheel[2]
        place, apart, bend, echo = 0, 0, 0.0, 0.0
        filtered[:] = 0.0
        for q in range(filters):
            levels[q, :] = filter_smooth[q, j]
        away = force - smooth[j]
        look = ends[i] + window
        ended = False
        n = 0
        while True:
            n += 1
            _advance(rail, spare, drives[j], force, decay, transitions, j)
            j = j + 1 if j + 1 < grid else 0
            irregularity = irregularities[i, n] if n < irregular else 0.0
            after = _meet(rail, wheel, shapes[j], gains[j], irregularity, physics, dt)
            if force > top:
                top_before, top, top_after, place = before, force, after, n - 1
            least = min(least, after)
            if after == 0.0:
                apart += 1
            away_after = after - smooth[j]
            for q in range(filters):
                level = filter_smooth[q, j] + filter_gains[q] * away_after
                for m in range(modes):
                    p = 2 * (modes * q + m)
                    re, im = filtered[p], filtered[p + 1]
                    filtered[p] = filter_decay[0, q, m] * re - filter_decay[1, q, m] * im + away
                    filtered[p + 1] = filter_decay[0, q, m] * im + filter_decay[1, q, m] * re
                    level += filter_shapes[0, q, m] * filtered[p] - filter_shapes[1, q, m] * filtered[p + 1]
                _top(levels[q], level)
            away = away_after
            echo = max(echo, abs(away))
            bend = max(bend, abs(before - 2.0 * force + after))
            before, force = force, after
            if n % _LOOK == 0 and n >= look:
                a_span_behind, run_out_over = n >= ends[i] + grid, n >= ends[i] + run_out
                over = _faded(echo, top, least, smooth_high, smooth_low, negligible, a_span_behind)
                if not ended and (over or run_out_over):
                    ended = True
                    peak, offset = _vertex(top_before, top, top_after)
                    results[i, 0], results[i, 1], results[i, 2] = peak, place + offset, least
                    results[i, 3], results[i, 4] = apart * dt, bend
                for q in range(filters):
                    over = over and _beneath(echo, levels[q, 3], filter_floors[q], negligible, a_span_behind)
                if ended and (over or run_out_over):
                    break
                look, echo = n + window, 0.0
        results[i, 5] = n
        if not np.isfinite(wheel[0]):
            results[i, 0] = np.nan
        if filters > 0:
            for q in range(filters):
                results[i, 6 + q] = _vertex(levels[q, 2], levels[q, 3], levels[q, 4])[0]
            _copy(filtered, results[i, 6 + filters : -3])
            _copy(wheel, results[i, -3:])


@compiled(nogil=True, fastmath=_FAST)
def _follow_in_lanes(departures, filtered, levels, company, j, k, decays, shapes, gains, smooth, filters, modes, grid):
    """Filters over the last `_LOOK` steps of a company of lanes that stand at grid points j and k.

    A block at a time, as so long the numbers of a pole stay in registers. Flat arrays of lanes: `departures` from the
    smooth rail's force, with the one before the block; `filtered` and `levels`, states and the five of `_top`, of each
    filter, are moved on. The other arrays are as in `peaks_in_lanes`.
    """
    zero, block = splat(0.0), np.empty(_LOOK * LANES)
    first, first_other = (j - _LOOK + 1) % grid, (k - _LOOK + 1) % grid
    for q in range(filters):
        row = company * filters + q
        gain, at, at_other = load(gains, row), first, first_other
        for n in range(_LOOK):
            settled = load_two(smooth, row * grid + at, row * grid + at_other)
            store(block, n, multiply_add(gain, load(departures, n + 1), settled))
            at = at + 1 if at + 1 < grid else 0
            at_other = at_other + 1 if at_other + 1 < grid else 0
        for p in range(modes * q, modes * q + modes):
            real, imag = 2 * filters * modes * company + p, filters * modes * (2 * company + 1) + p
            decay_re, decay_im, shape_re = load(decays, real), load(decays, imag), load(shapes, real)
            back_im, back_shape_im = zero - decay_im, zero - load(shapes, imag)
            re, im = load(filtered, 2 * p), load(filtered, 2 * p + 1)
            for n in range(_LOOK):
                new_re = multiply_add(decay_re, re, multiply_add(back_im, im, load(departures, n)))
                im = multiply_add(decay_re, im, decay_im * re)
                re = new_re
                store(block, n, multiply_add(shape_re, re, multiply_add(back_shape_im, im, load(block, n))))
            store(filtered, 2 * p, re)
            store(filtered, 2 * p + 1, im)
        before, level, top_before = load(levels, 5 * q), load(levels, 5 * q + 1), load(levels, 5 * q + 2)
        top, top_after = load(levels, 5 * q + 3), load(levels, 5 * q + 4)
        for n in range(_LOOK):
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


@compiled(nogil=True, fastmath=_FAST)
def peaks_in_lanes(
    companies, beginnings, decay, turn, drives, gains, starts, ends, windows, run_outs, smooth, negligible,
    irregularities, physics, dts, filter_decay, filter_shapes, filter_gains, filter_smooth, filter_floors, results,
):  # fmt: skip
    """`peaks_at_speed` for sixteen speeds at two places side by side, on the same grid: a lane each.

    Common poles only. `companies` (n_pair,): which company of speeds rolls at each pair of places; `beginnings`
    (n_pair, n_state + 3, LANES): its states at the starts. Of every company: `decay` and `turn`
    (n_company, 2, n_pole, LANES), E and what takes a drive to the shape; `gains` and `smooth`
    (n_company, n_grid, SPEEDS); `windows`, `run_outs` and `dts` (n_company, LANES). Of every pair: `starts` and `ends`
    (n_pair, 2), `irregularities` (n_pair, 2, n). `drives` (n_grid, n_state) serve all. Filters of every company:
    `filter_decay` and `filter_shapes` (n_company, 2, n_filter, n_pole, LANES), `filter_gains`
    and `filter_floors` (n_company, n_filter, LANES), `filter_smooth` (n_company, n_filter, n_grid, SPEEDS).
    `results` (n_pair, LANES, 6 + n_end).
    """
    grid, states = drives.shape[0], drives.shape[1]
    pairs, irregular = states // 2, irregularities.shape[2]
    decays, turns, table, gain_rows = decay.ravel(), turn.ravel(), drives.ravel(), gains.ravel()
    surface, smooth_rows, all_dts = irregularities.ravel(), smooth.ravel(), dts.ravel()
    filters, modes = filter_decay.shape[2], filter_decay.shape[3]
    filter_decay_rows, filter_shape_rows = filter_decay.ravel(), filter_shapes.ravel()
    filter_gain_rows, filter_rows = filter_gains.ravel(), filter_smooth.ravel()
    filtered, levels = np.empty(2 * filters * modes * LANES), np.empty(5 * filters * LANES)
    departures = np.empty((_LOOK + 1) * LANES)
    smooth_high, smooth_low = np.empty(SPEEDS), np.empty(SPEEDS)
    rail, found = np.empty(states * LANES), np.empty(11 * LANES)
    looks, steady_state, ended = np.empty(LANES, np.int64), np.empty(LANES, np.bool_), np.empty(LANES, np.bool_)
    zero, one, two, three = splat(0.0), splat(1.0), splat(2.0), splat(3.0)
    one_single, two_single, three_single = single(one), single(two), single(three)
    half, third, tiny = splat(0.5), splat(1.0 / 3.0), single(splat(1e-30))
    load_n, hertz = splat(physics[1]), splat(physics[2])
    for i in range(companies.shape[0]):
        company = companies[i]
        real_row, imag_row, grid_row = 2 * pairs * company, (2 * company + 1) * pairs, grid * company
        dt = load(all_dts, company)
        kick = dt / splat(physics[0])
        own = dt * kick * splat(1.0 / 6.0)
        for lane in range(SPEEDS):
            smooth_high[lane], smooth_low[lane] = _range(smooth[company, :, lane])
        begin = beginnings[i].ravel()
        _copy(begin[: states * LANES], rail)
        wheel, velocity, force = load(begin, states), load(begin, states + 1), load(begin, states + 2)
        before, top, top_before, top_after, least = force, force, force, force, force
        place, apart, bend, echo = zero, zero, zero, zero
        for lane in range(LANES):
            looks[lane] = ends[i, lane // SPEEDS] + windows[company, lane]
            steady_state[lane], ended[lane] = True, False
        left = LANES
        j, k = starts[i, 0] % grid, starts[i, 1] % grid
        for p in range(2 * filters * modes):
            store(filtered, p, zero)
        for q in range(filters):
            row = (company * filters + q) * grid
            for s in range(5):
                store(levels, 5 * q + s, load_two(filter_rows, row + j, row + k))
        store(departures, 0, force - load_two(smooth_rows, grid_row + j, grid_row + k))
        n = 0
        while left > 0:
            n += 1
            j_ahead = j + 1 if j + 1 < grid else 0
            k_ahead = k + 1 if k + 1 < grid else 0
            over, under = zero, zero
            if n < irregular:
                over = spread_two(surface, 2 * i * irregular + n, (2 * i + 1) * irregular + n)
            for p in range(pairs):
                re, im = load(rail, 2 * p), load(rail, 2 * p + 1)
                decay_re, decay_im = load(decays, real_row + p), load(decays, imag_row + p)
                turn_re, turn_im = load(turns, real_row + p), load(turns, imag_row + p)
                here_re = spread_two(table, j * states + 2 * p, k * states + 2 * p)
                here_im = spread_two(table, j * states + 2 * p + 1, k * states + 2 * p + 1)
                there_re = spread_two(table, j_ahead * states + 2 * p, k_ahead * states + 2 * p)
                there_im = spread_two(table, j_ahead * states + 2 * p + 1, k_ahead * states + 2 * p + 1)
                new_re = multiply_add(decay_re, re, multiply_add(zero - decay_im, im, here_re * force))
                new_im = multiply_add(decay_re, im, multiply_add(decay_im, re, here_im * force))
                store(rail, 2 * p, new_re)
                store(rail, 2 * p + 1, new_im)
                shape_re = multiply_add(turn_re, there_re, (zero - turn_im) * there_im)
                shape_im = multiply_add(turn_re, there_im, turn_im * there_re)
                over = multiply_add(shape_re, new_re, over)
                under = multiply_add(shape_im, new_im, under)
            free_wheel = multiply_add(dt, multiply_add(kick, half * load_n - third * force, velocity), wheel)
            gap = free_wheel - over + under
            gap = where_greater(gap, zero, gap, zero)
            # As `contact_force`; the first guess and its improvement in single precision, the last two steps with the
            # slope that is known by then.
            stiff = (load_two(gain_rows, grid_row + j_ahead, grid_row + k_ahead) + own) * hertz
            gap_single, stiff_single = single(gap), single(stiff)
            guess = square_root(gap_single / multiply_add(stiff_single, square_root(gap_single), one_single)) + tiny
            for _ in range(3):
                bent = stiff_single * guess
                inverse = one_single / (guess * multiply_add(three_single, bent, two_single))
                guess = guess - (guess * guess * (one_single + bent) - gap_single) * inverse
            root, slope = double(guess), double(inverse)
            for _ in range(2):
                root = root - (root * root * multiply_add(stiff, root, one) - gap) * slope
            after = where_greater(gap, zero, hertz * root * root * root, zero)
            wheel = free_wheel - own * after
            velocity = multiply_add(kick, load_n - half * (force + after), velocity)
            top_before = where_greater(force, top, before, top_before)
            top_after = where_greater(force, top, after, top_after)
            place = where_greater(force, top, splat(float(n - 1)), place)
            top = where_greater(force, top, force, top)
            least = where_greater(least, after, after, least)
            apart = apart + where_greater(gap, zero, zero, one)
            turned = magnitude(before - two * force + after)
            bend = where_greater(turned, bend, turned, bend)
            away = after - load_two(smooth_rows, grid_row + j_ahead, grid_row + k_ahead)
            heard = magnitude(away)
            echo = where_greater(heard, echo, heard, echo)
            before, force = force, after
            j, k = j_ahead, k_ahead
            if filters > 0:
                store(departures, (n - 1) % _LOOK + 1, away)
            if n % _LOOK > 0:
                continue
            if filters > 0:
                _follow_in_lanes(
                    departures, filtered, levels, company, j, k, filter_decay_rows, filter_shape_rows,
                    filter_gain_rows, filter_rows, filters, modes, grid,
                )  # fmt: skip
                store(departures, 0, away)
            store(found, 0, top_before)
            store(found, 1, top)
            store(found, 2, top_after)
            store(found, 3, place)
            store(found, 4, apart * dt)
            store(found, 5, bend)
            store(found, 6, least)
            store(found, 7, echo)
            store(found, 8, wheel)
            store(found, 9, velocity)
            store(found, 10, force)
            renewed = False
            for lane in range(LANES):
                if not steady_state[lane] or n < looks[lane]:
                    continue
                highest, lowest, heard_there = found[LANES + lane], found[6 * LANES + lane], found[7 * LANES + lane]
                speed, end = lane % SPEEDS, ends[i, lane // SPEEDS]
                a_span_behind, run_out_over = n >= end + grid, n >= end + run_outs[company, lane]
                faded = _faded(
                    heard_there, highest, lowest, smooth_high[speed], smooth_low[speed], negligible, a_span_behind
                )
                if not ended[lane] and (faded or run_out_over):
                    ended[lane] = True
                    peak, offset = _vertex(found[lane], highest, found[2 * LANES + lane])
                    results[i, lane, 0], results[i, lane, 1] = peak, found[3 * LANES + lane] + offset
                    results[i, lane, 2], results[i, lane, 3] = lowest, found[4 * LANES + lane]
                    results[i, lane, 4] = found[5 * LANES + lane]
                for q in range(filters):
                    highest, floor = levels[(5 * q + 3) * LANES + lane], filter_floors[company, q, lane]
                    faded = faded and _beneath(heard_there, highest, floor, negligible, a_span_behind)
                if ended[lane] and (faded or run_out_over):
                    steady_state[lane] = False
                    left -= 1
                    results[i, lane, 5] = n
                    if not np.isfinite(found[8 * LANES + lane]):
                        results[i, lane, 0] = np.nan
                    if filters > 0:
                        for q in range(filters):
                            top_at = (5 * q + 3) * LANES + lane
                            highest = _vertex(levels[top_at - LANES], levels[top_at], levels[top_at + LANES])[0]
                            results[i, lane, 6 + q] = highest
                        for p in range(2 * filters * modes):
                            results[i, lane, 6 + filters + p] = filtered[p * LANES + lane]
                        for s in range(3):
                            results[i, lane, s - 3] = found[(8 + s) * LANES + lane]
                else:
                    looks[lane] = n + windows[company, lane]
                    found[7 * LANES + lane] = 0.0
                    renewed = True
            if renewed:
                echo = load(found, 7)


@compiled(nogil=True, fastmath=_FAST)
def multiply_adds(numbers, rounds):
    """Four chains of multiply-adds of `LANES` in registers: the most that one core can do, to compare with."""
    factor, term = load(numbers, 0), load(numbers, 1)
    a, b, c, d = load(numbers, 2), load(numbers, 3), load(numbers, 4), load(numbers, 5)
    for _ in range(rounds):
        a, b = multiply_add(a, factor, term), multiply_add(b, factor, term)
        c, d = multiply_add(c, factor, term), multiply_add(d, factor, term)
    store(numbers, 2, a + b + c + d)


@compiled(nogil=True, fastmath=_FAST)
def history_of_passage(
    rail, wheel, decay, transitions, drives, shapes, gains, start, irregularity, physics, dt, result
):
    """One passage step by step: `result` (n, 3) gets force, wheel and rail displacement, the start included."""
    grid = drives.shape[0]
    spare = np.empty_like(rail)
    j = start % grid
    for n in range(irregularity.shape[0]):
        if n > 0:
            _advance(rail, spare, drives[j], wheel[2], decay, transitions, j)
            j = j + 1 if j + 1 < grid else 0
            _meet(rail, wheel, shapes[j], gains[j], irregularity[n], physics, dt)
        result[n, 0], result[n, 1] = wheel[2], wheel[0]
        displacement = gains[j] * wheel[2]
        for i in range(rail.shape[0]):
            displacement += shapes[j, i] * rail[i]
        result[n, 2] = displacement


@compiled(nogil=True, fastmath=_FAST)
def moving_response(
    behind_re, behind_im, shape_re, shape_im, multiplier_re, multiplier_im, turn_re, turn_im, start, row
):
    """Response, step by step, under a point that leaves grid point `start` with the force pulse it gave there.

    Sums waves over frequency: `behind` (n_wave, n_frequency) is the pulse's spectrum in each wave, `shape`
    (n_grid, n_wave, n_frequency) the waves over a span, `multiplier` (n_wave, n_frequency) their ratio from span to
    span, `turn` (n_frequency) the phase of one step. `behind` is changed; `row` (n_step) gets the response.
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
            turned = phase_re[k] * turn_re[k] - phase_im[k] * turn_im[k]
            phase_im[k] = phase_re[k] * turn_im[k] + phase_im[k] * turn_re[k]
            phase_re[k] = turned
        row[n] = total
        j += 1


@compiled(nogil=True, fastmath=_FAST)
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


@compiled(nogil=True, fastmath=_FAST)
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


@compiled(nogil=True, fastmath=_FAST)
def peak_by_runge_kutta(
    state, dt, steps, poles_re, poles_im, shapes, grid_m, pieces, piece_m, from_x, to_first, speed, physics
):
    """Peak force of `rate` by the classical fourth-order method in small steps: another solver for every passage."""
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
            peak = _vertex(before, force, after)[0]
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


@compiled(nogil=True, fastmath=_FAST)
def straightedge_gap(heights, reach):
    """Largest distance of equidistant heights (n,) below a straightedge of `reach` steps that lies on them anywhere.

    The straightedge rests on the highest points below it: on their upper hull.
    """
    hull, spanned = np.empty(reach + 1, np.int64), np.zeros(heights.shape[0], np.int64)
    largest = 0.0
    for first in range(heights.shape[0] - reach):
        count = 0
        for i in range(first, first + reach + 1):
            while count > 1:
                a, b = hull[count - 2], hull[count - 1]
                if (heights[b] - heights[a]) * (i - a) > (heights[i] - heights[a]) * (b - a):
                    break
                count -= 1
            hull[count] = i
            count += 1
        for k in range(count - 1):
            a, b = hull[k], hull[k + 1]
            if spanned[a] == b:  # where it lay before
                continue
            spanned[a] = b
            slope = (heights[b] - heights[a]) / (b - a)
            for i in range(a + 1, b):
                largest = max(largest, heights[a] + slope * (i - a) - heights[i])
    return largest
