"""assessment_node: force_map -> verdict; records every topic of the suite, and keeps the ledger of outcomes."""

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from std_msgs.msg import String

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.limits import load_limits
from weld_force_ros.errors import BagError, DiskFullError
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
)
from weld_force_ros.recording import MessageDefinition, Recorder
from weld_force_ros.ros import qos, typed_messages
from weld_force_ros.ros.contract_topics import ContractTopics, Incoming, Sample
from weld_force_ros.ros.diagnostics import TOPIC as DIAGNOSTICS_TOPIC
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.outcome_ledger import Ledger, read_ledger
from weld_force_ros.ros.type_definitions import message_definition
from weld_force_ros.ros.worker import BackPressureGroup, Worker

M = TypeVar("M", bound=Message)
Follow = Callable[[M], None]

STALLED_S = 5.0
"""After so long without any force map, open measurements are sent to the simulator again."""

_FOREIGN = (SimulationSettings, WeldProfile, ForceMap, ForceHistory, Rejection, WeldMarker)
_DISK_LOOK_S = 0.5
_LAST_MAPS_S = 2.0
_MB = 1e6


class AssessmentNode(LifecycleNodeBase):
    """Judges force maps and records, on one worker thread, in the order of arrival; each measurement once.

    What the node publishes itself is recorded before it is published, what others publish when it arrives. A
    recording that exists is continued: what it holds an outcome of gets no second one, what it holds without an
    outcome is finished. While the disk is full nothing is judged: what comes waits in queue, middleware and folder.

    Args:
        on_force_map: told of each valid force map, before it is judged.
        on_verdict: told of each verdict, after it is recorded and published.
        on_rejection: told of each rejection, of whichever node.
        node_options: passed to `rclpy.node.Node`.
    """

    kind = "assessment_node"

    def __init__(
        self,
        *,
        on_force_map: Follow[ForceMap] | None = None,
        on_verdict: Follow[Verdict] | None = None,
        on_rejection: Follow[Rejection] | None = None,
        **node_options: Any,
    ) -> None:
        super().__init__(**node_options)
        self._follow: dict[type[Message], Follow[Any] | None] = {
            ForceMap: on_force_map,
            Verdict: on_verdict,
            Rejection: on_rejection,
        }
        self._definitions: dict[str, MessageDefinition] = {}

    def _configure(self, values: dict[str, Any]) -> None:
        self._limits = _limits(values)
        self._closing = threading.Event()
        self._ledger = Ledger()
        self._recorder: Recorder | None = None
        self._disk_full: str | None = None
        self._heard_s = self._judged_s = time.monotonic()
        self._verdicts = 0
        gate = self.gate
        self.messenger = ContractTopics(self, [AssessmentSettings, Verdict, Rejection, Settled], self._record, gate)
        self._resources.enter_context(self.messenger)
        if values["bag"]:
            self._begin_or_continue(Path(values["bag"]).expanduser(), values)
        self._peak_force = self.messenger.outlet(WrenchStamped, "peak_force", qos.PLOT)
        self._criteria = self.messenger.outlet(DiagnosticArray, "criteria", qos.PLOT)
        self._to_simulator = self.messenger.outlet(
            String, TOPICS[WeldProfile].name, qos.SENT_AGAIN, record=lambda _: None
        )
        self._worker: Worker[Callable[[], None]] = Worker(
            "assessment", lambda item: item(), self.messenger.report_problem, on_room=self.wake
        )
        self._resources.callback(self._worker.close, CLOSE_S)
        self._resources.callback(self._closing.set)
        self._worker.put(partial(self._judge_by, self._limits))  # recorded, so it may have to wait for a full disk
        self._worker.put(self._take_up_what_was_left)
        self._report()
        for kind in _FOREIGN:
            self.messenger.listen(kind, partial(self._queue, kind))
        self.messenger.listen(Inquiry, self._queue_inquiry, BackPressureGroup(lambda: self.active))
        self.messenger.listen_to(DiagnosticArray, DIAGNOSTICS_TOPIC, qos.DIAGNOSTICS, self._queue_diagnostics)
        timer = self.create_timer(1.0, self._look_for_stall, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._resources.callback(self.destroy_timer, timer)

    @property
    def _has_room(self) -> bool:
        return self._worker.has_room

    @property
    def pending(self) -> int:
        """Messages queued or in hand."""
        return self._worker.pending if self._configured else 0

    @property
    def awaited(self) -> int:
        """Measurements whose force map is probably on its way: none if nothing was heard for a while."""
        return self._ledger.open_count if time.monotonic() - self._heard_s < _LAST_MAPS_S else 0

    @property
    def open_count(self) -> int:
        """Measurements accepted that have no outcome yet."""
        return self._ledger.open_count

    def _check_change(self, values: dict[str, Any]) -> None:
        _limits(values)

    def _change(self, values: dict[str, Any]) -> None:
        self._worker.put(partial(self._judge_by, _limits(values)))

    def _judge_by(self, limits: AssessmentSettings) -> None:
        self._limits = limits
        self.messenger.publish(limits)

    def _begin_or_continue(self, bag: Path, values: dict[str, Any]) -> None:
        existed = bag.exists()
        self._recorder = Recorder(bag, split_bytes=int(values["split_mb"] * _MB), split_s=60 * values["split_minutes"])
        self._resources.enter_context(self._recorder)
        if existed:
            self._ledger = read_ledger(bag, self.messenger.join)
        self.get_logger().info(
            f"recording to {bag}: {self._ledger.settled_count} measurements have their outcome, "
            f"{self._ledger.open_count} are open"
        )

    def _report(self) -> None:
        diagnostics = self.messenger.diagnostics
        diagnostics.queue_length = lambda: self._worker.pending
        diagnostics.facts = self._facts
        diagnostics.warning = self._warning
        diagnostics.blocked_by = lambda: self._disk_full
        self.messenger.publish_diagnostics()

    def _facts(self) -> dict[str, object]:
        since = f"{time.monotonic() - self._judged_s:.0f}" if self._verdicts else "none yet"
        disk: dict[str, object] = {}
        if self._recorder is not None:
            disk["disk free MB"] = f"{self._recorder.free_bytes / _MB:.0f}"
            disk["longest ms until on disk"] = f"{1e3 * self._recorder.longest_unsynced_s:.0f}"
        return {
            "seconds since last verdict": since,
            "measurements with outcome": self._ledger.settled_count,
            "measurements without outcome": self._ledger.open_count,
            **disk,
        }

    def _warning(self) -> str | None:
        if self._recorder is None:
            return "not recording: after a restart, outcomes may come a second time"
        others = self.count_publishers(self.resolve_topic_name(TOPICS[Verdict].name)) - 1
        if others:
            return f"{others + 1} assessment nodes publish verdicts here; stop all but one"
        return self._recorder.announcement

    def _queue(self, kind: type[Message], sample: Sample) -> None:
        self._worker.put(lambda: self._take(self.messenger.open(kind, sample)))

    def _queue_diagnostics(self, sample: Sample) -> None:
        self._worker.put(lambda: self._record(sample, may_wait=False))

    def _queue_inquiry(self, sample: Sample) -> None:
        # Before all that waits to be judged: who asks holds back measurements meanwhile.
        self._worker.put(lambda: self._answer(self.messenger.open(Inquiry, sample)), first=True)

    def _take(self, incoming: Incoming) -> None:
        if incoming.publisher == self.messenger.instance:
            return
        self._heard_s = time.monotonic()
        if incoming.kind is WeldProfile:
            self._take_profile(incoming)
        elif incoming.kind is Rejection:
            self._take_rejection(incoming)
        else:
            self._record_once(incoming)
            if incoming.kind is ForceMap and (force_map := self.messenger.read(ForceMap, incoming, self._refused)):
                self._assess(force_map, incoming.text)

    def _take_profile(self, incoming: Incoming) -> None:
        profile = self.messenger.read_quietly(WeldProfile, incoming)  # the simulator rejects what cannot be read
        if profile is None:
            self._record_once(incoming)
        elif self._ledger.is_settled(identity(profile)):
            self._answer_of([identity(profile)])
        else:
            self._record_once(incoming)
            self._ledger.accept(identity(profile), incoming.sample.cdr)

    def _take_rejection(self, incoming: Incoming) -> None:
        rejection = self.messenger.read(Rejection, incoming, self._refused)
        if rejection is None:
            self._record_once(incoming)
        elif not isinstance(rejection.profile_id, str):
            self._record_once(incoming)
            self._tell(rejection)
        elif self._ledger.is_settled(rejection.profile_id):
            self._answer_of([rejection.profile_id])
        else:
            self._record(incoming.sample)
            self._tell(rejection)
            self._settle(rejection.profile_id)

    def _refused(self, rejection: Rejection) -> None:
        """What this node itself rejected: a message that breaks the contract."""
        self._tell(rejection)
        self._settle(str(rejection.profile_id))

    def _assess(self, force_map: ForceMap, text: str) -> None:
        profile_id = identity(force_map)
        if self._ledger.is_settled(profile_id):
            return
        self._tell(force_map)
        try:
            verdict = judge(force_map, self._limits)
            verdict.profile_id = profile_id
            self.messenger.publish(verdict)
        except DiskFullError:
            raise  # only where the node is closing; the measurement stays open
        except Exception as error:  # every map has an outcome, whatever went wrong with it
            source = f"force map of {force_map.weld_id}"
            self._tell(
                self.messenger.reject(
                    source, error, text, profile_sha256=force_map.profile_sha256, profile_id=profile_id
                )
            )
        else:
            self._verdicts += 1
            self._judged_s = time.monotonic()
            self._peak_force.send(typed_messages.peak_force(verdict))
            self._criteria.send(typed_messages.criteria(verdict))
            self._tell(verdict)
        self._settle(profile_id)

    def _settle(self, profile_id: str) -> None:
        """Confirm an outcome that is recorded and published."""
        self._ledger.settle(profile_id)
        self.messenger.publish(Settled(profile_ids=[profile_id]))

    def _answer(self, incoming: Incoming) -> None:
        inquiry = self.messenger.read_quietly(Inquiry, incoming)
        if inquiry is not None:
            self._answer_of(inquiry.profile_ids, inquiry.publisher, inquiry.sequence)

    def _answer_of(self, profile_ids: list[str], asked_by: str = "", asked_sequence: int = 0) -> None:
        self.messenger.publish(
            Settled(profile_ids=self._ledger.settled_of(profile_ids), asked_by=asked_by, asked_sequence=asked_sequence)
        )

    def _take_up_what_was_left(self) -> None:
        """Finish what a process before this one had begun, as far as the bag holds it."""
        for profile_id, kept in list(self._ledger.unfinished.items()):
            if kept.kind is Verdict:
                self.messenger.publish_again(kept.kind, kept.cdr)
            self._settle(profile_id)
        self._ledger.unfinished.clear()
        for cdr in list(self._ledger.waiting_maps.values()):
            force_map = self.messenger.read_again(ForceMap, cdr)
            if force_map is not None:
                self._assess(force_map, "")
        self._heard_s = float("-inf")  # open measurements are sent to the simulator at once

    def _look_for_stall(self) -> None:
        if self._active and self._ledger.open_count:
            self._worker.put(self._send_again_if_stalled)

    def _send_again_if_stalled(self) -> None:
        if not self._ledger.open_count or time.monotonic() - self._heard_s < STALLED_S:
            return
        for cdr in self._ledger.oldest_open():
            self._to_simulator.send_again(cdr)
        self._heard_s = time.monotonic()

    def _record_once(self, incoming: Incoming) -> None:
        if not incoming.repeated:
            self._record(incoming.sample)

    def _record(self, sample: Sample, *, may_wait: bool = True) -> None:
        if self._recorder is None:
            return
        if sample.topic not in self._definitions:
            self._definitions[sample.topic] = message_definition(sample.message_type, sample.qos)
        definition = self._definitions[sample.topic]
        while True:
            try:
                self._recorder.write(
                    sample.topic, definition, sample.cdr, log_time_ns=sample.received_ns, publish_time_ns=sample.sent_ns
                )
                self._disk_full = None
            except DiskFullError as error:
                self._note_full_disk(error)
                if not may_wait:
                    return
                if self._closing.wait(_DISK_LOOK_S):
                    raise
                continue
            except BagError as error:  # a verdict that cannot be recorded is still worth publishing
                self.messenger.report_problem(f"not recorded: {error}")
            return

    def _note_full_disk(self, error: DiskFullError) -> None:
        if self._disk_full is None:
            self.messenger.report_problem(f"{error}; until then nothing is judged, and nothing is lost")
        self._disk_full = str(error)

    def _tell(self, message: Message) -> None:
        follow = self._follow.get(type(message))
        if follow is not None:
            follow(message)


def _limits(values: dict[str, Any]) -> AssessmentSettings:
    return load_limits(Path(values["limits"]).expanduser() if values["limits"] else None)
