"""Study `bands`: above 530 Hz the force works against that below over a dip, with it over a rise (Figs. 27, 28)."""

import numpy as np

from weld_force_ros.physics.analysis.spectra import CUT_HZ, bands, phase_at_peak
from weld_force_ros.physics.analysis.speed_curve import curve_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.studies import bands_figures, passage_curves, passage_records, variants
from weld_force_ros.studies.band_split import BandSplit
from weld_force_ros.studies.result_table import Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, Quantities, StudyContext, StudyResult, as_rows
from weld_force_ros.studies.variants import Variant

DIP_KMH = (50.0, 80.0, 120.0, 200.0)
RISE_KMH = (65.0, 120.0, 200.0)
MOVING_KMH = (80.0, 120.0, 160.0, 200.0)
_LOW_KMH = (80.0, 120.0, 200.0)
_BEFORE_M, _AFTER_M = 0.1, 0.4


def run(context: StudyContext) -> StudyResult:
    """Split the force at several speeds over a weld and its inverse, and compare their force-speed curves."""
    welds = variants.by_sign(context)
    speeds = context.speeds(20, 300, 1)
    peak_maps = list(context.vehicle_track(CONTINUOUS).peak_maps([weld.wheel_path for weld in welds], speeds, [0.0]))
    weld_splits = {speed: split_force(context, welds[0], speed) for speed in sorted({*DIP_KMH, *MOVING_KMH})}
    inverse_splits = {speed: split_force(context, welds[1], speed) for speed in RISE_KMH}
    first_m, last_m = welds[0].wheel_path.nonzero_extent_m
    shown_m = (first_m - _BEFORE_M, last_m + _AFTER_M)
    pictures = [
        bands_figures.parts(welds[0].label, "bands-weld", [weld_splits[speed] for speed in DIP_KMH], shown_m),
        bands_figures.parts(welds[1].label, "bands-inverse", list(inverse_splits.values()), shown_m),
        bands_figures.curves([weld.label for weld in welds], speeds, peak_maps),
        bands_figures.spectra(welds[0].label, [weld_splits[speed] for speed in MOVING_KMH]),
    ]
    tables = {
        "parts": _parts_table(welds, [weld_splits, inverse_splits], shown_m),
        "curves": _curves_table(welds, speeds, peak_maps),
    }
    measured: Quantities = {}
    if context.uses_paper_inputs:
        measured = _claim_quantities(speeds, peak_maps, weld_splits, inverse_splits)
        measured["bands.parts_where_force_rises_again_n"] = _parts_after_minimum(
            context, welds[0], speeds, peak_maps[0]
        )
    return StudyResult("bands", "Force below and above 530 Hz", pictures, tables, measured)


def split_force(context: StudyContext, weld: Variant, speed_kmh: float) -> BandSplit:
    """Return the force over a weld on continuous support at a speed, split at 530 Hz."""
    vehicle_track = context.vehicle_track(CONTINUOUS)
    passage = passage_records.record(vehicle_track, weld.wheel_path, speed_kmh)
    return BandSplit(
        speed_kmh, passage, bands(passage.x_m, passage.force_n, speed_kmh, CUT_HZ), vehicle_track.wheel.static_load_n
    )


def _parts_table(welds: list[Variant], passages: list[dict[float, BandSplit]], shown_m: tuple[float, float]) -> Table:
    rows: list[tuple[str | float, ...]] = []
    for weld, by_speed in zip(welds, passages, strict=True):
        for speed, split in by_speed.items():
            x = split.passage.x_m
            inside = (x >= shown_m[0]) & (x <= shown_m[1])
            cells = as_rows(x[inside], split.low_n[inside], split.parts.high_n[inside])
            rows += [(weld.label, speed, *row) for row in cells]
    return Table(
        "Dynamic force below and above 530 Hz",
        (Column("weld", "weld"), Column("speed_kmh", "km/h", 0), Column("x_m", "m after the weld's centre", 4),
         Column("low_n", "N", 0), Column("high_n", "N", 0)), rows,
    )  # fmt: skip


def _curves_table(welds: list[Variant], speeds: FloatArray, peak_maps: list[PeakMap]) -> Table:
    return Table(
        "Peak force over a weld and the same upside down",
        (Column("weld", "weld"), Column("speed_kmh", "km/h", 0), Column("peak_force_n", "N", 0)),
        [(weld.label, *row) for weld, peak_map in zip(welds, peak_maps, strict=True)
         for row in as_rows(speeds, peak_map.peak_force_n)],
    )  # fmt: skip


def _claim_quantities(
    speeds: FloatArray,
    peak_maps: list[PeakMap],
    dip_splits: dict[float, BandSplit],
    rise_splits: dict[float, BandSplit],
) -> Quantities:
    dip, rise = (peak_map.peak_force_n[:, 0] for peak_map in peak_maps)
    inverted = curve_features(speeds, rise)
    return {
        **_low_part(dip_splits),
        **_high_part(dip_splits),
        **_peak_locations(speeds, peak_maps[0], dip_splits),
        "bands.inverted_monotonic": inverted.monotonic,
        "bands.inverted_linearity": inverted.linearity,
        "bands.inverted_parts_at_peak_n": [part for split in rise_splits.values() for part in split.at_peak_n],
        "bands.dip_below_rise_share": float(np.mean(dip < rise)),
    }


def _low_part(splits: dict[float, BandSplit]) -> Quantities:
    peaks = np.array(
        [passage_records.first_two_hz(passage_records.peaks_between(splits[v].spectrum, 0, CUT_HZ)) for v in _LOW_KMH]
    )
    widths = [splits[speed].low_width_m for speed in MOVING_KMH]
    return {
        "bands.low_peaks_spread": (np.ptp(peaks, axis=0) / peaks.mean(axis=0)).tolist(),
        "bands.low_first_peak_hz": peaks[:, 0].tolist(),
        "bands.low_second_peak_hz": peaks[:, 1].tolist(),
        "bands.low_width_exponent": passage_records.exponent(MOVING_KMH, widths),
        "bands.low_peak_shift_50_to_200kmh_mm": (splits[200.0].low_peak_m - splits[50.0].low_peak_m) * 1e3,
    }


def _high_part(splits: dict[float, BandSplit]) -> Quantities:
    strongest = [passage_records.strongest_hz(splits[v].spectrum, CUT_HZ, np.inf) for v in MOVING_KMH]
    largest = [float(np.abs(splits[speed].parts.high_n).max()) for speed in DIP_KMH]
    phase = phase_at_peak(splits[80.0].parts)
    return {
        "bands.high_peak_exponent": passage_records.exponent(MOVING_KMH, strongest),
        "bands.high_peak_rises": bool(np.all(np.diff(strongest) > 0)),
        **{f"bands.high_share_{speed:g}kmh": splits[speed].high_share for speed in (50.0, 80.0, 120.0)},
        "bands.high_grows": bool(np.all(np.diff(largest) > 0)),
        "bands.high_at_low_maximum_80kmh_n": phase.high_n,
        "bands.phase_80kmh": phase.correlation,
        "bands.high_at_peak_50kmh_n": splits[50.0].at_peak_n[1],
        "bands.parts_at_peak_200kmh_n": splits[200.0].at_peak_n,
    }


def _parts_after_minimum(context: StudyContext, weld: Variant, speeds: FloatArray, peak_map: PeakMap) -> list[float]:
    """Return the low and the high part at the peak at the first computed speed past the curve's local minimum."""
    minimum = passage_curves.minimum_after_maximum(passage_curves.features(speeds, peak_map.peak_force_n[:, 0]))
    past = speeds[speeds > minimum.lowest_kmh] if minimum else speeds[:0]
    return split_force(context, weld, float(past[0])).at_peak_n if len(past) else []


def _peak_locations(speeds: FloatArray, peak_map: PeakMap, splits: dict[float, BandSplit]) -> Quantities:
    """Return how far the two peaks are from those of the two parts, and how they move."""
    maximum_kmh = passage_curves.first_maximum(passage_curves.features(speeds, peak_map.peak_force_n[:, 0]))[0]
    largest_m = passage_records.peak_location_at(speeds, peak_map, maximum_kmh)
    first_120, second_120 = _two_locations(splits[120.0], largest_m)
    first_200, second_200 = _two_locations(splits[200.0], largest_m)
    return {
        "bands.first_peak_to_high_120kmh_mm": (first_120 - splits[120.0].high_peak_m) * 1e3,
        "bands.second_peak_to_low_120kmh_mm": (second_120 - splits[120.0].low_peak_m) * 1e3,
        "bands.first_peak_shift_120_to_200kmh_mm": (first_200 - first_120) * 1e3,
        "bands.second_peak_shift_120_to_200kmh_mm": (second_200 - second_120) * 1e3,
    }


def _two_locations(split: BandSplit, largest_m: float) -> tuple[float, float]:
    first, second = passage_curves.two_highest(
        passage_curves.split_peaks(split.passage, split.static_load_n, largest_m)
    )
    return first.x_m, second.x_m
