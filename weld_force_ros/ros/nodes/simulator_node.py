"""Node simulator_node: weld_profile -> force_map and, of the passage that decides a verdict on it, force_history."""

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from std_msgs.msg import String

from weld_force_ros.assessment.judge import Simulates, deciding_history, simulate_vehicles
from weld_force_ros.messages import (
    TOPICS,
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Rejection,
    Settled,
    SimulationSettings,
    WeldProfile,
    identity,
)
from weld_force_ros.ros import qos
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.parameters import settings_from_parameters
from weld_force_ros.ros.serialized_messages import SerializedMessage
from weld_force_ros.ros.worker import Worker
from weld_force_ros.simulation import simulator

_OUTCOME_FOLLOWS_S = 4.0
"""What comes again so shortly after it was computed is not computed again: its outcome is on its way."""


class SimulatorNode(LifecycleNodeBase):
    """Computes in one worker thread, which also loads track and fit; callbacks only queue, up to a limit.

    A measurement that has its outcome is not computed again; one that is sent again for want of an outcome is. One
    whose publisher may not keep it is published once more and kept: the default quality of service sends nothing to an
    assessment node that hears of the publisher a moment too late, and no verdict is to be recorded without its
    measurement.

    Of several vehicles each has a force map and a history; if one cannot be computed, none is published but a
    Rejection. A history is that of the passage that decides the verdict on its map by the limits that the assessment
    node published last, and curves answer what advice on speed by these limits asks; as long as none are known, that of
    the highest peak, and curves of every km/h.

    Args:
        load: returns the simulator for given settings; called in the worker thread.
        node_options: passed to `rclpy.node.Node`.
    """

    kind = "simulator_node"

    def __init__(
        self, *, load: Callable[[SimulationSettings], Simulates] = simulator.Simulator, **node_options: Any
    ) -> None:
        super().__init__(**node_options)
        self._load = load

    def _configure(self, values: dict[str, Any]) -> None:
        self._settings = settings_from_parameters(values)
        self._settled: OrderedDict[str, None] = OrderedDict()
        self._computed_s: OrderedDict[str, float] = OrderedDict()
        self._passed_on: set[bytes] = set()
        self._simulators: list[Simulates]
        self._limits: AssessmentSettings | None = None
        self.topics = self._resources.enter_context(
            ContractTopics(self, [SimulationSettings, ForceMap, ForceHistory, Rejection], group=self.intake_group)
        )
        self._profiles = self.topics.add_publisher(String, TOPICS[WeldProfile].name, qos.RESENT)
        self._publish_settings()
        self._worker: Worker[SerializedMessage | list[SimulationSettings]] = Worker(
            "simulator", self._handle, self.topics.report_problem, self._prepare, on_room=self.wake
        )
        self._resources.callback(self._worker.close, CLOSE_S)
        self.topics.diagnostics.queue_length = lambda: self._worker.pending
        self.topics.diagnostics.warning = self._warning
        self.topics.publish_diagnostics()
        # In a group of its own: limits are to be known even while profiles have to wait.
        self.topics.subscribe(AssessmentSettings, self._note_limits, self.default_callback_group)
        self.topics.subscribe(Settled, self._note_settled)
        self.topics.subscribe(WeldProfile, self._worker.put)

    def _check_change(self, values: dict[str, Any]) -> None:
        settings_from_parameters(values)

    def _change(self, values: dict[str, Any]) -> None:
        self._worker.put(settings_from_parameters(values))

    def _warning(self) -> str | None:
        others = self.count_publishers(self.resolve_topic_name(TOPICS[ForceMap].name)) - 1
        return f"{others + 1} simulators publish force maps here; stop all but one" if others else None

    def _prepare(self) -> bool:
        try:
            self._simulators = [self._load(one) for one in self._settings]
        except Exception as error:  # reported by whoever runs the node, and in /diagnostics
            self.topics.diagnostics.fail(error)
            return False
        vehicles = [one.vehicle for one in self._settings if isinstance(one.vehicle, str)]
        self.get_logger().info(
            f"track {self._settings[0].track} ready{' for ' if vehicles else ''}{', '.join(vehicles)}"
        )
        return True

    def _note_settled(self, serialized: SerializedMessage) -> None:
        incoming = self.topics.receive(Settled, serialized)
        if incoming.replayed:  # settled for the ledger of that recording, not for the one here
            return
        settled = self.topics.decode_or_report(Settled, incoming)
        for profile_id in settled.profile_ids if settled is not None else ():
            self._settled[profile_id] = None
        while len(self._settled) > qos.KEPT_DEPTH[Settled]:
            self._settled.popitem(last=False)

    def _note_limits(self, serialized: SerializedMessage) -> None:
        incoming = self.topics.receive(AssessmentSettings, serialized)
        if not incoming.repeated:
            self._limits = self.topics.decode_or_report(AssessmentSettings, incoming) or self._limits

    def _publish_settings(self) -> None:
        for settings in self._settings:
            self.topics.publish(settings)

    def _handle(self, item: SerializedMessage | list[SimulationSettings]) -> None:
        if isinstance(item, list):
            self._simulators, self._settings = [self._load(one) for one in item], item
            self._publish_settings()
            return
        if item.cdr in self._passed_on:  # the copy comes back
            self._passed_on.remove(item.cdr)
            return
        incoming = self.topics.receive(WeldProfile, item)
        profile = self.topics.decode_or_reject(WeldProfile, incoming)
        if profile is not None and identity(profile) in self._settled:
            return
        if item.tolerated:
            self._passed_on.add(item.cdr)
            self._profiles.publish_recorded(item.cdr)
        if profile is None:
            return
        computed_s = self._computed_s.get(identity(profile), float("-inf"))
        if time.monotonic() - computed_s >= _OUTCOME_FOLLOWS_S:
            self._simulate(profile, incoming.text)

    def _simulate(self, profile: WeldProfile, text: str) -> None:
        profile_id = identity(profile)
        try:
            force_maps = simulate_vehicles(profile, self._simulators, self._limits)
            for force_map in force_maps:
                force_map.profile_id = profile_id
                self.topics.publish(force_map)
        except Exception as error:  # every profile has an outcome, whatever went wrong with it
            self.topics.reject(
                profile.source, error, text, profile_sha256=profile.profile_sha256, profile_id=profile_id
            )
        else:
            for its_simulator, force_map in zip(self._simulators, force_maps, strict=True):
                self._publish_history(profile, its_simulator, force_map)
        self._computed_s[profile_id] = time.monotonic()
        while len(self._computed_s) > qos.KEPT_DEPTH[ForceMap]:
            self._computed_s.popitem(last=False)

    def _publish_history(self, profile: WeldProfile, its_simulator: Simulates, force_map: ForceMap) -> None:
        try:
            history = deciding_history(profile, its_simulator, force_map, self._limits)
            history.profile_id = force_map.profile_id
            self.topics.publish(history)
        except Exception as error:  # the map is the outcome; a Rejection would be a second one
            self.topics.report_problem(f"force history of {profile.weld_id}: {error}")
