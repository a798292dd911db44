"""Compiled: linear equations between neighbours."""

import numpy as np

from weld_force_ros.physics._numba_cache import compiled


@compiled(nogil=True)
def solve(below, middle, above, right):
    """Replace `right` (n, n_column) by the solution, by elimination without pivoting.

    `below` (n - 1,), `middle` (n,) and `above` (n - 1,) are the matrix's diagonals.
    """
    n = middle.shape[0]
    pivot = np.empty(n)
    pivot[0] = middle[0]
    for i in range(1, n):
        share = below[i - 1] / pivot[i - 1]
        pivot[i] = middle[i] - share * above[i - 1]
        for j in range(right.shape[1]):
            right[i, j] -= share * right[i - 1, j]
    for j in range(right.shape[1]):
        right[n - 1, j] /= pivot[n - 1]
    for i in range(n - 2, -1, -1):
        for j in range(right.shape[1]):
            right[i, j] = (right[i, j] - above[i] * right[i + 1, j]) / pivot[i]
