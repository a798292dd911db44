"""What the node tests share: a collector that waits, a quick simulator, a foreign node, profile files."""

import threading
import time
from collections.abc import Callable
from typing import Any, Self

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from weld_force_ros.messages import ForceHistory, ForceMap, Message, SimulationSettings, WeldProfile
from weld_force_ros.ros import qos
from weld_force_ros.simulation.curve_refinement import Asks

DEADLINE_S = 60.0
"""How long a condition is waited for: on a busy machine alone the start of three processes takes half a minute."""


class Outcomes:
    """Collects messages from any thread and waits for them."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self.forward: Callable[[Any], None] = lambda _: None
        self._changed = threading.Condition()

    def __call__(self, message: Any) -> None:
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()
        self.forward(message)

    def wait(self, count: int, what: Callable[[Any], bool] = lambda _: True) -> list[Any]:
        """The messages that `what` selects, once there are `count` of them."""

        def chosen() -> list[Any]:
            return [message for message in self.messages if what(message)]

        with self._changed:
            assert self._changed.wait_for(lambda: len(chosen()) >= count, DEADLINE_S), (
                f"{len(chosen())} of {count} messages within {DEADLINE_S} s"
            )
            return chosen()

    def of(self, kind: type[Message]) -> list[Any]:
        return [message for message in self.messages if isinstance(message, kind)]


def wait_until(condition: Callable[[], object]) -> None:
    deadline, pause = time.monotonic() + DEADLINE_S, threading.Event()
    while not condition():
        assert time.monotonic() < deadline, "condition not met in time"
        pause.wait(0.01)


class QuickSimulator:
    """Forces by a formula that can be worked by hand: static load + 1 kN per mm of height, km/h and metre."""

    def __init__(self, settings: SimulationSettings) -> None:
        self.settings = settings
        self.computed: list[str] = []
        self.go_on = threading.Event()
        self.go_on.set()

    @staticmethod
    def peak_n(height_m: float, speed_kmh: float, position_m: float) -> float:
        return 50e3 + 1e3 * (height_m * 1e3 + speed_kmh + position_m)

    def force_map(self, profile: WeldProfile, asks: Asks | None = None) -> ForceMap:
        assert self.go_on.wait(DEADLINE_S)
        self.computed.append(profile.weld_id)
        if profile.weld_id == "impossible":
            raise ArithmeticError("no such weld")
        speeds, positions = self.settings.speeds_kmh, self.settings.positions_m
        height = max(profile.z_m) - min(profile.z_m)
        peaks = [self.peak_n(height, v, s) for v in speeds for s in positions]
        return ForceMap(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self.settings.config_sha256,
            track=self.settings.track,
            engine=self.settings.engine,
            speeds_kmh=speeds,
            positions_m=positions,
            peak_force_n=peaks,
            peak_x_m=[0.1] * len(peaks),
            min_force_n=[40e3] * len(peaks),
            contact_loss_s=[0.0] * len(peaks),
            static_load_n=50e3,
            vehicle=self.settings.vehicle,
            span_m=0.6,
            elapsed_s=0.0,
        )

    def force_history(self, profile: WeldProfile, speed_kmh: float, position_m: float, **_: Any) -> ForceHistory:
        return ForceHistory(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self.settings.config_sha256,
            speed_kmh=speed_kmh,
            position_m=position_m,
            x_m=[0.0, 1.0],
            force_n=[50e3, 50e3],
            wheel_m=[0.0, 0.0],
            rail_m=[0.0, 0.0],
            irregularity_m=[0.0, 0.0],
        )


class Probe:
    """A foreign node: publishes text on any topic, collects messages of any topic."""

    def __init__(self, domain_id: int) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("probe", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._publishers: dict[str, Any] = {}

    def publish(self, topic: str, data: str | bytes, profile: Any = qos.CONTRACT) -> None:
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(String, topic, profile)
            if profile is not qos.CONTRACT:  # not kept for who is found later
                wait_until(lambda: self._publishers[topic].get_subscription_count())
        self._publishers[topic].publish(String(data=data) if isinstance(data, str) else data)

    def nodes(self) -> set[str]:
        """The nodes that it knows of."""
        return set(self._node.get_node_names())

    def publisher(self, topic: str, profile: Any, message_type: type = String) -> Any:
        """A publisher of its own beside that of `publish`."""
        return self._node.create_publisher(message_type, topic, profile)

    def collect(self, topic: str, message_type: type, profile: Any) -> Outcomes:
        collected = Outcomes()
        self._node.create_subscription(message_type, topic, collected, profile)
        return collected

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """The answer of a service."""
        client = self._node.create_client(service_type, name)
        assert client.wait_for_service(DEADLINE_S), f"no service {name}"
        future = client.call_async(request)
        wait_until(future.done)
        return future.result()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._thread.join(DEADLINE_S)
        self._node.destroy_node()
        self._context.try_shutdown()


def profile_text(height_um: float = 200.0, weld_id: str | None = None) -> str:
    """A triangular dip of 60 samples, 5 mm apart."""
    rows = [f"{5 * i},{-height_um * (1 - abs(i - 30) / 30):.3f}" for i in range(61)]
    named = [f"# weld_id: {weld_id}"] if weld_id else []
    stated = ["# x_unit: mm", "# z_unit: um", "# z_positive: up", "# noise: none", "# samples: 61"]
    return "\n".join([*named, *stated, "x,z", *rows, ""])
