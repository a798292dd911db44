"""Study `population`: does a weld's geometry tell how its force grows with speed?

After sections 4, 7 and 8 of the paper. Hundreds of synthetic welds (`measurement.synthetic_welds`) are rolled over,
sorted by their geometry alone, and the classes held against what the forces did. Each weld with a dip is also rolled
over upside down.
"""

from dataclasses import asdict

import numpy as np

from weld_force_ros.measurement.synthetic_welds import population, without_short_waves
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies import population_figures as figures
from weld_force_ros.studies.laboratory import BILBAO, Measured, Picture, StudyContext, StudyResult, as_columns
from weld_force_ros.studies.population_rolling import (
    KINDS,
    POSITIONS_M,
    THIRDS,
    Case,
    Curve,
    Inverted,
    curve,
    curves_of,
    inverted,
    median_linearity,
    parametric_share,
    ratio_quartiles,
    rolled,
    with_hollow,
)
from weld_force_ros.studies.tables import Cell, Column, Table

COUNT, COARSE_COUNT, SEED = 500, 60, 2018


def run(lab: StudyContext) -> StudyResult:
    """Roll over the population, with the user's own weld at its side."""
    speeds = lab.speeds(20, 300, 10)
    welds = list(population(COARSE_COUNT if lab.coarse else COUNT, SEED))
    cases = rolled(lab, speeds, welds)
    without = rolled(lab, speeds, [without_short_waves(weld) for weld in welds])
    pairs = inverted(lab, speeds, cases)
    pictures = [
        Picture(
            "population-profiles", "Synthetic welds",
            "The first three welds of each class, and of those with the least gradients. How a weld was made is not "
            "asked: its geometry decides.", figures.examples(cases),
        ),
        Picture(
            "population-hollows", "Does the force fall with speed?",
            "Share of force-speed curves with a hollow, by class and by the steepness of the weld's gradients; numbers "
            "are curves with a hollow of all curves. Right: the same welds without their short waves, classified anew.",
            figures.hollow_shares(cases, without),
        ),
        Picture(
            "population-linearity", "How straight is the curve?",
            "R² of the line through each force-speed curve: share of the curves of a class that are no straighter. "
            "The further to the right a curve runs, the more linear its class.",
            figures.linearities(cases, without, _own_curves(lab, speeds)),
        ),
        Picture(
            "population-inverted", "Dips against protrusions of the same shape",
            "Each weld with a dip, and the same upside down. Left: share of the welds whose dip gives less force. "
            "Right: the dip's dynamic force over that of its inversion if that is a protrusion, by the frequency at "
            "which the main wave is passed; half of the passages lie in the band.",
            figures.against_inverted(speeds, pairs),
        ),
    ]  # fmt: skip
    tables = {"classes": _classes(cases, without), "welds": _welds(cases), "inverted": _inversions(speeds, pairs)}
    measured = _measured(lab, speeds, cases, pairs) if lab.papers else {}
    return StudyResult("population", "A population of welds", pictures, tables, measured)


def _own_curves(lab: StudyContext, speeds: FloatArray) -> list[Curve]:
    if lab.own_weld is None:
        return []
    peak_map = lab.peak_map(lab.own_weld.weld_id, BILBAO, speeds, POSITIONS_M)
    return [curve(speeds, force_n) for force_n in peak_map.peak_force_n.T]


def _classes(cases: list[Case], without: list[Case]) -> Table:
    columns = (
        Column("class", "class"), Column("welds", "welds"), Column("curves", "curves"),
        Column("monotonic", "monotonic"), Column("with_hollow", "with a hollow"),
        Column("share_with_hollow", "share", 3), Column("median_deepest_fall", "median fall", 3),
        Column("median_linearity_r2", "median R²", 3),
    )  # fmt: skip
    groups = [("all", cases, None), *((name, cases, third) for third, name in enumerate(THIRDS))]
    rows = [
        _class_row(kind or "both", name, curves_of(group, kind, third))
        for name, group, third in (*groups, ("all, without short waves", without, None))
        for kind in (*KINDS, None)
    ]
    return Table("Class of the geometry against the force over speed", columns, rows)


def _class_row(kind: str, group: str, curves: list[Curve]) -> tuple[Cell, ...]:
    count, fallen = len(curves), with_hollow(curves)
    if not curves:
        return kind, group, 0, 0, 0, None, None, None
    fall = float(np.median([curve.fall for curve in curves]))
    return kind, group, count, count - fallen, fallen, fallen / count, fall, median_linearity(curves)


def _welds(cases: list[Case]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            case.weld.weld_id, *asdict(case.weld.parameters).values(), case.geometry.kind, case.geometry.dip_m,
            case.geometry.protrusion_m, case.gradient_rad, float(position), curve.monotonic, curve.fall,
            curve.linearity, float(largest_n),
        )
        for case in cases
        for position, curve, largest_n in zip(
            POSITIONS_M, case.curves, case.peak_map.peak_force_n.max(axis=0), strict=True
        )
    ]  # fmt: skip
    names = (
        "weld_id", *asdict(cases[0].weld.parameters), "class", "dip_m", "protrusion_m", "gradient_rad", "position_m",
        "monotonic", "deepest_fall", "linearity_r2", "largest_peak_force_n",
    )  # fmt: skip
    return Table("Welds: made with, classified, rolled over", tuple(map(Column, names)), rows)


def _inversions(speeds: FloatArray, pairs: Inverted) -> Table:
    below = (pairs.dip_n < pairs.rise_n).mean(axis=(0, 2))
    columns = (
        Column("speed_kmh", "km/h", 0), Column("share_dip_below", "dip gives less", 3),
        Column("ratio_lower_quartile", "ratio: lower quartile", 3), Column("ratio_median", "median", 3),
        Column("ratio_upper_quartile", "upper quartile", 3),
    )  # fmt: skip
    return Table(
        "Dynamic force over dips, relative to the same inverted", columns,
        as_columns(speeds, below, *ratio_quartiles(pairs)),
    )  # fmt: skip


def _measured(lab: StudyContext, speeds: FloatArray, cases: list[Case], pairs: Inverted) -> Measured:
    dips, protrusions = (curves_of(cases, kind) for kind in KINDS)
    return {
        "population.non_monotonic_share_dips": with_hollow(dips) / max(len(dips), 1),
        "population.non_monotonic_share_protrusions": with_hollow(protrusions) / max(len(protrusions), 1),
        "population.linearity_dips": median_linearity(dips),
        "population.linearity_protrusions": median_linearity(protrusions),
        "population.dip_below_protrusion_share": float(np.mean(pairs.dip_n < pairs.rise_n)),
        "population.parametric_dominates_share_smooth": parametric_share(lab, speeds, cases),
    }
