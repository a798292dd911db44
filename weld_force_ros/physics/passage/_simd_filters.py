"""Compiled: low-pass filters of passages side by side."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import CHECK_EVERY_STEPS, FAST_MATH, Filters
from weld_force_ros.physics.passage._simd import LANES, load, load_four, multiply_add, splat, store, where_greater
from weld_force_ros.physics.passage._simd_places import ahead, row_of, rows_of


@compiled(nogil=True, fastmath=FAST_MATH)
def advance_filters(filters: Filters, n_filters, n_grid, departures, filtered, levels, slots, at):
    """Take the filters of four places over the last steps, since the last check, from grid points `at`.

    All steps of one mode before the next, as so long its numbers stay in registers. Flat arrays of lanes: `filters`,
    `departures` from the smooth rail's force, with the one before these steps; `filtered` and `levels`, each filter's
    states and five levels (see `_scalar_passage._add_level`), are moved on.
    """
    n_all, zero, block = filters.decay.shape[0] // (2 * LANES), splat(0.0), np.empty(CHECK_EVERY_STEPS * LANES)
    n_modes = n_all // max(1, n_filters)
    for q in range(n_filters):
        tables, here = row_of(slots, n_filters, q), at
        gain = load(filters.gains, q)
        for n in range(CHECK_EVERY_STEPS):
            here = ahead(here, n_grid)
            settled = load_four(filters.smooth_n, rows_of(tables, n_grid, here))
            store(block, n, multiply_add(gain, load(departures, n + 1), settled))
        for p in range(n_modes * q, n_modes * q + n_modes):
            decay_re, decay_im, shape_re = (
                load(filters.decay, p),
                load(filters.decay, n_all + p),
                load(filters.shapes, p),
            )
            minus_decay_im, minus_shape_im = zero - decay_im, zero - load(filters.shapes, n_all + p)
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
