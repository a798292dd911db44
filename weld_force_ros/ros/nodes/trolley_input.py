"""Take samples and marks of a live trolley, and write each weld as a file to the folder of the profile node."""

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
from msgspec import UNSET, UnsetType
from rclpy.clock import Clock, ClockType
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.measurement.live_capture import LiveCapture
from weld_force_ros.measurement.rail_stream import STEP_M
from weld_force_ros.messages import MAX_MESSAGE_BYTES, TOPICS, RailSurface, Running, WeldMarker
from weld_force_ros.ros import point_cloud, qos
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.foreign_publishers import TolerantSubscription
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.serialized_messages import SerializedMessage
from weld_force_ros.ros.worker import BackPressureGroup, Worker

CAPTURE_SERVICE = "capture_weld"

_LOOK_EVERY_S = 1.0


class TrolleyInput:
    """Topics `rail_surface`, `rail_surface_points` and `weld_marker`, and the service `capture_weld`, of one node.

    Callbacks only queue. What the queue has no room for waits in the middleware, as does what comes while the node is
    inactive. A context manager; leaving it, what was queued is still handled.

    Args:
        node: the node that has these topics.
        folder: where captured welds are written.
        topics: the node's contract topics.
        values: its parameters by name.
    """

    def __init__(
        self, node: LifecycleNodeBase, folder: Path, topics: ContractTopics, values: Mapping[str, Any]
    ) -> None:
        self._node = node
        self._topics = topics
        self._lock = threading.Lock()
        self._here_m: float | None = None
        self._malformed = 0
        self._last_problem = ""
        self._live = LiveCapture(
            folder,
            rail=values["rail"] or None,
            detect=values["detect_welds"],
            running=_running(values["running"]),
            marker_offset_m=values["marker_offset_m"],
            mark_timeout_s=values["mark_timeout_s"],
            reject=topics.reject,
            announce=node.get_logger().info,
        )
        self._worker: Worker[Callable[[], None]] = Worker(
            "trolley", lambda job: job(), topics.report_problem, on_room=node.wake
        )
        self._gate = BackPressureGroup(lambda: self._node.active and self._worker.has_room)
        self._samples = [
            self._subscribe(String, TOPICS[RailSurface].name, self._take_surface),
            self._subscribe(PointCloud2, point_cloud.TOPIC, self._take_points),
        ]
        self._marks = TolerantSubscription(
            node, String, TOPICS[WeldMarker].name, qos.STREAM, self._queue_marker, self._gate
        )
        self._service = node.create_service(Trigger, CAPTURE_SERVICE, self._capture_weld)
        self._timer = node.create_timer(
            _LOOK_EVERY_S, self._look_for_welds, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for subscription in (*self._samples, self._marks):
            subscription.destroy()
        self._node.destroy_service(self._service)
        self._node.destroy_timer(self._timer)
        done = threading.Event()
        self._worker.put(self._live.finish)
        self._worker.put(done.set)
        done.wait(CLOSE_S)
        self._worker.close(CLOSE_S)

    @property
    def pending(self) -> int:
        """Return how many batches and marks are queued or being handled."""
        return self._worker.pending

    def facts(self) -> dict[str, object]:
        """Return the state of the trolley, for /diagnostics; nothing as long as no trolley is there."""
        with self._lock:
            here_m = self._here_m
        if here_m is None and not self._live.waiting and not self._malformed:
            return {}
        return {
            "trolley at m": "not known" if here_m is None else f"{here_m:.3f}",
            "trolley batches queued": self.pending,
            "welds marked, rail awaited": self._live.waiting,
            "welds captured": self._live.captured,
            "rail samples that are no numbers": self._live.unusable,
            "point clouds refused": self._malformed,
        }

    def _subscribe(
        self, message_type: type, topic: str, handle: Callable[[SerializedMessage], None]
    ) -> TolerantSubscription:
        return TolerantSubscription(
            self._node,
            message_type,
            topic,
            qos.STREAM,
            lambda serialized: self._worker.put(lambda: handle(serialized)),
            self._gate,
        )

    def _queue_arrived_samples(self) -> None:
        """Queue the samples that wait in the middleware, as far as there is room.

        The executor takes one message of each topic in turn: a mark would overtake them, and count for where the
        trolley was before.
        """
        for subscription in [each for samples in self._samples for each in samples.subscriptions]:
            with subscription.handle:
                while self._worker.has_room and (
                    sample := subscription.handle.take_message(subscription.msg_type, subscription.raw)
                ):
                    subscription.callback(*sample)

    def _queue_marker(self, serialized: SerializedMessage) -> None:
        self._queue_arrived_samples()
        self._worker.put(lambda: self._take_marker(serialized))

    def _take_surface(self, serialized: SerializedMessage) -> None:
        incoming = self._topics.receive(RailSurface, serialized)
        surface = self._topics.decode_or_reject(RailSurface, incoming)
        if surface is not None:
            self._live.push(surface)
            self._note_position()

    def _take_points(self, serialized: SerializedMessage) -> None:
        self._topics.diagnostics.count_received(point_cloud.TOPIC)
        try:
            cloud = _cloud(serialized.cdr)
            chainage_m, height_m = point_cloud.samples_of(cloud)
        except MessageError as error:
            self._malformed += 1
            self._report_and_log_once(str(error))
            return
        coarseness_m = point_cloud.coarseness_m(cloud, chainage_m)
        if coarseness_m > STEP_M / 2:
            self._report_and_log_once(
                f"{point_cloud.TOPIC}: x as float32 tells chainages here to {coarseness_m * 1e3:.2g} mm only; "
                "publish x as float64, or chainages from a nearer origin"
            )
        self._live.push_samples(chainage_m, height_m)
        self._note_position()

    def _report_and_log_once(self, problem: str) -> None:
        """Log a problem once, but keep it in /diagnostics for as long as it lasts."""
        if problem == self._last_problem:
            self._topics.diagnostics.report_problem(problem)
        else:
            self._last_problem = problem
            self._topics.report_problem(problem)

    def _note_position(self) -> None:
        with self._lock:
            self._here_m = self._live.position_m

    def _take_marker(self, serialized: SerializedMessage) -> None:
        incoming = self._topics.receive(WeldMarker, serialized)
        if incoming.repeated:
            return
        marker = self._topics.decode_or_reject(WeldMarker, incoming)
        if marker is not None:
            self._mark(marker, incoming.description, incoming.text)

    def _mark(self, marker: WeldMarker, source: str, text: str) -> None:
        try:
            self._node.get_logger().info(self._live.mark(marker))
        except InputError as error:
            self._topics.reject(source, error, text)

    def _capture_weld(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Mark a weld, queued behind the samples that came before: the place is where the trolley is by then."""
        if self._node.active:
            self._queue_arrived_samples()
        with self._lock:
            here_m = self._here_m
        if not self._node.active:
            response.message = f"{self._node.get_name()} is not active; activate it, then mark the weld again"
        elif here_m is None and not self.pending:
            response.message = "nothing was measured yet; start the trolley, then mark the weld where it is"
        elif not self._worker.has_room:
            response.message = "more is queued than can be taken now; mark the weld again in a second"
        else:
            call = msgspec.json.encode({"service": CAPTURE_SERVICE, "called_ns": time.time_ns()}).decode()
            self._worker.put(lambda: self._mark(WeldMarker(), f"{CAPTURE_SERVICE} call", call))
            place = "here" if here_m is None else f"at about {here_m:.3f} m"
            response.success = True
            response.message = f"weld marked {place}; its profile follows when the metre about it is measured"
        return response

    def _look_for_welds(self) -> None:
        if self._node.active and not self.pending:
            self._worker.put(self._live.check_marks)


def _running(text: str) -> Running | UnsetType:
    if not text:
        return UNSET
    try:
        return msgspec.convert(text, Running)
    except msgspec.ValidationError:
        raise InputError(f"running {text!r} is unknown", "use with, against or both, or leave it empty") from None


def _cloud(cdr: bytes) -> PointCloud2:
    if len(cdr) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{point_cloud.TOPIC}: {len(cdr)} bytes", f"send at most {MAX_MESSAGE_BYTES}")
    try:
        return deserialize_message(cdr, PointCloud2)
    except Exception:
        raise MessageError(f"{point_cloud.TOPIC}: no sensor_msgs/PointCloud2", "publish this type") from None
