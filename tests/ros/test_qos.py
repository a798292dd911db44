"""Quality of service: who matches whom, by rclpy's own word."""

import itertools

import pytest
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible

from weld_force_ros.ros.qos import BEST_EFFORT, CONTRACT, DIAGNOSTICS, PLOT, RESENT, STREAM, serves_any


@pytest.mark.parametrize("offered", [CONTRACT, PLOT, RESENT, DIAGNOSTICS, STREAM, BEST_EFFORT])
def test_who_serves_any_has_no_subscriber_that_does_not_match(offered: QoSProfile) -> None:
    reliabilities = (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
    durabilities = (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE)
    matches = [
        qos_check_compatible(offered, QoSProfile(depth=1, reliability=reliability, durability=durability))[0]
        != QoSCompatibility.ERROR
        for reliability, durability in itertools.product(reliabilities, durabilities)
    ]
    assert serves_any(offered) == all(matches)
