"""One thread that works through a queue, so that callbacks only ever append to it."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Worker(Generic[T]):
    """Handles items one after the other, in the order they came, on a thread of its own."""

    def __init__(
        self,
        name: str,
        handle: Callable[[T], None],
        complain: Callable[[Exception], None],
        prepare: Callable[[], bool] = lambda: True,
    ) -> None:
        """Start the thread.

        Args:
            name: of the thread.
            handle: called with each item.
            complain: called with what `handle` raises; the next item is handled all the same.
            prepare: called once in the thread before the first item; if it returns False, the items stay unhandled.
        """
        self._handle = handle
        self._complain = complain
        self._prepare = prepare
        self._items: deque[T] = deque()
        self._in_hand = 0
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def pending(self) -> int:
        """Items waiting or in hand."""
        with self._changed:
            return len(self._items) + self._in_hand

    def put(self, item: T) -> None:
        """Append an item; never waits."""
        with self._changed:
            self._items.append(item)
            self._changed.notify()

    def close(self, timeout_s: float) -> int:
        """Stop after the item in hand, waiting for it so long; return how many items were not handled."""
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
                self._in_hand = 0
                self._changed.wait_for(lambda: self._items or self._closed)
                if self._closed:
                    return
                item = self._items.popleft()
                self._in_hand = 1
            try:
                self._handle(item)
            except Exception as error:
                if not self._closed:  # an abandoned item finds its publishers gone
                    self._complain(error)
