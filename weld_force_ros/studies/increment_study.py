"""Study `increment`: what a weld adds to the force on smooth rail (Fig. 22).

The dynamic force is the peak less the static load; the increment is the largest excess over the force that the same
wheel had at the same location on smooth rail.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from weld_force_ros.physics.analysis.speed_curve import SurfaceFeatures, surface_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies.figure_style import draw_map
from weld_force_ros.studies.map_figures import draw_surface, name_sleepers, outline
from weld_force_ros.studies.passage_curves import SIGNIFICANT, SmoothRailPassage, features
from weld_force_ros.studies.result_table import Column, Table
from weld_force_ros.studies.study_context import (
    BILBAO,
    WELDS,
    Picture,
    Profile,
    Quantities,
    StudyContext,
    StudyResult,
    grid_rows,
)
from weld_force_ros.studies.weld_map import SPEEDS_KMH, within

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ForceExcess:
    """Forces over one weld, each (n_speed, n_position).

    Attributes:
        dynamic_n: peak force less the static load.
        increment_n: largest excess over smooth rail.
        smooth_n: dynamic force on smooth rail at the peak's location.
    """

    dynamic_n: FloatArray
    increment_n: FloatArray
    smooth_n: FloatArray


def run(context: StudyContext) -> StudyResult:
    """Compute dynamic force and increment over speed and position."""
    (weld,) = context.welds(WELDS[0])
    speeds, positions, span_m = (
        context.speeds(*SPEEDS_KMH),
        context.positions(BILBAO),
        context.track(BILBAO).track.spacing_m,
    )
    excess = _excess(context, weld, speeds, positions)
    surfaces = _surfaces(speeds, positions, excess, span_m)
    pictures = [
        Picture(
            "increment", f"Dynamic force and increment: {weld}",
            "(a) Peak force less the static load. (b) Largest excess over the force on smooth rail at the same "
            "location. Outlined and hatched: local minima, where a lower speed gave more.",
            _draw(speeds, positions, excess, surfaces, span_m),
        ),
        Picture(
            "difference", f"Dynamic force less increment: {weld}",
            "(a) less (b). Positive, red: smooth rail alone had more than the static load where the peak occurs.",
            _draw_difference(speeds, positions, excess, span_m),
        ),
    ]  # fmt: skip
    columns = (
        Column("speed_kmh", "km/h", 0), Column("position_m", "m after sleeper", 2),
        Column("dynamic_force_n", "dynamic N", 0), Column("increment_n", "increment N", 0),
        Column("smooth_rail_dynamic_n", "smooth N", 0),
    )  # fmt: skip
    rows = grid_rows(speeds, positions, excess.dynamic_n, excess.increment_n, excess.smooth_n)
    table = Table(f"Dynamic force and increment over {weld}", columns, rows)
    measured = _claim_quantities(speeds, positions, excess, surfaces, span_m) if context.uses_paper_inputs else {}
    return StudyResult("increment", "Increment over smooth rail", pictures, {"increment": table}, measured)


def quantities_over_weld_1(context: StudyContext, weld: Profile) -> Quantities:
    """Return what claims ask for of weld 1, over a profile in its place."""
    speeds, positions = context.speeds(*SPEEDS_KMH), context.positions(BILBAO)
    excess, span_m = _excess(context, weld, speeds, positions), context.track(BILBAO).track.spacing_m
    return _claim_quantities(speeds, positions, excess, _surfaces(speeds, positions, excess, span_m), span_m)


def _surfaces(speeds: FloatArray, positions: FloatArray, excess: ForceExcess, span_m: float) -> list[SurfaceFeatures]:
    """Return the shape of the dynamic force and of the increment."""
    return [
        surface_features(speeds, positions, force, span_m, tolerance=SIGNIFICANT)
        for force in (excess.dynamic_n, excess.increment_n)
    ]


def _excess(context: StudyContext, weld: str | Profile, speeds_kmh: FloatArray, positions_m: FloatArray) -> ForceExcess:
    # Made once, before threads ask for them.
    wheel_path, vehicle_track = context.wheel_path(weld, BILBAO), context.vehicle_track(BILBAO)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = pool.map(partial(_at_speed, context, vehicle_track, wheel_path, positions_m), speeds_kmh.tolist())
        return ForceExcess(*np.stack(list(rows), axis=1))


def _at_speed(
    context: StudyContext,
    vehicle_track: VehicleTrackModel,
    wheel_path: WheelPath,
    positions_m: FloatArray,
    speed_kmh: float,
) -> FloatArray:
    """Return the fields of `ForceExcess` at one speed, (3, n_position)."""
    smooth, static_n = SmoothRailPassage(context, BILBAO, speed_kmh), vehicle_track.wheel.static_load_n
    stride = context.stride(BILBAO, speed_kmh)
    found = np.empty((3, len(positions_m)))
    for column, position in enumerate(positions_m.tolist()):
        history = vehicle_track.history(wheel_path, speed_kmh, position, stride=stride)
        without_n = smooth.force_n(history.x_m)
        peak = int(np.argmax(history.force_n))
        found[:, column] = (
            history.force_n[peak] - static_n,
            (history.force_n - without_n).max(),
            without_n[peak] - static_n,
        )
    return found


def _draw(
    speeds: FloatArray, positions: FloatArray, excess: ForceExcess, surfaces: list[SurfaceFeatures], span_m: float
) -> "Figure":
    figure = new_figure(7.0, 6.2)
    grid = figure.add_gridspec(2, 2)
    forces = (excess.dynamic_n / 1e3, excess.increment_n / 1e3)
    highest = max(float(force.max()) for force in forces)
    scale = {"vmin": 0.0, "vmax": highest}
    maps: list[Any] = []
    image: Any = None
    titles = ("(a) dynamic force, kN", "(b) increment, kN")
    for column, (force, shape, title) in enumerate(zip(forces, surfaces, titles, strict=True)):
        solid: Any = figure.add_subplot(grid[0, column], projection="3d")
        draw_surface(solid, positions, speeds, force, span_m, **scale)
        solid.set_zlim(0, highest)
        solid.set_title(title, fontsize=10, y=0.98)
        maps.append(figure.add_subplot(grid[1, column]))
        image = draw_map(maps[-1], positions, speeds, force, span_m, **scale)
        outline(maps[-1], positions, speeds, shape.hollow, span_m)
        name_sleepers(maps[-1], span_m)
        maps[-1].set_title(title, fontsize=10, pad=16)
    maps[1].set_ylabel("")
    figure.colorbar(image, ax=maps, label="kN")
    return figure


def _draw_difference(speeds: FloatArray, positions: FloatArray, excess: ForceExcess, span_m: float) -> "Figure":
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    difference = (excess.dynamic_n - excess.increment_n) / 1e3
    most = float(np.abs(difference).max())
    image = draw_map(axes, positions, speeds, difference, span_m, vmin=-most, vmax=most)
    image.set_cmap("RdBu_r")
    name_sleepers(axes, span_m)
    figure.colorbar(image, ax=axes, label="dynamic force less increment, kN")
    return figure


def _claim_quantities(
    speeds: FloatArray, positions: FloatArray, excess: ForceExcess, surfaces: list[SurfaceFeatures], span_m: float
) -> Quantities:
    dynamic, increment = excess.dynamic_n, excess.increment_n
    cells = [int(shape.hollow.sum()) for shape in surfaces]
    near = within(positions, 0.15, 0.35)
    curves = [features(speeds, force) for force in increment[:, near].T]
    has_minimum = [any(120 <= minimum.lowest_kmh <= 200 for minimum in curve.hollows) for curve in curves]
    above = dynamic > increment
    depressions = [_depressions(force) for force in (dynamic, increment)]
    return {
        "increment.minimum_cells_ratio": cells[1] / cells[0] if cells[0] else np.nan,
        "increment.depressions_ratio": depressions[1] / depressions[0] if depressions[0] else np.nan,
        "increment.minimum_share_120_200kmh_15_35cm": float(np.mean(has_minimum)),
        "increment.spread_ratio": _spread(increment) / _spread(dynamic),
        "increment.roughness_ratio": _roughness(increment) / _roughness(dynamic),
        "increment.sleeper_distance_highest_m": _sleeper_distance_of_highest(positions, increment, span_m),
        "increment.share_a_above_b": float(above.mean()),
        "increment.smooth_above_static_share": float((excess.smooth_n[above] > 0).mean()) if above.any() else np.nan,
    }


def _depressions(force_n: FloatArray) -> int:
    """Return how many cells are lower than all eight around them, round the span; not at the first or last speed."""
    around = np.pad(force_n, ((0, 0), (1, 1)), mode="wrap")
    neighbourhoods = np.lib.stride_tricks.sliding_window_view(around, (3, 3)).reshape(-1, 9)
    centre, neighbours = neighbourhoods[:, 4], np.delete(neighbourhoods, 4, axis=1)
    return int(np.sum(centre < neighbours.min(axis=1)))


def _spread(force_n: FloatArray) -> float:
    return float(np.median(np.ptp(force_n, axis=1)))


def _roughness(force_n: FloatArray) -> float:
    """Return the RMS of second differences along the position, round the span."""
    second = np.roll(force_n, 1, axis=1) - 2 * force_n + np.roll(force_n, -1, axis=1)
    return float(np.sqrt(np.mean(second**2)))


def _sleeper_distance_of_highest(positions_m: FloatArray, force_n: FloatArray, span_m: float) -> float:
    """Return the mean distance to the nearest sleeper of the highest twentieth of cells."""
    distance = np.broadcast_to(np.minimum(positions_m, span_m - positions_m), force_n.shape)
    count = max(1, round(0.05 * force_n.size))
    return float(distance.ravel()[np.argsort(force_n, axis=None)[-count:]].mean())
