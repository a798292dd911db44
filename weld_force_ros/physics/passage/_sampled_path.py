"""Compiled: the wheel's paths over many samples of one weld."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled

_CHUNK = 64  # samples that share a reach


@compiled(nogil=True)
def dilate(surface, half, circle, wheel_radius_m, step_m, out):
    """Fill `out` (n,) with the largest of `surface` (n + 2 half,) plus `circle` (2 half + 1,) about each sample.

    Where a chunk's surroundings rise little above it, the wheel touches nothing farther off, and nothing is tried.
    """
    for first in range(0, out.shape[0], _CHUNK):
        end = min(first + _CHUNK, out.shape[0])
        rise = surface[first : end + 2 * half].max() - surface[first + half : end + half].min()
        reach = np.sqrt(max(0.0, 2 * wheel_radius_m * rise - rise * rise)) if rise < wheel_radius_m else np.inf
        near = int(min(float(half), np.ceil(reach / step_m) + 1.0))
        chunk = out[first:end]
        for i in range(chunk.shape[0]):
            chunk[i] = surface[first + half + i] + circle[half]
        for k in range(half - near, half + near + 1):
            lift, shifted = circle[k], surface[first + k : end + k]
            for i in range(chunk.shape[0]):
                raised = shifted[i] + lift
                chunk[i] = raised if raised > chunk[i] else chunk[i]


@compiled(nogil=True)
def average(surface, weight, out):
    """Fill `out` (n,) with `surface` (n + 2 half,) averaged by symmetric weights (half + 1,), the first in the middle.

    Chunk by chunk, so that sums stay in registers or near them.
    """
    half = weight.shape[0] - 1
    for first in range(0, out.shape[0], _CHUNK):
        chunk = out[first : first + _CHUNK]
        count = chunk.shape[0]
        chunk[:] = weight[0] * surface[first + half : first + half + count]
        for k in range(1, half + 1):
            share, before, after = weight[k], surface[first + half - k :], surface[first + half + k :]
            for i in range(count):
                chunk[i] += share * (before[i] + after[i])


@compiled(nogil=True)
def sampled_locally(heights, step_m, firsts_m, apart_m, first_row, rows):
    """Fill rows of (n_path, n_row, n) with minus the heights (n_path, n_height), every `apart_m` from `firsts_m` on.

    Cubics through the four heights about a place, zero outside; places are counted from the first height. `firsts_m`
    (n,) are of `first_row` and the rows after it.
    """
    last = heights.shape[1] - 1
    for own in range(firsts_m.shape[0]):
        row = first_row + own
        for n in range(rows.shape[2]):
            place = (firsts_m[own] + n * apart_m) / step_m
            if not 1.0 <= place < last - 1:
                rows[:, row, n] = 0.0
                continue
            j = int(place)
            s = place - j
            before, here = -s * (s - 1) * (s - 2) / 6, (s + 1) * (s - 1) * (s - 2) / 2
            after, beyond = -s * (s + 1) * (s - 2) / 2, s * (s + 1) * (s - 1) / 6
            for path in range(rows.shape[0]):
                rows[path, row, n] = -(
                    before * heights[path, j - 1]
                    + here * heights[path, j]
                    + after * heights[path, j + 1]
                    + beyond * heights[path, j + 2]
                )


@compiled(nogil=True)
def resample_monotone(x, heights, grid, out):
    """Fill `out` (n_path, n) with heights (n_path, n_x) at `grid` (n,): shape-preserving cubics, zero outside.

    Slopes after Fritsch & Butland, as of `scipy.interpolate.PchipInterpolator`.
    """
    count = x.shape[0]
    width, secant, slope = np.empty(count - 1), np.empty(count - 1), np.empty(count)
    for i in range(count - 1):  # `np.diff` takes seconds to compile
        width[i] = x[i + 1] - x[i]
    for path in range(heights.shape[0]):
        z = heights[path]
        for i in range(count - 1):
            secant[i] = (z[i + 1] - z[i]) / width[i]
        for i in range(1, count - 1):
            slope[i] = 0.0
            if secant[i - 1] * secant[i] > 0.0:
                near, far = 2 * width[i] + width[i - 1], width[i] + 2 * width[i - 1]
                slope[i] = (near + far) / (near / secant[i - 1] + far / secant[i])
        slope[0] = _slope_at_end(width[0], width[1], secant[0], secant[1])
        slope[-1] = _slope_at_end(width[-1], width[-2], secant[-1], secant[-2])
        i = 0
        for n in range(grid.shape[0]):
            at = grid[n]
            if at < x[0] or at > x[-1]:
                out[path, n] = 0.0
                continue
            while i < count - 2 and at >= x[i + 1]:
                i += 1
            s, h = at - x[i], width[i]
            bend = (3 * secant[i] - 2 * slope[i] - slope[i + 1]) / h
            twist = (slope[i] + slope[i + 1] - 2 * secant[i]) / (h * h)
            out[path, n] = ((twist * s + bend) * s + slope[i]) * s + z[i]


@compiled(nogil=True, inline="always")
def _slope_at_end(width, width_next, secant, secant_next):
    slope = ((2 * width + width_next) * secant - width * secant_next) / (width + width_next)
    if slope * secant <= 0.0:
        return 0.0
    if secant * secant_next <= 0.0 and abs(slope) > 3 * abs(secant):
        return 3 * secant
    return slope
