"""Drive a measuring trolley: lines of its serial port, or of a file, become batches of samples and marks of welds.

    python trolley_driver.py < /dev/ttyUSB0        # beside `weld-force up --folder measurements`

A line `12000.001,-35.2` is a chainage in m and a height in micrometres, positive up; a line `weld KM12-L-004` is the
button at a weld where the trolley is now. Change how lines are read to what your trolley sends. Needs rclpy and
std_msgs alone; what the topics take is in msgs_json/RailSurface.json and msgs_json/WeldMarker.json.
"""

import itertools
import json
import sys

import rclpy
from rclpy.duration import Duration
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

BATCH = 100  # samples: a tenth of a metre at 1 mm
KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
HEADER = {"schema_version": "1.6"}
UNITS = {"chainage_unit": "m", "height_unit": "um", "height_positive": "up"}


def send(publisher, content: dict) -> None:
    """Publish a message of the contract."""
    publisher.publish(String(data=json.dumps(HEADER | content)))


def wait_until_taken(publisher) -> None:
    """Wait until all messages have arrived: a mark must not overtake samples, and none may be lost at the end."""
    if not publisher.wait_for_all_acked(Duration(seconds=30)):
        sys.exit("the suite does not take what the trolley measures: is it running?")


def drive(lines, node) -> None:
    """Publish what the trolley measures until its lines end."""
    surface = node.create_publisher(String, "rail_surface", KEEP_ALL)
    marks = node.create_publisher(String, "weld_marker", KEEP_ALL)
    while not (surface.get_subscription_count() and marks.get_subscription_count()):
        rclpy.spin_once(node, timeout_sec=0.1)
    chainage, height, place = [], [], {}
    for line in itertools.chain(lines, [""]):
        if line[:1].isdigit():
            x, z = map(float, line.split(","))
            chainage.append(x)
            height.append(z)
            place = {"chainage_m": x}  # in the mark, too: by the time it is taken the trolley may be farther on
        if chainage and (len(chainage) == BATCH or not line[:1].isdigit()):
            send(surface, {"chainage": chainage, "height": height, **UNITS})
            chainage, height = [], []
        if line.startswith("weld"):
            wait_until_taken(surface)
            send(marks, {"weld_id": line.removeprefix("weld").strip() or "weld", **place})
    wait_until_taken(surface)
    wait_until_taken(marks)


if __name__ == "__main__":
    rclpy.init()
    drive(sys.stdin, rclpy.create_node("trolley_driver"))
