"""Compiled: a straightedge that lies on a rail."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled
from weld_force_ros.physics.passage._contact import FAST_MATH


@compiled(nogil=True, fastmath=FAST_MATH)
def straightedge_gap(heights, reach):
    """Return the largest distance of equidistant heights (n,) below a straightedge of `reach` steps laid anywhere.

    The straightedge rests on the highest points below it: on their upper hull.
    """
    hull, spanned = np.empty(reach + 1, np.int64), np.zeros(heights.shape[0], np.int64)
    largest = 0.0
    for first in range(heights.shape[0] - reach):
        count = 0
        for i in range(first, first + reach + 1):
            if first < i < first + reach and heights[i - 1] == heights[i] == heights[i + 1]:
                continue  # on a level stretch, which its ends span
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
