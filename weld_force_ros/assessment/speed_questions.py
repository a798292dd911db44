"""Say at which speeds a force-speed curve is still to be simulated for the advice on speed to be that of every km/h.

A curve is known exactly at some speeds and within bounds at the others. Each question that
`weld_force_ros.assessment.speed_advice` puts to it is open as long as curves within the bounds answer it differently:
which speeds are within limits, what restrictions come to, where maxima and local minima lie that are to be told.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.assessment.criteria import FORCE_CRITERIA
from weld_force_ros.assessment.limits import decides, within_limits
from weld_force_ros.assessment.speed_advice import lessened, restricted, runs
from weld_force_ros.messages import Limit
from weld_force_ros.physics.analysis.speed_curve import NEGLIGIBLE
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.curve_bounds import WorstBetween

_NEARLY = 0.9  # of what is told: what may turn out to be once it is known exactly


class SpeedQuestions:
    """The questions of advice on speed by some limits.

    Args:
        limits: those for force criteria that decide count.
        limits_sha256: their identity.
        error_share: as of `weld_force_ros.assessment.speed_advice.advise`.
    """

    def __init__(self, limits: Sequence[Limit], limits_sha256: str, error_share: float | None) -> None:
        self.limits_sha256 = limits_sha256
        self._limits = [limit for limit in limits if decides(limit) and limit.name in FORCE_CRITERIA]
        self._share = error_share or 0.0

    def open_speeds(self, speeds_kmh: FloatArray, worst: WorstBetween) -> Mapping[str, NDArray[np.bool_]]:
        """Return by column at which speeds (n_speed,) it is to be simulated; nothing where all is answered.

        Args:
            speeds_kmh: (n_speed,), increasing, up to the line's speed.
            worst: what is known at these speeds.
        """
        mildest, severest = worst.mildest.columns, worst.severest.columns
        asked = {name: np.zeros(len(speeds_kmh), dtype=np.bool_) for name in mildest}
        for name, rows in (*self._at_limits(speeds_kmh, worst), *self._clearly_beyond(speeds_kmh, worst)):
            if name in asked:
                asked[name][rows] = True
        low, high = mildest["peak_force_n"], severest["peak_force_n"]
        told_n = np.maximum(NEGLIGIBLE * (high.max() - low.min()), self._share * (high - worst.mildest.static_load_n))
        of_peaks = (_extremes(low, high), _maxima(low, high, told_n), _hollows(low, high, told_n))
        for asked_rows in (restricted(speeds_kmh), *of_peaks):
            asked["peak_force_n"][asked_rows] = True
        unknown = {name: mask & (mildest[name] != severest[name]) for name, mask in asked.items()}
        return {name: mask for name, mask in unknown.items() if mask.any()}

    def _at_limits(self, speeds_kmh: FloatArray, worst: WorstBetween) -> Iterator[tuple[str, NDArray[np.intp]]]:
        """Yield where a limit may be exceeded and may not."""
        for limit in self._limits:
            mild, severe = (within_limits(speeds_kmh, one, [limit]) for one in (worst.mildest, worst.severest))
            yield FORCE_CRITERIA[limit.name].column, np.flatnonzero(mild != severe)

    def _clearly_beyond(self, speeds_kmh: FloatArray, worst: WorstBetween) -> Iterator[tuple[str, NDArray[np.intp]]]:
        """Yield, of bands beyond limits that may reach beyond them clearly and may not, where they reach farthest."""
        if not self._share:
            return
        mild, severe = lessened(worst.mildest, self._share), lessened(worst.severest, self._share)
        clear = ~within_limits(speeds_kmh, mild, self._limits)
        for band in runs(~within_limits(speeds_kmh, worst.mildest, self._limits)):
            for limit in self._limits if not clear[band].any() else ():
                criterion, at_band = FORCE_CRITERIA[limit.name], severe.at(band)
                may_be, values = ~within_limits(speeds_kmh[band], at_band, [limit]), criterion.value(at_band)
                if values is not None and may_be.any():
                    farthest = band.start + int(np.where(may_be, values, -np.inf).argmax())
                    yield criterion.column, np.array([farthest])


def _extremes(low: FloatArray, high: FloatArray) -> list[int]:
    """Return where a curve between two is probably highest and lowest: what is negligible is relative to these."""
    return [int(high.argmax()), int(low.argmin())]


def _maxima(low: FloatArray, high: FloatArray, told_n: FloatArray) -> list[int]:
    """Return where the maxima are to be simulated, with their neighbours, that are told or may be.

    Args:
        low: (n,), the curve at least.
        high: (n,), at most.
        told_n: (n,), by how much a maximum stands above its surroundings to be told.
    """
    asked: list[int] = []
    tops = np.flatnonzero((high[1:-1] >= high[:-2]) & (high[1:-1] >= high[2:])) + 1
    told = tops[_standing_out(tops, low, high) >= _NEARLY * told_n[tops]]
    for top in told.tolist():
        if low[top] != high[top]:
            asked.append(top)
            continue
        asked += [top - 1, top + 1]
        before, after = low[:top][::-1], low[top + 1 :]
        at_least = min(_descent(low[top], high[:top][::-1]), _descent(low[top], high[top + 1 :]))
        if at_least < told_n[top] / _NEARLY:
            asked += [top - 1 - row for row in _doubts(high[top], before, high[:top][::-1])]
            asked += [top + 1 + row for row in _doubts(high[top], after, high[top + 1 :])]
    return asked


def _standing_out(tops: NDArray[np.intp], low: FloatArray, high: FloatArray) -> FloatArray:
    """Return by how much each of some tops can stand above its surroundings, (n_top,), as `_descent` of either side."""
    rows, at, top_n = np.arange(len(low)), tops[:, None], high[tops, None]
    higher = low > top_n
    begin = np.where(higher & (rows < at), rows, -1).max(axis=1, initial=-1)[:, None]
    end = np.where(higher & (rows > at), rows, len(low)).min(axis=1, initial=len(low))[:, None]
    between = ((begin < rows) & (rows < at), (at < rows) & (rows < end))
    lowest = [np.minimum(np.where(side, low, top_n).min(axis=1), high[tops]) for side in between]
    return np.asarray(high[tops] - np.maximum(*lowest))


def _descent(top_n: float, values: FloatArray) -> float:
    """Return by how much values fall below a top before they rise above it."""
    return float(top_n - values[: _end(values > top_n)].min(initial=top_n))


def _doubts(top_n: float, low: FloatArray, high: FloatArray) -> list[int]:
    """Return where a curve beside a top is to be known to tell how far it descends before it rises above the top."""
    end = _end(low > top_n)
    higher = _end(high > top_n)
    return [*([int(low[:end].argmin())] if end else []), *([higher] if higher < len(high) else [])]


def _end(mask: NDArray[np.bool_]) -> int:
    """Return the index of the first true value, or how many there are."""
    return int(mask.argmax()) if mask.any() else len(mask)


def _hollows(low: FloatArray, high: FloatArray, told_n: FloatArray) -> list[int]:
    """Return where the local minima are to be simulated, from summit to summit, that are told or may be."""
    asked: list[int] = []
    before_n = np.maximum.accumulate(high)
    summit = np.maximum.accumulate(np.where(high >= before_n, np.arange(len(high)), 0))
    deep = before_n - low >= _NEARLY * told_n[summit]
    for top in np.unique(summit[deep]).tolist():
        if low[top] != high[top]:
            asked.append(top)
            continue
        end = top + 1 + _end(high[top + 1 :] >= high[top])
        lowest = top + 1 + int(low[top + 1 : end].argmin()) if end > top + 1 else top
        known_end, known_lowest = end == len(high) or low[end] == high[end], low[lowest] == high[lowest]
        asked += [max(top - 1, 0), min(top + 1, len(high) - 1), min(end, len(high) - 1), lowest]
        asked += [end - 1] if known_end else []
        asked += [max(lowest - 1, 0), min(lowest + 1, len(high) - 1)] if known_lowest else []
    return asked
