"""Study `population`: does a weld's geometry predict how its force grows with speed?

After sections 4, 7 and 8 of the paper. Hundreds of synthetic welds (`measurement.synthetic_welds`) are simulated and
sorted by their geometry alone, and the classes compared with how their force grows. Each weld with a dip is also
simulated upside down.
"""

from dataclasses import asdict

import numpy as np

from weld_force_ros.measurement.synthetic_welds import population, without_short_waves
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies import population_figures as figures
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.simulated_population import (
    KINDS,
    POSITIONS_M,
    THIRDS,
    CurveShape,
    InvertedDips,
    SimulatedWeld,
    count_falling,
    curve_shape,
    curves_of,
    invert_dips,
    median_linearity,
    parametric_share,
    ratio_quartiles,
    simulate_welds,
)
from weld_force_ros.studies.study_context import BILBAO, Picture, Quantities, StudyContext, StudyResult, as_rows

COUNT, COARSE_COUNT, SEED = 500, 60, 2018


def run(context: StudyContext) -> StudyResult:
    """Simulate the population, with the user's own weld beside it."""
    speeds = context.speeds(20, 300, 10)
    welds = list(population(COARSE_COUNT if context.coarse else COUNT, SEED))
    simulated_welds = simulate_welds(context, speeds, welds)
    without = simulate_welds(context, speeds, [without_short_waves(weld) for weld in welds])
    pairs = invert_dips(context, speeds, simulated_welds)
    pictures = [
        Picture(
            "population-profiles", "Synthetic welds",
            "The first three welds of each class, and of those with the least gradients. The class "
            "follows from the geometry, not from how a weld was made.", figures.examples(simulated_welds),
        ),
        Picture(
            "population-falling", "Does the force fall with speed?",
            "Share of force-speed curves with a local minimum, by class and by the steepness of the weld's gradients; "
            "numbers are those curves of all curves. Right: the same welds without their short waves, classified anew.",
            figures.falling_shares(simulated_welds, without),
        ),
        Picture(
            "population-linearity", "How straight is the curve?",
            "R² of the line through each force-speed curve: share of the curves of a class that are no straighter. "
            "The further to the right a curve runs, the more linear its class.",
            figures.linearities(simulated_welds, without, _own_curves(context, speeds)),
        ),
        Picture(
            "population-inverted", "Dips against protrusions of the same shape",
            "Each weld with a dip, and the same upside down. Left: share of the welds whose dip gives less force. "
            "Right: the dip's dynamic force over that of its inversion if that is a protrusion, by the frequency at "
            "which the main wave is passed; half of the passages lie in the band.",
            figures.against_inverted(speeds, pairs),
        ),
    ]  # fmt: skip
    tables = {
        "classes": _classes(simulated_welds, without),
        "welds": _welds(simulated_welds),
        "inverted": _inversions(speeds, pairs),
    }
    measured = _claim_quantities(context, speeds, simulated_welds, pairs) if context.uses_paper_inputs else {}
    return StudyResult("population", "A population of welds", pictures, tables, measured)


def _own_curves(context: StudyContext, speeds: FloatArray) -> list[CurveShape]:
    if context.own_weld is None:
        return []
    peak_map = context.peak_map(context.own_weld.weld_id, BILBAO, speeds, POSITIONS_M)
    return [curve_shape(speeds, force_n) for force_n in peak_map.peak_force_n.T]


def _classes(simulated_welds: list[SimulatedWeld], without: list[SimulatedWeld]) -> Table:
    columns = (
        Column("class", "class"), Column("welds", "welds"), Column("curves", "curves"),
        Column("monotonic", "monotonic"), Column("falling", "with a local minimum"),
        Column("share_falling", "share", 3), Column("median_deepest_fall", "median fall", 3),
        Column("median_linearity_r2", "median R²", 3),
    )  # fmt: skip
    groups = [("all", simulated_welds, None), *((name, simulated_welds, third) for third, name in enumerate(THIRDS))]
    rows = [
        _class_row(kind or "both", name, curves_of(group, kind, third))
        for name, group, third in (*groups, ("all, without short waves", without, None))
        for kind in (*KINDS, None)
    ]
    return Table("Class of the geometry against the force over speed", columns, rows)


def _class_row(kind: str, group: str, curves: list[CurveShape]) -> tuple[Cell, ...]:
    count, falling = len(curves), count_falling(curves)
    if not curves:
        return kind, group, 0, 0, 0, None, None, None
    fall = float(np.median([curve.fall for curve in curves]))
    return kind, group, count, count - falling, falling, falling / count, fall, median_linearity(curves)


def _welds(simulated_welds: list[SimulatedWeld]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            simulated.weld.weld_id, *asdict(simulated.weld.parameters).values(), simulated.geometry.kind,
            simulated.geometry.dip_m, simulated.geometry.protrusion_m, simulated.gradient_rad, float(position),
            curve.monotonic, curve.fall, curve.linearity, float(largest_n),
        )
        for simulated in simulated_welds
        for position, curve, largest_n in zip(
            POSITIONS_M, simulated.curves, simulated.peak_map.peak_force_n.max(axis=0), strict=True
        )
    ]  # fmt: skip
    names = (
        "weld_id", *asdict(simulated_welds[0].weld.parameters), "class", "dip_m", "protrusion_m", "gradient_rad",
        "position_m", "monotonic", "deepest_fall", "linearity_r2", "largest_peak_force_n",
    )  # fmt: skip
    return Table("Welds: parameters, class of the geometry, force-speed curves", tuple(map(Column, names)), rows)


def _inversions(speeds: FloatArray, pairs: InvertedDips) -> Table:
    below = (pairs.dip_n < pairs.rise_n).mean(axis=(0, 2))
    columns = (
        Column("speed_kmh", "km/h", 0), Column("share_dip_below", "dip gives less", 3),
        Column("ratio_lower_quartile", "ratio: lower quartile", 3), Column("ratio_median", "median", 3),
        Column("ratio_upper_quartile", "upper quartile", 3),
    )  # fmt: skip
    return Table(
        "Dynamic force over dips, relative to the same inverted", columns,
        as_rows(speeds, below, *ratio_quartiles(pairs)),
    )  # fmt: skip


def _claim_quantities(
    context: StudyContext, speeds: FloatArray, simulated_welds: list[SimulatedWeld], pairs: InvertedDips
) -> Quantities:
    dips, protrusions = (curves_of(simulated_welds, kind) for kind in KINDS)
    return {
        "population.non_monotonic_share_dips": count_falling(dips) / max(len(dips), 1),
        "population.non_monotonic_share_protrusions": count_falling(protrusions) / max(len(protrusions), 1),
        "population.linearity_dips": median_linearity(dips),
        "population.linearity_protrusions": median_linearity(protrusions),
        "population.dip_below_protrusion_share": float(np.mean(pairs.dip_n < pairs.rise_n)),
        "population.parametric_dominates_share_smooth": parametric_share(context, speeds, simulated_welds),
    }
