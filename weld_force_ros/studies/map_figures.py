"""Figures of forces over speed and position."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies.figure_style import MAP, draw_map
from weld_force_ros.studies.study_context import Picture
from weld_force_ros.studies.weld_map import WeldMap


def picture(weld: WeldMap) -> Picture:
    """Draw one weld's forces as a 3D surface and a map, local minima over speed outlined."""
    figure = new_figure(7.0, 3.5)
    grid = figure.add_gridspec(1, 2)
    solid: Any = figure.add_subplot(grid[0], projection="3d")
    flat = figure.add_subplot(grid[1])
    draw_surface(solid, weld.positions_m, weld.speeds_kmh, weld.force_n / 1e3, weld.span_m)
    solid.set_title("peak force, kN", fontsize=9, y=0.98)
    image = draw_map(flat, weld.positions_m, weld.speeds_kmh, weld.force_n / 1e3, weld.span_m)
    name_sleepers(flat, weld.span_m)
    outline(flat, weld.positions_m, weld.speeds_kmh, weld.shape.hollow, weld.span_m)
    figure.colorbar(image, ax=flat, label="peak force, kN")
    caption = (
        f"Peak force over {weld.name} against speed and the weld's position between two sleepers (dashed). Hatched: "
        f"local minima, where a lower speed gave more; {weld.shape.hollow_share:.0%} of the positions have one."
    )
    return Picture(weld.file_name, weld.name, caption, figure)


def draw_surface(
    axes: Any, positions_m: FloatArray, speeds_kmh: FloatArray, values: FloatArray, span_m: float, **how: Any
) -> None:
    """Draw values (n_speed, n_position) as a 3D surface over position and speed, sleepers dashed at both ends."""
    closed = np.append(positions_m, positions_m[0] + span_m) * 100
    values = np.column_stack([values, values[:, 0]])
    position, speed = np.meshgrid(closed, speeds_kmh)
    how = {"cmap": MAP, "rcount": 60, "ccount": 20, "edgecolor": "#00000040", "linewidth": 0.2} | how
    axes.plot_surface(position, speed, values, **how)
    for edge, column in ((closed[0], values[:, 0]), (closed[-1], values[:, -1])):
        axes.plot(np.full_like(speeds_kmh, edge), speeds_kmh, column, color="black", linestyle="--", linewidth=1.0)
    axes.set_xlabel("position, cm", fontsize=8)
    axes.set_ylabel("speed, km/h", fontsize=8)
    axes.locator_params(axis="x", nbins=4)
    axes.locator_params(axis="y", nbins=4)
    axes.tick_params(labelsize=8)
    axes.view_init(elev=28, azim=-55)


def outline(axes: Any, positions_m: FloatArray, speeds_kmh: FloatArray, mask: NDArray[np.bool_], span_m: float) -> None:
    """Draw white lines round the cells of a mask (n_speed, n_position) on a map, and hatch them."""
    closed = np.append(positions_m, positions_m[0] + span_m) * 100
    cells = np.column_stack([mask, mask[:, 0]]).astype(float)
    if mask.any():
        axes.contour(closed, speeds_kmh, cells, levels=[0.5], colors="white", linewidths=1.2)
        hatching = axes.contourf(closed, speeds_kmh, cells, levels=[0.5, 1.5], colors="none", hatches=["//"])
        hatching.set(edgecolor="#FFFFFF80", linewidth=0.0)


def name_sleepers(axes: Any, span_m: float) -> None:
    """Name the sleepers above a map's left and right edge."""
    for sleeper_cm, side in ((0.0, "left"), (span_m * 100, "right")):
        axes.text(sleeper_cm, 1.01, "sleeper", transform=axes.get_xaxis_transform(), ha=side, fontsize=8)
