"""Study `map`: maximum force over speed and position of the five welds (Figs. 10, 16, 17, 20, 21)."""

import time
from collections.abc import Sequence

import numpy as np

from weld_force_ros.physics.analysis.geometry import classify
from weld_force_ros.physics.analysis.speed_curve import CurveFeatures
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies import map_figures
from weld_force_ros.studies.passage_curves import SIGNIFICANT, first_maximum, minimum_after_maximum
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import WELDS, Quantities, StudyContext, StudyResult, grid_rows
from weld_force_ros.studies.weld_map import WeldMap, plateau_width, weld_maps, within

# From the straightedge's start: weld 4's ramp and 50 mm after it, and weld 5's ramp.
_RAMP_4_M, _RAMP_5_M = (0.10, 0.20 + 0.05), (0.10, 0.25)


def run(context: StudyContext) -> StudyResult:
    """Compute maps of every weld, drawn with 3D surfaces."""
    began = time.perf_counter()
    maps = weld_maps(context, context.welds(*WELDS))
    seconds = (time.perf_counter() - began) / sum(m.force_n.size for m in maps)
    measured = (
        _claim_quantities(context, maps) | {"map.seconds_per_passage": seconds} if context.uses_paper_inputs else {}
    )
    return StudyResult(
        "map", "Maximum force over speed and position", [map_figures.picture(m) for m in maps],
        {"welds": _weld_table(context, maps)} | {m.file_name: _map_table(m) for m in maps}, measured,
    )  # fmt: skip


def _weld_table(context: StudyContext, maps: Sequence[WeldMap]) -> Table:
    columns = (
        Column("weld", "weld"), Column("kind", "kind"), Column("dip_m"), Column("protrusion_m"),
        Column("minimum_share", "with a local minimum", 2), Column("linearity_r2", "R² of a line", 3),
        Column("position_spread", "position spread", 3), Column("best_position_m", "best m", 2),
        Column("worst_position_m", "worst m", 2), Column("largest_force_n", "largest N", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for m in maps:
        profile = context.weld(m.name)
        geometry = classify(profile.x_m, profile.z_m)
        rows.append((
            m.name, geometry.kind, geometry.dip_m, geometry.protrusion_m, m.shape.hollow_share, _linearity(m),
            m.position_spread(), m.shape.best_by_mean_m, m.shape.worst_by_mean_m, float(m.force_n.max()),
        ))  # fmt: skip
    return Table("Welds: shape of the force over speed and position", columns, rows)


def _map_table(weld: WeldMap) -> Table:
    columns = (
        Column("speed_kmh", "km/h", 0), Column("position_m", "m after sleeper", 2), Column("peak_force_n", "peak N", 0),
        Column("peak_x_m", "at m", 3), Column("min_force_n", "minimum N", 0), Column("contact_loss_s", "loss s", 4),
        Column("local_minimum", "local minimum", 0),
    )  # fmt: skip
    found = weld.peak_map
    falls = weld.shape.hollow.astype(float)
    values = (found.peak_force_n, found.peak_x_m, found.min_force_n, found.contact_loss_s, falls)
    return Table(f"Peaks over {weld.name}", columns, grid_rows(weld.speeds_kmh, weld.positions_m, *values))


def _claim_quantities(context: StudyContext, maps: Sequence[WeldMap]) -> Quantities:
    first, second, third, fourth, fifth = maps
    spreads = [m.position_spread() for m in maps]
    tripled = weld_maps(context, [fifth.name], scale=3.0)[0].position_spread()
    measured: Quantities = {f"map.minimum_share_weld_{i}": _share(m, 0, np.inf) for i, m in enumerate(maps, start=1)}
    measured |= {f"map.plateau_weld_{i}_kmh": _plateau_widths(m) for i, m in enumerate(maps[:3], start=1)}
    measured |= _of_weld_1(first) | _of_weld_2(second) | _of_weld_3(third)
    return measured | {
        "map.linearity_dip_welds": [_linearity(m) for m in maps[:3]],
        "map.linearity_weld_4": _linearity(fourth),
        "map.linearity_weld_5": _linearity(fifth),
        "map.position_spread_weld_4": spreads[3],
        "map.position_spread_ratio_weld_5_to_4": spreads[4] / spreads[3],
        "map.position_spread_ratio_dips_to_rises": float(np.mean(spreads[:3]) / np.mean(spreads[3:])),
        "map.position_spread_ratio_weld_5_tripled": tripled / spreads[4],
        "map.peak_on_ramp_share_weld_4": float(within(fourth.peak_location_m, *_RAMP_4_M).mean()),
        "map.peak_up_ramp_weld_5": float(np.median((fifth.peak_location_m - _RAMP_5_M[0]) / np.ptp(_RAMP_5_M))),
        "map.distinct_worst_positions": float(len({int(np.argmax(m.force_n.mean(axis=0))) for m in maps})),
    }


def _of_weld_1(weld: WeldMap) -> Quantities:
    ahead = within(weld.positions_m, 0.10, 0.30)
    falls = np.array([_steepest_fall(weld.speeds_kmh, force) for force in weld.force_n.T])
    mean = weld.between(120, 200)
    before = weld.force_n[within(weld.speeds_kmh, 20, 200)].max(axis=0)
    beyond = weld.force_n[within(weld.speeds_kmh, 200, 250)].max(axis=0)
    return {
        "map.first_maximum_weld_1_kmh": [first_maximum(curve)[0] for curve in weld.curves],
        "map.relative_minimum_depth_weld_1": [_relative_depth(curve, weld.static_n) for curve in weld.curves],
        "map.fall_ratio_10_30cm_weld_1": float(falls[ahead].mean() / falls[~ahead].mean()) if falls.any() else np.nan,
        "map.relative_force_10_30cm_weld_1": float(mean[ahead].mean() / mean[~ahead].mean()),
        "map.growth_beyond_200kmh_weld_1": [float(g) for g in (beyond / before - 1)[ahead]],
    }


def _of_weld_2(weld: WeldMap) -> Quantities:
    lowest_n = np.array([_lowest(weld, i) for i, curve in enumerate(weld.curves) if curve.hollows])
    return {
        "map.best_position_weld_2_m": float(weld.positions_m[np.argmin(weld.between(80, 250))]),
        "map.relative_force_25cm_weld_2": weld.relative_at(0.24, 20, 120),
        "map.relative_force_40cm_weld_2": weld.relative_at(0.40, 20, 80),
        "map.minimum_force_spread_weld_2": float(np.ptp(lowest_n) / lowest_n.mean()) if len(lowest_n) else np.nan,
    }


def _lowest(weld: WeldMap, position: int) -> float:
    """Return the force in a position's deepest local minimum, N."""
    deepest = max(weld.curves[position].hollows, key=lambda minimum: minimum.depth_n)
    return float(weld.force_n[within(weld.speeds_kmh, deepest.from_kmh, deepest.to_kmh), position].min())


def _of_weld_3(weld: WeldMap) -> Quantities:
    lost = (weld.peak_map.contact_loss_s > 0).any(axis=1)
    early = within(weld.positions_m, 0.0, 0.15)
    mean = weld.force_n.mean(axis=0)
    return {
        "map.minimum_share_120kmh_weld_3": _share(weld, 100, 140),
        "map.minimum_share_250kmh_weld_3": _share(weld, 225, 275),
        "map.minimum_depth_ratio_weld_3": _mean_depth(weld, 100, 140) / _mean_depth(weld, 225, 275),
        "map.first_contact_loss_weld_3_kmh": float(weld.speeds_kmh[np.argmax(lost)]) if lost.any() else np.nan,
        "map.relative_force_first_15cm_weld_3": float(mean[early].mean() / mean[~early].mean()),
    }


def _relative_depth(curve: CurveFeatures, static_n: float) -> float:
    minimum = minimum_after_maximum(curve)
    return minimum.depth_n / (first_maximum(curve)[1] - static_n) if minimum else np.nan


def _plateau_widths(weld: WeldMap) -> list[float]:
    return [
        plateau_width(weld.speeds_kmh, force, SIGNIFICANT * (force.max() - weld.static_n)) for force in weld.force_n.T
    ]


def _linearity(weld: WeldMap) -> float:
    return float(np.median([curve.linearity for curve in weld.curves]))


def _share(weld: WeldMap, first_kmh: float, last_kmh: float) -> float:
    """Return the share of positions with a local minimum whose lowest force is in a range of speeds."""
    return float(np.mean([bool(_depths(curve, first_kmh, last_kmh)) for curve in weld.curves]))


def _mean_depth(weld: WeldMap, first_kmh: float, last_kmh: float) -> float:
    depths = [depth for curve in weld.curves for depth in _depths(curve, first_kmh, last_kmh)]
    return float(np.mean(depths)) if depths else np.nan


def _depths(curve: CurveFeatures, first_kmh: float, last_kmh: float) -> list[float]:
    return [minimum.depth_n for minimum in curve.hollows if first_kmh <= minimum.lowest_kmh <= last_kmh]


def _steepest_fall(speeds_kmh: FloatArray, force_n: FloatArray) -> float:
    """Return the largest -dF/dv from 60 to 120 km/h, 0 if the force only rises."""
    near = within(speeds_kmh, 60, 120)
    return float(max(0.0, *(-np.diff(force_n[near]) / np.diff(speeds_kmh[near]))))
