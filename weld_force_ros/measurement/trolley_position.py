"""The position of a measuring trolley, from the newest samples of the rail."""

import numpy as np

from weld_force_ros.physics.arrays import FloatArray

_NEWEST_SAMPLES = 5  # their median is the position, so that a stray chainage does not move it


class TrolleyPosition:
    """Median chainage of the newest samples."""

    def __init__(self) -> None:
        self._newest_m: list[float] = []

    @property
    def chainage_m(self) -> float | None:
        """The trolley's chainage; None before anything was measured."""
        return sorted(self._newest_m)[len(self._newest_m) // 2] if self._newest_m else None

    def push(self, chainage_m: FloatArray, height_m: FloatArray) -> None:
        """Follow samples in the order measured, each (n,); those that are not numbers are left out."""
        usable = chainage_m[np.isfinite(chainage_m) & np.isfinite(height_m)]
        self._newest_m = [*self._newest_m, *usable[-_NEWEST_SAMPLES:].tolist()][-_NEWEST_SAMPLES:]

    def is_within(self, distance_m: float, chainage_m: float) -> bool:
        """Return whether the trolley is known to be within a distance of a chainage."""
        here_m = self.chainage_m
        return here_m is not None and abs(here_m - chainage_m) <= distance_m
