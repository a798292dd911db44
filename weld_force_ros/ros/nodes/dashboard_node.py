"""Node dashboard_node: shows what the other nodes publish on a page of this machine; publishes no result itself."""

import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Message,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
)
from weld_force_ros.report.html_page import Report, page
from weld_force_ros.report.live_report import NEWEST, LiveReport
from weld_force_ros.report.live_server import ADDRESS, Server
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.serialized_messages import SerializedMessage
from weld_force_ros.ros.worker import Worker

_SHOWN = (SimulationSettings, AssessmentSettings, WeldProfile, ForceMap, ForceHistory, Verdict, Rejection)


class DashboardNode(LifecycleNodeBase):
    """Takes messages in one worker thread; pages are served in threads of their own.

    Attributes:
        url: address of the page; only while configured.
    """

    kind = "dashboard_node"

    def _configure(self, values: dict[str, Any]) -> None:
        namespace = self.get_namespace().strip("/")
        about = f"as they are judged, the newest {NEWEST:,}"
        title = f"Rail welds, {namespace}" if namespace else ""
        html = page(Report(title=title, about=about), live=True, newest=NEWEST)
        folder = self._resources.enter_context(tempfile.TemporaryDirectory(prefix="weld-force-dashboard-"))
        self._report = LiveReport(Path(folder))
        self.topics = self._resources.enter_context(ContractTopics(self, [], group=self.intake_group))
        self._worker: Worker[tuple[type[Message], SerializedMessage]] = Worker(
            "dashboard", self._take, self.topics.report_problem, on_room=self.wake
        )
        self._resources.callback(self._worker.close, CLOSE_S)
        server = Server(self._report, html, values["port"], values["host"])
        self._resources.callback(server.close)
        self.url = server.url
        self.topics.diagnostics.queue_length = lambda: self._worker.pending
        self.topics.diagnostics.facts = lambda: {"page": self.url, "welds shown": self._report.count}
        self.topics.publish_diagnostics()
        for kind in _SHOWN:
            self.topics.subscribe(kind, partial(self._queue, kind))
        self.get_logger().info(f"dashboard: {self.url}")
        if values["host"] != ADDRESS and sys.stderr.isatty():
            import segno

            segno.make(self.url).terminal(sys.stderr, compact=True)  # for the tablet's camera

    def _queue(self, kind: type[Message], serialized: SerializedMessage) -> None:
        self._worker.put((kind, serialized))

    def _take(self, item: tuple[type[Message], SerializedMessage]) -> None:
        kind, serialized = item
        incoming = self.topics.receive(kind, serialized)
        if incoming.repeated:
            return
        message = self.topics.decode_or_report(kind, incoming)  # who has to act on it rejects what cannot be read
        if message is not None:
            self._report.add(message)
