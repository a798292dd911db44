"""Choose the quality of service with which a recorded topic is played."""

from collections.abc import Iterable, Mapping
from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

_LIVE_DEPTH = 100
_LATCHED_DEPTH = 1000
_KEPT_BYTES = 32 * 2**20
"""Bytes that the publisher of one topic may hold. Set to keep all, Fast DDS would hold 5000 messages of any size."""

# As rosbag2 writes them since Jazzy, and the numbers that it wrote before.
_RELIABLE = ("reliable", ReliabilityPolicy.RELIABLE.value)
_BEST_EFFORT = ("best_effort", ReliabilityPolicy.BEST_EFFORT.value)
_LATCHED = ("transient_local", DurabilityPolicy.TRANSIENT_LOCAL.value)
_KEEP_LAST = ("keep_last", HistoryPolicy.KEEP_LAST.value)
_MANUAL = ("manual_by_topic", LivelinessPolicy.MANUAL_BY_TOPIC.value)


def playback_qos(profiles: Iterable[str], largest_bytes: int) -> QoSProfile:
    """Return a quality of service that suits every subscriber that the recorded publishers of a topic suited.

    Args:
        profiles: offered profiles of the topic's channels, each a YAML list.
        largest_bytes: size of the largest message; a publisher never holds more messages than fit 32 MiB.

    Returns:
        The strongest of all that was offered; reliable where that cannot be read.
    """
    offered = [profile for text in profiles for profile in _parsed(text)]
    latched = [profile for profile in offered if profile.get("durability") in _LATCHED]
    weak = bool(offered) and all(profile.get("reliability") in _BEST_EFFORT for profile in offered)
    depth = max(map(_latched_depth, latched), default=_LIVE_DEPTH)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(1, min(depth, _KEPT_BYTES // max(1, largest_bytes))),
        reliability=ReliabilityPolicy.BEST_EFFORT if weak else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        **(_timing(offered[0]) if offered else {}),
    )


def _parsed(text: str) -> list[dict[str, Any]]:
    try:
        profiles = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    return [profile for profile in profiles if isinstance(profile, dict)] if isinstance(profiles, list) else []


def _latched_depth(profile: Mapping[str, Any]) -> int:
    depth = profile.get("depth")
    if profile.get("history") in _KEEP_LAST and isinstance(depth, int) and depth > 0:
        return min(depth, _LATCHED_DEPTH)
    return _LATCHED_DEPTH


def _timing(profile: Mapping[str, Any]) -> dict[str, Any]:
    """Return deadline, lifespan and liveliness as they were offered; empty if they cannot be read."""
    try:
        durations = {
            name: Duration(seconds=profile[name]["sec"], nanoseconds=profile[name]["nsec"])
            for name in ("deadline", "lifespan", "liveliness_lease_duration")
        }
    except (KeyError, TypeError, ValueError, OverflowError):
        return {}
    manual = profile.get("liveliness") in _MANUAL
    return {**durations, "liveliness": LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC}
