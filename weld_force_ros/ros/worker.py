"""Handle queued items on a thread of their own, and hold callbacks back while the queue is full."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

T = TypeVar("T")


class Worker(Generic[T]):
    """A thread that handles items one after the other, in the order they came; callbacks only append to its queue."""

    def __init__(
        self,
        name: str,
        handle: Callable[[T], None],
        report_problem: Callable[[Exception], None],
        prepare: Callable[[], bool] = lambda: True,
        *,
        limit: int = 64,
        on_room: Callable[[], None] = lambda: None,
    ) -> None:
        """Start the thread.

        Args:
            name: of the thread.
            handle: called with each item.
            report_problem: called with what `handle` raises; the next item is handled all the same.
            prepare: called once in the thread before the first item; if it returns False, the items stay unhandled.
            limit: how many items may wait before there is no more room.
            on_room: called in the thread when there is room again.
        """
        self._handle = handle
        self._report_problem = report_problem
        self._prepare = prepare
        self._limit = limit
        self._on_room = on_room
        self._items: deque[T] = deque()
        self._being_handled = 0
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def pending(self) -> int:
        """Return how many items wait or are being handled."""
        with self._changed:
            return len(self._items) + self._being_handled

    @property
    def has_room(self) -> bool:
        """Return whether callbacks may bring more; `put` itself refuses nothing."""
        return len(self._items) < self._limit

    def put(self, item: T, *, first: bool = False) -> None:
        """Append an item, or put it before all others; never waits."""
        with self._changed:
            (self._items.appendleft if first else self._items.append)(item)
            self._changed.notify()

    def close(self, timeout_s: float) -> int:
        """Stop after the item being handled, waiting for it so long; return how many items were not handled."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(timeout_s)
        return self.pending

    def _run(self) -> None:
        if not self._prepare():
            return
        while True:
            with self._changed:
                self._being_handled = 0
                self._changed.wait_for(lambda: self._items or self._closed)
                if self._closed:
                    return
                item = self._items.popleft()
                self._being_handled = 1
                room_again = len(self._items) == self._limit - 1
            if room_again:
                self._on_room()
            try:
                self._handle(item)
            except Exception as error:
                if not self._closed:  # an abandoned item finds its publishers gone
                    self._report_problem(error)


class BackPressureGroup(MutuallyExclusiveCallbackGroup):
    """A group of callbacks that are held back while there is no room: their messages wait in the middleware."""

    def __init__(self, is_open: Callable[[], bool]) -> None:
        super().__init__()
        self._is_open = is_open

    def can_execute(self, entity: object) -> bool:
        """Return whether the executor may take a message for `entity`."""
        return self._is_open() and super().can_execute(entity)
