"""assessment_node: force_map -> verdict; records every topic of the suite."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from weld_force_ros import assess
from weld_force_ros.bag import MessageDefinition, Recorder
from weld_force_ros.contract import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Message,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
)
from weld_force_ros.errors import BagError
from weld_force_ros.ros import parameters, qos
from weld_force_ros.ros.accounts import Repeats
from weld_force_ros.ros.definitions import message_definition
from weld_force_ros.ros.health import TOPIC as DIAGNOSTICS_TOPIC
from weld_force_ros.ros.messenger import Incoming, Messenger, Sample, listen
from weld_force_ros.ros.worker import Worker

M = TypeVar("M", bound=Message)
Follow = Callable[[M], None]

RAIL_FRAME = "rail"
_FOREIGN = (SimulationSettings, WeldProfile, ForceMap, ForceHistory, Rejection)


class AssessmentNode(Node):
    """Judges force maps and records, on one worker thread, in the order of arrival.

    What the node publishes itself is recorded before it is published, what others publish when it arrives.

    Args:
        on_force_map: told of each valid force map, before it is judged.
        on_verdict: told of each verdict, after it is recorded and published.
        on_rejection: told of each rejection, of whichever node.
        node_options: passed to `rclpy.node.Node`.

    Raises:
        InputError: a parameter that cannot be used, or a bag that exists already.
    """

    def __init__(
        self,
        *,
        on_force_map: Follow[ForceMap] | None = None,
        on_verdict: Follow[Verdict] | None = None,
        on_rejection: Follow[Rejection] | None = None,
        **node_options: Any,
    ) -> None:
        super().__init__("assessment_node", **node_options)
        limits = parameters.text(self, "limits", "", "file of limits (YAML); empty: the shipped ones")
        bag = parameters.text(self, "bag", "", "folder to record to, which must not exist; empty: no recording")
        self._limits = assess.load_limits(Path(limits).expanduser() if limits else None)
        self._follow: dict[type[Message], Follow[Any] | None] = {
            ForceMap: on_force_map,
            Verdict: on_verdict,
            Rejection: on_rejection,
        }
        self._definitions: dict[str, MessageDefinition] = {}
        self._repeats = Repeats()
        self._taking = True
        self._recorder = Recorder(Path(bag).expanduser()) if bag else None
        self.messenger = Messenger(self, [AssessmentSettings, Verdict, Rejection], self._record)
        self._peak_force = self.messenger.outlet(WrenchStamped, "peak_force", qos.PLOT)
        self.messenger.publish(self._limits)
        self._worker: Worker[tuple[type[Message] | None, Sample]] = Worker(
            "assessment", self._handle, self.messenger.complain
        )
        self.messenger.report_health(queue_length=lambda: self._worker.pending)
        for kind in _FOREIGN:
            self.messenger.listen(kind, partial(self._queue, kind))
        listen(self, DiagnosticArray, DIAGNOSTICS_TOPIC, qos.DIAGNOSTICS, partial(self._queue, None))
        self.get_logger().info(f"recording to {bag}" if bag else "not recording: parameter bag is empty")

    @property
    def pending(self) -> int:
        """Messages queued or in hand."""
        return self._worker.pending

    def stop_intake(self) -> None:
        """Ignore what arrives from now on."""
        self._taking = False

    def close(self, timeout_s: float) -> int:
        """Stop after the message in hand, then close and index the bag; return how many messages were left.

        Raises:
            BagError: the bag could not be completed; its messages are kept.
        """
        self.stop_intake()
        left = self._worker.close(timeout_s)
        self.messenger.wait_until_acknowledged(timeout_s)
        if self._recorder is not None:
            self._recorder.close()
        return left

    def _queue(self, kind: type[Message] | None, sample: Sample) -> None:
        if self._taking:
            self._worker.put((kind, sample))

    def _handle(self, item: tuple[type[Message] | None, Sample]) -> None:
        kind, sample = item
        if kind is None:
            self._take_diagnostics(sample)
        else:
            self._take_contract(self.messenger.open(kind, sample))

    def _take_diagnostics(self, sample: Sample) -> None:
        array = deserialize_message(sample.cdr, DiagnosticArray)
        if all(status.hardware_id != self.messenger.instance for status in array.status):
            self._record(sample)

    def _take_contract(self, incoming: Incoming) -> None:
        if incoming.publisher == self.messenger.instance:
            return
        self._record(incoming.sample)
        if incoming.kind is ForceMap and (force_map := self.messenger.read(ForceMap, incoming, self._tell)):
            self._assess(force_map, incoming.text)
        elif incoming.kind is Rejection and (rejection := self.messenger.read(Rejection, incoming, self._tell)):
            self._tell(rejection)

    def _assess(self, force_map: ForceMap, text: str) -> None:
        identity = (force_map.weld_id, force_map.profile_sha256, force_map.config_sha256)
        if not self._repeats.is_new(identity, force_map.publisher, force_map.sequence):
            return
        self._tell(force_map)
        try:
            verdict = assess.judge(force_map, self._limits)
            self.messenger.publish(verdict)
        except Exception as error:  # every map has an outcome, whatever went wrong with it
            source = f"force map of {force_map.weld_id}"
            self._tell(self.messenger.reject(source, error, text, profile_sha256=force_map.profile_sha256))
        else:
            self._peak_force.send(_wrench(verdict))
            self._tell(verdict)

    def _record(self, sample: Sample) -> None:
        if self._recorder is None:
            return
        if sample.topic not in self._definitions:
            self._definitions[sample.topic] = message_definition(sample.message_type, sample.qos)
        definition = self._definitions[sample.topic]
        try:
            self._recorder.write(
                sample.topic, definition, sample.cdr, log_time_ns=sample.received_ns, publish_time_ns=sample.sent_ns
            )
        except BagError as error:  # a verdict that cannot be recorded is still worth publishing
            self.messenger.complain(f"not recorded: {error}")

    def _tell(self, message: Message) -> None:
        follow = self._follow.get(type(message))
        if follow is not None:
            follow(message)


def _wrench(verdict: Verdict) -> WrenchStamped:
    """The peak force as a typed twin; z is up, the wheel pushes the rail with it."""
    wrench = WrenchStamped()
    wrench.header.frame_id = RAIL_FRAME
    wrench.header.stamp.sec, wrench.header.stamp.nanosec = verdict.stamp.sec, verdict.stamp.nanosec
    wrench.wrench.force.z = verdict.peak_force_n
    return wrench
