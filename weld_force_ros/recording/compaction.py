"""Replace the files of a recording by compressed and indexed ones, one at a time in the background."""

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from weld_force_ros._files import sync_folder, whole_file
from weld_force_ros.errors import BagError
from weld_force_ros.recording.disk_space import DISK_FULL, DiskSpace
from weld_force_ros.recording.mcap_reader import McapFile
from weld_force_ros.recording.mcap_writer import write_mcap
from weld_force_ros.recording.metadata_file import MetadataFile
from weld_force_ros.recording.rosbag2_format import ChannelStatistics, FileForm

DAMAGED = ".cut"
"""The ending of the name of a damaged file, kept beside what was readable of it."""

KEPT = "its messages are kept: check the disk, then run `weld-force bag recover` on it"
"""The remedy where a recording could not be completed."""


class Compactor:
    """Replaces files in the background, so that at any moment a readable one is there.

    A file for which there is no room stays as it is until it is tried again.
    """

    def __init__(self, metadata_file: MetadataFile, space: DiskSpace, form: FileForm) -> None:
        self._metadata_file = metadata_file
        self._space = space
        self._form = form
        self._postponed: SimpleQueue[Path] = SimpleQueue()
        self._failures: SimpleQueue[BagError] = SimpleQueue()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="compaction")

    def submit(self, path: Path) -> None:
        """Replace a file that is no longer written to, when its turn comes."""
        self._pool.submit(self._try, path)

    def submit_postponed(self) -> None:
        """Try the files again for which there was no room."""
        for _ in range(self._postponed.qsize()):
            self.submit(self._postponed.get())

    def close(self) -> None:
        """Wait until the submitted files are replaced.

        Raises:
            BagError: a file could not be replaced, for another reason than a full disk; its messages are kept.
        """
        self._pool.shutdown(wait=True)
        if not self._failures.empty():
            raise self._failures.get()

    def _try(self, path: Path) -> None:
        try:
            if self._space.has_room_for(path.stat().st_size):
                self._metadata_file.put((path, _compacted(path, self._form)))
            else:
                self._postponed.put(path)
        except OSError as error:
            if error.errno in DISK_FULL:
                self._postponed.put(path)
            else:
                self._failures.put(BagError(f"{path}: {error.strerror or error}", KEPT))
        except BagError as error:
            self._failures.put(error)


def _compacted(path: Path, form: FileForm) -> ChannelStatistics:
    file = McapFile(path)
    file.scan()
    if file.lost_bytes:
        _keep_damaged(path, path.with_name(f"{path.name}{DAMAGED}"))
    if file.error:
        write_mcap(path, (), file.statistics, form)
    else:
        write_mcap(path, file.ordered(), file.statistics, form, file.extras())
    return file.statistics


def _keep_damaged(path: Path, copy: Path) -> None:
    if copy.exists():
        return
    try:
        os.link(path, copy)
        sync_folder(path.parent)
    except OSError:  # a file system without links
        with whole_file(copy, fsync=True) as target, path.open("rb") as source:
            shutil.copyfileobj(source, target)
