"""Pictures of the study `engines` (extra: report)."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray
from weld_force_ros.report.figures import BLUE, GREEN, GREY, ORANGE, RED, new_figure, save
from weld_force_ros.studies.engines_study import FLATS, TARGETS, EnginesStudy, FlatCurve, PointReceptance
from weld_force_ros.studies.fit_orders import PAPERS_SECOND_KINK_KMH, OrderEffect
from weld_force_ros.studies.peak_comparison import ComparedPassage, peak_difference

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The rest of Okabe and Ito's colours.
_SKY, _PURPLE, _BLACK = "#56B4E9", "#CC79A7", "#000000"
_GRID = "#dddddd"
_SHAPE_STYLES = tuple(zip((BLUE, ORANGE, GREEN, RED, _PURPLE, _SKY, _BLACK, GREY), "os^vDPX*", strict=True))
_TRACK_COLOURS = {"johansson-nielsen": BLUE, "bilbao-viscous": GREEN, "bilbao": RED, "bilbao-continuous": _PURPLE}
_ENGINE_COLOURS = {"common-poles": BLUE, "rfp": RED}


def write(study: EnginesStudy, out: Path) -> list[Path]:
    """Draw everything into a folder, as PNG and SVG; return the PNGs.

    Raises:
        InputError: matplotlib is not installed, or the folder cannot be written.
    """
    figures = {
        "error-by-speed": error_by_speed(study.passages),
        "flats": flat_curves(study.flats),
        "error-by-order": error_by_order(study.orders),
        "hysteretic-receptance": hysteretic_receptance(study.receptances),
    }
    for name, figure in figures.items():
        for ending in ("svg", "png"):
            save(figure, out / f"{name}.{ending}")
    return [out / f"{name}.png" for name in figures]


def error_by_speed(passages: Sequence[ComparedPassage]) -> "Figure":
    """Draw the largest difference of all positions against speed: a column a track, a row an engine, a line a shape."""
    tracks = list(dict.fromkeys(p.track for p in passages))
    engines = list(dict.fromkeys(p.engine for p in passages))
    figure = new_figure(4.2 * len(tracks), 2.8 * len(engines) + 1.2)
    axes = figure.subplots(len(engines), len(tracks), sharex=True, sharey=True, squeeze=False)
    for row, engine in zip(axes, engines, strict=True):
        for panel, track in zip(row, tracks, strict=True):
            _draw_errors(panel, [p for p in passages if (p.track, p.engine) == (track, engine)])
            panel.set_title(f"{track}: {engine}", fontweight="bold")
        row[0].set_ylabel("largest difference, %")
    axes[0, 0].set_ylim(bottom=0.01)  # of all panels, which share it; now that they are drawn
    for panel in axes[-1]:
        panel.set_xlabel("speed, km/h")
        panel.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2, fontsize=7.5, frameon=False, columnspacing=1.0
        )
    figure.suptitle("Peak force against the reference engine, the worst of all positions")
    return figure


def _draw_errors(panel: "Axes", passages: Sequence[ComparedPassage]) -> None:
    speeds = sorted({p.speed_kmh for p in passages})
    for shape, (colour, marker) in zip(dict.fromkeys(p.shape for p in passages), _SHAPE_STYLES, strict=False):
        own = [[p for p in passages if (p.shape, p.speed_kmh) == (shape, speed)] for speed in speeds]
        errors = [peak_difference(at_speed).max_percent for at_speed in own]
        panel.plot(speeds, errors, color=colour, marker=marker, markersize=4, linewidth=1.2, label=shape)
    _, target = TARGETS.get((passages[0].track, passages[0].engine), (None, None))
    if target is not None:
        panel.axhline(target, color=_BLACK, linestyle="--", linewidth=1, label="target (dashed line)")
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter("{x:g}")
    panel.grid(color=_GRID, linewidth=0.6)


def flat_curves(curves: Sequence[FlatCurve]) -> "Figure":
    """Draw the largest peak force of all positions against speed, a panel for each wheel flat."""
    shapes = [shape for shape in FLATS if any(c.shape == shape for c in curves)]
    figure = new_figure(4.2 * len(shapes), 4.4)
    panels = figure.subplots(1, len(shapes), sharey=True, squeeze=False)[0]
    for panel, shape in zip(panels, shapes, strict=True):
        for curve in sorted((c for c in curves if c.shape == shape), key=lambda c: c.engine == "reference"):
            force_kn = np.array(curve.peak_force_n) / 1e3
            if curve.engine == "reference":
                panel.plot(curve.speeds_kmh, force_kn, "--o", color=_BLACK, markerfacecolor="none", linewidth=0.9,
                           markersize=6, label="reference (at the circles)")  # fmt: skip
            else:
                # Curves that coincide lie on one another: the narrower one is drawn over the wider.
                width = 3.5 if curve.engine == "common-poles" else 1.3
                colour = _ENGINE_COLOURS.get(curve.engine, GREEN)
                panel.plot(curve.speeds_kmh, force_kn, color=colour, linewidth=width, label=curve.engine)
        panel.set(xlabel="speed, km/h", title=shape)
        panel.grid(color=_GRID, linewidth=0.6)
    panels[0].set_ylim(bottom=0)
    panels[0].set_ylabel("largest peak force of all positions, kN")
    panels[0].legend(loc="lower right")
    return figure


def error_by_order(effects: Sequence[OrderEffect]) -> "Figure":
    """Draw fit error, difference in peak force and second kink against the number of states."""
    figure = new_figure(12.6, 4.9)
    fit, force, kink = figure.subplots(1, 3)
    fitted = [e for e in effects if e.order is not None]
    for track in dict.fromkeys(e.track for e in fitted):
        own = [e for e in fitted if e.track == track]
        colour, orders = _TRACK_COLOURS.get(track, GREY), [e.order for e in own]
        fit.plot(orders, [e.fit_error_percent for e in own], "o-", color=colour, label=track)
        errors = [e.error for e in own if e.error]
        if errors:
            force.plot(orders, [e.rms_percent for e in errors], "o-", color=colour, label=f"{track}: RMS")
            force.plot(orders, [e.max_percent for e in errors], "^:", color=colour, label=f"{track}: max")
        seconds = [(e.order, e.kinks_kmh[1]) for e in own if len(e.kinks_kmh) > 1]
        if seconds:
            kink.plot(*zip(*seconds, strict=True), "o-", color=colour, label="common-poles")
    for e in effects:
        if e.order is None and len(e.kinks_kmh) > 1:
            kink.axhline(e.kinks_kmh[1], color=_BLACK, linestyle="--", label="reference")
    kink.axhline(PAPERS_SECOND_KINK_KMH, color=ORANGE, linestyle="-.", label="2018 paper")
    kink.set_ylim(100, 140)
    for panel, title, label in (
        (fit, "fit of the receptance", "error relative to track, contact and wheel, %"),
        (force, "peak force against the reference", "difference, %"),
        (kink, "48 mm cosine dip, continuous track", "second kink, km/h"),
    ):
        panel.set(title=title, ylabel=label, xlabel="order of common-poles (states)")
        panel.grid(color=_GRID, linewidth=0.6)
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, fontsize=8, frameon=False)
        panel.set_xticks(sorted({e.order for e in fitted if e.order is not None}))
    for panel in (fit, force):
        panel.set(yscale="log", ylim=(0.1, 30))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter("")
    return figure


def hysteretic_receptance(points: Sequence[PointReceptance]) -> "Figure":
    """Draw the exact receptance of a track with loss factors, its causal part, the fits, and their errors."""
    figure = new_figure(5.4 * len(points), 8.6)
    axes = figure.subplots(3, len(points), sharex=True, sharey="row", squeeze=False, height_ratios=[3, 2, 2])
    for column, point in zip(axes.T, points, strict=True):
        position = "over the sleeper" if point.at_m == 0.0 else f"{point.at_m * 100:.0f} cm after the sleeper"
        column[0].set_title(f"{point.track}, {position}")
        _draw_receptance(column, point, "exact", point.exact, {"color": "#bbbbbb", "linewidth": 5})
        _draw_receptance(column, point, "exact, cut at the impulse", point.causal, {"color": _BLACK, "linestyle": "--"})
        for engine, values in point.engines.items():
            style = {"color": _ENGINE_COLOURS.get(engine, GREEN), "linewidth": 1.3}
            _draw_receptance(column, point, engine, values, style)
    magnitude, phase, error = axes[:, 0]
    magnitude.set(ylabel="receptance, nm/N", xscale="log", yscale="log")
    phase.set(ylabel="phase, degrees", ylim=(-200, 20), yticks=range(-180, 1, 45))
    error.set(ylabel="error relative to track,\ncontact and wheel, %", yscale="log", ylim=(0.1, 100))
    for panel in axes[-1]:
        panel.set_xlabel("frequency, Hz")
        panel.xaxis.set_major_formatter("{x:g}")
    for panel in (magnitude, error):
        panel.yaxis.set_major_formatter("{x:g}")
    for panel in axes.flat:
        panel.grid(color=_GRID, linewidth=0.6)
    magnitude.legend(fontsize=8)
    return figure


def _draw_receptance(
    panels: "Sequence[Axes]", point: PointReceptance, name: str, values: ComplexArray, style: dict[str, Any]
) -> None:
    magnitude, phase, error = panels
    magnitude.plot(point.frequency_hz, np.abs(values) * 1e9, label=name, **style)
    # A passive track stays between 0 and -180 degrees; what oversteps that a little is not to jump across the panel.
    degrees = np.mod(np.degrees(np.angle(values)) + 270, 360) - 270
    degrees[1:][np.abs(np.diff(degrees)) > 180] = np.nan
    phase.plot(point.frequency_hz, degrees, **style)
    if values is not point.exact:
        relative = np.abs(values - point.exact) / np.abs(point.exact + point.contact)
        error.plot(point.frequency_hz, 100 * relative, **style)
