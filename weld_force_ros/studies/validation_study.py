"""Study `validation`: the force over wheel flats on the track of Johansson and Nielsen (Figs. 7 and 8).

The measurements, and Pieringer's curves, are in the paper's figures only; neither is drawn here. The text says
of them: a first maximum near 40 km/h, a minimum near 95 km/h, and growth from there to 300 km/h.
"""

from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.analysis.speed_curve import Hollow
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import GREY, as_text, new_figure
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.grids import COSINES_M, sampled_cosine
from weld_force_ros.studies.passage_curves import features, first_maximum, minimum_after_maximum
from weld_force_ros.studies.result_table import Column, Table
from weld_force_ros.studies.study_context import (
    FLAT,
    JOHANSSON_NIELSEN,
    Picture,
    Quantities,
    StudyContext,
    StudyResult,
    as_rows,
    grid_rows,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DEEPER = ("wheel-flat-1mm", "wheel-flat-2mm")
_LENGTH_M, _LONGER_M, _DEPTH_M = 0.100, 0.150, 0.9e-3
_TEXT_KMH = (40.0, 95.0)  # of the measurements, in the paper's section 1


def run(context: StudyContext) -> StudyResult:
    """Compute peak forces over flats up to 300 km/h, everywhere in the span."""
    speeds = context.speeds(10, 300, 1)
    positions = context.positions(JOHANSSON_NIELSEN)
    (weld,) = context.welds(FLAT)
    peak_n = context.peak_map(weld, JOHANSSON_NIELSEN, speeds, positions).peak_force_n
    pictures = [
        Picture(
            "validation-envelope", f"Peak force over {weld}",
            "The band spans all positions in the sleeper span. Dotted: where the measurements of Johansson and Nielsen "
            "have their maximum and minimum, according to the paper's text; their points are in its figure only.",
            _envelope(speeds, peak_n, weld, _TEXT_KMH if context.uses_paper_inputs else ()),
        )
    ]  # fmt: skip
    tables = {
        "envelope": Table(
            f"Peak force over {weld}",
            (Column("speed_kmh", "km/h", 0), Column("position_m", "m", 3), Column("peak_force_n", "N", 0)),
            grid_rows(speeds, positions, peak_n),
        )
    }
    if context.own_weld is None:
        upper = {name: _upper(context, sampled_cosine(*COSINES_M[name]), speeds, positions) for name in _DEEPER}
        pictures.append(
            Picture(
                "validation-deeper-flats", "Rounded flats of 1 and 2 mm",
                "Largest peak force of all positions. Flats are cosine dips, the deeper the longer; the paper gives "
                "neither the exact form nor the forces of Pieringer's flats, so that hers are not drawn.",
                _deeper_flats(speeds, upper),
            )
        )  # fmt: skip
        columns = (Column("speed_kmh", "km/h", 0), *(Column(f"upper_n_{name}", f"{name}, N", 0) for name in upper))
        tables["deeper"] = Table("Largest peak force of all positions", columns, as_rows(speeds, *upper.values()))
    measured = _claim_quantities(context, speeds, positions, peak_n) if context.uses_paper_inputs else {}
    return StudyResult("validation", "Wheel flats", pictures, tables, measured)


def _upper(
    context: StudyContext, flat: tuple[FloatArray, FloatArray], speeds: FloatArray, positions: FloatArray
) -> FloatArray:
    return np.asarray(context.peak_map(flat, JOHANSSON_NIELSEN, speeds, positions).peak_force_n.max(axis=1))


def _envelope(speeds: FloatArray, peak_n: FloatArray, weld: str, text_kmh: tuple[float, ...]) -> "Figure":
    figure = new_figure(7.0, 4.0)
    axes = figure.subplots()
    lower, upper = peak_n.min(axis=1) / 1e3, peak_n.max(axis=1) / 1e3
    axes.fill_between(speeds, lower, upper, color=COLOURS[1], alpha=0.35, linewidth=0, label="all positions")
    axes.plot(speeds, upper, color=COLOURS[1], label=as_text(f"largest, {weld}"))
    axes.plot(speeds, lower, color=COLOURS[1], linewidth=0.8, linestyle="--", label="smallest")
    for speed in text_kmh:
        axes.axvline(speed, color=GREY, linewidth=1, linestyle=":")
    axes.set(xlabel="speed, km/h", ylabel="peak force, kN", xlim=(0, 300), ylim=(0, None))
    legend_above(figure, 3)
    return figure


def _deeper_flats(speeds: FloatArray, upper_n: dict[str, FloatArray]) -> "Figure":
    figure = new_figure(7.0, 3.8)
    axes = figure.subplots()
    for (name, upper), colour in zip(upper_n.items(), COLOURS, strict=False):
        axes.plot(speeds, upper / 1e3, color=colour, label=name)
    axes.set(xlabel="speed, km/h", ylabel="largest peak force, kN", xlim=(0, 300), ylim=(0, None))
    legend_above(figure, 2)
    return figure


def _claim_quantities(
    context: StudyContext, speeds: FloatArray, positions: FloatArray, peak_n: FloatArray
) -> Quantities:
    upper_n = peak_n.max(axis=1)
    curve = features(speeds, upper_n)
    speed_kmh, maximum_n = first_maximum(curve)
    minimum = minimum_after_maximum(curve) or Hollow(np.nan, np.nan, np.nan, np.nan)
    longer_kmh, shorter_kmh = (
        first_maximum(features(speeds, _upper(context, sampled_cosine(length_m, _DEPTH_M), speeds, positions[:1])))[0]
        for length_m in (_LONGER_M, _LENGTH_M)
    )
    return {
        "validation.first_maximum_kmh": speed_kmh,
        "validation.minimum_kmh": minimum.lowest_kmh,
        "validation.fall_n": minimum.depth_n,
        "validation.rise_after_minimum_n": float(upper_n[-1]) - (maximum_n - minimum.depth_n),
        "validation.first_maximum_shift_longer_kmh": longer_kmh - shorter_kmh,
    }
