"""Study `hertz`: a stiffer contact raises the force and hardly changes the curve's shape (section 6.1)."""

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.report.figures import as_text, new_figure
from weld_force_ros.studies import passage_curves, variants
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.result_table import Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, Picture, Quantities, StudyContext, StudyResult, as_rows
from weld_force_ros.studies.variants import Variant

STIFFNESSES_GN_PER_M15 = (50.0, 75.0, 93.7, 100.0)
_LAST_KMH = 200.0
_STYLES = (":", "--", "-", "-.")


def run(context: StudyContext) -> StudyResult:
    """Compute force against speed with four contact stiffnesses, over a weld and the same upside down."""
    speeds = context.speeds(20, 300, 1)
    welds = variants.by_sign(context)
    # For each stiffness, a peak map of each weld.
    peak_maps = [_peak_maps(context, welds, speeds, stiffness) for stiffness in STIFFNESSES_GN_PER_M15]
    table = Table(
        "Peak force by contact stiffness",
        (Column("weld", "weld"), Column("hertz_gn_per_m15", "GN/m^1.5", 1), Column("speed_kmh", "km/h", 0),
         Column("peak_force_n", "N", 0), Column("peak_x_m", "m after the weld's centre", 4)),
        [(weld.label, stiffness, *row) for stiffness, of_welds in zip(STIFFNESSES_GN_PER_M15, peak_maps, strict=True)
         for weld, peak_map in zip(welds, of_welds, strict=True)
         for row in as_rows(speeds, peak_map.peak_force_n, peak_map.peak_x_m)],
    )  # fmt: skip
    pictures = [_curves(welds, speeds, peak_maps), _changes(context, welds, speeds, peak_maps)]
    measured = _claim_quantities(context, speeds, peak_maps[0], peak_maps[-1]) if context.uses_paper_inputs else {}
    return StudyResult("hertz", "Stiffness of the contact", pictures, {"curves": table}, measured)


def _peak_maps(context: StudyContext, welds: list[Variant], speeds: FloatArray, gn_per_m15: float) -> list[PeakMap]:
    vehicle_track = context.vehicle_track(CONTINUOUS, hertz_n_per_m15=gn_per_m15 * 1e9)
    return list(vehicle_track.peak_maps([weld.wheel_path for weld in welds], speeds, [0.0]))


def _curves(welds: list[Variant], speeds: FloatArray, peak_maps: list[list[PeakMap]]) -> Picture:
    figure = new_figure(7.0, 6.4)
    panels = figure.subplots(len(welds), 1, sharex=True)
    for row, stiffness, colour, style in zip(peak_maps, STIFFNESSES_GN_PER_M15, COLOURS, _STYLES, strict=False):
        for axes, peak_map in zip(panels, row, strict=True):
            label = f"{stiffness:g} GN/m$^{{3/2}}$" if axes is panels[0] else None
            axes.plot(speeds, peak_map.peak_force_n[:, 0] / 1e3, style, color=colour, label=label)
    for axes, weld in zip(panels, welds, strict=True):
        axes.set(title=as_text(weld.label), ylabel="peak force, kN")
    panels[-1].set(xlabel="speed, km/h")
    legend_above(figure, 4)
    return Picture(
        "hertz-curves", "Peak force by contact stiffness",
        "A stiffer contact gives more force, the more so the higher the speed, and moves a dip's maximum slightly to "
        "higher speed; the curves keep their shape.", figure,
    )  # fmt: skip


def _changes(
    context: StudyContext, welds: list[Variant], speeds: FloatArray, peak_maps: list[list[PeakMap]]
) -> Picture:
    static_n = context.vehicle_track(CONTINUOUS).wheel.static_load_n
    figure = new_figure(7.0, 3.2)
    axes = figure.subplots()
    for weld, soft, stiff, colour in zip(welds, peak_maps[0], peak_maps[-1], COLOURS, strict=False):
        change = 100 * (stiff.peak_force_n - soft.peak_force_n)[:, 0] / static_n
        axes.plot(speeds, change, color=colour, label=as_text(weld.label))
    axes.set(xlabel="speed, km/h", ylabel="change of peak force,\n% of static load")
    legend_above(figure, 2)
    return Picture(
        "hertz-change", "Change of peak force from 50 to 100 GN/m^1.5",
        "How much a contact twice as stiff adds depends on the speed: there is no one percentage.", figure,
    )  # fmt: skip


def _claim_quantities(
    context: StudyContext, speeds: FloatArray, soft: list[PeakMap], stiff: list[PeakMap]
) -> Quantities:
    static_n = context.vehicle_track(CONTINUOUS).wheel.static_load_n
    shown = speeds <= _LAST_KMH
    (soft_dip, soft_rise), (stiff_dip, stiff_rise) = (
        [peak_map.peak_force_n[:, 0] for peak_map in peak_maps] for peak_maps in (soft, stiff)
    )
    soft_kmh, soft_n = _first_maximum(speeds, soft_dip)
    stiff_kmh, stiff_n = _first_maximum(speeds, stiff_dip)
    soft_kink_kmh, stiff_kink_kmh = (passage_curves.first_kinks_kmh(speeds, maps[0])[0] for maps in (soft, stiff))
    return {
        "hertz.change_of_static": (stiff_n - soft_n) / static_n,
        "hertz.largest_change_of_static": float(np.max(stiff_dip - soft_dip) / static_n),
        "hertz.change_of_static_rise": float(np.mean((stiff_rise - soft_rise)[shown]) / static_n),
        "hertz.shape_correlation": float(np.corrcoef(soft_dip[shown], stiff_dip[shown])[0, 1]),
        "hertz.shape_correlation_rise": float(np.corrcoef(soft_rise[shown], stiff_rise[shown])[0, 1]),
        "hertz.first_maximum_shift_kmh": stiff_kmh - soft_kmh,
        "hertz.first_kink_shift_kmh": stiff_kink_kmh - soft_kink_kmh,
    }


def _first_maximum(speeds: FloatArray, force: FloatArray) -> tuple[float, float]:
    return passage_curves.first_maximum(passage_curves.features(speeds, force))
