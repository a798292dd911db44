"""The force on smooth rail by harmonics of the sleeper-passing frequency, over speed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.smooth_study import SPEEDS_KMH, whole_spans
from weld_force_ros.studies.study_context import BILBAO, StudyContext

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HARMONICS = 3
_SPANS = 4


@dataclass(frozen=True)
class SleeperHarmonics:
    """Amplitudes of the fluctuating force.

    Attributes:
        speeds_kmh: (n_speed,).
        amplitude_n: (n_speed, n_harmonic), the fundamental first.
        rest: (n_speed,), RMS of all that is no multiple of the fundamental, relative to the fluctuation's.
        spacing_m: of the sleepers.
    """

    speeds_kmh: FloatArray
    amplitude_n: FloatArray
    rest: FloatArray
    spacing_m: float


def sleeper_harmonics(context: StudyContext) -> SleeperHarmonics:
    """Roll over smooth rail at 50 to 300 km/h, and split the force of whole spans into its lines."""
    speeds, spacing_m = context.speeds(50, 300, 5), context.track(BILBAO).track.spacing_m
    speeds = np.union1d(speeds, SPEEDS_KMH)
    amplitudes, rests = [], []
    for speed in speeds:
        history = context.smooth_rail(BILBAO, float(speed), _SPANS)
        x, force = whole_spans(history.x_m, history.force_n, spacing_m)
        count = round((x[-1] - x[0]) / spacing_m)
        lines = 2 * np.abs(np.fft.rfft(force - force.mean())) / len(force)
        amplitudes.append(lines[count : (HARMONICS + 1) * count : count])
        power = lines**2
        rests.append(np.sqrt(max(0.0, 1 - power[::count].sum() / power.sum())))
    return SleeperHarmonics(speeds, np.array(amplitudes), np.array(rests), spacing_m)


def table(found: SleeperHarmonics) -> Table:
    """Return a row for each speed of the paper's Fig. 13."""
    columns = (
        Column("speed_kmh", "km/h", 0), Column("fundamental_hz", "sleeper passing, Hz", 1),
        *(Column(f"amplitude_{n}_n", f"harmonic {n}, N", 0) for n in range(1, HARMONICS + 1)),
        Column("rest", "all else, relative"),
    )  # fmt: skip
    shown = np.searchsorted(found.speeds_kmh, SPEEDS_KMH)
    rows: list[tuple[Cell, ...]] = [
        (float(found.speeds_kmh[i]), float(found.speeds_kmh[i] / 3.6 / found.spacing_m),
         *map(float, found.amplitude_n[i]), float(found.rest[i]))
        for i in shown
    ]  # fmt: skip
    return Table("The force on smooth rail by harmonics of the sleeper-passing frequency", columns, rows)


def figure(found: SleeperHarmonics, resonance_hz: float) -> "Figure":
    """Draw amplitudes over speed; dashed where each harmonic meets a resonance of the wheelset on its track."""
    drawn = new_figure(7.0, 3.4)
    axes = drawn.subplots()
    for number, colour in zip(range(HARMONICS), COLOURS, strict=False):
        axes.plot(found.speeds_kmh, found.amplitude_n[:, number] / 1e3, color=colour, label=f"harmonic {number + 1}")
        meets_kmh = resonance_hz * found.spacing_m * 3.6 / (number + 1)
        if meets_kmh <= found.speeds_kmh[-1]:
            axes.axvline(meets_kmh, color=colour, linewidth=0.8, linestyle="--", zorder=0)
    for speed in SPEEDS_KMH:
        axes.axvline(speed, color=GREY, linewidth=0.4, zorder=0)
    axes.set(xlabel="speed, km/h", ylabel="amplitude, kN")
    axes.set_ylim(bottom=0)
    legend_above(drawn, HARMONICS)
    return drawn
