"""The contact force of a passage, split at 530 Hz into a low and a high part, and their features."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from weld_force_ros.physics.analysis.spectra import Bands, Spectrum
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History
from weld_force_ros.studies import passage_records


@dataclass(frozen=True)
class BandSplit:
    """A passage with its force in two parts, the static load in neither."""

    speed_kmh: float
    passage: History
    parts: Bands
    static_load_n: float

    @cached_property
    def low_n(self) -> FloatArray:
        """Return the dynamic force below the cut frequency, N, (n,)."""
        return np.asarray(self.parts.low_n - self.static_load_n)

    @cached_property
    def spectrum(self) -> Spectrum:
        """Return the spectrum of the whole force."""
        return passage_records.force_spectrum(self.passage, self.speed_kmh)

    @property
    def low_peak_m(self) -> float:
        """Return where the low part is largest."""
        return float(self.passage.x_m[np.argmax(self.low_n)])

    @property
    def high_peak_m(self) -> float:
        """Return where the high part is largest."""
        return float(self.passage.x_m[np.argmax(self.parts.high_n)])

    @property
    def high_share(self) -> float:
        """Return the largest magnitude of the high part divided by that of the low part."""
        return float(np.abs(self.parts.high_n).max() / np.abs(self.low_n).max())

    @property
    def at_peak_n(self) -> list[float]:
        """Return the low and the high part where the whole force is largest."""
        largest = np.argmax(self.passage.force_n)
        return [float(self.low_n[largest]), float(self.parts.high_n[largest])]

    @property
    def low_width_m(self) -> float:
        """Return the distance between the low part's zero crossings on either side of its maximum; NaN without two."""
        summit = int(np.argmax(self.low_n))
        below = np.flatnonzero(self.low_n <= 0)
        before, after = below[below < summit], below[below > summit]
        if not (len(before) and len(after)):
            return float("nan")
        return self._crossing_m(int(after[0]) - 1) - self._crossing_m(int(before[-1]))

    def _crossing_m(self, index: int) -> float:
        """Return where the low part crosses zero between a sample and the next."""
        x, low = self.passage.x_m, self.low_n
        return float(x[index] - low[index] * (x[index + 1] - x[index]) / (low[index + 1] - low[index]))
