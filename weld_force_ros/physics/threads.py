"""How many threads compute."""

import os
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any


def thread_count(threads: int | None) -> int:
    """Return `threads`, or one a core if that is None."""
    return threads or os.cpu_count() or 1


def executor(threads: int | None) -> Executor:
    """Return an executor with `threads` workers, one a core if None; 1 works in the calling thread."""
    count = thread_count(threads)
    return ThreadPoolExecutor(count, thread_name_prefix="passages") if count > 1 else _CallingThread()


class _CallingThread(Executor):
    def submit(self, work: Callable[..., Any], /, *arguments: Any, **named: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(work(*arguments, **named))
        except Exception as error:  # for whoever asks for the result
            future.set_exception(error)
        return future
