"""Rows are made once, when they are asked for."""

from typing import NamedTuple

import numpy as np

from weld_force_ros.physics.passage.kept_rows import KeptRows


class Squares(NamedTuple):
    value: np.ndarray
    powers: np.ndarray


def test_rows_are_made_once_and_only_where_they_are_asked_for():
    made: list[int] = []

    def make(numbers: np.ndarray, run) -> Squares:
        made.extend(numbers.tolist())
        return Squares(np.array(list(run(lambda n: n * n, numbers))), numbers[:, None] ** np.arange(3))

    kept = KeptRows(6, make)
    assert kept.of(np.array([4, 1, 4])).value[[1, 4]].tolist() == [1, 16]
    rows = kept.of(np.array([[1, 5], [4, 5]]))
    assert rows.value[5] == 25
    assert rows.powers[[1, 4, 5]].tolist() == [[1, 1, 1], [1, 4, 16], [1, 5, 25]]
    assert sorted(made) == [1, 4, 5]
    assert kept.size_bytes == 3 * (8 + 3 * 8)
