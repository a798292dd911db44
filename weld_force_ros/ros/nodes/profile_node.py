"""Node profile_node: measurement files in a watched folder, and a live trolley -> weld_profile."""

import hashlib
import re
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec import UNSET
from rclpy.clock import Clock, ClockType

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.profile_file import PlainForm, parse_profile
from weld_force_ros.measurement.text_columns import MAX_FILE_BYTES
from weld_force_ros.messages import TOPICS, Inquiry, Rejection, Settled, WeldProfile, measurement_id
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.flow_control import FlowControl
from weld_force_ros.ros.nodes.folder_watcher import FolderWatcher
from weld_force_ros.ros.nodes.trolley_input import TrolleyInput

SUFFIXES = (".csv", ".txt")

_STATES_ITS_UNITS = re.compile(rb"^\s*#\s*(x_unit|z_unit|z_positive)\s*:", re.MULTILINE | re.IGNORECASE)


class ProfileNode(LifecycleNodeBase):
    """Publishes each file's content once, as a WeldProfile or a Rejection; a file that changed is measured anew.

    Files are read in the watcher's thread, which waits while many measurements are without an outcome: the folder is
    the buffer. What is in the folder at the start counts, unless the ledger knows its outcome. Welds of a live trolley
    are written to the folder as files.
    """

    kind = "profile_node"

    def _configure(self, values: dict[str, Any]) -> None:
        folder = _folder(values["folder"])
        self._form = _plain_form(values)
        self._stopping = threading.Event()
        self.topics = self._resources.enter_context(ContractTopics(self, [WeldProfile, Rejection, Inquiry]))
        settled_topic = self.resolve_topic_name(TOPICS[Settled].name)
        self._flow_control = FlowControl(self.topics, lambda: self.count_publishers(settled_topic), self._stopping)
        self.topics.subscribe(Settled, self._flow_control.take_settled)
        self._watcher = FolderWatcher(folder, SUFFIXES, values["settle_s"], self._take, self.topics.report_problem)
        self._trolley = self._resources.enter_context(TrolleyInput(self, folder, self.topics, values))
        timer = self.create_timer(1.0, self._flow_control.ask_again, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._resources.callback(self.destroy_timer, timer)
        self.topics.diagnostics.queue_length = lambda: self._watcher.waiting
        self.topics.diagnostics.facts = self._facts
        self.topics.diagnostics.warning = self._warning
        self.topics.publish_diagnostics()
        self.get_logger().info(f"watching {folder}")

    def _activate(self) -> None:
        self._stopping.clear()
        self._watcher.start()
        super()._activate()

    def stop_intake(self) -> None:
        """Take no further files or samples."""
        if self._active:
            self._deactivate()

    def _deactivate(self) -> None:
        super()._deactivate()
        self._stopping.set()  # the file in hand is published if there is room for it
        self._watcher.close(CLOSE_S)

    @property
    def pending(self) -> int:
        """Return how many batches and marks of a live trolley wait; all else that was taken is kept by the folder."""
        return self._trolley.pending if self._configured else 0

    @property
    def watching(self) -> bool:
        """Return whether files are still taken."""
        return self._watcher.running

    def _facts(self) -> dict[str, object]:
        return {"measurements without outcome": self._flow_control.under_way, **self._trolley.facts()}

    def _warning(self) -> str | None:
        if not self._flow_control.full:
            return None
        return f"{self._flow_control.under_way} measurements wait for an outcome: are simulator and assessment running?"

    def _take(self, paths: Sequence[Path]) -> None:
        files = {}
        for path in paths:
            if (file := self._read(path)) is not None:
                files[file.profile_id] = file
        for profile_id in self._flow_control.without_outcome(list(files)):
            files[profile_id].wanted = True
        for file in files.values():
            if file.wanted and not self._stopping.is_set():
                self._publish(file)

    def _read(self, path: Path) -> "_File | None":
        name = str(path.name).encode("utf-8", "replace").decode()
        try:
            with path.open("rb") as file:
                return _File(name, file.read(MAX_FILE_BYTES + 1))
        except FileNotFoundError:
            return None
        except OSError as error:
            problem = InputError(
                f"cannot be read: {error.strerror or error}", "make the file readable and save it again"
            )
            self.topics.reject(name, problem)
            return None

    def _publish(self, file: "_File") -> None:
        form = None if _STATES_ITS_UNITS.search(file.content) else self._form
        try:
            profile = parse_profile(file.content, file.name, form)
            profile.profile_id = file.profile_id
            self._flow_control.send(profile)
        except Exception as error:  # whatever is wrong with a file, it ends as a Rejection
            whole = len(file.content) <= MAX_FILE_BYTES
            text = file.content.decode("utf-8", "replace")
            digest = file.sha256 if whole else UNSET
            self._flow_control.send(
                self.topics.rejection(file.name, error, text, source_sha256=digest, profile_id=file.profile_id)
            )


class _File:
    """A file as it was read; `wanted` if it has no outcome yet."""

    def __init__(self, name: str, content: bytes) -> None:
        self.name = name
        self.content = content
        self.sha256 = hashlib.sha256(content).hexdigest()
        self.profile_id = measurement_id(name, self.sha256)
        self.wanted = False


def _folder(text: str) -> Path:
    if not text:
        raise InputError("parameter folder is not set", "name the folder to watch, e.g. -p folder:=measurements")
    folder = Path(text).expanduser()
    if not folder.is_dir():
        raise InputError(f"folder {folder} does not exist", "create it, or name another one")
    return folder


def _plain_form(values: dict[str, Any]) -> PlainForm:
    """Return the form of files without a header; an empty text and 0 mean: not stated."""
    return PlainForm(
        x_unit=values["x_unit"] or None,
        z_unit=values["z_unit"] or None,
        z_positive=values["z_positive"] or None,
        spacing=values["spacing"] or None,
    )
