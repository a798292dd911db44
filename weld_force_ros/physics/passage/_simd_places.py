"""Compiled: the four places whose passages advance side by side, each at eight speeds and with its own row in tables.

Tables along the span are put side by side in four slots, as far as they are met; places of the same speeds share one.
"""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import FAST_MATH, copy
from weld_force_ros.physics.passage._simd import LANES, PLACES, SPEEDS

CHUNK = 64
"""Grid points whose tables are put side by side at once: a multiple of `CHECK_EVERY_STEPS`."""


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def four_from(values, first):
    """Return four neighbours."""
    return values[first], values[first + 1], values[first + 2], values[first + 3]


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def rows_of(tables, count, at):
    """Return where the rows `at` of four tables are, all tables with `count` rows lying one after the other."""
    return (
        tables[0] * count + at[0], tables[1] * count + at[1], tables[2] * count + at[2], tables[3] * count + at[3]
    )  # fmt: skip


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def row_of(tables, count, row):
    """Return where the same row of each of four tables is."""
    return rows_of(tables, count, (row, row, row, row))


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def ahead(at, grid):
    """Return four grid points a step on."""
    return (
        at[0] + 1 if at[0] + 1 < grid else 0, at[1] + 1 if at[1] + 1 < grid else 0,
        at[2] + 1 if at[2] + 1 < grid else 0, at[3] + 1 if at[3] + 1 < grid else 0,
    )  # fmt: skip


@compiled(nogil=True)
def put_in_lanes(table, speeds, lanes):
    """Fill `lanes` with the rows that a table (n_speed, ...) has of the lanes' speeds (LANES,)."""
    flat = table.ravel()
    count = flat.shape[0] // table.shape[0]
    for lane in range(LANES):
        for k in range(count):
            lanes[k * LANES + lane] = flat[speeds[lane] * count + k]


@compiled(nogil=True)
def slots_of(speeds):
    """Return of each place the first that has the same speeds (LANES,): tables side by side serve both."""
    found = np.arange(PLACES)
    for place in range(1, PLACES):
        for other in range(place - 1, -1, -1):
            if _are_the_same(speeds, place, speeds, other):
                found[place] = other
    return found[0], found[1], found[2], found[3]


@compiled(nogil=True)
def take_up(speeds, slots, at_hand, is_there):
    """Give each slot that serves a place that place's speeds; what was there of others (PLACES, n_chunk) goes."""
    for slot in range(PLACES):
        if slots[slot] == slot and not _are_the_same(speeds, slot, at_hand, slot):
            copy(speeds[SPEEDS * slot : SPEEDS * slot + SPEEDS], at_hand[SPEEDS * slot : SPEEDS * slot + SPEEDS])
            is_there[slot] = False


@compiled(nogil=True)
def _are_the_same(some, place, others, other):
    differences = 0
    for k in range(SPEEDS):
        differences += some[SPEEDS * place + k] != others[SPEEDS * other + k]
    return differences == 0


@compiled(nogil=True)
def put_side_by_side(tables, n_grid, at_hand, slots, at, steps, is_there, side_by_side):
    """Put the parts of tables side by side that four places meet from grid points `at` through some steps.

    Args:
        tables: some, each flat, with `n_grid` numbers for each of its quantities and speeds.
        n_grid: grid points.
        at_hand: (LANES,), the speeds of the slots.
        slots: of the places.
        at: grid points.
        steps: at most CHUNK.
        is_there: (PLACES, n_chunk), which parts were put there before.
        side_by_side: of each table, flat, (PLACES, n_quantity, n_grid, SPEEDS).
    """
    last = is_there.shape[1] - 1
    for place in range(PLACES):
        slot = slots[place]
        for point in (at[place], (at[place] + steps) % n_grid):
            chunk = min(point // CHUNK, last)
            if is_there[slot, chunk]:
                continue
            is_there[slot, chunk] = True
            first, end = chunk * CHUNK, n_grid if chunk == last else chunk * CHUNK + CHUNK
            for table, out in zip(tables, side_by_side):  # noqa: B905 - Numba's has no `strict`
                quantities = out.shape[0] // (LANES * n_grid)
                for quantity in range(quantities):
                    row = (slot * quantities + quantity) * n_grid
                    own = (at_hand[SPEEDS * slot : SPEEDS * slot + SPEEDS] * quantities + quantity) * n_grid
                    _put_eight(table, own + first, out[(row + first) * SPEEDS : (row + end) * SPEEDS])


@compiled(nogil=True)
def _put_eight(table, firsts, out):
    """Fill `out` with eight stretches of a table, side by side: quicker all at once than one after the other."""
    a, b, c, d = table[firsts[0] :], table[firsts[1] :], table[firsts[2] :], table[firsts[3] :]
    e, f, g, h = table[firsts[4] :], table[firsts[5] :], table[firsts[6] :], table[firsts[7] :]
    for n in range(out.shape[0] // SPEEDS):
        to = out[SPEEDS * n : SPEEDS * n + SPEEDS]
        to[0], to[1], to[2], to[3] = a[n], b[n], c[n], d[n]
        to[4], to[5], to[6], to[7] = e[n], f[n], g[n], h[n]
