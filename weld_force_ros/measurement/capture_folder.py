"""The folder of captured welds: how files and welds are named in it, and how a measurement file is written.

The folder is watched by the profile node: a weld that was captured is a file like any other.
"""

import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros._files import whole_file
from weld_force_ros.errors import ProfileError, os_errors_as
from weld_force_ros.measurement.profile_file import samples_csv
from weld_force_ros.measurement.rail_stream import Window
from weld_force_ros.measurement.weld_marks import WeldMark
from weld_force_ros.messages import Running, WeldMarker, WeldProfile

_DECIMALS = 12  # of metres
_LONGEST_NAME, _LONGEST_RAIL, _LONGEST_RAIL_IN_FILE_NAMES = 200, 100, 40


class CaptureFolder:
    """Names and writes the measurement files of one rail.

    Args:
        folder: where they go.
        rail: its name, if known; part of file names and default weld names.
    """

    def __init__(self, folder: Path, rail: str | None) -> None:
        self._folder = folder
        self._rail = _printable(rail or "")[:_LONGEST_RAIL]
        in_file_names = re.sub(r"[^\w.-]+", "-", self._rail).strip(".-")[:_LONGEST_RAIL_IN_FILE_NAMES]
        self._prefix = f"{in_file_names}-" if self._rail else ""

    @property
    def marks_file(self) -> Path:
        """The file of the rail's marks, hidden."""
        return self._folder / f".{self._prefix}weld-marks.json"

    def new_mark(
        self, chainage_m: float, marker: WeldMarker, others: Iterable[WeldMark], *, found: bool = False
    ) -> WeldMark:
        """Return a mark with a file name that neither the folder nor one of the other marks has.

        Args:
            chainage_m: of the weld.
            marker: what is known of the weld beside its chainage.
            others: marks whose file names are taken.
            found: the weld was detected, not marked.
        """
        place = f"km{chainage_m / 1e3:.6f}"
        stem = f"{self._prefix}{place}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        taken = {mark.file for mark in others}
        number, file = 1, f"{stem}.csv"
        while file in taken or (self._folder / file).exists():
            number += 1
            file = f"{stem}-{number}.csv"
        name = _printable(marker.weld_id) if isinstance(marker.weld_id, str) else ""
        return WeldMark(
            file,
            chainage_m,
            name or _printable(f"{self._rail}-{place}" if self._rail else place),
            marker.line_speed_kmh,
            marker.weld_position_m,
            found,
        )

    def profile(self, mark: WeldMark, window: Window, running: Running | UnsetType = UNSET) -> WeldProfile:
        """Return the profile of a marked weld; x rises with chainage, so that trains run along it as along the rail."""
        x_m, z_m = ((np.round(values, _DECIMALS) + 0.0).tolist() for values in (window.x_m, window.z_m))
        return WeldProfile(
            weld_id=mark.weld_id,
            source=mark.file,
            x_m=x_m,
            z_m=z_m,
            rail=self._rail or UNSET,
            chainage_m=round(mark.chainage_m, 6),
            chainage_direction="with",
            running=running,
            line_speed_kmh=mark.line_speed_kmh,
            weld_position_m=mark.weld_position_m,
            conditioning=[*window.conditioning, "weld found in the rail" if mark.found else "weld marked"],
        )

    def write(self, profile: WeldProfile) -> None:
        """Write the file of a profile, which appears whole or not at all and replaces none.

        Raises:
            ProfileError: the file exists or cannot be written.
        """
        path = self._folder / profile.source
        text = samples_csv(profile, noise="auto")
        if path.exists():
            raise ProfileError(f"{path} exists", "keep one rail a folder, or name the rails")
        with (
            os_errors_as(ProfileError, path, "give a path that can be written"),
            whole_file(path, fsync=True) as stream,
        ):
            stream.write(text.encode())


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else " " for character in text).strip()[:_LONGEST_NAME].strip()
