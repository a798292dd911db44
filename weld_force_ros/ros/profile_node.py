"""profile_node: measurement files in a watched folder -> weld_profile."""

import hashlib
import re
from pathlib import Path
from typing import Any

from msgspec import UNSET
from rclpy.node import Node

from weld_force_ros.columns import MAX_FILE_BYTES
from weld_force_ros.contract import Rejection, WeldProfile
from weld_force_ros.errors import InputError
from weld_force_ros.profiles import PlainForm, parse_profile
from weld_force_ros.ros import parameters
from weld_force_ros.ros.folder import FolderWatcher
from weld_force_ros.ros.messenger import Messenger

SUFFIXES = (".csv", ".txt")

_STATES_ITS_UNITS = re.compile(rb"^\s*#\s*(x_unit|z_unit|z_positive)\s*:", re.MULTILINE | re.IGNORECASE)


class ProfileNode(Node):
    """Publishes each file's content once, as a WeldProfile or a Rejection; a file that changed is measured anew.

    Files are read in the watcher's thread; what is in the folder at the start counts.

    Raises:
        InputError: a parameter that cannot be used.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("profile_node", **node_options)
        folder = _folder(parameters.text(self, "folder", "", "folder of measurement files (*.csv, *.txt)"))
        settle_s = parameters.number(
            self, "settle_s", 0.2, "s that a file must stay unchanged before it is read", low=0.0, high=600.0
        )
        self._form = _plain_form(self)
        self._published: set[tuple[str, str]] = set()
        self.messenger = Messenger(self, [WeldProfile, Rejection])
        self._watcher = FolderWatcher(folder, SUFFIXES, settle_s, self._take, self.messenger.complain)
        self.messenger.report_health(queue_length=lambda: self._watcher.waiting)
        self.get_logger().info(f"watching {folder}")
        self._watcher.start()

    @property
    def pending(self) -> int:
        """Nothing that was taken waits here: a file is published as soon as it is read."""
        return 0

    @property
    def watching(self) -> bool:
        """Whether files are still taken."""
        return self._watcher.running

    def stop_intake(self, timeout_s: float = 5.0) -> None:
        """Take no further files; the one in hand is published."""
        self._watcher.close(timeout_s)

    def close(self, timeout_s: float) -> int:
        """Stop; return how many accepted profiles were not published, which is none."""
        self.stop_intake(timeout_s)
        return 0

    def _take(self, path: Path) -> None:
        name = str(path.name).encode("utf-8", "replace").decode()
        try:
            with path.open("rb") as file:
                content = file.read(MAX_FILE_BYTES + 1)
        except FileNotFoundError:
            return
        except OSError as error:
            problem = InputError(
                f"cannot be read: {error.strerror or error}", "make the file readable and save it again"
            )
            self.messenger.reject(name, problem)
            return
        digest = hashlib.sha256(content).hexdigest()
        if (name, digest) not in self._published:
            self._published.add((name, digest))
            self._publish(name, content, digest)

    def _publish(self, name: str, content: bytes, digest: str) -> None:
        form = None if _STATES_ITS_UNITS.search(content) else self._form
        try:
            self.messenger.publish(parse_profile(content, name, form))
        except Exception as error:  # whatever is wrong with a file, it ends as a Rejection
            whole = len(content) <= MAX_FILE_BYTES
            text = content.decode("utf-8", "replace")
            self.messenger.reject(name, error, text, source_sha256=digest if whole else UNSET)


def _folder(text: str) -> Path:
    if not text:
        raise InputError("parameter folder is not set", "name the folder to watch, e.g. -p folder:=measurements")
    folder = Path(text).expanduser()
    if not folder.is_dir():
        raise InputError(f"folder {folder} does not exist", "create it, or name another one")
    return folder


def _plain_form(node: Node) -> PlainForm:
    """What files without a header do not say of themselves; an empty text and 0 mean: not stated."""
    unit = "of files that do not state it: m, cm, mm or um"
    x_unit = parameters.text(node, "x_unit", "", f"unit of the positions {unit}")
    z_unit = parameters.text(node, "z_unit", "", f"unit of the heights {unit}")
    z_positive = parameters.text(node, "z_positive", "", "up or down: what a positive height means in such files")
    spacing = parameters.number(
        node, "spacing", 0.0, "distance of samples in x_unit, for files of heights only", low=0.0, high=1e6
    )
    return PlainForm(
        x_unit=x_unit or None, z_unit=z_unit or None, z_positive=z_positive or None, spacing=spacing or None
    )
