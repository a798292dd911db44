"""Study `curve`: maximum force against speed, and how the peak of the force splits (Fig. 11)."""

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.peaks import ImpactForces, Peak, p1_p2
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies.figure_style import COLOURS
from weld_force_ros.studies.passage_curves import (
    features,
    first_maximum,
    minimum_after_maximum,
    split_peaks,
    two_highest,
)
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import (
    BILBAO,
    WELDS,
    Picture,
    Profile,
    Quantities,
    StudyContext,
    StudyResult,
    as_rows,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POSITION_M = 0.15
HISTORIES_KMH = {"A": 55.0, "B": 80.0, "C": 150.0, "D": 170.0, "E": 200.0}
_SPEEDS_KMH = (20.0, 300.0, 2.0)
_SHOWN_M = (-0.3, 0.5)
_EVERY = 4  # points of the 0.25 mm grid, in the table
_FORCE, _WELD, _IMPACT = COLOURS[0], COLOURS[1], COLOURS[2]


def run(context: StudyContext) -> StudyResult:
    """Compute the force against speed at one position, and five of its passages."""
    (weld,) = context.welds(WELDS[0])
    speeds = context.speeds(*_SPEEDS_KMH)
    peak_map = context.peak_map(weld, BILBAO, speeds, [POSITION_M])
    histories = {speed: context.history(weld, BILBAO, speed, POSITION_M) for speed in HISTORIES_KMH.values()}
    impacts = {speed: impact_forces(context, weld, history, speed) for speed, history in histories.items()}
    figure = _draw(context, weld, speeds, peak_map.peak_force_n[:, 0], histories, impacts)
    picture = Picture(
        "force-against-speed", f"Force against speed: {weld}",
        f"Above: peak force over {weld}, centred {POSITION_M * 100:g} cm after a sleeper, against speed. Below: the "
        "force along the rail at the points A to E; dots are the peaks that stand out, triangles the forces P1 (up) "
        "and P2 (down) as of a dipped joint: P2 is that below 120 Hz. Last: the weld.", figure,
    )  # fmt: skip
    tables = {
        "curve": Table(
            "Peak force against speed",
            (Column("speed_kmh", "km/h", 0), Column("peak_force_n", "peak N", 0), Column("peak_x_m", "at m", 3)),
            as_rows(speeds, peak_map.peak_force_n, peak_map.peak_x_m),
        ),
        "histories": Table(
            "Force along the rail; x from the weld's centre",
            (Column("speed_kmh", "km/h", 0), Column("x_m", "m", 4), Column("force_n", "N", 0)),
            [(speed, *row) for speed, h in histories.items() for row in _rows(h)],
        ),
        "impact": _impact_table(impacts),
    }
    measured = _claim_quantities(context, speeds, peak_map, histories) if context.uses_paper_inputs else {}
    return StudyResult("curve", "Force against speed", [picture], tables, measured)


def impact_forces(context: StudyContext, weld: str, history: History, speed_kmh: float) -> ImpactForces | None:
    """Return P1 and P2 of a passage as over a dipped joint, None if the weld is level or no peak follows its angle.

    The wheel arrives where the upward curvature is largest, which is where a dipped joint has its angle.
    """
    profile = context.weld(weld)
    curvature_per_m = CubicSpline(profile.x_m, profile.z_m)(profile.x_m, 2)
    if not np.any(curvature_per_m > 0):
        return None
    arrival_m = POSITION_M + profile.x_m[int(np.argmax(curvature_per_m))]
    speed_m_s = speed_kmh / 3.6
    try:
        return p1_p2(history.x_m / speed_m_s, history.force_n, arrival_m / speed_m_s)
    except InputError:
        return None


def _locations_m(impact: ImpactForces, speed_kmh: float) -> tuple[float, float]:
    """Return where P1 and P2 act, m after the weld's centre."""
    return impact.p1_s * speed_kmh / 3.6 - POSITION_M, impact.p2_s * speed_kmh / 3.6 - POSITION_M


def _impact_table(impacts: dict[float, ImpactForces | None]) -> Table:
    columns = (
        Column("speed_kmh", "km/h", 0), Column("p1_n", "P1, N", 0), Column("p1_x_m", "at m", 3),
        Column("p2_n", "P2, N", 0), Column("p2_x_m", "at m", 3),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for speed, impact in impacts.items():
        if impact is None:
            rows.append((speed, None, None, None, None))
        else:
            p1_m, p2_m = _locations_m(impact, speed)
            rows.append((speed, impact.p1_n, p1_m, impact.p2_n, p2_m))
    return Table("P1 and P2 of the passages, as over a dipped joint; x from the weld's centre", columns, rows)


def _rows(history: History) -> list[tuple[float, ...]]:
    x = history.x_m - POSITION_M
    shown = np.flatnonzero((x >= _SHOWN_M[0]) & (x <= _SHOWN_M[1]))[::_EVERY]
    return as_rows(x[shown], history.force_n[shown])


def _draw(
    context: StudyContext,
    weld: str,
    speeds: FloatArray,
    force_n: FloatArray,
    histories: dict[float, History],
    impacts: dict[float, ImpactForces | None],
) -> "Figure":
    figure = new_figure(7.0, 7.0)
    grid = figure.add_gridspec(3, 3, height_ratios=[1.5, 1, 1])
    above = figure.add_subplot(grid[0, :])
    above.plot(speeds, force_n / 1e3, color=_FORCE)
    for letter, speed in HISTORIES_KMH.items():
        at = float(histories[speed].force_n.max()) / 1e3
        above.plot(speed, at, "o", color=_WELD)
        above.annotate(letter, (speed, at), xytext=(0, 6), textcoords="offset points", ha="center", weight="bold")
    above.margins(y=0.12)
    above.set(xlabel="speed, km/h", ylabel="peak force, kN")
    panels: list[Any] = [figure.add_subplot(grid[1 + i // 3, i % 3]) for i in range(6)]
    for axes, (letter, speed) in zip(panels, HISTORIES_KMH.items(), strict=False):
        axes.sharey(panels[0])
        _draw_history(axes, histories[speed], context.track(BILBAO).wheel.static_load_n)
        _draw_impact(axes, impacts[speed], speed)
        axes.set_title(f"{letter}: {speed:g} km/h", fontsize=9)
    for axes in (panels[0], panels[3]):
        axes.set_ylabel("force, kN")
    profile = context.weld(weld)
    panels[5].plot(np.array(profile.x_m) * 100, np.array(profile.z_m) * 1e6, color=_WELD)
    panels[5].set_title("height of the weld, µm", fontsize=9)
    for axes in panels:
        axes.set_xlim(_SHOWN_M[0] * 100, _SHOWN_M[1] * 100)
        axes.axvline(0, color="#666666", linewidth=0.6)
    figure.supxlabel("distance from the weld's centre, cm", fontsize=10)
    return figure


def _draw_history(axes: Any, history: History, static_n: float) -> None:
    axes.plot((history.x_m - POSITION_M) * 100, history.force_n / 1e3, color=_FORCE)
    for peak in split_peaks(history, static_n, float(history.x_m[np.argmax(history.force_n)])):
        axes.plot((peak.x_m - POSITION_M) * 100, peak.force_n / 1e3, "o", color=_WELD, markersize=4)


def _draw_impact(axes: Any, impact: ImpactForces | None, speed_kmh: float) -> None:
    if impact is not None:
        p1_m, p2_m = _locations_m(impact, speed_kmh)
        axes.plot(p1_m * 100, impact.p1_n / 1e3, "^", color=_IMPACT, fillstyle="none", markersize=9)
        axes.plot(p2_m * 100, impact.p2_n / 1e3, "v", color=_IMPACT, markersize=5)


def quantities_over_weld_1(context: StudyContext, weld: Profile) -> Quantities:
    """Return what claims ask for of weld 1, over a profile in its place."""
    speeds = context.speeds(*_SPEEDS_KMH)
    peak_map = context.peak_map(weld, BILBAO, speeds, [POSITION_M])
    histories = {speed: context.history(weld, BILBAO, speed, POSITION_M) for speed in HISTORIES_KMH.values()}
    return _claim_quantities(context, speeds, peak_map, histories)


def _claim_quantities(
    context: StudyContext, speeds: FloatArray, peak_map: PeakMap, histories: dict[float, History]
) -> Quantities:
    curve = features(speeds, peak_map.peak_force_n[:, 0])
    static_n = context.track(BILBAO).wheel.static_load_n
    maximum_kmh = first_maximum(curve)[0]
    minimum = minimum_after_maximum(curve)
    at_maximum = int(np.argmin(np.abs(speeds - maximum_kmh))) if curve.maxima else 0
    largest_m = float(peak_map.peak_x_m[at_maximum, 0]) if curve.maxima else np.nan
    largest = {speed: float(h.force_n.max()) for speed, h in histories.items()}
    peaks = {speed: split_peaks(h, static_n, largest_m) for speed, h in histories.items()}
    pairs = {speed: two_highest(found) for speed, found in peaks.items()}
    return {
        "curve.first_maximum_kmh": maximum_kmh,
        "curve.minimum_kmh": minimum.lowest_kmh if minimum else np.nan,
        "curve.rise_55_to_80kmh_n": largest[80] - largest[55],
        "curve.rise_80_to_150kmh_n": largest[150] - largest[80],
        "curve.peaks_55kmh": float(len(peaks[55])) if curve.maxima else np.nan,
        "curve.peaks_150kmh": float(len(peaks[150])) if curve.maxima else np.nan,
        "curve.second_over_first_150kmh": _second_over_first(pairs[150], static_n),
        "curve.second_over_first_200kmh": _second_over_first(pairs[200], static_n),
        "curve.second_peak_growth_150_to_170kmh_n": pairs[170][1].force_n - pairs[150][1].force_n,
        "curve.first_peak_growth_170_to_200kmh_n": pairs[200][0].force_n - pairs[170][0].force_n,
    }


def _second_over_first(pair: tuple[Peak, Peak], static_n: float) -> float:
    return (pair[1].force_n - static_n) / (pair[0].force_n - static_n)
