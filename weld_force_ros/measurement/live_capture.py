"""A live trolley's rail surface and the welds marked or detected on it -> measurement files in a watched folder.

A weld that was marked ends in one file or one rejection:

- It is captured once the trolley has left its window, so that the last pass counts as long as the trolley is over it.
- A gap in its window may be mended by measuring the place again: it is rejected once the trolley is `GIVEN_UP_M` away.
- Rail that was never measured is waited for, up to a time. This time begins anew after a restart: marks that wait are
  kept in a hidden file of the folder, the rail measured so far is not.
- Marks nearer to each other than `SAME_M`, or than `APART_M` if one of them was detected and not marked, are one weld.
  A captured weld is remembered until the trolley is farther from it than rail is kept; then it is measured anew.

A running trolley is assumed to move towards higher chainages where welds are detected: the other way, what is found
near the limit of what stands out may differ from what is found in the whole run.
"""

import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError, ProfileError
from weld_force_ros.measurement.capture_folder import CaptureFolder
from weld_force_ros.measurement.rail_stream import KEPT_M, LARGEST_GAP_M, Missing, RailStream, Window
from weld_force_ros.measurement.shapes import STRAIGHTEDGE_LENGTH_M
from weld_force_ros.measurement.trolley_position import TrolleyPosition
from weld_force_ros.measurement.weld_detection import APART_M, SETTLED_M, detect
from weld_force_ros.measurement.weld_marks import TIMEOUT_S, WeldMark, WeldMarks
from weld_force_ros.messages import RailSurface, Running, WeldMarker, profile_problem

GIVEN_UP_M = 10.0
MOST_WAITING = 100

_LENGTH_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_HALF_M = STRAIGHTEDGE_LENGTH_M / 2
_LEFT_M = _HALF_M + LARGEST_GAP_M  # from a mark: samples out of order are in by then
_CHECK_EVERY_M = 0.05
_DETECT_EVERY_M = 1.0
_SAMPLES_AT_ONCE = 200  # after which marks are checked: a whole batch may be longer than the rail that is kept


class LiveCapture:
    """Takes samples of the rail and marks of welds, writes measurement files. To be used from one thread.

    Args:
        folder: where measurement files go.
        rail: its name, if known; part of file names and default weld names.
        detect: whether to look for welds that nobody marked.
        running: how trains run where the stream does not say it: `with` (towards rising chainage), `against` or `both`;
            unset if that is not known.
        marker_offset_m: from the measured place to the place that is marked as being here, towards higher chainages.
        mark_timeout_s: how long a marked weld may wait for its rail.
        reject: called once for each marked weld that cannot be captured, with the name of the file that does not come,
            the reason, and the mark as JSON.
        announce: receives a line for the operator.
        clock: seconds, steady.
    """

    def __init__(
        self,
        folder: Path,
        *,
        rail: str | None = None,
        detect: bool = False,
        running: Running | UnsetType = UNSET,
        marker_offset_m: float = 0.0,
        mark_timeout_s: float = TIMEOUT_S,
        reject: Callable[[str, InputError, str], object],
        announce: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._detect = detect
        self._running = running
        self._marker_offset_m = marker_offset_m
        self._mark_timeout_s = mark_timeout_s
        self._reject = reject
        self._announce = announce
        self._stream = RailStream()
        self._position = TrolleyPosition()
        self._folder = CaptureFolder(folder, rail)
        self._marks = WeldMarks(self._folder.marks_file, mark_timeout_s, announce, clock)
        self._checked_at_m = self._detected_at_m = np.inf
        self._announced: dict[str, str] = {}
        self.captured = 0

    @property
    def position_m(self) -> float | None:
        """Chainage of the trolley; None before anything was measured."""
        return self._position.chainage_m

    @property
    def waiting(self) -> int:
        """Number of marked welds that have neither file nor rejection yet."""
        return len(self._marks.waiting)

    @property
    def unusable(self) -> int:
        """Number of samples that were not numbers."""
        return self._stream.unusable

    def push(self, surface: RailSurface) -> None:
        """Take a message of samples."""
        if not isinstance(surface.running, UnsetType):
            self._running = surface.running
        upwards = 1.0 if surface.height_positive == "up" else -1.0
        self.push_samples(
            _LENGTH_M[surface.chainage_unit] * np.asarray(surface.chainage),
            upwards * _LENGTH_M[surface.height_unit] * np.asarray(surface.height),
        )

    def push_samples(self, chainage_m: ArrayLike, height_m: ArrayLike) -> None:
        """Take samples in the order measured, each (n,), heights positive up; those that are not numbers are left out.

        Raises:
            InputError: shapes that differ or are not (n,); no sample was taken.
        """
        chainages, heights = np.asarray(chainage_m, dtype=np.float64), np.asarray(height_m, dtype=np.float64)
        if chainages.ndim != 1 or chainages.shape != heights.shape:
            self._stream.push(chainages, heights)  # says what is wrong
        for begin in range(0, len(chainages), _SAMPLES_AT_ONCE):
            part = slice(begin, begin + _SAMPLES_AT_ONCE)
            self._stream.push(chainages[part], heights[part])
            self._position.push(chainages[part], heights[part])
            self._check_after_move()

    def mark(self, marker: WeldMarker | None = None) -> str:
        """Mark a weld, where the marker says or else where the trolley is.

        Returns:
            The mark and when its profile comes, in words.

        Raises:
            InputError: nothing can come of it; it was not accepted.
        """
        marker = marker or WeldMarker()
        chainage_m = self._marked_m(marker)
        known = self._marks.at(chainage_m)
        if known is not None and not (known.found and self._marks.is_waiting(known)):
            return f"the weld at {known.chainage_m:.3f} m is {self._outcome(known)}; it is not measured twice"
        window = self._stream.window(chainage_m)
        if isinstance(window, Missing) and self._is_lost(window, chainage_m):
            raise InputError(
                f"no weld can be measured at {chainage_m:.3f} m: {window.reason}",
                "take the trolley over the place again, then mark it",
            )
        if known is None and self.waiting >= MOST_WAITING:
            raise InputError(f"{self.waiting} welds wait for their rail", "go over them, or wait for their time to end")
        mark = self._folder.new_mark(chainage_m, marker, self._marks.all)
        self._marks.accept(mark, replaces=known)
        self.check_marks()
        return f"{mark} is {self._outcome(mark)}"

    def check_marks(self) -> None:
        """Capture or reject the marks that need not wait longer; to be called regularly, as a trolley may stand."""
        self._marks.retry_save()
        for mark in self._marks.waiting:
            self._check(mark)

    def finish(self) -> None:
        """Capture what is complete although the trolley is still over it; the other marks wait for the next start."""
        for mark in self._marks.waiting:
            window = self._stream.window(mark.chainage_m)
            if isinstance(window, Window):
                self._capture(mark, window)

    def _check_after_move(self) -> None:
        position_m = self.position_m
        if position_m is None:
            return
        if not abs(position_m - self._checked_at_m) < _CHECK_EVERY_M:
            self._checked_at_m = position_m
            self._marks.forget(lambda mark: not self._position.is_within(KEPT_M + APART_M, mark.chainage_m))
            self.check_marks()
        if self._detect and not abs(position_m - self._detected_at_m) < _DETECT_EVERY_M:
            self._detected_at_m = position_m
            self._mark_detected(position_m)

    def _marked_m(self, marker: WeldMarker) -> float:
        if isinstance(marker.chainage_m, float):
            return marker.chainage_m
        if self.position_m is None:
            raise InputError("nothing was measured yet", "start the trolley, then mark the weld where it is")
        return self.position_m + self._marker_offset_m

    def _is_lost(self, missing: Missing, chainage_m: float) -> bool:
        return not missing.awaited and not self._position.is_within(GIVEN_UP_M, chainage_m)

    def _mark_detected(self, position_m: float) -> None:
        for stretch in self._stream.stretches():
            for weld in detect(stretch.chainage_m, stretch.height_m):
                is_new = all(abs(mark.chainage_m - weld.centre_m) > APART_M for mark in self._marks.all)
                settled = abs(weld.centre_m - position_m) > SETTLED_M
                if is_new and settled and self.waiting < MOST_WAITING:
                    self._accept_detected(round(weld.centre_m, 3))

    def _accept_detected(self, chainage_m: float) -> None:
        mark = self._folder.new_mark(chainage_m, WeldMarker(), self._marks.all, found=True)
        try:
            self._marks.accept(mark)
        except InputError as error:  # it is detected again farther on, as long as its rail is kept
            self._announce_once(mark, str(error))
            return
        self._announce(f"weld found at {chainage_m:.3f} m")
        self.check_marks()

    def _check(self, mark: WeldMark) -> None:
        overdue = self._marks.is_overdue(mark)
        if self._position.is_within(_LEFT_M, mark.chainage_m) and not overdue:
            return
        window = self._stream.window(mark.chainage_m)
        if isinstance(window, Window):
            self._capture(mark, window, overdue)
        elif overdue:
            self._give_up(mark, f"its rail was not measured within {self._mark_timeout_s:g} s: {window.reason}")
        elif self._is_lost(window, mark.chainage_m):
            self._give_up(mark, window.reason)
        elif not window.awaited:
            self._announce_once(mark, f"{window.reason}; go over it again: it is refused at {GIVEN_UP_M:g} m from here")

    def _capture(self, mark: WeldMark, window: Window, overdue: bool = False) -> None:
        profile = self._folder.profile(mark, window, self._running)
        if problem := profile_problem(profile.x_m, profile.z_m):
            self._give_up(mark, problem)
            return
        try:
            self._folder.write(profile)
        except ProfileError as error:
            self._announce_once(mark, f"cannot be written: {error}; trying again")
            if overdue:
                self._give_up(mark, f"cannot be written: {error}")
            return
        self.captured += 1
        self._end(mark, captured=True)
        self._announce(f"{mark} is captured in {mark.file}")

    def _give_up(self, mark: WeldMark, reason: str) -> None:
        error = InputError(
            f"{mark}: {reason}", "take the trolley over the whole metre about it without a gap, and mark it there"
        )
        # Rejected before it is ended: rejected again after a kill in between, it is known by the same source and text.
        self._reject(mark.file, error, msgspec.json.encode(mark).decode())
        self._end(mark, captured=False)

    def _end(self, mark: WeldMark, *, captured: bool) -> None:
        self._marks.end(mark, captured=captured)
        self._announced.pop(mark.file, None)

    def _outcome(self, mark: WeldMark) -> str:
        if self._marks.is_waiting(mark):
            first_m, last_m = mark.chainage_m - _HALF_M, mark.chainage_m + _HALF_M
            return f"marked, its profile follows when the rail from {first_m:.3f} to {last_m:.3f} m is measured"
        return f"captured in {mark.file}" if self._marks.is_captured(mark) else "refused"

    def _announce_once(self, mark: WeldMark, problem: str) -> None:
        if self._announced.get(mark.file) != problem:
            self._announced[mark.file] = problem
            self._announce(f"{mark}: {problem}")
