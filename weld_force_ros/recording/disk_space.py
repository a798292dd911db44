"""The room left on the disk of a recording, and the time until it is full at the rate the recording grows."""

import errno
import math
import shutil
import time
from contextlib import suppress
from pathlib import Path

NEARLY_FULL_BYTES = 512 * 10**6
NEARLY_FULL_S = 600.0
"""Thresholds of the warning: bytes free, and the time for which there is room at the present rate."""

DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
"""The operating system's error numbers for a full disk, and for a user's full share of it."""

_RATE_OVER_S = 60.0
_SHORTEST_RATE_S = 1.0


class DiskSpace:
    """The room on the disk of a folder, of which a reserve is left for what completes a recording."""

    def __init__(self, directory: Path, reserve_bytes: int) -> None:
        self.reserve_bytes = reserve_bytes
        self._directory = directory
        self._free_bytes = 0
        self._written = 0.0
        self._began_s = self._written_s = time.monotonic()

    @property
    def free_bytes(self) -> int:
        """Return how much the folder's disk has free for this user, or had when it could last be read."""
        with suppress(OSError):  # a folder that is gone is found by who writes to it
            self._free_bytes = shutil.disk_usage(self._directory).free
        return self._free_bytes

    @property
    def rate_bytes_per_s(self) -> float:
        """Return how fast the recording grew over about the last minute."""
        now_s = time.monotonic()
        weight_s = _RATE_OVER_S * -math.expm1(-max(now_s - self._began_s, _SHORTEST_RATE_S) / _RATE_OVER_S)
        return self._decayed(now_s) / weight_s

    @property
    def nearly_full(self) -> str | None:
        """Return a warning if the disk will be full soon, as a clause; None while there is room."""
        free_bytes, rate_bytes_per_s = self.free_bytes, self.rate_bytes_per_s
        if free_bytes >= max(NEARLY_FULL_BYTES, NEARLY_FULL_S * rate_bytes_per_s):
            return None
        clause = f"disk nearly full: {free_bytes / 1e6:.0f} MB free"
        left_min = max(0.0, (free_bytes - self.reserve_bytes) / rate_bytes_per_s / 60) if rate_bytes_per_s else math.inf
        return f"{clause}, about {left_min:.0f} min at this rate" if left_min < 24 * 60 else clause

    def wrote(self, count: int) -> None:
        """Count bytes by which the recording grew."""
        now_s = time.monotonic()
        self._written = self._decayed(now_s) + count
        self._written_s = now_s

    def has_room_for(self, count: int) -> bool:
        """Return whether this many bytes more would leave the reserve free."""
        return self.free_bytes - count >= self.reserve_bytes

    def _decayed(self, now_s: float) -> float:
        return self._written * math.exp(-(now_s - self._written_s) / _RATE_OVER_S)
