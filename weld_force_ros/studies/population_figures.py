"""Figures of the study `population`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.simulated_population import (
    KINDS,
    THIRDS,
    CurveShape,
    InvertedDips,
    SimulatedWeld,
    count_falling,
    curves_of,
    ratios_by_frequency,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMES = ("dip is the main feature", "protrusion is the main feature")
_TICKS_HZ = (20, 50, 100, 200, 500)


def examples(simulated_welds: list[SimulatedWeld]) -> "Figure":
    """Draw profiles: three of each class, and three of the smoothest third."""
    chosen = [
        [simulated for simulated in simulated_welds if simulated.geometry.kind == kind and simulated.third > 0][:3]
        for kind in KINDS
    ]
    chosen.append([simulated for simulated in simulated_welds if simulated.third == 0][:3])
    figure = new_figure(7.0, 5.2)
    grid = figure.subplots(3, 3, sharex=True, sharey="row")
    titles = ("dip", "protrusion", "smoothest third")
    for row, welds, title, colour in zip(grid, chosen, titles, COLOURS, strict=False):
        for axes, simulated in zip(row, welds, strict=False):
            axes.axhline(0, color=GREY, linewidth=0.6)
            axes.plot(simulated.weld.x_m * 100, simulated.weld.z_m * 1e6, color=colour, linewidth=1.2)
        row[0].set_ylabel(f"{title}\nheight, µm")
    for axes in grid[-1]:
        axes.set_xlabel("from the weld's centre, cm")
    return figure


def falling_shares(simulated_welds: list[SimulatedWeld], without: list[SimulatedWeld]) -> "Figure":
    """Draw the share of curves with a local minimum, by class and gradient, and of welds without short waves."""
    figure = new_figure(7.0, 3.8)
    axes = figure.subplots()
    welds = [(simulated_welds, 0), (simulated_welds, 1), (simulated_welds, 2), (simulated_welds, None), (without, None)]
    for index, (kind, name) in enumerate(zip(KINDS, _NAMES, strict=True)):
        groups = [curves_of(group, kind, third) for group, third in welds]
        shares = [100 * count_falling(curves) / max(len(curves), 1) for curves in groups]
        bars = axes.bar(np.arange(len(groups)) + 0.4 * index - 0.2, shares, 0.38, color=COLOURS[index], label=name)
        axes.bar_label(bars, [f"{count_falling(curves)}\nof {len(curves)}" for curves in groups], fontsize=8, padding=2)
    names = (*(third.replace(" ", "\n") for third in THIRDS), "all\nwelds", "all, without\nshort waves")
    axes.set_xticks(range(len(names)), names)
    axes.set(ylabel="curves with a local minimum, %", ylim=(0, 118), yticks=range(0, 101, 20))
    legend_above(figure, 2)
    return figure


def linearities(
    simulated_welds: list[SimulatedWeld], without: list[SimulatedWeld], own: Sequence[CurveShape]
) -> "Figure":
    """Draw the distribution of the curves' R² by class, with and without short waves, and the user's own weld."""
    figure = new_figure(7.0, 4.2)
    axes = figure.subplots()
    for kind, name, colour in zip(KINDS, _NAMES, COLOURS, strict=False):
        axes.ecdf([curve.linearity for curve in curves_of(simulated_welds, kind)], color=colour, label=name)
        without_short = [curve.linearity for curve in curves_of(without, kind)]
        axes.ecdf(without_short, color=colour, linestyle="--", linewidth=1, label="the same without short waves")
    for number, curve in enumerate(own):
        label = None if number else "your weld"
        axes.axvline(curve.linearity, color=COLOURS[2], linestyle=":", label=label)
    axes.set(xlabel="R² of the straight line through force against speed", ylabel="share of curves", xlim=(0, 1))
    legend_above(figure, 2)
    return figure


def against_inverted(speeds: FloatArray, pairs: InvertedDips) -> "Figure":
    """Draw how often a dip gives less force than its inverse by speed, and how much by frequency of passing."""
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots(1, 2)
    other = pairs.becomes_protrusion
    below = pairs.dip_n < pairs.rise_n
    axes[0].plot(speeds, 100 * below.mean(axis=(0, 2)), color=COLOURS[0], label="all dips")
    axes[0].plot(
        speeds, 100 * below[other].mean(axis=(0, 2)), "--", color=COLOURS[1], label="inversion is a protrusion"
    )
    axes[0].axhline(50, color=GREY, linewidth=0.8, linestyle=":")
    axes[0].set(xlabel="speed, km/h", ylabel="dip gives less force, % of welds", ylim=(0, 100))
    axes[0].legend(fontsize=8)
    frequency_hz, (low, median, high) = ratios_by_frequency(pairs)
    axes[1].fill_between(frequency_hz, low, high, color=COLOURS[1], alpha=0.25, linewidth=0)
    axes[1].plot(frequency_hz, median, color=COLOURS[1])
    axes[1].axhline(1, color=GREY, linewidth=0.8, linestyle=":")
    axes[1].set(xscale="log", xlabel="speed / wavelength, Hz", ylabel="dynamic force, dip / inverted", ylim=(0, None))
    axes[1].set_xticks(_TICKS_HZ, [f"{tick:g}" for tick in _TICKS_HZ])
    axes[1].minorticks_off()
    return figure
