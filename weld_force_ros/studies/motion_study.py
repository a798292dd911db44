"""Study `motion`: force, wheel and rail during a passage over a weld (Fig. 12)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies.figure_style import COLOURS, mark_sleepers
from weld_force_ros.studies.passage_curves import SmoothRailPassage
from weld_force_ros.studies.result_table import Column, Table
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
from weld_force_ros.studies.weld_map import upward_ramp

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPEEDS_KMH = {"O": 20.0, "A": 55.0, "B": 80.0, "C": 150.0, "D": 170.0, "E": 200.0}
POSITION_M = 0.15
_WELD_5_POSITION_M, _WELD_5_SPEED_KMH = 0.30, 100.0
_HALF_WELD_M = 0.5  # a straightedge of a metre
_FORCE_LAGS_M, _CENTRAL_TO_M = 0.05, 0.15
_SHOWN_M = 0.6
_EVERY = 4  # points of the 0.25 mm grid, in the table
_RAIL, _WHEEL, _GEOMETRY = COLOURS[0], COLOURS[1], COLOURS[6]


@dataclass(frozen=True)
class Motion:
    """A passage compared with that over smooth rail at the same speed, each (n,).

    Attributes:
        x_m: from the weld's centre, which lies `position_m` after a sleeper.
        force_n: contact force.
        wheel_m: displacement, positive up, less that over smooth rail.
        surface_m: the same of the rail's surface under the wheel: rail displacement and the weld's height.
        height_m: of the wheel centre's path over the weld.
    """

    x_m: FloatArray
    force_n: FloatArray
    wheel_m: FloatArray
    surface_m: FloatArray
    height_m: FloatArray

    def on(self, first_m: float, last_m: float) -> "Motion":
        """Return the part between two distances from the weld's centre."""
        part = (self.x_m >= first_m - 1e-9) & (self.x_m <= last_m + 1e-9)
        return Motion(*(column[part] for column in self.columns))

    @property
    def columns(self) -> tuple[FloatArray, ...]:
        """Return the fields in their order."""
        return self.x_m, self.force_n, self.wheel_m, self.surface_m, self.height_m

    @property
    def peak_x_m(self) -> float:
        """Return the location of the largest force, m."""
        return float(self.x_m[np.argmax(self.force_n)])


def run(context: StudyContext) -> StudyResult:
    """Compute passages at six speeds over one weld, and one over a weld with a protrusion."""
    (weld,) = context.welds(WELDS[0])
    motions = {speed: moving(context, weld, speed, POSITION_M) for speed in SPEEDS_KMH.values()}
    pictures = [
        Picture(
            "wheel-and-rail", f"Wheel and rail over {weld}",
            "Left: contact force, and the weld's height (dotted, scaled to the panel). Right: displacements of the "
            "wheel and of the rail's surface under it, less those over smooth rail, with the weld's height (dotted). "
            f"The weld is centred {POSITION_M * 100:g} cm after a sleeper (dashed).", _draw(context, motions),
        )
    ]  # fmt: skip
    measured: Quantities = {}
    if context.own_weld is None:
        over_weld_5 = moving(context, WELDS[4], _WELD_5_SPEED_KMH, _WELD_5_POSITION_M)
        pictures.append(_weld_5_picture(context, over_weld_5))
        if context.uses_paper_inputs:
            measured = _claim_quantities(context, context.profile(weld), motions) | _weld_5_quantities(
                context, context.profile(WELDS[4]), over_weld_5
            )
    columns = (
        Column("speed_kmh", "km/h", 0), Column("x_m", "m", 4), Column("force_n", "N", 0),
        Column("wheel_less_smooth_m", "wheel m", 6), Column("rail_surface_less_smooth_m", "rail surface m", 6),
        Column("weld_height_m", "height m", 6),
    )  # fmt: skip
    rows = [
        (speed, *row) for speed, m in motions.items() for row in as_rows(*(column[::_EVERY] for column in m.columns))
    ]
    table = Table(f"Wheel and rail over {weld}; x from its centre", columns, rows)
    return StudyResult("motion", "Motion of wheel and rail", pictures, {"motion": table}, measured)


def moving(context: StudyContext, weld: str | Profile, speed_kmh: float, position_m: float) -> Motion:
    """Simulate one passage, from 60 cm before the weld's centre to 60 cm after it."""
    history: History = context.history(weld, BILBAO, speed_kmh, position_m)
    smooth = SmoothRailPassage(context, BILBAO, speed_kmh)
    return Motion(
        x_m=history.x_m - position_m,
        force_n=history.force_n,
        wheel_m=history.wheel_m - smooth.wheel_m(history.x_m),
        surface_m=history.rail_m + history.irregularity_m - smooth.rail_m(history.x_m),
        height_m=history.irregularity_m,
    ).on(-_SHOWN_M, _SHOWN_M)


def _draw(context: StudyContext, motions: dict[float, Motion]) -> "Figure":
    figure, span_m = new_figure(7.0, 9.0), context.track(BILBAO).track.spacing_m
    panels = figure.subplots(len(motions), 2, sharex=True, sharey="col")
    for (left, right), (letter, speed) in zip(panels, SPEEDS_KMH.items(), strict=True):
        motion = motions[speed]
        _draw_force(left, motion, POSITION_M)
        left.set_ylabel(f"{letter}: {speed:g} km/h\nkN")
        x_cm = (motion.x_m + POSITION_M) * 100
        right.plot(x_cm, motion.height_m * 1e6, color=_GEOMETRY, linewidth=0.9, linestyle=":")
        right.plot(x_cm, motion.wheel_m * 1e6, color=_WHEEL)
        right.plot(x_cm, motion.surface_m * 1e6, color=_RAIL, linestyle="-.")
        right.set_ylabel("µm")
        for axes in (left, right):
            mark_sleepers(axes, span_m, 2 * span_m)
            axes.set_xlim((POSITION_M - _HALF_WELD_M) * 100, (POSITION_M + _HALF_WELD_M) * 100)
    panels[0, 0].set_title("contact force", fontsize=10)
    panels[0, 1].set_title("displacement", fontsize=10)
    figure.supxlabel("distance from the sleeper before the weld, cm", fontsize=10)
    names = ("weld", "wheel", "rail's surface")
    figure.legend(panels[0, 1].lines[:3], names, loc="outside upper center", ncols=3, frameon=False)
    return figure


def _draw_force(axes: "Axes", motion: Motion, position_m: float) -> None:
    x_cm = (motion.x_m + position_m) * 100
    axes.plot(x_cm, motion.force_n / 1e3, color=COLOURS[2])
    height_axes = axes.twinx()
    height_axes.plot(x_cm, motion.height_m * 1e6, color=_GEOMETRY, linewidth=0.9, linestyle=":")
    height_axes.set_yticks([])


def _weld_5_picture(context: StudyContext, motion: Motion) -> Picture:
    figure, span_m = new_figure(7.0, 3.2), context.track(BILBAO).track.spacing_m
    axes = figure.subplots()
    _draw_force(axes, motion, _WELD_5_POSITION_M)
    mark_sleepers(axes, span_m, 2 * span_m)
    axes.set(xlabel="distance from the sleeper before the weld, cm", ylabel="contact force, kN", xlim=(-25, 85))
    caption = (
        f"Contact force over {WELDS[4]} (dotted, not to scale) at {_WELD_5_SPEED_KMH:g} km/h, its centre "
        f"{_WELD_5_POSITION_M * 100:g} cm after a sleeper (dashed): a peak on the ramp, unloading, and what follows."
    )
    return Picture("protrusion", "Force over a ramp and what follows", caption, figure)


def quantities_over_weld_1(context: StudyContext, weld: Profile) -> Quantities:
    """Return what claims ask for of weld 1, over a profile in its place."""
    motions = {speed: moving(context, weld, speed, POSITION_M) for speed in SPEEDS_KMH.values()}
    return _claim_quantities(context, weld, motions)


def quantities_over_weld_5(context: StudyContext, weld: Profile) -> Quantities:
    """Return what claims ask for of weld 5, over a profile in its place; NaN if it has no ramp before its centre."""
    return _weld_5_quantities(context, weld, moving(context, weld, _WELD_5_SPEED_KMH, _WELD_5_POSITION_M))


def _claim_quantities(context: StudyContext, profile: Profile, motions: dict[float, Motion]) -> Quantities:
    static_n = context.track(BILBAO).wheel.static_load_n
    depth_m = -float(profile[1].min()) or np.nan
    welds = [motion.on(-_HALF_WELD_M, _HALF_WELD_M) for motion in motions.values()]
    wheel = [-float(weld.wheel_m.min()) / depth_m for weld in welds]
    rail = [-float(weld.surface_m.min()) / depth_m for weld in welds]
    slope = CubicSpline(*profile).derivative()
    peak_m = motions[55].peak_x_m
    near = motions[170].on(-0.100, 0.200)
    lowest_m = float(near.x_m[np.argmin(near.surface_m)])
    rise = motions[170].on(lowest_m, lowest_m + 0.100)
    return {
        "motion.dynamic_share_20kmh": (float(motions[20].force_n.max()) - static_n) / static_n,
        "motion.wheel_descent": wheel,
        "motion.rail_descent": rail,
        "motion.wheel_descent_20kmh": wheel[0],
        "motion.wheel_descent_200kmh": wheel[-1],
        "motion.wheel_descent_falls": bool(np.all(np.diff(wheel) < 0)),
        "motion.rail_descent_falls": bool(np.all(np.diff(rail) < 0)),
        "motion.peak_slope_55kmh": float(slope(peak_m)),
        "motion.peak_to_inflection_55kmh_mm": 1e3 * (peak_m - _nearest_inflection(slope, peak_m)),
        "motion.peak_shift_55_to_80kmh_mm": 1e3 * (motions[80].peak_x_m - peak_m),
        "motion.rail_rise_start_170kmh_mm": 1e3 * lowest_m,
        "motion.wheel_over_rail_range_170kmh": float(np.ptp(rise.wheel_m) / np.ptp(rise.surface_m)),
    }


def _nearest_inflection(slope: CubicSpline, x_m: float) -> float:
    """Return the nearest location, m, at which the curvature changes sign while the height rises; NaN without one."""
    roots_m = np.asarray(slope.derivative().roots(extrapolate=False))
    rising = roots_m[slope(roots_m) > 0]
    return float(rising[np.argmin(np.abs(rising - x_m))]) if len(rising) else np.nan


def _weld_5_quantities(context: StudyContext, profile: Profile, motion: Motion) -> Quantities:
    static_n = context.track(BILBAO).wheel.static_load_n
    start_m, end_m = upward_ramp(profile)
    ramp = motion.on(start_m, end_m + _FORCE_LAGS_M)
    if not len(ramp.x_m) or ramp.peak_x_m >= 0:
        return {"motion.weld_5_minimum_after_ramp_n": np.nan, "motion.weld_5_second_over_first": np.nan}
    behind = motion.on(ramp.peak_x_m, 0.0)
    unloaded = int(np.argmin(behind.force_n))
    central = motion.on(float(behind.x_m[unloaded]), _CENTRAL_TO_M)
    first, second = float(ramp.force_n.max()) - static_n, float(central.force_n.max()) - static_n
    return {
        "motion.weld_5_minimum_after_ramp_n": float(behind.force_n[unloaded]),
        "motion.weld_5_second_over_first": second / first,
    }
