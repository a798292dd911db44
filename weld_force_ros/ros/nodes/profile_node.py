"""Node profile_node: measurement files in a watched folder, and a live trolley -> weld_profile."""

import hashlib
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET
from rclpy.clock import Clock, ClockType

from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.measurement.instruments import format_of
from weld_force_ros.measurement.profile_file import MeasurementFile
from weld_force_ros.measurement.text_file import MAX_FILE_BYTES
from weld_force_ros.messages import TOPICS, Inquiry, Rejection, Settled, WeldProfile, measurement_id
from weld_force_ros.ros.contract_topics import ContractTopics
from weld_force_ros.ros.lifecycle import CLOSE_S, LifecycleNodeBase
from weld_force_ros.ros.nodes.flow_control import FlowControl
from weld_force_ros.ros.nodes.folder_watcher import FolderWatcher
from weld_force_ros.ros.nodes.trolley_input import TrolleyInput

_STATEMENTS = ("format", "noise", "x_unit", "z_unit", "z_positive", "line_speed_kmh", "spacing", "skip_rows")


class ProfileNode(LifecycleNodeBase):
    """Publishes the welds of each file's content once, as WeldProfiles or a Rejection; a changed file is measured anew.

    A file that was refused is read again when the options of reading have changed.
    Files are read in the watcher's thread, which waits while many measurements are without an outcome: the folder is
    the buffer. What is in the folder at the start counts, unless the ledger knows its outcome. Welds of a live trolley
    are written to the folder as files.
    """

    kind = "profile_node"

    def _configure(self, values: dict[str, Any]) -> None:
        folder = _folder(values["folder"])
        self._form = format_of(**{name: values[name] for name in _STATEMENTS})
        self._complete: dict[Path, MeasurementFile] = {}
        self._stopping = threading.Event()
        self.topics = self._resources.enter_context(ContractTopics(self, [WeldProfile, Rejection, Inquiry]))
        settled_topic = self.resolve_topic_name(TOPICS[Settled].name)
        self._flow_control = FlowControl(self.topics, lambda: self.count_publishers(settled_topic), self._stopping)
        self.topics.subscribe(Settled, self._flow_control.take_settled)
        self._watcher = FolderWatcher(
            folder,
            values["settle_s"],
            values["unfinished_s"],
            self._is_complete,
            self._take,
            self.topics.report_problem,
        )
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

    def _is_complete(self, path: Path) -> bool:
        try:
            measured = MeasurementFile(_content(path), self._form)
        except OSError:
            return True  # the reason is given when it is read
        if measured.is_complete:
            self._complete[path] = measured  # taken next
        return measured.is_complete

    def _take(self, paths: Sequence[Path]) -> None:
        outcomes: dict[str, WeldProfile | Rejection] = {}
        for path in paths:
            if (read := self._read(path)) is not None:
                outcomes |= {str(outcome.profile_id): outcome for outcome in self._outcomes(*read)}
        self._complete.clear()
        wanted = self._flow_control.without_outcome(list(outcomes))
        for profile_id, outcome in outcomes.items():
            if profile_id in wanted and not self._stopping.is_set():
                self._publish(outcome)

    def _read(self, path: Path) -> tuple[str, MeasurementFile] | None:
        name = str(path.name).encode("utf-8", "replace").decode()
        try:
            measured, known = MeasurementFile(_content(path), self._form), self._complete.get(path)
            return name, known if known is not None and known.raw == measured.raw else measured
        except FileNotFoundError:
            return None
        except OSError as error:
            problem = InputError(
                f"cannot be read: {error.strerror or error}", "make the file readable and save it again"
            )
            self.topics.reject(name, problem)
            return None

    def _outcomes(self, name: str, measured: MeasurementFile) -> list[WeldProfile | Rejection]:
        """Return the welds of a file, or why there are none; each with the identity of its measurement."""
        content = measured.raw
        digest = hashlib.sha256(content).hexdigest()
        try:
            welds = [understood.profile for understood in measured.welds(name)]
        except Exception as error:  # whatever is wrong with a file, it ends as a Rejection
            text = content.decode("utf-8", "replace")
            whole = digest if len(content) <= MAX_FILE_BYTES else UNSET
            rejected = self.topics.rejection(
                name, error, text, source_sha256=whole, profile_id=measurement_id(name, self._refused(digest))
            )
            rejected.file_version_of = name[-200:]
            return [rejected]
        for count, weld in enumerate(welds):
            weld.profile_id = measurement_id(name if len(welds) == 1 else f"{name}#{count + 1}", digest)
            weld.file_version_of = name[-200:]
        return [*welds]

    def _refused(self, digest: str) -> str:
        """Return the identity of a content that was refused as it is read now: read otherwise, it is another try."""
        return hashlib.sha256(digest.encode() + msgspec.json.encode(self._form)).hexdigest()

    def _publish(self, outcome: WeldProfile | Rejection) -> None:
        try:
            self._flow_control.send(outcome)
        except MessageError as error:
            if isinstance(outcome, WeldProfile):
                self._flow_control.send(self.topics.rejection(outcome.source, error, "", profile_id=outcome.profile_id))


def _content(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MAX_FILE_BYTES + 1)


def _folder(text: str) -> Path:
    if not text:
        raise InputError("parameter folder is not set", "name the folder to watch, e.g. -p folder:=measurements")
    folder = Path(text).expanduser()
    if not folder.is_dir():
        raise InputError(f"folder {folder} does not exist", "create it, or name another one")
    return folder
