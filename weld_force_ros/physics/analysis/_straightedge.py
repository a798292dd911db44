"""Compiled: a straightedge that lies on a rail."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import FAST_MATH


@compiled(nogil=True, fastmath=FAST_MATH, inline="always")
def _push(heights, hull, count, i):
    """Add point i to an upper hull of `count` points on one side of it; return how many there are then."""
    while count > 1:
        a, b = hull[count - 2], hull[count - 1]
        if (heights[b] - heights[a]) * (i - a) > (heights[i] - heights[a]) * (b - a):
            break
        count -= 1
    hull[count] = i
    return count + 1


@compiled(nogil=True, fastmath=FAST_MATH)
def _neighbours_on_hull(heights, middle, reach, ahead, behind):
    """Fill the next point `ahead` on the hull from each point up to `middle`, and the one `behind` up to each from it.

    Mirrored, as `_push` needs it, a point's place counts from the right.
    """
    hull, count = np.empty(reach + 1, np.int64), 0
    mirrored = heights[::-1]
    last = heights.shape[0] - 1
    for i in range(middle, max(middle - reach, 0) - 1, -1):
        count = _push(mirrored, hull, count, last - i)
        ahead[i] = last - hull[count - 2] if count > 1 else i
    count = 0
    for i in range(middle, min(middle + reach, last) + 1):
        count = _push(heights, hull, count, i)
        behind[i] = hull[count - 2] if count > 1 else i


@compiled(nogil=True, fastmath=FAST_MATH)
def straightedge_gap(heights, reach):
    """Return the largest distance of equidistant heights (n,) below a straightedge of `reach` steps laid anywhere.

    The straightedge rests on the highest points below it: on their upper hull. That is the hull of the two up to and
    from a point in the middle, which neighbouring places of the straightedge share.
    """
    hull, far, spanned = np.empty(reach + 2, np.int64), np.empty(reach + 1, np.int64), np.zeros(len(heights), np.int64)
    ahead, behind = np.empty(len(heights), np.int64), np.empty(len(heights), np.int64)
    largest, middle = 0.0, -1
    for first in range(len(heights) - reach):
        if first > middle:
            middle = first + reach
            _neighbours_on_hull(heights, middle, reach, ahead, behind)
        count, i = 1, first
        hull[0] = first
        while i < middle:
            i = ahead[i]
            hull[count] = i
            count += 1
        steps, i = 0, first + reach
        while i > middle:
            far[steps] = i
            steps += 1
            i = behind[i]
        for k in range(steps - 1, -1, -1):
            count = _push(heights, hull, count, far[k])
        for k in range(count - 1):
            a, b = hull[k], hull[k + 1]
            if spanned[a] == b:  # where it lay before
                continue
            spanned[a] = b
            slope = (heights[b] - heights[a]) / (b - a)
            for i in range(a + 1, b):
                largest = max(largest, heights[a] + slope * (i - a) - heights[i])
    return largest
