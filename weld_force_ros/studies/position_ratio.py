"""How much receptances differ along the span, over frequency: rail as a beam and by 2.5-D finite elements (SAFE)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.track import beam
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.rail_study import with_waveguide
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.spectrum_study import FIG_5_POSITIONS
from weld_force_ros.studies.study_context import BILBAO, StudyContext

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = 1.5  # the bound that the claim's criterion sets at 300 Hz
_SHOWN_HZ = (100.0, 200.0, 300.0, 400.0)
_STEP_HZ = 10.0
_SECTION = "60E1"


@dataclass(frozen=True)
class PositionRatio:
    """Largest over smallest magnitude among the positions of the paper's Fig. 5, (n_frequency,)."""

    rail: str
    frequency_hz: FloatArray
    ratio: FloatArray
    pinned_pinned_hz: float


def position_ratios(context: StudyContext) -> list[PositionRatio]:
    """Compute the ratio with either rail, 10 to 1500 Hz."""
    frequency_hz = np.arange(_STEP_HZ, 1500.5, _STEP_HZ * (5 if context.coarse else 1))
    definition, found = context.track(BILBAO), []
    for rail, track in (("beam", definition.track), ("SAFE", with_waveguide(definition, _SECTION).track)):
        magnitude = np.abs(beam.receptance(track, frequency_hz, FIG_5_POSITIONS * track.spacing_m))
        ratio = magnitude.max(axis=0) / magnitude.min(axis=0)
        found.append(PositionRatio(rail, frequency_hz, ratio, beam.pinned_pinned_hz(definition.track)))
    return found


def table(found: list[PositionRatio]) -> Table:
    """Return a row a rail."""
    columns = (
        Column("rail", "rail"), *(Column(f"ratio_{v:g}_hz", f"at {v:g} Hz", 2) for v in _SHOWN_HZ),
        Column("below_1_5_until_hz", "below 1.5 until, Hz", 0), Column("largest", "largest", 1),
        Column("largest_at_hz", "at, Hz", 0), Column("pinned_pinned_hz", "pinned-pinned, Hz", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for one in found:
        until = one.frequency_hz[np.argmax(one.ratio >= SMALL)]
        largest = int(np.argmax(one.ratio))
        shown = np.interp(_SHOWN_HZ, one.frequency_hz, one.ratio)
        cells = (*shown, until, one.ratio[largest], one.frequency_hz[largest], one.pinned_pinned_hz)
        rows.append((one.rail, *map(float, cells)))
    return Table("Largest over smallest receptance at the positions of Fig. 5", columns, rows)


def figure(found: list[PositionRatio]) -> "Figure":
    """Draw the ratio over frequency."""
    drawn = new_figure(7.0, 3.4)
    axes = drawn.subplots()
    for one, colour, style in zip(found, COLOURS, ("-", "--"), strict=False):
        axes.semilogy(one.frequency_hz, one.ratio, style, color=colour, label=one.rail)
    for hertz, label in ((300.0, "300 Hz "), (found[0].pinned_pinned_hz, "pinned-pinned ")):
        axes.axvline(hertz, color=GREY, linewidth=0.8, linestyle="--", zorder=0)
        axes.text(hertz, 0.97, label, ha="right", va="top", transform=axes.get_xaxis_transform())
    axes.axhline(SMALL, color=GREY, linewidth=0.8, zorder=0)
    axes.set(xlabel="frequency, Hz", ylabel="largest over smallest, relative", ylim=(1, None))
    legend_above(drawn, 2)
    return drawn
