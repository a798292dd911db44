"""Node foxglove_node: streams what the other nodes publish to Foxglove or Lichtblick; publishes nothing in ROS itself.

Contract messages come as JSON with their schemas, so that panels see their fields; typed topics as they are. The
protocol is Foxglove's own, over a WebSocket, by its SDK. It keeps no message for who joins later: the newest one of
each latched topic is sent again when a client subscribes.
"""

from collections.abc import Callable
from functools import partial
from importlib import resources
from typing import Any

import foxglove
import msgspec
from diagnostic_msgs.msg import DiagnosticArray
from foxglove.websocket import ChannelView, Client, ServerListener
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import PointCloud2

from weld_force_ros.errors import InputError
from weld_force_ros.messages import TOPICS, Inquiry, Message, Settled, encode, json_schema
from weld_force_ros.ros import diagnostics, point_cloud, qos
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.serialized_messages import SerializedMessage
from weld_force_ros.ros.type_definitions import definition_text
from weld_force_ros.ros.worker import Worker

ADDRESS = "127.0.0.1"
"""The only address that is served: the protocol has no token, and sends everything to whoever asks."""

_SHOWN = [kind for kind in TOPICS if kind not in (Inquiry, Settled)]
_TYPED = (
    ("peak_force", WrenchStamped, qos.PLOT),
    ("criteria", DiagnosticArray, qos.PLOT),
    (diagnostics.TOPIC, DiagnosticArray, qos.DIAGNOSTICS),
    (point_cloud.TOPIC, PointCloud2, qos.BEST_EFFORT),
)
_WAITING = 256  # messages for one client; of more, the oldest are left out

_Job = tuple[foxglove.Channel, type[Message] | None, SerializedMessage]


class FoxgloveNode(LifecycleNodeBase):
    """Takes messages in one worker thread; clients are served by threads of the SDK.

    Attributes:
        url: address that Foxglove connects to; only while configured.
    """

    kind = "foxglove_node"

    def _configure(self, values: dict[str, Any]) -> None:
        self.topics = self._resources.enter_context(ContractTopics(self, [], group=self.intake_group))
        self._newest: dict[str, tuple[foxglove.Channel, bytes, int]] = {}
        context = self._foxglove = foxglove.Context()  # channels close with it
        contract = {kind: self._contract_channel(kind, context) for kind in _SHOWN}
        typed = [self._typed_channel(topic, kind, context) for topic, kind, _ in _TYPED]
        try:
            server = foxglove.start_server(
                name="weld_force_ros", host=ADDRESS, port=values["port"], context=context,
                server_listener=_Listener(self._send_newest), message_backlog_size=_WAITING,
            )  # fmt: skip
        except RuntimeError as error:
            raise InputError(
                f"port {values['port']} for Foxglove cannot be used: {error}",
                "give another one with --foxglove-port (parameter port)",
            ) from None
        self._resources.callback(server.stop)
        self.url = f"ws://{ADDRESS}:{server.port}"
        self._worker: Worker[_Job] = Worker("foxglove", self._send, self.topics.report_problem, on_room=self.wake)
        self._resources.callback(self._worker.close, CLOSE_S)
        self.topics.diagnostics.queue_length = lambda: self._worker.pending
        self.topics.diagnostics.facts = lambda: {"Foxglove": self.url}
        self.topics.publish_diagnostics()
        for kind, channel in contract.items():
            self.topics.subscribe(kind, partial(self._queue, channel, kind))
        for (topic, message_type, profile), channel in zip(_TYPED, typed, strict=True):
            self.topics.subscribe_other(message_type, topic, profile, partial(self._queue, channel, None))
        layout = resources.files("weld_force_ros.data") / "foxglove" / "weld-force.json"
        self.get_logger().info(f"Foxglove: open connection {self.url}; a layout to import: {layout}")

    def _contract_channel(self, kind: type[Message], context: foxglove.Context) -> foxglove.Channel:
        schema = foxglove.Schema(
            name=f"weld_force_ros/{kind.__name__}",
            encoding="jsonschema",
            data=msgspec.json.encode(json_schema(kind)),
        )
        topic = self.resolve_topic_name(TOPICS[kind].name)
        return foxglove.Channel(topic, schema=schema, message_encoding="json", context=context)

    def _typed_channel(self, topic: str, message_type: type, context: foxglove.Context) -> foxglove.Channel:
        package, name = message_type.__module__.split(".")[0], message_type.__name__
        schema = foxglove.Schema(
            name=f"{package}/msg/{name}",
            encoding="ros2msg",
            data=definition_text(f"{package}/{name}").encode(),
        )
        return foxglove.Channel(self.resolve_topic_name(topic), schema=schema, message_encoding="cdr", context=context)

    def _queue(self, channel: foxglove.Channel, kind: type[Message] | None, serialized: SerializedMessage) -> None:
        self._worker.put((channel, kind, serialized))

    def _send(self, job: _Job) -> None:
        channel, kind, serialized = job
        data = serialized.cdr
        if kind is not None:
            incoming = self.topics.receive(kind, serialized)
            message = None if incoming.repeated else self.topics.decode_or_report(kind, incoming)
            if message is None:
                return
            data = encode(message)  # anew: panels trip over fields that the schema does not know
            if TOPICS[kind].latched:
                self._newest[channel.topic()] = (channel, data, serialized.received_ns)
        channel.log(data, log_time=serialized.received_ns)

    def _send_newest(self, topic: str) -> None:
        if found := self._newest.get(topic):
            channel, data, received_ns = found
            channel.log(data, log_time=received_ns)


class _Listener(ServerListener):
    """Calls back when a client subscribes to a topic."""

    def __init__(self, on_topic: Callable[[str], None]) -> None:
        self._on_topic = on_topic

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Send what a client that joins late would have missed."""
        self._on_topic(channel.topic)
