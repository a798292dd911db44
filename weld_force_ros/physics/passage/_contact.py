"""Compiled: the contact of wheel and rail, and what the scalar and the SIMD passage share.

Positive down. At the end of a step, the rail and the wheel give way to the force that acts there by their compliance:

    delta = delta_free - compliance f,    f = hertz max(delta, 0)^(3/2)

which has one root; with u = sqrt(delta) it is a cubic that Newton's method descends from above without a branch.
"""

from typing import NamedTuple

import numpy as np

from weld_force_ros.physics._numba_cache import compiled

# Reassociation lets sums vectorise; NaN and infinity keep their meaning, as they are how a failure shows.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}
CHECK_EVERY_STEPS = 16  # whether a passage may end
_NEWTON_STEPS = 6
_DECAYED = 0.5  # share of a margin that a transient may have, through a window
QUIET = 0.25
"""Share of a margin that a transient may have through half a window, without filters.

Half a window, 6.25 ms, sees 0.56 of a swing of 30 Hz even about its zero, and 0.9 of the wheelset's on the track.
It counts where it is more than a negligible force: where the margin is none, the smooth rail's extremes may be the
passage's, and they come once a span.
"""


class Filters(NamedTuple):
    """Low-pass filters as the compiled passages take them; see `weld_force_ros.physics.passage.lowpass.LowPass`.

    Attributes:
        decay: (2, n_filter, n_mode) of one speed; (n_speed, 2, n_filter, n_mode) of many.
        shapes: as `decay`.
        gains: (n_filter,); (n_speed, n_filter).
        smooth_n: (n_filter, n_grid); (n_speed, n_filter, n_grid).
        floors_n: as `gains`.
    """

    decay: np.ndarray
    shapes: np.ndarray
    gains: np.ndarray
    smooth_n: np.ndarray
    floors_n: np.ndarray


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def contact_force(free, compliance, hertz):
    """Return the root of f = hertz (free - compliance f)^(3/2); zero where `free` is not positive."""
    if free <= 0.0:
        return 0.0
    # u^2 + a u^3 = free, convex and increasing for u > 0: Newton descends monotonically from any upper bound.
    a = compliance * hertz
    u = min(np.sqrt(free), np.cbrt(free / a)) if a > 0.0 else np.sqrt(free)
    for _ in range(_NEWTON_STEPS):
        u -= (u * u * (1.0 + a * u) - free) / (u * (2.0 + 3.0 * a * u))
    return hertz * u * u * u


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def copy(source, target):
    """Copy into `target`; for `target[:] = source` Numba would compile seconds of code that words an error."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def extremes(values):
    """Return the highest and the lowest value; NumPy's own functions take a second to compile."""
    high, low = values[0], values[0]
    for value in values:
        high, low = max(high, value), min(low, value)
    return high, low


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def transient_decayed(transient, highest, lowest, smooth_high, smooth_low, negligible, a_span_behind):
    """Return whether a transient of this amplitude can change the extremes no more, or only by a negligible force."""
    if transient <= _DECAYED * min(highest - smooth_high, smooth_low - lowest):
        return True
    # The smooth rail's own extremes may be the passage's: they come once a span.
    return a_span_behind and transient <= negligible


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def filtered_transient_decayed(transient, highest, floor, negligible, a_span_behind):
    """Return the same for a filter that lets the transient pass: its highest level is compared with smooth rail's."""
    return transient <= _DECAYED * (highest - floor) or (a_span_behind and transient <= negligible)


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def vertex(before, top, after):
    """Return value and offset of the vertex of the parabola through three samples, the middle one the highest."""
    second_difference = before - 2.0 * top + after
    if after > top or second_difference == 0.0:
        return top, 0.0
    offset = 0.5 * (before - after) / second_difference
    return top - 0.25 * (before - after) * offset, offset
