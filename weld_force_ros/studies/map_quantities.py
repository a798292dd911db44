"""What the map of each of the paper's welds says, by the names under which the claims ask for it."""

import numpy as np

from weld_force_ros.physics.analysis.speed_curve import CurveFeatures
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies.passage_curves import SIGNIFICANT, first_maximum, minimum_after_maximum
from weld_force_ros.studies.study_context import Quantities
from weld_force_ros.studies.weld_map import WeldMap, plateau_width, upward_ramp, within

_FORCE_LAGS_M = 0.05
_WITH_DIP = (1, 2, 3)


def of_weld(number: int, weld: WeldMap) -> Quantities:
    """Return all that claims ask for of weld 1 to 5 alone."""
    measured: Quantities = {f"map.minimum_share_weld_{number}": _share(weld, 0, np.inf)}
    if number in _WITH_DIP:
        measured[f"map.plateau_weld_{number}_kmh"] = _plateau_widths(weld)
        measured["map.linearity_dip_welds"] = [linearity(weld)]
    else:
        measured[f"map.linearity_weld_{number}"] = linearity(weld)
    return measured | (_of_weld_1, _of_weld_2, _of_weld_3, _of_weld_4, _of_weld_5)[number - 1](weld)


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


def _of_weld_4(weld: WeldMap) -> Quantities:
    start_m, end_m = upward_ramp(weld.profile)
    on_ramp = within(weld.peak_location_m, start_m, end_m + _FORCE_LAGS_M)
    return {
        "map.position_spread_weld_4": weld.position_spread(),
        "map.peak_on_ramp_share_weld_4": float(on_ramp.mean()),
    }


def _of_weld_5(weld: WeldMap) -> Quantities:
    start_m, end_m = upward_ramp(weld.profile)
    return {"map.peak_up_ramp_weld_5": float(np.median((weld.peak_location_m - start_m) / (end_m - start_m)))}


def _relative_depth(curve: CurveFeatures, static_n: float) -> float:
    minimum = minimum_after_maximum(curve)
    return minimum.depth_n / (first_maximum(curve)[1] - static_n) if minimum else np.nan


def _plateau_widths(weld: WeldMap) -> list[float]:
    return [
        plateau_width(weld.speeds_kmh, force, SIGNIFICANT * (force.max() - weld.static_n)) for force in weld.force_n.T
    ]


def linearity(weld: WeldMap) -> float:
    """Return R^2 of the straight line over speed, median over the positions."""
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
