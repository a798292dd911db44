"""Trolley position: that of the newest samples, whatever a stray one says."""

import numpy as np

from weld_force_ros.measurement.trolley_position import TrolleyPosition


def test_position_is_the_median_of_the_newest_numbers():
    position = TrolleyPosition()
    assert position.chainage_m is None
    assert not position.is_within(np.inf, 0.0)
    position.push(np.array([np.nan, 1.0, 2.0]), np.zeros(3))
    position.push(np.array([9e5, 3.0, 4.0, 5.0]), np.array([0.0, 0.0, 0.0, np.nan]))
    assert position.chainage_m == 3.0
    assert position.is_within(1.0, 4.0)
    assert not position.is_within(0.9, 4.0)
