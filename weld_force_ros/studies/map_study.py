"""Study `map`: maximum force over speed and position of the five welds (Figs. 10, 16, 17, 20, 21)."""

import time
from collections.abc import Sequence

import numpy as np

from weld_force_ros.physics.analysis.geometry import classify
from weld_force_ros.studies import map_figures
from weld_force_ros.studies.map_quantities import linearity, of_weld
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import WELDS, Quantities, StudyContext, StudyResult, grid_rows
from weld_force_ros.studies.weld_map import WeldMap, weld_maps


def run(context: StudyContext) -> StudyResult:
    """Compute maps of every weld, drawn with 3D surfaces."""
    began = time.perf_counter()
    maps = weld_maps(context, {name: context.profile(name) for name in context.welds(*WELDS)})
    seconds = (time.perf_counter() - began) / sum(m.force_n.size for m in maps)
    measured = (
        quantities_over(context, maps) | {"map.seconds_per_passage": seconds} if context.uses_paper_inputs else {}
    )
    return StudyResult(
        "map", "Maximum force over speed and position", [map_figures.picture(m) for m in maps],
        {"welds": _weld_table(maps)} | {m.file_name: _map_table(m) for m in maps}, measured,
    )  # fmt: skip


def _weld_table(maps: Sequence[WeldMap]) -> Table:
    columns = (
        Column("weld", "weld"), Column("kind", "kind"), Column("dip_m"), Column("protrusion_m"),
        Column("minimum_share", "with a local minimum", 2), Column("linearity_r2", "R² of a line", 3),
        Column("position_spread", "position spread", 3), Column("best_position_m", "best m", 2),
        Column("worst_position_m", "worst m", 2), Column("largest_force_n", "largest N", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for m in maps:
        geometry = classify(*m.profile)
        rows.append((
            m.name, geometry.kind, geometry.dip_m, geometry.protrusion_m, m.shape.hollow_share, linearity(m),
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


def quantities_over(context: StudyContext, maps: Sequence[WeldMap]) -> Quantities:
    """Return what claims ask for, over maps of five welds in the place of the paper's."""
    measured: Quantities = {}
    for number, weld in enumerate(maps, start=1):
        measured |= of_weld(number, weld)
    spreads = [m.position_spread() for m in maps]
    x, z = maps[4].profile
    (tripled,) = weld_maps(context, {maps[4].name: (x, 3.0 * z)})
    return measured | {
        "map.linearity_dip_welds": [linearity(m) for m in maps[:3]],
        "map.position_spread_ratio_weld_5_to_4": spreads[4] / spreads[3],
        "map.position_spread_ratio_dips_to_rises": float(np.mean(spreads[:3]) / np.mean(spreads[3:])),
        "map.position_spread_ratio_weld_5_tripled": tripled.position_spread() / spreads[4],
        "map.distinct_worst_positions": float(len({int(np.argmax(m.force_n.mean(axis=0))) for m in maps})),
    }
