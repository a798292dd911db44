"""simulator_node: weld_profile -> force_map and the worst passage's force_history."""

from collections.abc import Callable
from typing import Any, Protocol

from rclpy.node import Node

from weld_force_ros import assess
from weld_force_ros.contract import ForceHistory, ForceMap, Rejection, SimulationSettings, WeldProfile
from weld_force_ros.ros import parameters
from weld_force_ros.ros.accounts import Repeats
from weld_force_ros.ros.messenger import Messenger, Sample
from weld_force_ros.ros.worker import Worker


class Simulates(Protocol):
    """What the node needs of `assess.Simulator`."""

    def force_map(self, profile: WeldProfile) -> ForceMap:
        """Peak forces over speed and position."""

    def worst_history(self, profile: WeldProfile, force_map: ForceMap) -> ForceHistory:
        """The passage with the largest peak."""


class SimulatorNode(Node):
    """Computes on one worker thread, which also loads track and fit; callbacks only queue.

    Args:
        load: makes the simulator, in the worker thread.
        node_options: passed to `rclpy.node.Node`.

    Raises:
        InputError: a parameter that cannot be used.
    """

    def __init__(
        self, *, load: Callable[[SimulationSettings], Simulates] = assess.Simulator, **node_options: Any
    ) -> None:
        super().__init__("simulator_node", **node_options)
        self._settings = _settings(self)
        self._load = load
        self._repeats = Repeats()
        self._taking = True
        self._simulator: Simulates
        self.messenger = Messenger(self, [SimulationSettings, ForceMap, ForceHistory, Rejection])
        self.messenger.publish(self._settings)
        self._worker: Worker[Sample] = Worker("simulator", self._handle, self.messenger.complain, self._prepare)
        self.messenger.report_health(queue_length=lambda: self._worker.pending)
        self.messenger.listen(WeldProfile, self._queue)

    @property
    def pending(self) -> int:
        """Profiles queued or being simulated."""
        return self._worker.pending

    def stop_intake(self) -> None:
        """Leave further profiles to the next simulator: the topic is latched."""
        self._taking = False

    def close(self, timeout_s: float) -> int:
        """Stop after the profile in hand; return how many were left."""
        self.stop_intake()
        left = self._worker.close(timeout_s)
        self.messenger.wait_until_acknowledged(timeout_s)
        return left

    def _queue(self, sample: Sample) -> None:
        if self._taking:
            self._worker.put(sample)

    def _prepare(self) -> bool:
        try:
            self._simulator = self._load(self._settings)
        except Exception as error:  # reported by whoever runs the node, and in /diagnostics
            self.messenger.health.fail(error)
            return False
        self.get_logger().info(f"track {self._settings.track} ready")
        return True

    def _handle(self, sample: Sample) -> None:
        incoming = self.messenger.open(WeldProfile, sample)
        profile = self.messenger.read(WeldProfile, incoming)
        if profile is None:
            return
        identity = (profile.weld_id, profile.profile_sha256)
        if not self._repeats.is_new(identity, profile.publisher, profile.sequence):
            return
        try:
            force_map = self._simulator.force_map(profile)
            self.messenger.publish(force_map)
        except Exception as error:  # every profile has an outcome, whatever went wrong with it
            self.messenger.reject(profile.source, error, incoming.text, profile_sha256=profile.profile_sha256)
        else:
            self._publish_history(profile, force_map)

    def _publish_history(self, profile: WeldProfile, force_map: ForceMap) -> None:
        try:
            self.messenger.publish(self._simulator.worst_history(profile, force_map))
        except Exception as error:  # the map is the outcome; a Rejection would be a second one
            self.messenger.complain(f"force history of {profile.weld_id}: {error}")


def _settings(node: Node) -> SimulationSettings:
    own = "; 0: the track's own"
    options = {
        "wheel_mass_kg": parameters.number(
            node, "wheel_mass_kg", 0.0, f"unsprung mass per wheel, kg{own}", low=0.0, high=1e4
        ),
        "static_load_n": parameters.number(node, "static_load_n", 0.0, f"static wheel load, N{own}", low=0.0, high=1e6),
        "wheel_radius_m": parameters.number(node, "wheel_radius_m", 0.0, f"wheel radius, m{own}", low=0.0, high=2.0),
        "hertz_n_per_m15": parameters.number(
            node, "hertz_n_per_m15", 0.0, f"contact stiffness, N/m^1.5{own}", low=0.0, high=1e13
        ),
    }
    return assess.simulation_settings(
        track=parameters.text(node, "track", "bilbao", "a shipped track, or the path of a track file (YAML)"),
        engine=parameters.text(node, "engine", "common-poles", "common-poles, rfp or reference"),
        speeds_kmh=assess.parse_speeds(
            parameters.list_text(node, "speeds", "20:300:5", "speeds in km/h: first:last:step, or a list")
        ),
        positions=assess.parse_positions(
            parameters.list_text(node, "positions", "15", "equal steps over one span, or a list of m after the sleeper")
        ),
        **{name: value or None for name, value in options.items()},
    )
