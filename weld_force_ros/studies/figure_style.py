"""Colours and map drawing of the studies' figures: readable on a phone, in print and for the colour-blind."""

from typing import TYPE_CHECKING, Any

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import BLUE, GREEN, GREY, ORANGE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, RED, GREEN, ORANGE, "#CC79A7", "#56B4E9", "#000000")
MAP = "viridis"


def legend_above(figure: "Figure", columns: int, axes: "Axes | None" = None) -> None:
    """Put a legend of one panel's curves, or of all, above the figure's panels."""
    curves = () if axes is None else axes.get_legend_handles_labels()
    figure.legend(*curves, loc="outside upper center", ncols=columns, frameon=False)


def label_panel(axes: "Axes", text: str) -> None:
    """Write a label into a panel's upper right corner."""
    axes.text(0.99, 0.93, text, transform=axes.transAxes, ha="right", va="top")


def mark_sleepers(axes: "Axes", span_m: float, until_m: float, from_m: float = 0.0) -> None:
    """Draw dashed lines at the sleepers, on an axis of cm."""
    for sleeper in np.arange(np.ceil(from_m / span_m), until_m / span_m + 1e-9):
        axes.axvline(sleeper * span_m * 100, color=GREY, linewidth=0.8, linestyle="--", zorder=0)


def draw_map(
    axes: "Axes", positions_m: FloatArray, speeds_kmh: FloatArray, values: FloatArray, span_m: float, **options: Any
) -> Any:
    """Draw a heat map of values (n_speed, n_position) over position (cm) and speed, sleepers at both ends."""
    closed = np.append(positions_m, positions_m[0] + span_m)
    image = axes.pcolormesh(
        closed * 100, speeds_kmh, np.column_stack([values, values[:, 0]]), shading="gouraud", cmap=MAP, **options
    )
    for sleeper in (0.0, span_m):
        axes.axvline(sleeper * 100, color="white", linewidth=1.2, linestyle="--")
    axes.set(xlabel="weld's centre after the sleeper, cm", ylabel="speed, km/h")
    return image
