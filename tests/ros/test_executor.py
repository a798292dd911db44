"""One thread runs all callbacks: what others or a callback make possible is not missed, and no round is for nothing."""

import itertools
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from tests.harness.ros import DEADLINE_S, Outcomes, wait_until
from weld_force_ros.ros import qos
from weld_force_ros.ros.executor import OneThreadExecutor
from weld_force_ros.ros.worker import BackPressureGroup


class Spinning:
    """A node that an executor of some class runs, and how often the executor gathered what it can wait for."""

    def __init__(self, domain_id: int, kind: type[SingleThreadedExecutor] = OneThreadExecutor) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("node", context=self.context)
        self.rounds = rounds = itertools.count()

        class Counting(kind):  # type: ignore[misc]
            def get_nodes(self) -> list[Node]:
                next(rounds)
                return list(super().get_nodes())

        self.executor = Counting(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self.executor.spin()

    def echo(self, texts: int) -> int:
        """Publish to itself one text after the other; return in how many rounds they came."""
        heard = Outcomes()
        self.node.create_subscription(String, "echo", heard, qos.CONTRACT)
        publisher = self.node.create_publisher(String, "echo", qos.CONTRACT)
        publisher.publish(String(data="first"))
        heard.wait(1)
        before = next(self.rounds)
        for count in range(texts):
            publisher.publish(String(data=str(count)))
            heard.wait(2 + count)
            threading.Event().wait(0.05)  # until it waits again
        return next(self.rounds) - before

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join(DEADLINE_S)
        assert not self.thread.is_alive()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def spinning(domain_id: int) -> Iterator[Spinning]:
    made = Spinning(domain_id)
    yield made
    made.close()


@pytest.mark.parametrize(("kind", "least", "most"), [(OneThreadExecutor, 20, 22), (SingleThreadedExecutor, 30, 80)])
def test_a_message_takes_one_round_and_with_rclpys_executor_two(
    domain_id: int, kind: type[SingleThreadedExecutor], least: int, most: int
) -> None:
    made = Spinning(domain_id, kind)
    rounds = made.echo(20)
    made.close()
    assert least <= rounds <= most


def test_what_was_held_back_comes_when_another_thread_says_so(spinning: Spinning) -> None:
    is_open, heard = threading.Event(), Outcomes()
    group = BackPressureGroup(is_open.is_set)
    spinning.node.create_subscription(String, "held", heard, qos.CONTRACT, callback_group=group)
    publisher = spinning.node.create_publisher(String, "held", qos.CONTRACT)
    publisher.publish(String(data="a"))
    spinning.echo(3)
    assert not heard.messages
    is_open.set()
    spinning.executor.wake()
    heard.wait(1)


def test_what_a_callback_makes_or_lets_through_is_heard(spinning: Spinning) -> None:
    is_open, heard = threading.Event(), Outcomes()
    group = BackPressureGroup(is_open.is_set)
    spinning.node.create_subscription(String, "held", heard, qos.CONTRACT, callback_group=group)
    spinning.node.create_publisher(String, "held", qos.CONTRACT).publish(String(data="held"))
    spinning.node.create_publisher(String, "new", qos.CONTRACT).publish(String(data="new"))

    def make(_: Any) -> None:
        spinning.node.create_subscription(String, "new", heard, qos.CONTRACT)
        is_open.set()
        spinning.executor.wake()
        spinning.executor.create_task(heard, "task")

    spinning.node.create_subscription(String, "make", make, qos.CONTRACT)
    spinning.node.create_publisher(String, "make", qos.CONTRACT).publish(String(data=""))
    found = heard.wait(3)
    assert {each if isinstance(each, str) else each.data for each in found} == {"held", "new", "task"}


def test_a_task_of_another_thread_is_done_at_once(spinning: Spinning) -> None:
    done = Outcomes()
    spinning.echo(1)
    spinning.executor.create_task(done, "task")
    assert done.wait(1) == ["task"]


def test_it_ends_when_its_context_does(domain_id: int) -> None:
    made = Spinning(domain_id)
    made.echo(1)
    made.context.try_shutdown()
    wait_until(lambda: not made.thread.is_alive())
