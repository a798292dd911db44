"""Judge force maps and publish what came of each measurement: a verdict with its typed copies, or a rejection."""

import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped

from weld_force_ros.assessment.judge import judge_vehicles
from weld_force_ros.errors import DiskFullError
from weld_force_ros.messages import AssessmentSettings, ForceMap, Rejection, Verdict, identity
from weld_force_ros.ros import qos, typed_messages
from weld_force_ros.ros.contract_topics import ContractTopics


class VerdictPublisher:
    """Publishes one outcome for each measurement, on the topics of a node that may publish verdicts.

    Args:
        topics: the node's.
        limits: the limits to judge by, until `apply` is called.
    """

    def __init__(self, topics: ContractTopics, limits: AssessmentSettings) -> None:
        self._topics = topics
        self._limits = limits
        self._peak_force = topics.add_publisher(WrenchStamped, "peak_force", qos.PLOT)
        self._criteria = topics.add_publisher(DiagnosticArray, "criteria", qos.PLOT)
        self._last_verdict_s: float | None = None

    @property
    def seconds_since_last(self) -> float | None:
        """Return how long ago the last verdict was published; None if none was yet."""
        return None if self._last_verdict_s is None else time.monotonic() - self._last_verdict_s

    def apply(self, limits: AssessmentSettings) -> None:
        """Judge by these limits from now on, and publish them."""
        self._limits = limits
        self._topics.publish(limits)

    def publish_outcome(self, force_maps: Sequence[ForceMap], text: str) -> Verdict | Rejection:
        """Judge a measurement's force maps, publish the outcome and return it.

        Args:
            force_maps: of each vehicle.
            text: JSON of one of them, for a Rejection.

        Raises:
            DiskFullError: the node is closing; nothing was published, and the measurement stays open.
        """
        weld = force_maps[0]
        profile_id = identity(weld)
        try:
            verdict = judge_vehicles(force_maps, self._limits)
            verdict.profile_id = profile_id
            self._topics.publish(verdict)
        except DiskFullError:
            raise
        except Exception as error:  # every map has an outcome, whatever went wrong with it
            return self._topics.reject(
                f"force map of {weld.weld_id}",
                error,
                text,
                profile_sha256=weld.profile_sha256,
                profile_id=profile_id,
            )
        self._last_verdict_s = time.monotonic()
        self._peak_force.publish(typed_messages.peak_force(verdict))
        self._criteria.publish(typed_messages.criteria(verdict))
        return verdict
