"""Study `map`: maximum force over speed and position of the five welds (Figs. 10, 16, 17, 20, 21)."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.core.curves import CurveFeatures, SurfaceFeatures, surface_features
from weld_force_ros.core.geometry import classify
from weld_force_ros.core.surface import Surface
from weld_force_ros.core.track import Real
from weld_force_ros.core.weld import wheel_trajectory
from weld_force_ros.report import new_figure
from weld_force_ros.studies.laboratory import BILBAO, WELDS, Investigation, Laboratory, Measured, Picture, grid_rows
from weld_force_ros.studies.passages import SIGNIFICANT, features, first_maximum, hollow_after_maximum
from weld_force_ros.studies.style import MAP, draw_map
from weld_force_ros.studies.tables import Cell, Column, Table

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

SPEEDS_KMH = (20.0, 300.0, 5.0)
# From the straightedge's start: weld 4's ramp with what lies 50 mm behind it, and weld 5's ramp.
_STRAIGHTEDGE_CENTRE_M = 0.5
_RAMP_4_M, _RAMP_5_M = (0.10, 0.20 + 0.05), (0.10, 0.25)


@dataclass(frozen=True)
class WeldMap:
    """Peaks over one weld; arrays over speed and position are (n_speed, n_position)."""

    name: str
    speeds_kmh: Real
    positions_m: Real
    span_m: float
    static_n: float
    surface: Surface

    @property
    def force_n(self) -> Real:
        """Peak forces."""
        return self.surface.peak_force_n

    @cached_property
    def curves(self) -> list[CurveFeatures]:
        """Of each position."""
        return [features(self.speeds_kmh, force) for force in self.force_n.T]

    @cached_property
    def shape(self) -> SurfaceFeatures:
        """Hollows, best and worst positions."""
        return surface_features(self.speeds_kmh, self.positions_m, self.force_n, self.span_m, tolerance=SIGNIFICANT)

    @property
    def place_m(self) -> Real:
        """Place of the peaks from the straightedge's start."""
        return np.asarray(self.surface.peak_x_m - self.positions_m + _STRAIGHTEDGE_CENTRE_M)

    def between(self, first_kmh: float, last_kmh: float) -> Real:
        """Mean over speeds, (n_position,)."""
        return np.asarray(self.force_n[within(self.speeds_kmh, first_kmh, last_kmh)].mean(axis=0))

    def relative_at(self, position_m: float, first_kmh: float, last_kmh: float) -> float:
        """Mean force at the nearest position over that of all, in a range of speeds."""
        mean = self.between(first_kmh, last_kmh)
        return float(mean[np.argmin(np.abs(self.positions_m - position_m))] / mean.mean())

    def position_spread(self) -> float:
        """Largest less smallest force over positions, as a share of the mean dynamic force: median over speeds."""
        force = self.force_n[self.speeds_kmh >= 50]
        return float(np.median(np.ptp(force, axis=1) / (force.mean(axis=1) - self.static_n)))


def within(values: Real, first: float, last: float) -> NDArray[np.bool_]:
    """Which values lie in a range, ends included."""
    return np.asarray((values >= first - 1e-9) & (values <= last + 1e-9))


def run(lab: Laboratory) -> Investigation:
    """Maps of every weld, with 3D surfaces."""
    began = time.perf_counter()
    maps = weld_maps(lab, lab.welds(*WELDS))
    seconds = (time.perf_counter() - began) / sum(m.force_n.size for m in maps)
    measured = _measured(lab, maps) | {"map.seconds_per_passage": seconds} if lab.papers else {}
    return Investigation(
        "map", "Maximum force over speed and position", [_picture(m) for m in maps],
        {"welds": _weld_table(lab, maps)} | {m.name: _map_table(m) for m in maps}, measured,
    )  # fmt: skip


def weld_maps(lab: Laboratory, names: Sequence[str], scale: float = 1.0) -> list[WeldMap]:
    """Maps of welds on the paper's track, heights times `scale`."""
    speeds, positions, rig = lab.speeds(*SPEEDS_KMH), lab.positions(BILBAO), lab.rig(BILBAO)
    profiles = [lab.weld(name) for name in names]
    rolled = [wheel_trajectory(np.array(p.x_m), scale * np.array(p.z_m), rig.wheel.radius_m) for p in profiles]
    surfaces = rig.surfaces(rolled, speeds, positions)
    span_m, static_n = rig.model.spacing_m, rig.wheel.static_load_n
    return [
        WeldMap(name, speeds, positions, span_m, static_n, surface)
        for name, surface in zip(names, surfaces, strict=True)
    ]


def _picture(weld: WeldMap) -> Picture:
    figure = new_figure(7.0, 3.5)
    solid: Any = figure.add_subplot(1, 2, 1, projection="3d")
    flat = figure.add_subplot(1, 2, 2)
    draw_surface(solid, weld.positions_m, weld.speeds_kmh, weld.force_n / 1e3, weld.span_m)
    solid.set_zlabel("peak force, kN", fontsize=8)
    image = draw_map(flat, weld.positions_m, weld.speeds_kmh, weld.force_n / 1e3, weld.span_m)
    outline(flat, weld.positions_m, weld.speeds_kmh, weld.shape.hollow, weld.span_m)
    figure.colorbar(image, ax=flat, label="peak force, kN")
    caption = (
        f"Peak force over {weld.name} against speed and the weld's position between two sleepers (dashed). Outlined: "
        f"hollows, where a lower speed gave more force; {weld.shape.hollow_share:.0%} of the positions have one."
    )
    return Picture(weld.name, weld.name, caption, figure)


def draw_surface(axes: "Axes3D", positions_m: Real, speeds_kmh: Real, values: Real, span_m: float, **how: Any) -> None:
    """Values (n_speed, n_position) as a 3D surface over position and speed, the span closed, sleepers dashed."""
    closed = np.append(positions_m, positions_m[0] + span_m) * 100
    values = np.column_stack([values, values[:, 0]])
    position, speed = np.meshgrid(closed, speeds_kmh)
    how = {"cmap": MAP, "rcount": 60, "ccount": 20, "edgecolor": "#00000040", "linewidth": 0.2} | how
    axes.plot_surface(position, speed, values, **how)
    for edge, column in ((closed[0], values[:, 0]), (closed[-1], values[:, -1])):
        axes.plot(np.full_like(speeds_kmh, edge), speeds_kmh, column, color="black", linestyle="--", linewidth=1.0)
    axes.set_xlabel("position, cm", fontsize=8)
    axes.set_ylabel("speed, km/h", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.view_init(elev=28, azim=-55)


def outline(axes: Any, positions_m: Real, speeds_kmh: Real, mask: NDArray[np.bool_], span_m: float) -> None:
    """White lines round the cells of a mask (n_speed, n_position) on a map."""
    if mask.any():
        closed = np.append(positions_m, positions_m[0] + span_m) * 100
        cells = np.column_stack([mask, mask[:, 0]]).astype(float)
        axes.contour(closed, speeds_kmh, cells, levels=[0.5], colors="white", linewidths=1.2)


def _weld_table(lab: Laboratory, maps: Sequence[WeldMap]) -> Table:
    columns = (
        Column("weld", "weld"), Column("kind", "kind"), Column("protrusion_over_dip", "protrusion / dip", 2),
        Column("hollow_share", "with a hollow", 2), Column("linearity_r2", "R² of a line", 3),
        Column("position_spread", "position spread", 3), Column("best_position_m", "best m", 2),
        Column("worst_position_m", "worst m", 2), Column("largest_force_n", "largest N", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for m in maps:
        profile = lab.weld(m.name)
        geometry = classify(profile.x_m, profile.z_m)
        rows.append((
            m.name, geometry.kind, geometry.ratio, m.shape.hollow_share, _linearity(m), m.position_spread(),
            m.shape.best_by_mean_m, m.shape.worst_by_mean_m, float(m.force_n.max()),
        ))  # fmt: skip
    return Table("Welds: shape of the force over speed and position", columns, rows)


def _map_table(weld: WeldMap) -> Table:
    columns = (
        Column("speed_kmh", "km/h", 0), Column("position_m", "m after sleeper", 2), Column("peak_force_n", "peak N", 0),
        Column("peak_x_m", "at m", 3), Column("min_force_n", "least N", 0), Column("contact_loss_s", "loss s", 4),
        Column("hollow", "hollow", 0),
    )  # fmt: skip
    s = weld.surface
    values = (s.peak_force_n, s.peak_x_m, s.min_force_n, s.contact_loss_s, weld.shape.hollow.astype(float))
    return Table(f"Peaks over {weld.name}", columns, grid_rows(weld.speeds_kmh, weld.positions_m, *values))


def _linearity(weld: WeldMap) -> float:
    return float(np.median([curve.linearity for curve in weld.curves]))


def _measured(lab: Laboratory, maps: Sequence[WeldMap]) -> Measured:
    first, second, third, fourth, fifth = maps
    spreads = [m.position_spread() for m in maps]
    tripled = weld_maps(lab, [fifth.name], scale=3.0)[0].position_spread()
    measured: Measured = {f"map.hollow_share_weld_{i}": _share(m, 0, np.inf) for i, m in enumerate(maps, start=1)}
    measured |= {f"map.standstill_weld_{i}_kmh": _standstills(m) for i, m in enumerate(maps[:3], start=1)}
    measured |= _of_weld_1(first) | _of_weld_2(second) | _of_weld_3(third)
    return measured | {
        "map.linearity_dip_welds": [_linearity(m) for m in maps[:3]],
        "map.linearity_weld_4": _linearity(fourth),
        "map.linearity_weld_5": _linearity(fifth),
        "map.position_spread_weld_4": spreads[3],
        "map.position_spread_ratio_weld_5_to_4": spreads[4] / spreads[3],
        "map.position_spread_ratio_dips_to_rises": float(np.mean(spreads[:3]) / np.mean(spreads[3:])),
        "map.position_spread_ratio_weld_5_tripled": tripled / spreads[4],
        "map.peak_on_ramp_share_weld_4": float(within(fourth.place_m, *_RAMP_4_M).mean()),
        "map.peak_up_ramp_weld_5": float(np.median((fifth.place_m - _RAMP_5_M[0]) / np.ptp(_RAMP_5_M))),
        "map.distinct_worst_positions": float(len({int(np.argmax(m.force_n.mean(axis=0))) for m in maps})),
    }


def _of_weld_1(weld: WeldMap) -> Measured:
    ahead = within(weld.positions_m, 0.10, 0.30)
    falls = np.array([_steepest_fall(weld.speeds_kmh, force) for force in weld.force_n.T])
    mean = weld.between(120, 200)
    before = weld.force_n[within(weld.speeds_kmh, 20, 200)].max(axis=0)
    beyond = weld.force_n[within(weld.speeds_kmh, 200, 250)].max(axis=0)
    return {
        "map.first_maximum_weld_1_kmh": [first_maximum(curve)[0] for curve in weld.curves],
        "map.relative_hollow_depth_weld_1": [_relative_depth(curve, weld.static_n) for curve in weld.curves],
        "map.fall_ratio_10_30cm_weld_1": float(falls[ahead].mean() / falls[~ahead].mean()) if falls.any() else np.nan,
        "map.relative_force_10_30cm_weld_1": float(mean[ahead].mean() / mean[~ahead].mean()),
        "map.growth_beyond_200kmh_weld_1": [float(g) for g in (beyond / before - 1)[ahead]],
    }


def _of_weld_2(weld: WeldMap) -> Measured:
    bottoms = np.array([_bottom(weld, i) for i, curve in enumerate(weld.curves) if curve.hollows])
    return {
        "map.best_position_weld_2_m": float(weld.positions_m[np.argmin(weld.between(80, 250))]),
        "map.relative_force_25cm_weld_2": weld.relative_at(0.24, 20, 120),
        "map.relative_force_40cm_weld_2": weld.relative_at(0.40, 20, 80),
        "map.hollow_floor_spread_weld_2": float(np.ptp(bottoms) / bottoms.mean()) if len(bottoms) else np.nan,
    }


def _bottom(weld: WeldMap, position: int) -> float:
    """Force at the bottom of a position's deepest hollow."""
    deepest = max(weld.curves[position].hollows, key=lambda hollow: hollow.depth_n)
    return float(weld.force_n[within(weld.speeds_kmh, deepest.from_kmh, deepest.to_kmh), position].min())


def _of_weld_3(weld: WeldMap) -> Measured:
    lost = (weld.surface.contact_loss_s > 0).any(axis=1)
    early = within(weld.positions_m, 0.0, 0.15)
    mean = weld.force_n.mean(axis=0)
    return {
        "map.hollow_share_120kmh_weld_3": _share(weld, 100, 140),
        "map.hollow_share_250kmh_weld_3": _share(weld, 225, 275),
        "map.hollow_depth_ratio_weld_3": _mean_depth(weld, 100, 140) / _mean_depth(weld, 225, 275),
        "map.first_contact_loss_weld_3_kmh": float(weld.speeds_kmh[np.argmax(lost)]) if lost.any() else np.nan,
        "map.relative_force_first_15cm_weld_3": float(mean[early].mean() / mean[~early].mean()),
    }


def _share(weld: WeldMap, first_kmh: float, last_kmh: float) -> float:
    """Share of positions with a hollow that is deepest in a range of speeds."""
    return float(np.mean([bool(_depths(curve, first_kmh, last_kmh)) for curve in weld.curves]))


def _mean_depth(weld: WeldMap, first_kmh: float, last_kmh: float) -> float:
    depths = [depth for curve in weld.curves for depth in _depths(curve, first_kmh, last_kmh)]
    return float(np.mean(depths)) if depths else np.nan


def _depths(curve: CurveFeatures, first_kmh: float, last_kmh: float) -> list[float]:
    return [hollow.depth_n for hollow in curve.hollows if first_kmh <= hollow.lowest_kmh <= last_kmh]


def _relative_depth(curve: CurveFeatures, static_n: float) -> float:
    hollow = hollow_after_maximum(curve)
    return hollow.depth_n / (first_maximum(curve)[1] - static_n) if hollow else np.nan


def _steepest_fall(speeds_kmh: Real, force_n: Real) -> float:
    """Largest -dF/dv from 60 to 120 km/h, 0 if the force only rises."""
    near = within(speeds_kmh, 60, 120)
    return float(max(0.0, *(-np.diff(force_n[near]) / np.diff(speeds_kmh[near]))))


def _standstills(weld: WeldMap) -> list[float]:
    return [standstill(weld.speeds_kmh, force, SIGNIFICANT * (force.max() - weld.static_n)) for force in weld.force_n.T]


def standstill(speeds_kmh: Real, force_n: Real, tolerance_n: float) -> float:
    """Width of the widest speed interval in which the force exceeds that at its beginning by no more than a tolerance.

    It begins at a given speed; its end lies between two where the force is linear.
    """
    widths = []
    for k, speed in enumerate(speeds_kmh):
        bound = force_n[k] + tolerance_n
        above = np.flatnonzero(force_n[k:] > bound)
        end = speeds_kmh[-1]
        if len(above):
            rise = slice(k + above[0] - 1, k + above[0] + 1)
            end = np.interp(bound, force_n[rise], speeds_kmh[rise])
        widths.append(float(end - speed))
    return max(widths)
