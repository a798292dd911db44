"""Node assessment_node: force_map -> verdict; records every topic, and keeps the ledger of outcomes."""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType

from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.messages import (
    TOPICS,
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Inquiry,
    Message,
    Rejection,
    Settled,
    SimulationSettings,
    Verdict,
    WeldMarker,
    WeldProfile,
    identity,
    text_identity,
)
from weld_force_ros.ros import qos
from weld_force_ros.ros.contract_topics import ContractTopics, Incoming
from weld_force_ros.ros.diagnostics import TOPIC as DIAGNOSTICS_TOPIC
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.graph_configurations import GraphConfigurations
from weld_force_ros.ros.nodes.outcome_ledger import Ledger, read_ledger
from weld_force_ros.ros.nodes.published_ledger import PublishedLedger
from weld_force_ros.ros.nodes.topic_recorder import TopicRecorder
from weld_force_ros.ros.nodes.verdict_publisher import VerdictPublisher
from weld_force_ros.ros.serialized_messages import SerializedMessage
from weld_force_ros.ros.worker import BackPressureGroup, Worker

M = TypeVar("M", bound=Message)
OnMessage = Callable[[M], None]

_FROM_OTHERS = (SimulationSettings, WeldProfile, ForceMap, ForceHistory, Rejection, WeldMarker)
_MB = 1e6


class AssessmentNode(LifecycleNodeBase):
    """Judges force maps and records, on one worker thread, in the order of arrival; each measurement once.

    What the node publishes itself is recorded before it is published, what others publish when it arrives. A
    recording that exists is continued: a measurement with an outcome in it gets no second one, one without an outcome
    is finished. While the disk is full nothing is judged: what comes waits in queue, middleware and folder. Maps that
    are played from a recording are judged only if a simulator of this graph has their configuration, or there is none.

    Args:
        on_force_map: called with each valid force map, before it is judged.
        on_verdict: called with each verdict, after it is recorded and published.
        on_rejection: called with each rejection, of whichever node.
        node_options: passed to `rclpy.node.Node`.
    """

    kind = "assessment_node"

    def __init__(
        self,
        *,
        on_force_map: OnMessage[ForceMap] | None = None,
        on_verdict: OnMessage[Verdict] | None = None,
        on_rejection: OnMessage[Rejection] | None = None,
        **node_options: Any,
    ) -> None:
        super().__init__(**node_options)
        self._on_message: dict[type[Message], OnMessage[Any] | None] = {
            ForceMap: on_force_map,
            Verdict: on_verdict,
            Rejection: on_rejection,
        }

    def _configure(self, values: dict[str, Any]) -> None:
        limits, closing = _limits(values), threading.Event()
        bag = Path(values["bag"]).expanduser() if values["bag"] else None
        intake_group = self.intake_group
        self.topics = self._resources.enter_context(
            ContractTopics(
                self,
                [AssessmentSettings, Verdict, Rejection, Settled],
                lambda message: self.recorder.record(message),
                intake_group,
            )
        )
        continued = bag is not None and bag.exists()
        self.recorder = self._resources.enter_context(
            TopicRecorder(
                bag,
                split_bytes=int(values["split_mb"] * _MB),
                split_s=60 * values["split_minutes"],
                closing=closing,
                report_problem=self.topics.report_problem,
                say=self.get_logger().info,
            )
        )
        self._outcomes = PublishedLedger(
            self.topics, read_ledger(bag, self.topics.resume) if bag is not None and continued else Ledger()
        )
        self._ledger = self._outcomes.ledger
        self._configurations = GraphConfigurations()
        if bag is not None:
            self.get_logger().info(
                f"recording to {bag}: {self._ledger.settled_count} processed, {self._ledger.open_count} pending"
            )
        self._verdicts = VerdictPublisher(self.topics, limits)
        self._worker: Worker[Callable[[], None]] = Worker(
            "assessment", lambda item: item(), self.topics.report_problem, on_room=self.wake
        )
        self._resources.callback(self._worker.close, CLOSE_S)
        self._resources.callback(closing.set)
        self._worker.put(partial(self._verdicts.apply, limits))  # recorded, so it may have to wait for a full disk
        self._worker.put(self._resume)
        self._publish_diagnostics()
        self._subscribe()

    def _publish_diagnostics(self) -> None:
        diagnostics = self.topics.diagnostics
        diagnostics.queue_length = lambda: self._worker.pending
        diagnostics.facts = self._facts
        diagnostics.warning = self._warning
        diagnostics.blocked_by = lambda: self.recorder.disk_full
        self.topics.publish_diagnostics()

    def _subscribe(self) -> None:
        def receive(kind: type[Message], message: SerializedMessage) -> None:
            self._worker.put(lambda: self._take(self.topics.receive(kind, message)))

        def answer(message: SerializedMessage) -> None:
            # Before all that waits to be judged: who asks holds back measurements meanwhile.
            self._worker.put(lambda: self._outcomes.answer(self.topics.receive(Inquiry, message)), first=True)

        def record(message: SerializedMessage) -> None:
            self._worker.put(lambda: self.recorder.record(message, may_wait=False))

        def look_for_stall() -> None:
            if self._active and self._ledger.open_count:
                self._worker.put(self._outcomes.resend_if_stalled)

        for kind in _FROM_OTHERS:
            self.topics.subscribe(kind, partial(receive, kind))
        self.topics.subscribe(Inquiry, answer, BackPressureGroup(lambda: self.active))
        self.topics.subscribe_other(DiagnosticArray, DIAGNOSTICS_TOPIC, qos.DIAGNOSTICS, record)
        timer = self.create_timer(1.0, look_for_stall, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._resources.callback(self.destroy_timer, timer)

    @property
    def awaited(self) -> int:
        """Return how many force maps are probably on their way: none if no message came for a while."""
        return self._outcomes.awaited

    @property
    def open_count(self) -> int:
        """Return how many accepted measurements have no outcome yet."""
        return self._ledger.open_count

    def _check_change(self, values: dict[str, Any]) -> None:
        _limits(values)

    def _change(self, values: dict[str, Any]) -> None:
        self._worker.put(partial(self._verdicts.apply, _limits(values)))

    def _facts(self) -> dict[str, object]:
        since_s = self._verdicts.seconds_since_last
        return {
            "seconds since last verdict": "none yet" if since_s is None else f"{since_s:.0f}",
            "measurements with outcome": self._ledger.settled_count,
            "measurements without outcome": self._ledger.open_count,
            **self.recorder.facts(),
        }

    def _warning(self) -> str | None:
        others = self.count_publishers(self.resolve_topic_name(TOPICS[Verdict].name)) - 1
        if self.recorder.records and others:
            return f"{others + 1} assessment nodes publish verdicts here; stop all but one"
        return self.recorder.warning

    def _take(self, incoming: Incoming) -> None:
        if incoming.publisher == self.topics.instance:
            return
        self._configurations.note(incoming)
        if self._configurations.is_foreign(incoming):
            if report := self._configurations.first_report(incoming):
                self.topics.report_problem(report)
            return
        self._outcomes.note_message()
        if incoming.kind is WeldProfile:
            self._take_profile(incoming)
        elif incoming.kind is Rejection:
            self._take_rejection(incoming)
        else:
            self._record_once(incoming)
            if incoming.kind is ForceMap:
                force_map = self.topics.decode_or_reject(ForceMap, incoming, self._after_own_rejection)
                if force_map is not None:
                    self._assess(force_map, incoming.text)

    def _take_profile(self, incoming: Incoming) -> None:
        profile = self.topics.decode_or_report(WeldProfile, incoming)  # the simulator rejects what cannot be read
        profile_id = identity(profile) if profile is not None else text_identity(incoming.description, incoming.text)
        if not self._ledger.has_profile(profile_id):
            self.recorder.record(incoming.serialized)
            self._ledger.accept(profile_id, incoming.serialized.cdr)
        if self._ledger.is_settled(profile_id):
            self._outcomes.confirm_again(profile_id)

    def _take_rejection(self, incoming: Incoming) -> None:
        rejection = self.topics.decode_or_reject(Rejection, incoming, self._after_own_rejection)
        if rejection is None:
            self._record_once(incoming)
        elif not isinstance(rejection.profile_id, str):
            self._record_once(incoming)
            self._notify(rejection)
        elif self._ledger.is_settled(rejection.profile_id):
            self._outcomes.confirm_again(rejection.profile_id)
        else:
            self.recorder.record(incoming.serialized)
            self._notify(rejection)
            self._outcomes.settle(rejection.profile_id)

    def _after_own_rejection(self, rejection: Rejection) -> None:
        """Settle a message that this node itself rejected, because it breaks the contract."""
        self._notify(rejection)
        self._outcomes.settle(str(rejection.profile_id))

    def _assess(self, force_map: ForceMap, text: str) -> None:
        if self._ledger.is_settled(identity(force_map)):
            return
        self._notify(force_map)
        if force_maps := self._ledger.gather(force_map):
            self._notify(self._verdicts.publish_outcome(force_maps, text))
            self._outcomes.settle(identity(force_map))

    def _resume(self) -> None:
        """Finish what an earlier process had begun, as far as the bag holds it."""
        self._outcomes.confirm_unfinished()
        for cdr in [cdr for maps in self._ledger.waiting_maps.values() for cdr in maps]:
            force_map = self.topics.decode_recorded(ForceMap, cdr)
            if force_map is not None:
                self._assess(force_map, "")
        self._outcomes.resend_at_once()

    def _record_once(self, incoming: Incoming) -> None:
        if not incoming.repeated:
            self.recorder.record(incoming.serialized)

    def _notify(self, message: Message) -> None:
        on_message = self._on_message.get(type(message))
        if on_message is not None:
            on_message(message)


def _limits(values: dict[str, Any]) -> AssessmentSettings:
    return load_limits(values["limits"])
