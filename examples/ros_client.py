"""Publish a weld and wait for its outcome, with `weld-force up` running: `python ros_client.py weld_profile.json`.

Needs rclpy and std_msgs alone; any language with a ROS client can do the same, see docs/clients.md.
"""

import json
import secrets
import sys
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

KEPT = QoSProfile(depth=200, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # also what came before they heard of us


def assess(node: Node, weld: dict, timeout_s: float = 60.0) -> dict:
    """Return the verdict or rejection of a weld, a dict with the fields of msgs_json/WeldProfile.json."""
    deadline_s = time.monotonic() + timeout_s
    me = f"{node.get_fully_qualified_name()}#{secrets.token_hex(4)}"
    weld = {**weld, "publisher": me, "sequence": 0, "profile_id": secrets.token_hex(32)}
    outcomes = []

    def keep_mine(message: String) -> None:
        outcome = json.loads(message.data)
        # A profile that breaks the contract is known by its message, any other by its measurement.
        if (
            outcome.get("profile_id") == weld["profile_id"]
            or outcome.get("source") == f"weld_profile message 0 of {me}"
        ):
            outcomes.append(outcome)

    for topic in ("verdict", "rejection"):
        node.create_subscription(String, topic, keep_mine, KEPT)
    publisher = node.create_publisher(String, "weld_profile", 10)
    while publisher.get_subscription_count() < 2 and time.monotonic() < deadline_s:  # simulator and assessment
        rclpy.spin_once(node, timeout_sec=0.1)
    publisher.publish(String(data=json.dumps(weld)))
    while not outcomes and time.monotonic() < deadline_s:
        rclpy.spin_once(node, timeout_sec=0.1)
    return outcomes[0] if outcomes else {"reason": f"no outcome within {timeout_s:g} s: is the suite running?"}


if __name__ == "__main__":
    rclpy.init()
    with open(sys.argv[1]) as file:
        found = assess(rclpy.create_node("weld_client"), json.load(file))
    print(found.get("decision", "no verdict"), found.get("weld_id", ""), found["reason"])
    sys.exit(found.get("decision") != "accept")
