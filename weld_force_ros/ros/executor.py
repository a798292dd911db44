"""Run the callbacks of nodes on one thread, without the rounds that rclpy's executors make for threads that wait."""

import threading

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition


class OneThreadExecutor(SingleThreadedExecutor):
    """Runs callbacks in the thread that spins, which does not wake itself.

    rclpy's executors wake themselves after each callback, as other threads of theirs may wait for what it held back.
    With one thread none does: awake, it makes a wait set of all entities for nothing, which takes longer than most
    callbacks. After the callbacks that are ready it looks again whether it was woken or not.
    """

    _guard: GuardCondition  # rclpy has no public name for what wakes an executor

    def __init__(self, *, context: Context) -> None:
        super().__init__(context=context)
        self._guard.destroy()
        self._guard = self._guard_for_others = _GuardForOthers(None, None, context=context)

    def spin(self) -> None:
        """Execute callbacks until shutdown."""
        self._guard_for_others.waiting_thread = threading.get_ident()
        super().spin()


class _GuardForOthers(GuardCondition):
    """A guard condition that the thread which waits for it does not trigger."""

    waiting_thread: int | None = None

    def trigger(self) -> None:
        if threading.get_ident() != self.waiting_thread:
            super().trigger()
