"""Take what publishers of other makers send, whatever quality of service they offer: each message once."""

from collections import OrderedDict
from collections.abc import Callable
from functools import partial

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from weld_force_ros.ros.qos import more_tolerant
from weld_force_ros.ros.serialized_messages import SerializedMessage, subscribe_raw

_REMEMBERED = 4096


class TolerantSubscription:
    """A subscription that is joined by less demanding ones where publishers need them.

    A publisher whose durability or reliability does not match delivers nothing, and `ros2 topic pub` and rclpy offer
    other than the suite asks for. What several of the subscriptions receive is handed over once.

    Args:
        node: the node.
        message_type: of the topic.
        topic: its name.
        profile: what is asked for first, and what is recorded as the topic's.
        take: called with each message in the executor's thread; must be quick.
        group: callback group of all of them.

    Attributes:
        subscriptions: those that there are now.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        profile: QoSProfile,
        take: Callable[[SerializedMessage], None],
        group: CallbackGroup | None = None,
    ) -> None:
        self._node = node
        self._topic = topic
        self._recorded_as = profile
        self._take = take
        self._subscribe_raw = partial(subscribe_raw, node, message_type, topic, take=self._take_once, group=group)
        self._taken: OrderedDict[tuple[int, int], None] = OrderedDict()
        self.subscriptions: list[Subscription] = []
        self._subscribe(profile)

    def destroy(self) -> None:
        """Withdraw all of them."""
        for subscription in self.subscriptions:
            self._node.destroy_subscription(subscription)

    def _subscribe(self, profile: QoSProfile) -> None:
        tolerant, count = more_tolerant(profile), len(self.subscriptions) + 1

        def accept_mismatch(_: object) -> None:
            if tolerant is not None and len(self.subscriptions) == count:
                self._accept(tolerant)

        events = SubscriptionEventCallbacks(incompatible_qos=accept_mismatch, use_default_callbacks=False)
        self.subscriptions.append(self._subscribe_raw(profile=profile, events=events))

    def _accept(self, tolerant: QoSProfile) -> None:
        self._subscribe(tolerant)
        if tolerant.reliability == ReliabilityPolicy.BEST_EFFORT:
            self._node.get_logger().warning(
                f"a publisher of {self._topic} sends with best effort: what is lost on the way is not sent again"
            )

    def _take_once(self, message: SerializedMessage) -> None:
        # The publisher's clock and count are those of the message, not of the subscription that received it.
        key = (message.sent_ns, message.number)
        if key in self._taken:
            return
        self._taken[key] = None
        if len(self._taken) > _REMEMBERED:
            self._taken.popitem(last=False)
        self._take(message._replace(qos=self._recorded_as, tolerated=message.qos != self._recorded_as))
