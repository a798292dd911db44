"""Define the quality of service of every topic of the suite.

Contract topics lose nothing: reliable, and read with everything kept. What is written is kept for those who join later
up to a depth by topic: Fast DDS would keep 5000 messages of any size, a gigabyte of force histories. Before a message
is pushed out of that depth, every live subscriber must have it (`serialized_messages.RecordedPublisher`).
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from weld_force_ros.messages import (
    MAX_VEHICLES,
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Message,
    Rejection,
    Settled,
    SimulationSettings,
    Topic,
    Verdict,
    WeldProfile,
)

MAX_OUTSTANDING = 64
"""How many measurements of one profile node may be without an outcome at once: the others wait in the folder."""

KEPT_DEPTH: dict[type[Message], int] = {
    WeldProfile: 2 * MAX_OUTSTANDING,
    ForceMap: 128,
    ForceHistory: 16,
    Verdict: 200,
    Rejection: 2 * MAX_OUTSTANDING,
    Settled: 3 * MAX_OUTSTANDING,
    SimulationSettings: 2 * MAX_VEHICLES,
    AssessmentSettings: 10,
}
"""How many messages of a latched topic a publisher keeps for those who join later."""

_LATCHED, _LIVE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE


def _reliable(durability: DurabilityPolicy, depth: int | None = None) -> QoSProfile:
    history = HistoryPolicy.KEEP_ALL if depth is None else HistoryPolicy.KEEP_LAST
    return QoSProfile(history=history, depth=depth or 0, reliability=ReliabilityPolicy.RELIABLE, durability=durability)


CONTRACT = _reliable(_LATCHED)
PLOT = _reliable(_LATCHED, 100)
DIAGNOSTICS = _reliable(_LIVE, 10)
STREAM = _reliable(_LIVE)
BEST_EFFORT = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.BEST_EFFORT, durability=_LIVE)
RESENT = _reliable(_LATCHED, 16)


def more_tolerant(profile: QoSProfile) -> QoSProfile | None:
    """Return what to ask for where a publisher does not offer `profile`: no history, then best effort, then None."""
    if profile.durability == _LATCHED:
        return STREAM
    return BEST_EFFORT if profile.reliability == ReliabilityPolicy.RELIABLE else None


def serves_any(profile: QoSProfile) -> bool:
    """Return whether no subscriber can ask for more than a publisher of this quality of service offers."""
    return profile.durability == _LATCHED and profile.reliability == ReliabilityPolicy.RELIABLE


def subscription_qos(topic: Topic) -> QoSProfile:
    """Return the quality of service of a subscription to a contract topic."""
    return CONTRACT if topic.latched else STREAM


def publisher_qos(topic: Topic) -> QoSProfile:
    """Return the quality of service of a publisher of a contract topic."""
    return _reliable(_LATCHED, KEPT_DEPTH[topic.type]) if topic.latched else STREAM
