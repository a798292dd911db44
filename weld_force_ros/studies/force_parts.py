"""Over the 48 mm dip, at every speed: the low and the high part of the force at its peak, and its spectral peaks."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.analysis.spectra import CUT_HZ, bands
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies import passage_records, variants
from weld_force_ros.studies.bands_study import split_force
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import StudyContext

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUTS_HZ = (480.0, CUT_HZ, 580.0)
HIGH_FROM_KMH = 80.0  # slower, the part above 530 Hz is negligible, and its peaks are ripple
_SHOWN_KMH = (50.0, 80.0, 120.0, 130.0, 160.0, 200.0, 250.0, 300.0)


@dataclass(frozen=True)
class ForceParts:
    """Over speed, each (n_speed,).

    Attributes:
        speeds_kmh: of the passages.
        low_n: at the peak, below each frequency of `CUTS_HZ`: (n_speed, n_cut).
        high_n: at the peak, above `CUT_HZ`.
        low_hz: of the strongest spectral peak between 150 and 530 Hz.
        high_hz: of the strongest one above 530 Hz; NaN below `HIGH_FROM_KMH`.
    """

    speeds_kmh: FloatArray
    low_n: FloatArray
    high_n: FloatArray
    low_hz: FloatArray
    high_hz: FloatArray


def force_parts(context: StudyContext) -> ForceParts:
    """Roll over the dip on continuous support at 30 to 300 km/h."""
    weld, speeds = variants.by_sign(context)[0], context.speeds(30, 300, 10)
    speeds = np.union1d(speeds, _SHOWN_KMH)
    low, high, low_hz, high_hz = [], [], [], []
    for speed in speeds.tolist():
        split = split_force(context, weld, speed)
        passage, static_n = split.passage, split.static_load_n
        at = int(np.argmax(passage.force_n))
        low.append([bands(passage.x_m, passage.force_n, speed, cut).low_n[at] - static_n for cut in CUTS_HZ])
        high.append(split.at_peak_n[1])
        low_hz.append(passage_records.strongest_hz(split.spectrum, 150.0, CUT_HZ))
        clear = speed >= HIGH_FROM_KMH
        high_hz.append(passage_records.strongest_hz(split.spectrum, CUT_HZ, np.inf) if clear else np.nan)
    return ForceParts(speeds, *(np.array(values) for values in (low, high, low_hz, high_hz)))


def table(found: ForceParts) -> Table:
    """Return a row for some speeds."""
    columns = (
        Column("speed_kmh", "km/h", 0),
        *(Column(f"low_{cut:g}_hz_n", f"low part at the peak, cut at {cut:g} Hz, N", 0) for cut in CUTS_HZ),
        Column("high_n", "high part, N", 0), Column("low_peak_hz", "spectral peak below, Hz", 0),
        Column("high_peak_hz", "spectral peak above, Hz", 0),
    )  # fmt: skip
    shown = np.searchsorted(found.speeds_kmh, _SHOWN_KMH)
    rows: list[tuple[Cell, ...]] = [
        (float(found.speeds_kmh[i]), *map(float, found.low_n[i]),
         *(float(values[i]) for values in (found.high_n, found.low_hz, found.high_hz)))
        for i in shown
    ]  # fmt: skip
    return Table("Over the 48 mm dip: parts of the force at its peak, and peaks of its spectrum", columns, rows)


def figure(found: ForceParts, turns_kmh: tuple[float, float]) -> "Figure":
    """Draw both parts (above) and spectral peaks over speed; dashed: the curve's first maximum and second kink."""
    drawn = new_figure(7.0, 6.0)
    above, below = drawn.subplots(2, 1, sharex=True)
    low_n = found.low_n[:, CUTS_HZ.index(CUT_HZ)]
    for axes, pair, unit in ((above, (low_n, found.high_n), 1e3), (below, (found.low_hz, found.high_hz), 1.0)):
        for values, label, colour in zip(pair, ("below 530 Hz", "above 530 Hz"), COLOURS, strict=False):
            axes.plot(found.speeds_kmh, values / unit, "o-", markersize=3, color=colour, label=label)
        for speed in turns_kmh:
            axes.axvline(speed, color=GREY, linewidth=0.8, linestyle="--", zorder=0)
    above.axhline(0, color=GREY, linewidth=0.6, zorder=0)
    above.set_ylabel("part of the force\nat its peak, kN")
    below.set(xlabel="speed, km/h", ylabel="strongest spectral\npeak, Hz")
    below.set_ylim(bottom=0)
    legend_above(drawn, 2, above)
    return drawn
