"""Record messages of every topic to a bag, and wait while the disk is full."""

import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from weld_force_ros.errors import BagError, DiskFullError
from weld_force_ros.recording import MessageDefinition, Recorder
from weld_force_ros.ros.serialized_messages import SerializedMessage
from weld_force_ros.ros.type_definitions import message_definition

_RETRY_S = 0.5
_MB = 1e6


class TopicRecorder:
    """A recorder that does not give up when the disk is full; a context manager.

    Args:
        bag: folder to record to; a recording there is continued; None: nothing is recorded.
        split_bytes: size at which a new file of the bag is begun.
        split_s: age at which a new file of the bag is begun.
        closing: set when waiting for room on the disk is to be given up.
        report_problem: called with what goes wrong.
        say: called with who is waited for before the recording begins.

    Attributes:
        disk_full: what to do about the full disk, while it is full; else None.

    Raises:
        BagError: the folder cannot be recorded to.
    """

    def __init__(
        self,
        bag: Path | None,
        *,
        split_bytes: int,
        split_s: float,
        closing: threading.Event,
        report_problem: Callable[[str], None],
        say: Callable[[str], None],
    ) -> None:
        self._recorder = Recorder(bag, split_bytes=split_bytes, split_s=split_s, say=say) if bag is not None else None
        self._closing = closing
        self._report_problem = report_problem
        self._definitions: dict[str, MessageDefinition] = {}
        self.disk_full: str | None = None

    def __enter__(self) -> Self:
        if self._recorder is not None:
            self._recorder.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the bag."""
        if self._recorder is not None:
            self._recorder.__exit__(kind, error, trace)

    @property
    def records(self) -> bool:
        """Return whether there is a bag."""
        return self._recorder is not None

    @property
    def warning(self) -> str | None:
        """Return what about the recording needs a person's attention now, or None."""
        if self._recorder is None:
            return "not recording: after a restart, outcomes may come a second time"
        return self._recorder.disk_warning

    def facts(self) -> dict[str, object]:
        """Return the state of the disk, for /diagnostics."""
        if self._recorder is None:
            return {}
        return {
            "disk free MB": f"{self._recorder.free_bytes / _MB:.0f}",
            "longest ms until on disk": f"{1e3 * self._recorder.longest_unsynced_s:.0f}",
        }

    def record(self, message: SerializedMessage, *, may_wait: bool = True) -> None:
        """Write a message to the bag.

        Args:
            message: the message.
            may_wait: whether to wait for room on a full disk; otherwise the message is not recorded.

        Raises:
            DiskFullError: there was no room until the node was closed.
        """
        if self._recorder is None:
            return
        if message.topic not in self._definitions:
            self._definitions[message.topic] = message_definition(message.message_type, message.qos)
        while True:
            try:
                self._recorder.write(
                    message.topic,
                    self._definitions[message.topic],
                    message.cdr,
                    log_time_ns=message.received_ns,
                    publish_time_ns=message.sent_ns,
                )
                self.disk_full = None
            except DiskFullError as error:
                if self.disk_full is None:
                    self._report_problem(f"{error}; until then nothing is judged, and nothing is lost")
                self.disk_full = str(error)
                if not may_wait:
                    return
                if self._closing.wait(_RETRY_S):
                    raise
                continue
            except BagError as error:  # a verdict that cannot be recorded is still worth publishing
                self._report_problem(f"not recorded: {error}")
            return
