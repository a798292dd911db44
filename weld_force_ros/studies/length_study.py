"""Study `length`: a dip twice as long has its first maximum of force at twice the speed (Fig. 23)."""

import numpy as np

from weld_force_ros.physics.analysis.speed_curve import CurveFeatures
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.report.figures import GREY, as_text, new_figure
from weld_force_ros.studies import passage_curves, passage_records, variants
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, Picture, Quantities, StudyContext, StudyResult, as_rows
from weld_force_ros.studies.variants import Variant

_SPLITTING_KMH = (53.0, 74.0, 100.0, 124.0)
_KINK_KMH = 74.0
_LENGTHS_MM = (48, 96)
_SHAPE_KMH = np.arange(20.0, 151.0)
_BEHIND_M = 0.2


def run(context: StudyContext) -> StudyResult:
    """Compute force against speed over a weld and one twice as long, and how its peak splits."""
    speeds = context.speeds(20, 300, 1)
    welds = variants.by_length(context)
    vehicle_track = context.vehicle_track(CONTINUOUS)
    peak_maps = list(vehicle_track.peak_maps([weld.wheel_path for weld in welds], speeds, [0.0]))
    splitting = [vehicle_track.history(welds[0].wheel_path, speed, 0.0) for speed in _SPLITTING_KMH]
    rows: list[tuple[Cell, ...]] = [(weld.label, *row) for weld, peak_map in zip(welds, peak_maps, strict=True)
            for row in as_rows(speeds, peak_map.peak_force_n, peak_map.peak_x_m)]  # fmt: skip
    table = Table(
        "Peak force over both lengths",
        (Column("weld", "weld"), Column("speed_kmh", "km/h", 0), Column("peak_force_n", "N", 0),
         Column("peak_x_m", "m after the weld's centre", 4)), rows,
    )  # fmt: skip
    pictures = [
        _curves(welds, speeds, peak_maps),
        _stretched(welds, speeds, peak_maps),
        _splitting(welds[0], splitting),
    ]
    measured = _claim_quantities(context, speeds, peak_maps) if context.uses_paper_inputs else {}
    return StudyResult("length", "Length of the weld", pictures, {"curves": table}, measured)


def _features(speeds: FloatArray, peak_map: PeakMap) -> CurveFeatures:
    return passage_curves.features(speeds, peak_map.peak_force_n[:, 0])


def _curves(welds: list[Variant], speeds: FloatArray, peak_maps: list[PeakMap]) -> Picture:
    figure = new_figure(7.0, 6.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    for weld, peak_map, colour in zip(welds, peak_maps, COLOURS, strict=False):
        force = peak_map.peak_force_n[:, 0] / 1e3
        above.plot(speeds, force, color=colour, label=as_text(weld.label))
        below.plot(speeds, peak_map.peak_x_m[:, 0] * 1e3, ".", markersize=3, color=colour)
        maxima = _features(speeds, peak_map).maxima[:1]
        above.plot([m.speed_kmh for m in maxima], [m.force_n / 1e3 for m in maxima], "o", color=colour)
        kinks = passage_curves.kinks_kmh(speeds, peak_map)
        above.plot(kinks, np.interp(kinks, speeds, force), "v", color=colour, fillstyle="none", markersize=8)
    above.plot([], [], "o", color=GREY, label="first maximum")
    above.plot([], [], "v", color=GREY, fillstyle="none", markersize=8, label="kink")
    above.set(ylabel="peak force, kN")
    below.set(xlabel="speed, km/h", ylabel="peak after centre, mm")
    legend_above(figure, 2)
    return Picture(
        "length-curves", "Peak force over a weld and one twice as long",
        "Above: over a dip, the paper says, the force rises to a first maximum (dot), falls, and rises again, and over "
        "one twice as long it does so at twice the speed. Below: the location of the peak. It jumps at the kinks "
        "(triangles), where another peak becomes the largest.",
        figure,
    )  # fmt: skip


def _stretched(welds: list[Variant], speeds: FloatArray, peak_maps: list[PeakMap]) -> Picture:
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    for weld, peak_map, colour, scale in zip(welds, peak_maps, COLOURS, (1, 2), strict=False):
        shown = (speeds >= scale * speeds[0]) & (speeds <= scale * speeds[-1] / 2)
        force = peak_map.peak_force_n[shown, 0] / 1e3
        axes.plot(speeds[shown] / scale, force, ("-", "--")[scale - 1], color=colour, label=as_text(weld.label))
    axes.set(xlabel="speed, km/h (of the longer weld: half its speed)", ylabel="peak force, kN")
    legend_above(figure, 2)
    return Picture(
        "length-stretched", "Both curves over speed per length",
        "The longer weld's curve is drawn at half its speed. As far as it covers the shorter one's, what decides is "
        "the time that the wheel takes over the weld.", figure,
    )  # fmt: skip


def _splitting(weld: Variant, histories: list[History]) -> Picture:
    figure = new_figure(7.0, 6.2)
    panels = figure.subplots(len(histories) + 1, 1, sharex=True, height_ratios=[1.0, *[2.0] * len(histories)])
    first_m, last_m = weld.wheel_path.nonzero_extent_m
    shown_m = (first_m - 0.02, last_m + _BEHIND_M)
    highest = max(float(passage.force_n.max()) for passage in histories) / 1e3
    lowest = min(float(passage.force_n.min()) for passage in histories) / 1e3
    for axes, passage, speed in zip(panels[1:], histories, _SPLITTING_KMH, strict=True):
        axes.plot(passage.x_m * 1e3, passage.force_n / 1e3, color=COLOURS[0])
        axes.set(ylim=(lowest - 2, highest + 2))
        label_panel(axes, f"{speed:g} km/h")
    panels[0].plot(histories[0].x_m * 1e3, histories[0].irregularity_m * 1e6, color=GREY)
    panels[0].set(ylabel="wheel\npath, μm", xlim=(shown_m[0] * 1e3, shown_m[1] * 1e3))
    figure.supylabel("contact force, kN", fontsize="medium")
    panels[-1].set(xlabel="distance after the weld's centre, mm")
    return Picture(
        "length-splitting", f"How the peak splits: {weld.label}",
        "The force during the passage of the wheel (top: path of its centre). With speed the peak splits into "
        "one that stays with the weld and one that moves in the running direction.", figure,
    )  # fmt: skip


def _claim_quantities(context: StudyContext, speeds: FloatArray, peak_maps: list[PeakMap]) -> Quantities:
    features = [_features(speeds, peak_map) for peak_map in peak_maps]
    kinks = [passage_curves.first_kinks_kmh(speeds, peak_map) for peak_map in peak_maps]
    maxima_kmh = [passage_curves.first_maximum(feature)[0] for feature in features]
    minima = [passage_curves.minimum_after_maximum(feature) for feature in features]
    short, long = (peak_map.peak_force_n[:, 0] for peak_map in peak_maps)
    stretched = np.interp(2 * _SHAPE_KMH, speeds, long)
    measured: Quantities = {
        "length.first_maximum_ratio": float(maxima_kmh[1] / maxima_kmh[0]),
        "length.fall_after_maximum_n": [minimum.depth_n if minimum else np.nan for minimum in minima],
        "length.shape_correlation": float(np.corrcoef(np.interp(_SHAPE_KMH, speeds, short), stretched)[0, 1]),
    }
    for length_mm, maximum_kmh, (first_kmh, second_kmh) in zip(_LENGTHS_MM, maxima_kmh, kinks, strict=True):
        measured[f"length.first_maximum_{length_mm}mm_kmh"] = float(maximum_kmh)
        measured[f"length.first_kink_{length_mm}mm_kmh"] = first_kmh
        measured[f"length.second_kink_{length_mm}mm_kmh"] = second_kmh
    return measured | _peaks_at_the_kink(context, passage_records.peak_location_at(speeds, peak_maps[0], maxima_kmh[0]))


def _peaks_at_the_kink(context: StudyContext, largest_m: float) -> Quantities:
    vehicle_track = context.vehicle_track(CONTINUOUS)
    history = vehicle_track.history(variants.by_length(context)[0].wheel_path, _KINK_KMH, 0.0)
    first, second = passage_curves.two_highest(
        passage_curves.split_peaks(history, vehicle_track.wheel.static_load_n, largest_m)
    )
    return {
        "length.first_peak_location_74kmh_mm": first.x_m * 1e3,
        "length.peak_separation_74kmh_mm": (second.x_m - first.x_m) * 1e3,
    }
