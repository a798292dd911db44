"""Figures of force maps and passages (extra: report)."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from weld_force_ros.assessment.grinding_spots import ends_in_words
from weld_force_ros.errors import InputError
from weld_force_ros.messages import ForceHistory, ForceMap, GrindingAdvice, WeldProfile, known
from weld_force_ros.physics.analysis.geometry import inclinations
from weld_force_ros.simulation.force_map_view import relevant_range, worse_passages

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by the colour-blind and in print.
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#666666"
_LONGEST_NAME = 48


def new_figure(width_in: float, height_in: float) -> "Figure":
    """Return an empty figure.

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise _missing() from None
    return Figure(figsize=(width_in, height_in), layout="constrained")


def current_axes() -> "Axes":
    """Return the axes that pyplot draws to, new ones if there are none.

    Raises:
        InputError: matplotlib is not installed.
    """
    axes: Axes = _pyplot().gca()
    return axes


def next_figure(width_in: float, height_in: float) -> "Figure":
    """Return a new figure of pyplot, which notebooks show and `pyplot.show()` opens.

    Raises:
        InputError: matplotlib is not installed.
    """
    figure: Figure = _pyplot().figure(figsize=(width_in, height_in), layout="constrained")
    return figure


def _pyplot() -> Any:
    try:
        from matplotlib import pyplot
    except ImportError:
        raise _missing() from None
    return pyplot


def _missing() -> InputError:
    return InputError("pictures need matplotlib", "install it with `pip install 'weld_force_ros[report]'`")


def as_text(name: str) -> str:
    """Return a name from outside so that matplotlib finds no formula in it; a long one loses its middle."""
    half = _LONGEST_NAME // 2
    shown = name if len(name) <= _LONGEST_NAME else f"{name[:half]}…{name[-half:]}"
    return shown.replace("$", r"\$")


def save(figure: "Figure", path: Path) -> None:
    """Write a figure to a file; the name's ending decides the format.

    Raises:
        InputError: the file cannot be written or the ending is unknown.
    """
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise InputError(f"picture {path}: {error}", "name a .png, .svg or .pdf file in a writable folder") from None


def compare_maps(rows: Sequence[tuple[WeldProfile, ForceMap]]) -> "Figure":
    """Draw profile and force map of several welds side by side, on one colour scale."""
    figure = new_figure(5.2 * len(rows), 6.6)
    axes = figure.subplots(2, len(rows), height_ratios=[1, 2.6], squeeze=False)
    highest = max(worse_passages(m).peak_force_n.max() for _, m in rows) / 1e3
    lowest = min(worse_passages(m).peak_force_n.min() for _, m in rows) / 1e3
    image: Any = None
    for (profile, force_map), (above, below) in zip(rows, axes.T, strict=True):
        draw_profile(above, profile)
        image = _draw_map(below, force_map, lowest, highest)
        above.set_title(as_text(profile.weld_id), fontweight="bold")
    figure.colorbar(image, ax=axes[1, :], label="peak force, kN", shrink=0.95)
    return figure


def one_weld(profile: WeldProfile, force_map: ForceMap, history: ForceHistory) -> "Figure":
    """Draw a weld on one page: profile, force map, force against speed, and the worst passage."""
    figure = new_figure(11, 7.6)
    (top_left, top_right), (bottom_left, bottom_right) = figure.subplots(2, 2)
    draw_profile(top_left, profile)
    peaks = worse_passages(force_map).peak_force_n / 1e3
    image = _draw_map(top_right, force_map, peaks.min(), peaks.max())
    figure.colorbar(image, ax=top_right, label="peak force, kN")
    _draw_curve(bottom_left, force_map)
    _draw_history(bottom_right, history)
    figure.suptitle(as_text(f"{profile.weld_id} on {force_map.track} ({force_map.engine})"), fontweight="bold")
    return figure


def grinding(advice: GrindingAdvice, figure: "Figure | None" = None) -> "Figure":
    """Draw where metal comes off a weld, its quality index along the rail and the worst force, before and after.

    Args:
        advice: to draw.
        figure: an empty one to draw in; a new one if not given.
    """
    figure = figure or new_figure(11, 6.4)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.25, 1], height_ratios=[1.7, 1])
    rail, index, force = (figure.add_subplot(cell) for cell in (grid[0, 0], grid[1, 0], grid[:, 1]))
    _draw_spots(rail, advice)
    _draw_quality_index(index, advice)
    _draw_forces(force, advice)
    index.sharex(rail)
    for axes in (rail, index, force):
        axes.legend(fontsize=8)
    found = f"at most {advice.most_removed_m * 1e3:.2f} mm removed" if advice.reached else "no grinding helps"
    figure.suptitle(as_text(f"{advice.weld_id}: {found}"), fontweight="bold")
    return figure


def _draw_spots(axes: "Axes", advice: GrindingAdvice) -> None:
    x_mm, before_um = np.array(advice.x_m) * 1e3, np.array(advice.z_m) * 1e6
    after_um = before_um - np.array(advice.removal_m) * 1e6
    axes.axhline(0, color=GREY, linewidth=0.6)
    axes.plot(x_mm, before_um, color=BLUE, label="before")
    axes.plot(x_mm, after_um, color=GREEN, linestyle="--", label="after")
    axes.fill_between(x_mm, after_um, before_um, color=ORANGE, alpha=0.5, label="removed")
    for spot in advice.spots:
        axes.axvspan(spot.from_m * 1e3, spot.to_m * 1e3, color=ORANGE, alpha=0.12, linewidth=0)
        axes.annotate(
            f"{spot.depth_m * 1e3:.2f} mm", (spot.deepest_m * 1e3, np.interp(spot.deepest_m * 1e3, x_mm, before_um)),
            xytext=(0, 5), textcoords="offset points", ha="center", fontsize=9,
        )  # fmt: skip
    falling, rising = ends_in_words(advice.chainage_direction)
    for place, side, words in ((0.0, "left", f"← {falling}"), (1.0, "right", f"{rising} →")):
        axes.annotate(
            words, (place, 1.0), xytext=(0, 4), xycoords="axes fraction", textcoords="offset points", ha=side,
            fontsize=9, color=GREY,
        )  # fmt: skip
    axes.margins(y=0.12)
    axes.set(ylabel="height, µm")


def _draw_quality_index(axes: "Axes", advice: GrindingAdvice) -> None:
    before, norm = np.array(advice.z_m), known(advice.gradient_norm_rad)
    for heights, colour, style, name in (
        (before, BLUE, "-", "before"),
        (before - np.array(advice.removal_m), GREEN, "--", "after"),
    ):
        x_m, slope = inclinations(advice.x_m, heights)
        axes.plot(x_m * 1e3, np.abs(slope) / (norm or 1e-3), color=colour, linestyle=style, label=name)
    axes.set(xlabel="distance from the weld's centre, mm", ylabel="quality index" if norm else "inclination, mrad")
    if norm:
        axes.axhline(1.0, color=RED, linestyle=":", label=f"norm, {norm * 1e3:.2f} mrad")


def _draw_forces(axes: "Axes", advice: GrindingAdvice) -> None:
    for peaks_n, colour, style, name in (
        (advice.peak_before_n, BLUE, "-", "before"),
        (advice.peak_after_n, GREEN, "--", "after"),
    ):
        axes.plot(advice.speeds_kmh, np.array(peaks_n) / 1e3, color=colour, linestyle=style, label=name)
    for criterion in advice.before:
        if criterion.name == "peak_force":
            unverified = "" if criterion.verified else " (unverified)"
            axes.axhline(criterion.limit / 1e3, color=RED, linestyle=":", label=f"limit{unverified}")
    axes.set(xlabel="speed, km/h", ylabel="peak force at the worst position, kN")


def draw_profile(axes: "Axes", profile: WeldProfile) -> None:
    """Draw the rail over a weld on axes, and the measured samples where the file has them."""
    axes.axhline(0, color=GREY, linewidth=0.6)
    measured_x, measured_z = known(profile.measured_x_m), known(profile.measured_z_m)
    if measured_x is not None and measured_z is not None:
        axes.plot(
            np.array(measured_x) * 100, np.array(measured_z) * 1e6, ".", color=GREY, markersize=3, label="samples"
        )
    axes.plot(np.array(profile.x_m) * 100, np.array(profile.z_m) * 1e6, color=BLUE, label="rail")
    if measured_x is not None:
        axes.legend(fontsize=8)
    axes.set(xlabel="distance from the weld's centre, cm", ylabel="height, µm")


def _draw_map(axes: "Axes", force_map: ForceMap, lowest_kn: float, highest_kn: float) -> Any:
    speeds, positions = np.array(force_map.speeds_kmh), np.array(force_map.positions_m)
    peaks = worse_passages(force_map).peak_force_n / 1e3
    edges = _edges(positions)
    if np.isclose(edges[-1] - edges[0], force_map.span_m):
        # A whole span: what lies before its first sleeper stands again before the next one.
        peaks, positions = np.column_stack([peaks, peaks[:, 0]]), np.append(positions, positions[0] + force_map.span_m)
        edges = _edges(positions)
    image = axes.pcolormesh(edges * 100, _edges(speeds), peaks, cmap="viridis", vmin=lowest_kn, vmax=highest_kn)
    for sleeper in (0.0, force_map.span_m):
        if edges[0] <= sleeper <= edges[-1]:
            axes.axvline(sleeper * 100, color="white", linestyle="--", linewidth=1.2)
    if isinstance(force_map.line_speed_kmh, float):
        axes.axhline(force_map.line_speed_kmh, color="white", linewidth=1.2)
    relevant = relevant_range(force_map)
    row, column = relevant.peak_index
    worst = (relevant.positions_m[column] * 100, relevant.speeds_kmh[row])
    peak_kn = relevant.passages.peak_force_n[row, column] / 1e3
    axes.plot(*worst, marker="o", markersize=9, color=RED, markeredgecolor="white")
    axes.annotate(
        f"{peak_kn:.0f} kN", worst, xytext=(0, -16), textcoords="offset points",
        color="black", ha="center", va="center", fontsize=9,
        bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.85, "linewidth": 0},
        annotation_clip=False,
    )  # fmt: skip
    axes.set(xlabel="weld's centre after the sleeper, cm (sleepers dashed)", ylabel="speed, km/h")
    return image


def _edges(centres: np.ndarray) -> np.ndarray:
    if len(centres) == 1:
        return float(centres[0]) + np.array([-0.5, 0.5]) * max(0.02, abs(float(centres[0])) * 0.02)
    inner = (centres[:-1] + centres[1:]) / 2
    return np.concatenate([[2 * centres[0] - inner[0]], inner, [2 * centres[-1] - inner[-1]]])


def _draw_curve(axes: "Axes", force_map: ForceMap) -> None:
    peaks = worse_passages(force_map).peak_force_n / 1e3
    speeds = force_map.speeds_kmh
    axes.fill_between(speeds, peaks.min(axis=1), peaks.max(axis=1), color=ORANGE, alpha=0.35, label="all positions")
    relevant = relevant_range(force_map)
    column = force_map.positions_m.index(relevant.positions_m[relevant.peak_index[1]])
    label = f"weld {force_map.positions_m[column] * 100:.0f} cm after the sleeper (worst)"
    axes.plot(speeds, peaks[:, column], color=RED, label=label)
    axes.axhline(force_map.static_load_n / 1e3, color=GREY, linestyle=":", label="static load")
    if isinstance(force_map.line_speed_kmh, float):
        axes.axvline(force_map.line_speed_kmh, color=GREY, linewidth=0.8, label="line speed")
    axes.set(xlabel="speed, km/h", ylabel="peak force, kN")
    axes.legend(fontsize=8)


def _draw_history(axes: "Axes", history: ForceHistory) -> None:
    x = np.array(history.x_m) * 100
    axes.plot(x, np.array(history.force_n) / 1e3, color=RED, linewidth=1.2)
    axes.set(
        xlabel="distance from the sleeper before the weld, cm", ylabel="contact force, kN",
        title=f"worst passage: {history.speed_kmh:g} km/h, weld at {history.position_m * 100:.0f} cm",
    )  # fmt: skip
    touched = np.flatnonzero(np.array(history.irregularity_m) != 0.0)
    last = min(len(x) - 1, (touched[-1] if len(touched) else 0) + len(x) // 6)
    axes.set_xlim(x[0], x[last])
    other = axes.twinx()
    other.plot(x, np.array(history.irregularity_m) * 1e6, color=BLUE, linestyle="--", linewidth=1)
    other.set_ylabel("wheel centre trajectory, µm (dashed)", color=BLUE)
