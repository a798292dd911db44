"""Node trolley_node: a simulated measuring trolley -> rail_surface or rail_surface_points, and marks of its welds."""

import threading
import time
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from weld_force_ros.errors import InputError
from weld_force_ros.measurement import synthetic_rail
from weld_force_ros.measurement.synthetic_rail import Handling, PlacedWeld, SampleBatch, SyntheticRail
from weld_force_ros.messages import TOPICS, RailSurface, WeldMarker
from weld_force_ros.ros import point_cloud, qos
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.trolley_input import CAPTURE_SERVICE

LINE_SPEED_KMH = 160.0
"""Of the line that the simulated rail lies in."""
_POLL_S = 0.05
_ANSWER_S = 5.0
_PRESS_AGAIN_S = 0.5
_MARKS = ("marker", "service", "none")
_FORMS = ("json", "points")


class TrolleyNode(LifecycleNodeBase):
    """Measures a synthetic rail once, `rate` times as fast as real, when it has subscribers; stands while inactive."""

    kind = "trolley_node"

    def _configure(self, values: dict[str, Any]) -> None:
        _check_choice(values, "marks", _MARKS)
        _check_choice(values, "form", _FORMS)
        self._marks, self._form, self._rate = values["marks"], values["form"], values["rate"]
        self.rail = SyntheticRail(values["length_m"], values["seed"])
        self._batches = synthetic_rail.run(self.rail, values["seed"], Handling(speed_m_per_s=values["speed_m_per_s"]))
        self.topics = self._resources.enter_context(ContractTopics(self, [RailSurface, WeldMarker]))
        if self._form == "points":
            self._points = self.topics.add_publisher(PointCloud2, point_cloud.TOPIC, qos.STREAM)
        if self._marks == "service":
            self._client = self.create_client(Trigger, CAPTURE_SERVICE)
            self._resources.callback(self.destroy_client, self._client)
        self.topics.publish_diagnostics()
        self._running, self._stopped, self._finished = threading.Event(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="trolley run", daemon=True)
        self._resources.callback(self._stop)

    def _activate(self) -> None:
        super()._activate()
        self._running.set()
        if self._thread.ident is None:
            self._thread.start()

    def _deactivate(self) -> None:
        super()._deactivate()
        self._running.clear()

    def stop_intake(self) -> None:
        """Stop the trolley for good."""
        if self._configured:
            self._stopped.set()

    @property
    def finished(self) -> bool:
        """Return whether the whole rail was measured and every weld marked."""
        return self._configured and self._finished.is_set()

    def _stop(self) -> None:
        self._stopped.set()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        try:
            if self._await_subscribers():
                self._measure()
        except Exception as error:  # reported by whoever runs the node, and in /diagnostics
            if not self._stopped.is_set():
                self.topics.diagnostics.fail(error)

    def _await_subscribers(self) -> bool:
        self.get_logger().info("waiting for subscribers")
        while not self._has_subscribers:
            if self._stopped.wait(_POLL_S):
                return False
        return True

    @property
    def _has_subscribers(self) -> bool:
        wanted = [point_cloud.TOPIC if self._form == "points" else TOPICS[RailSurface].name]
        if self._marks == "marker":
            wanted.append(TOPICS[WeldMarker].name)
        subscribed = all(self.count_subscribers(self.resolve_topic_name(topic)) for topic in wanted)
        return subscribed and (self._marks != "service" or self._client.service_is_ready())

    def _measure(self) -> None:
        due_s, at_s = time.monotonic(), 0.0
        for batch in self._batches:
            due_s, at_s = max(due_s + (batch.at_s - at_s) / self._rate, time.monotonic()), batch.at_s
            if not self._wait_until(due_s):
                return
            self._send(batch)
            if batch.weld is not None:
                self._mark(batch.weld)
        self._finished.set()
        self.get_logger().info(f"{self.rail.length_m:g} m of rail measured, {len(self.rail.welds)} welds")

    def _wait_until(self, due_s: float) -> bool:
        """Return True once it is time, False if the trolley was stopped."""
        while not self._running.wait(_POLL_S):
            if self._stopped.is_set():
                return False
        return not self._stopped.wait(max(due_s - time.monotonic(), 0.0))

    def _send(self, batch: SampleBatch) -> None:
        if self._form == "points":
            self._points.publish(point_cloud.cloud_of(batch.chainage_m, batch.height_m))
            return
        self.topics.publish(
            RailSurface(
                chainage=np.round(batch.chainage_m, 6).tolist(),
                chainage_unit="m",
                height=np.round(batch.height_m * 1e6, 3).tolist(),
                height_unit="um",
                height_positive="up",
            )
        )

    def _mark(self, placed: PlacedWeld) -> None:
        if self._marks == "marker":
            self.topics.publish(
                WeldMarker(chainage_m=placed.chainage_m, weld_id=placed.weld_id, line_speed_kmh=LINE_SPEED_KMH)
            )
        elif self._marks == "service":
            self._call_service()

    def _call_service(self) -> None:
        """Mark a weld by the service, again while that is refused; the trolley stands still until there is an end."""
        self.topics.wait_until_acknowledged(_ANSWER_S)
        if self._form == "points":
            self._points.wait_until_acknowledged(time.monotonic() + _ANSWER_S)
        deadline = time.monotonic() + _ANSWER_S
        while (problem := self._press()) and time.monotonic() < deadline and not self._stopped.wait(_PRESS_AGAIN_S):
            pass
        if problem:
            self.topics.report_problem(f"{CAPTURE_SERVICE}: {problem}")

    def _press(self) -> str:
        """Call the service; return why no weld is marked, or an empty text."""
        answered = threading.Event()
        future = self._client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(_ANSWER_S):
            return f"no answer within {_ANSWER_S:g} s"
        response = future.result()
        return "" if response.success else str(response.message)


def _check_choice(values: dict[str, Any], name: str, choices: tuple[str, ...]) -> None:
    if values[name] not in choices:
        raise InputError(f"parameter {name} is {values[name]!r}", f"give one of {', '.join(choices)}")
