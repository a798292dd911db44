"""A live trolley's rail surface and the welds marked or found on it -> measurement files in a watched folder.

The folder is the buffer: a weld that was captured is a file like any other. A weld that was marked ends in one file or
one refusal:

- It is captured once the trolley has left its window, so that the last pass counts as long as the trolley is over it.
- A gap in its window may be mended by going over the place again: it is refused once the trolley is `GIVEN_UP_M` away.
- Rail that was never measured is waited for, up to a time. This time begins anew after a restart: marks that wait are
  kept in a hidden file of the folder, the rail measured so far is not.
- Marks nearer to each other than `SAME_M`, or than `APART_M` if one of them was found and not marked, are one weld.
  What was captured is remembered until the trolley is farther from it than rail is kept; then it is measured anew.

A running trolley is assumed to move towards higher chainages where welds are looked for: the other way, what is found
near the limit of what stands out may differ from what is found in the whole run.
"""

import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import ArrayLike

from weld_force_ros._files import new_file
from weld_force_ros.errors import InputError, ProfileError
from weld_force_ros.measurement.profile_file import write_profile
from weld_force_ros.measurement.rail_stream import KEPT_M, LARGEST_GAP_M, Missing, RailStream, Window
from weld_force_ros.measurement.shapes import STRAIGHTEDGE_LENGTH_M
from weld_force_ros.measurement.weld_detection import APART_M, SETTLED_M, detect
from weld_force_ros.messages import RailSurface, WeldMarker, WeldProfile, profile_problem, profile_sha256
from weld_force_ros.physics.arrays import FloatArray

GIVEN_UP_M = 10.0
SAME_M = 0.1
MOST_WAITING = 100
TIMEOUT_S = 600.0

_LENGTH_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_HALF_M = STRAIGHTEDGE_LENGTH_M / 2
_LEFT_M = _HALF_M + LARGEST_GAP_M  # from a mark: samples out of order are in by then
_LOOK_EVERY_M = 0.05
_DETECT_EVERY_M = 1.0
_AT_ONCE = 200  # samples of a batch, after which marks are looked at: a whole batch may be longer than what is kept
_STRAY = 5  # samples whose middle one tells where the trolley is, so that a stray one does not
_MOST_REMEMBERED = 1000
_MAX_BYTES = 1_000_000
_DECIMALS = 12  # of metres
_LONGEST_NAME, _LONGEST_RAIL, _LONGEST_IN_FILE_NAMES = 200, 100, 40

_FileName = Annotated[str, msgspec.Meta(pattern=r"^\w[\w.-]*\.csv$")]


class _Mark(msgspec.Struct, frozen=True):
    file: _FileName
    chainage_m: float
    weld_id: str
    line_speed_kmh: float | UnsetType = UNSET
    weld_position_m: float | UnsetType = UNSET
    found: bool = False
    captured: bool = False


class _Kept(msgspec.Struct):
    """What outlives a restart: marks without outcome, and those with one whose rail may still be run over."""

    waiting: list[_Mark] = []
    ended: list[_Mark] = []


class LiveRail:
    """Takes samples and marks, writes files. To be used from one thread.

    Args:
        folder: where measurement files go.
        rail: its name, if known; part of file names and default weld names.
        detect: whether to look for welds that nobody marked.
        marker_offset_m: from where is measured to what is marked as being here, towards higher chainages.
        mark_timeout_s: how long a marked weld may wait for its rail.
        refuse: told once of each marked weld that cannot be captured: the name of the file that does not come, why,
            and the mark as JSON.
        announce: told in one line what an operator should know.
        clock: seconds, steady.
    """

    def __init__(
        self,
        folder: Path,
        *,
        rail: str | None = None,
        detect: bool = False,
        marker_offset_m: float = 0.0,
        mark_timeout_s: float = TIMEOUT_S,
        refuse: Callable[[str, InputError, str], object],
        announce: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._folder = folder
        self._rail = _printable(rail or "")[:_LONGEST_RAIL]
        self._detect = detect
        self._marker_offset_m = marker_offset_m
        self._mark_timeout_s = mark_timeout_s
        self._refuse = refuse
        self._announce = announce
        self._clock = clock
        self._stream = RailStream()
        self._recent_m: list[float] = []
        self._looked_m = self._detected_m = np.inf
        self._deadline_s: dict[str, float] = {}
        self._told: dict[str, str] = {}
        self._outdated = False
        self.captured = 0
        self._prefix = f"{_in_file_names(self._rail)}-" if self._rail else ""
        self._memory = folder / f".{self._prefix}weld-marks.json"
        self._kept = self._restored()

    @property
    def position_m(self) -> float | None:
        """Where the trolley is; None before anything was measured."""
        return sorted(self._recent_m)[len(self._recent_m) // 2] if self._recent_m else None

    @property
    def waiting(self) -> int:
        """How many marked welds have neither file nor refusal yet."""
        return len(self._kept.waiting)

    @property
    def unusable(self) -> int:
        """How many samples were no numbers."""
        return self._stream.unusable

    def take(self, surface: RailSurface) -> None:
        """Take a batch of samples."""
        upwards = 1.0 if surface.height_positive == "up" else -1.0
        self.take_samples(
            _LENGTH_M[surface.chainage_unit] * np.asarray(surface.chainage),
            upwards * _LENGTH_M[surface.height_unit] * np.asarray(surface.height),
        )

    def take_samples(self, chainage_m: ArrayLike, height_m: ArrayLike) -> None:
        """Take samples in the order measured, each (n,), heights positive up; what is no number is left out.

        Raises:
            InputError: shapes that differ or are not (n,); nothing of the batch was taken.
        """
        chainages, heights = np.asarray(chainage_m, dtype=np.float64), np.asarray(height_m, dtype=np.float64)
        if chainages.ndim != 1 or chainages.shape != heights.shape:
            self._stream.push(chainages, heights)  # says what is wrong
        for begin in range(0, len(chainages), _AT_ONCE):
            part = slice(begin, begin + _AT_ONCE)
            self._take_part(chainages[part], heights[part])

    def mark(self, marker: WeldMarker | None = None) -> str:
        """Note a weld, where the marker says or else where the trolley is.

        Returns:
            What was noted and when its profile comes, in words.

        Raises:
            InputError: nothing can come of it; it was not noted.
        """
        marker = marker or WeldMarker()
        chainage_m = self._marked_m(marker)
        known = self._same(chainage_m)
        if known is not None and not (known.found and known in self._kept.waiting):
            return f"the weld at {known.chainage_m:.3f} m is {self._state(known)}; it is not measured twice"
        self._check_reachable(chainage_m)
        if known is None and self.waiting >= MOST_WAITING:
            raise InputError(f"{self.waiting} welds wait for their rail", "go over them, or wait for their time to end")
        mark = self._new_mark(chainage_m, marker)
        self._note(mark, instead_of=known)
        self.look()
        return f"weld {mark.weld_id} at {chainage_m:.3f} m is {self._state(mark)}"

    def look(self) -> None:
        """Refuse what has waited for too long; to be called once in a while, as a trolley may stand."""
        if self._outdated:
            self._remember_soon()
        for mark in list(self._kept.waiting):
            self._look_at(mark)

    def finish(self) -> None:
        """Capture what is complete although the trolley is still over it; the other marks wait for the next start."""
        for mark in list(self._kept.waiting):
            window = self._stream.window(mark.chainage_m)
            if isinstance(window, Window):
                self._capture(mark, window)

    def _take_part(self, chainage_m: FloatArray, height_m: FloatArray) -> None:
        self._stream.push(chainage_m, height_m)
        usable = chainage_m[np.isfinite(chainage_m) & np.isfinite(height_m)]
        self._recent_m = [*self._recent_m, *usable[-_STRAY:].tolist()][-_STRAY:]
        position_m = self.position_m
        if position_m is None:
            return
        if not abs(position_m - self._looked_m) < _LOOK_EVERY_M:
            self._looked_m = position_m
            self._forget()
            self.look()
        if self._detect and not abs(position_m - self._detected_m) < _DETECT_EVERY_M:
            self._detected_m = position_m
            self._find(position_m)

    def _marked_m(self, marker: WeldMarker) -> float:
        if isinstance(marker.chainage_m, float):
            return marker.chainage_m
        if self.position_m is None:
            raise InputError("nothing was measured yet", "start the trolley, then mark the weld where it is")
        return self.position_m + self._marker_offset_m

    def _check_reachable(self, chainage_m: float) -> None:
        window = self._stream.window(chainage_m)
        if isinstance(window, Missing) and self._lost(window, chainage_m):
            raise InputError(
                f"no weld can be measured at {chainage_m:.3f} m: {window.reason}",
                "take the trolley over the place again, then mark it",
            )

    def _lost(self, missing: Missing, chainage_m: float) -> bool:
        return not missing.awaited and not self._within(GIVEN_UP_M, chainage_m)

    def _within(self, distance_m: float, chainage_m: float) -> bool:
        return self.position_m is not None and abs(self.position_m - chainage_m) <= distance_m

    def _same(self, chainage_m: float) -> _Mark | None:
        """The weld that is already known at a place; one that was refused may be marked again."""
        for mark in (*self._kept.waiting, *(ended for ended in self._kept.ended if ended.captured)):
            if abs(mark.chainage_m - chainage_m) <= (APART_M if mark.found else SAME_M):
                return mark
        return None

    def _find(self, position_m: float) -> None:
        for section in self._stream.sections():
            for weld in detect(section.chainage_m, section.height_m):
                known = (*self._kept.waiting, *self._kept.ended)
                is_new = all(abs(mark.chainage_m - weld.centre_m) > APART_M for mark in known)
                settled = abs(weld.centre_m - position_m) > SETTLED_M
                if is_new and settled and self.waiting < MOST_WAITING:
                    self._note_found(round(weld.centre_m, 3))

    def _note_found(self, chainage_m: float) -> None:
        mark = self._new_mark(chainage_m, WeldMarker(), found=True)
        try:
            self._note(mark)
        except InputError as error:  # it is found again farther on, as long as its rail is kept
            self._tell(mark, str(error))
            return
        self._announce(f"weld found at {chainage_m:.3f} m")
        self.look()

    def _new_mark(self, chainage_m: float, marker: WeldMarker, found: bool = False) -> _Mark:
        place = f"km{chainage_m / 1e3:.6f}"
        name = _printable(marker.weld_id) if isinstance(marker.weld_id, str) else ""
        return _Mark(
            self._free_file(f"{self._prefix}{place}"),
            chainage_m,
            name or _printable(f"{self._rail}-{place}" if self._rail else place),
            marker.line_speed_kmh,
            marker.weld_position_m,
            found,
        )

    def _free_file(self, stem: str) -> str:
        stem = f"{stem}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        taken = {mark.file for mark in (*self._kept.waiting, *self._kept.ended)}
        number = 1
        while (file := f"{stem}{f'-{number}' if number > 1 else ''}.csv") in taken or (self._folder / file).exists():
            number += 1
        return file

    def _note(self, mark: _Mark, instead_of: _Mark | None = None) -> None:
        before = self._kept
        waiting = [other for other in before.waiting if other is not instead_of]
        self._kept = _Kept([*waiting, mark], before.ended)
        try:
            self._remember()
        except OSError as error:
            self._kept = before
            raise InputError(
                f"the weld at {mark.chainage_m:.3f} m cannot be kept in {self._folder}: {error.strerror or error}",
                "free space or make the folder writable, then mark it again",
            ) from None
        self._deadline_s[mark.file] = self._clock() + self._mark_timeout_s
        if instead_of is not None:
            self._deadline_s.pop(instead_of.file, None)

    def _look_at(self, mark: _Mark) -> None:
        overdue = self._clock() >= self._deadline_s[mark.file]
        if self._within(_LEFT_M, mark.chainage_m) and not overdue:
            return
        window = self._stream.window(mark.chainage_m)
        if isinstance(window, Window):
            self._capture(mark, window, overdue)
        elif overdue:
            self._give_up(mark, f"its rail was not measured within {self._mark_timeout_s:g} s: {window.reason}")
        elif self._lost(window, mark.chainage_m):
            self._give_up(mark, window.reason)
        elif not window.awaited:
            self._tell(mark, f"{window.reason}; go over it again: it is refused at {GIVEN_UP_M:g} m from here")

    def _capture(self, mark: _Mark, window: Window, overdue: bool = False) -> None:
        profile = self._profile(mark, window)
        if problem := profile_problem(profile.x_m, profile.z_m):
            self._give_up(mark, problem)
            return
        try:
            _write(profile, self._folder / mark.file)
        except (ProfileError, OSError) as error:
            self._tell(mark, f"cannot be written: {error}; trying again")
            if overdue:
                self._give_up(mark, f"cannot be written: {error}")
            return
        self.captured += 1
        self._end(msgspec.structs.replace(mark, captured=True))
        self._announce(f"weld {mark.weld_id} at {mark.chainage_m:.3f} m is captured in {mark.file}")

    def _profile(self, mark: _Mark, window: Window) -> WeldProfile:
        x_m, z_m = (np.round(values, _DECIMALS) + 0.0 for values in (window.x_m, window.z_m))
        return WeldProfile(
            weld_id=mark.weld_id,
            source=mark.file,
            x_m=x_m.tolist(),
            z_m=z_m.tolist(),
            profile_sha256=profile_sha256(x_m.tolist(), z_m.tolist()),
            rail=self._rail or UNSET,
            chainage_m=round(mark.chainage_m, 6),
            line_speed_kmh=mark.line_speed_kmh,
            weld_position_m=mark.weld_position_m,
            conditioning=[*window.conditioning, "weld found in the rail" if mark.found else "weld marked"],
        )

    def _give_up(self, mark: _Mark, reason: str) -> None:
        error = InputError(
            f"weld {mark.weld_id} at {mark.chainage_m:.3f} m: {reason}",
            "take the trolley over the whole metre about it without a gap, and mark it there",
        )
        # Said before it is noted: said again after a kill in between, it is known by the same source and text.
        self._refuse(mark.file, error, msgspec.json.encode(mark).decode())
        self._end(mark)

    def _end(self, mark: _Mark) -> None:
        waiting = [other for other in self._kept.waiting if other.file != mark.file]
        self._kept = _Kept(waiting, [*self._kept.ended, mark][-_MOST_REMEMBERED:])
        self._deadline_s.pop(mark.file, None)
        self._told.pop(mark.file, None)
        self._remember_soon()

    def _forget(self) -> None:
        """Drop what lies where no rail is kept any more."""
        self._kept.ended = [mark for mark in self._kept.ended if self._within(KEPT_M + APART_M, mark.chainage_m)]

    def _state(self, mark: _Mark) -> str:
        if any(waiting.file == mark.file for waiting in self._kept.waiting):
            first_m, last_m = mark.chainage_m - _HALF_M, mark.chainage_m + _HALF_M
            return f"marked, its profile follows when the rail from {first_m:.3f} to {last_m:.3f} m is measured"
        captured = any(ended.captured and ended.file == mark.file for ended in self._kept.ended)
        return f"captured in {mark.file}" if captured else "refused"

    def _tell(self, mark: _Mark, problem: str) -> None:
        if self._told.get(mark.file) != problem:
            self._told[mark.file] = problem
            self._announce(f"weld {mark.weld_id} at {mark.chainage_m:.3f} m: {problem}")

    def _restored(self) -> _Kept:
        try:
            with self._memory.open("rb") as file:
                kept = msgspec.json.decode(file.read(_MAX_BYTES), type=_Kept)
        except FileNotFoundError:
            return _Kept()
        except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
            self._announce(f"{self._memory}: {error}; mark the welds again whose file did not come")
            return _Kept()
        # Killed after it had written a file, and before it had noted so.
        written = [mark for mark in kept.waiting if (self._folder / mark.file).exists()]
        waiting = [mark for mark in kept.waiting if mark not in written]
        for mark in waiting:
            self._deadline_s[mark.file] = self._clock() + self._mark_timeout_s
            self._announce(f"weld {mark.weld_id} at {mark.chainage_m:.3f} m, marked before the restart, is waited for")
        return _Kept(waiting, kept.ended + [msgspec.structs.replace(mark, captured=True) for mark in written])

    def _remember_soon(self) -> None:
        """Note the marks; where that cannot be, with the next look: an outdated note does no harm."""
        try:
            self._remember()
        except OSError as error:
            if not self._outdated:
                self._announce(f"{self._memory}: {error.strerror or error}; free space or make the folder writable")
            self._outdated = True

    def _remember(self) -> None:
        with new_file(self._memory) as file:  # it forces the folder to the disk, captured files included
            file.write(msgspec.json.encode(self._kept))
        self._outdated = False


def _write(profile: WeldProfile, path: Path) -> None:
    """A file that appears whole or not at all, and replaces none."""
    part = path.with_name(f".{path.name}.part")
    try:
        write_profile(profile, part)
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        if path.exists():
            raise ProfileError(f"{path} exists", "keep one rail a folder, or name the rails")
        part.rename(path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else " " for character in text).strip()[:_LONGEST_NAME].strip()


def _in_file_names(text: str) -> str:
    return re.sub(r"[^\w.-]+", "-", text).strip(".-")[:_LONGEST_IN_FILE_NAMES]
