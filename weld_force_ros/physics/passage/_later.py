"""Compiled: what slow filters still show of passages after their end."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled


@compiled(nogil=True, fastmath={"contract"})
def add_later(speeds, ends, endings, slow, smooth_n, later, steps, greatest):
    """Raise `greatest` (n, n_filter) to what the slow filters show later.

    Args:
        speeds: (n,), row of a passage in the tables.
        ends: (n,), step of the span at which it ended.
        endings: (n, n_state), states of the slow filters and the wheel's departure there.
        slow: (n_slow,), numbers of those filters.
        smooth_n: of `weld_force_ros.physics.passage.lowpass.LowPass`, as the following.
        later: (n_speed, n_state, n_slow, n_time).
        steps: (n_speed, n_slow, n_time).
        greatest: changed in place.
    """
    grid, departure = smooth_n.shape[2], np.empty(steps.shape[2])
    for i in range(speeds.shape[0]):
        speed = speeds[i]
        for k in range(slow.shape[0]):
            departure[:] = 0.0
            for s in range(endings.shape[1]):
                for t in range(departure.shape[0]):
                    departure[t] += endings[i, s] * later[speed, s, k, t]
            for t in range(departure.shape[0]):
                level = departure[t] + smooth_n[speed, slow[k], (ends[i] + steps[speed, k, t]) % grid]
                greatest[i, slow[k]] = max(greatest[i, slow[k]], level)
