"""A recording of the nodes, read without ROS."""

import warnings
from functools import cached_property
from os import PathLike
from pathlib import Path

import pandas as pd
import xarray as xr

from weld_force_ros._files import write_whole
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.library import datasets, frames
from weld_force_ros.library.limits import Limits
from weld_force_ros.library.notebook import table
from weld_force_ros.library.profile import Profile
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.recording.weld_records import Record, WeldRecord, records_of_recording


class Recording:
    """What the nodes recorded: profiles, force maps, verdicts and rejections; of a file read twice, the last version.

    Args:
        path: the folder of a bag, or one of its files (.mcap); what is damaged is read as far as it goes, with a
            warning. SQLite bags (.db3) need the extra `foreign`.

    Raises:
        BagError: it cannot be read, or holds no message of this package.

    Examples:
        >>> import weld_force_ros as wf
        >>> recording = wf.Recording("bags/demo")
        >>> recording
        <Recording 'bags/demo': 8 welds, 8 verdicts, 0 rejections>
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)
        self._read = open_recording(self.path)
        if self._read.damage:
            warnings.warn(f"{self.path}: {self._read.damage}; reading what is there", stacklevel=2)
        for unreadable in self._read.unreadable:
            warnings.warn(f"{self.path}: left out: {unreadable}", stacklevel=2)

    @property
    def profiles(self) -> list[Profile]:
        """Return the measured welds, in the order they were recorded.

        Examples:
            >>> recording.profiles[0].weld_id
            'cosine-dip-48mm'
        """
        return [Profile.from_message(weld) for weld in self._read.profiles.values()]

    @property
    def verdicts(self) -> pd.DataFrame:
        """Return the verdicts, a row a weld: decision, reason, peak force, worst speed and position, and provenance.

        Examples:
            >>> recording.verdicts.set_index("weld_id").decision.value_counts().index.tolist()[0]
            'accept'
        """
        return frames.of("verdicts", [record.verdict for record in self._welds()])

    @property
    def criteria(self) -> pd.DataFrame:
        """Return every criterion of every verdict, with value, limit and source, a row each.

        Examples:
            >>> "margin" in recording.criteria
            True
        """
        return frames.of("criteria", [record.verdict for record in self._welds()])

    @property
    def rejections(self) -> pd.DataFrame:
        """Return the inputs that could not be used: source, reason and what to do about it, a row each.

        Examples:
            >>> recording.rejections.columns.tolist()[:3]
            ['source', 'reason', 'remedy']
        """
        return frames.of("rejections", [one.rejection for one in self._recorded if not isinstance(one, WeldRecord)])

    @property
    def maps(self) -> list[xr.Dataset]:
        """Return the force maps, as `Model.force_map` returns them, in the order they were recorded.

        Of several vehicles each has one; `vehicle` is in the attributes. Those of one grid are joined along the welds
        by `xarray.concat(recording.maps, "weld_id")`.

        Examples:
            >>> recording.maps[0].peak_force_n.dims
            ('speed_kmh', 'position_m', 'running')
        """
        settings = self._read.settings
        maps = [datasets.of_force_map(one, settings.get(one.config_sha256)) for one in self._read.force_maps]
        return [one.assign_coords(weld_id=one.attrs["weld_id"]) for one in maps]

    def report(self, path: str | PathLike[str], limits: Limits | str | None = None) -> Path:
        """Write one self-contained page (HTML) of the welds: what to do with each and why, as `weld-force report`.

        Args:
            path: of the page; its folder is made.
            limits: to judge every map anew by; recorded verdicts stay if not given.

        Returns:
            The path.

        Raises:
            InputError: the page cannot be written, or the extra `report` is not installed.

        Examples:
            >>> import tempfile
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     recording.report(f"{folder}/demo.html").stat().st_size > 100_000
            True
        """
        from weld_force_ros.report.html_page import page_of_records

        chosen = limits if isinstance(limits, Limits) or limits is None else Limits(limits)
        records = self._recorded if chosen is None else records_of_recording(self._read, chosen.message, load_limits())
        html = page_of_records(records, about=f"from {self.path.absolute().name}")
        target = Path(path)
        with os_errors_as(InputError, target, "name a file in a writable folder"):
            write_whole(target, html.encode())
        return target

    @cached_property
    def _recorded(self) -> list[Record]:
        return records_of_recording(self._read, None, load_limits())

    def _welds(self) -> list[WeldRecord]:
        return [record for record in self._recorded if isinstance(record, WeldRecord)]

    def __repr__(self) -> str:
        counts = {
            "weld": len(self._read.profiles),
            "verdict": len(self._welds()),
            "rejection": len(self.rejections),
        }
        words = ", ".join(f"{count} {word}{'s' * (count != 1)}" for word, count in counts.items())
        return f"<Recording {str(self.path)!r}: {words}>"

    def _repr_html_(self) -> str:
        decisions = self.verdicts.decision.value_counts()
        facts = {str(decision): int(count) for decision, count in decisions.items()}
        return table(f"Recording {self.path}", facts | {"rejected": len(self.rejections)})
