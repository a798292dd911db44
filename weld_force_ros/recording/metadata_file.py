"""`metadata.yaml` of a recording that grows: its files, and what each holds."""

import threading
from pathlib import Path

from weld_force_ros.recording.mcap_writer import write_metadata
from weld_force_ros.recording.rosbag2_format import ChannelStatistics, FileForm


class MetadataFile:
    """The files of a recording in order; every change is written at once. Safe to use from several threads."""

    def __init__(self, directory: Path, form: FileForm) -> None:
        self._directory = directory
        self._form = form
        self._files: dict[str, ChannelStatistics] = {}
        self._lock = threading.Lock()

    def put(self, *files: tuple[Path, ChannelStatistics]) -> None:
        """Add files, or update what they hold.

        Raises:
            OSError: `metadata.yaml` cannot be written; the next change makes up for it.
        """
        with self._lock:
            for path, statistics in files:
                self._files[path.name] = ChannelStatistics(
                    dict(statistics.counts), statistics.first_ns, statistics.last_ns
                )
            write_metadata(self._directory, self._files, self._form)

    def drop(self, path: Path) -> None:
        """Remove a file; errors as `put`."""
        with self._lock:
            self._files.pop(path.name, None)
            write_metadata(self._directory, self._files, self._form)
