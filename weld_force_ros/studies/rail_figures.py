"""Pictures of the study `rail`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.track.cross_section import Mesh
from weld_force_ros.physics.track.waveguide_rail import WaveShape
from weld_force_ros.report.figures import BLUE, GREY, RED, new_figure
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.study_context import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLES = {"beam": ("beam", RED, "--"), "waveguide": ("2.5-D finite elements", BLUE, "-")}
_LARGEST_M = 0.012  # of a shape as it is drawn
_COLUMNS = 4


@dataclass(frozen=True)
class Shape:
    """A wave of a rail cross-section at a frequency."""

    frequency_hz: float
    wave: WaveShape
    mesh: Mesh


@dataclass(frozen=True)
class RailForces:
    """Peak forces over a weld on either rail, (n_speed, n_position)."""

    weld: str
    speeds_kmh: FloatArray
    beam: PeakMap
    waveguide: PeakMap

    @property
    def difference(self) -> FloatArray:
        """Return the finite elements' peak force relative to the beam's, less 1."""
        return np.asarray(self.waveguide.peak_force_n / self.beam.peak_force_n - 1)

    @property
    def worst(self) -> tuple[FloatArray, FloatArray]:
        """Return the worst position's force at each speed, of beam and finite elements."""
        return self.beam.peak_force_n.max(axis=1), self.waveguide.peak_force_n.max(axis=1)


def dispersion(frequency_hz: FloatArray, waves: dict[str, FloatArray]) -> Picture:
    """Draw wavenumbers of travelling waves over frequency."""
    figure = new_figure(7.0, 4.4)
    axes = figure.subplots()
    for name, numbers in waves.items():
        label, colour, _ = _STYLES[name]
        hz = np.broadcast_to(frequency_hz, numbers.shape)
        size, marker = (7, "x") if name == "beam" else (5, "o")
        axes.scatter(hz[:, ::3], numbers[:, ::3], size, color=colour, marker=marker, linewidths=0.7, label=label)
    axes.set(xlabel="frequency, Hz", ylabel="wavenumber, rad/m", xlim=(0, frequency_hz[-1]), ylim=(0, None))
    axes.legend(frameon=False, loc="upper left")
    return Picture(
        "rail-dispersion", "Waves along the free rail",
        "The beam has one travelling wave, bending. The finite elements have extension as well (the lowest line) and, "
        "from a few kilohertz on, waves that deform the cross-section.", figure,
    )  # fmt: skip


def receptances(frequency_hz: FloatArray, at_m: FloatArray, found: dict[str, ComplexArray]) -> Picture:
    """Draw receptances of the track with either rail."""
    figure = new_figure(7.0, 2.4 * len(at_m) + 0.6)
    panels = figure.subplots(len(at_m), 1, sharex=True, sharey=True)
    for row, (axes, x) in enumerate(zip(panels, at_m.tolist(), strict=True)):
        for name, values in found.items():
            label, colour, style = _STYLES[name]
            axes.plot(frequency_hz, np.abs(values[row]) * 1e9, style, color=colour, label=label)
        axes.set(yscale="log", ylabel="nm/N")
        label_panel(axes, f"{x * 100:.0f} cm after the sleeper")
    _over_frequency(panels[-1], frequency_hz)
    legend_above(figure, 2, panels[0])
    return Picture(
        "rail-receptances", "Receptances of the track",
        "The beam is enough as long as the lines coincide. Near the pinned-pinned resonance, about 1 kHz, a small "
        "shift of frequency makes a large difference.", figure,
    )  # fmt: skip


def differences(frequency_hz: FloatArray, at_m: FloatArray, found: dict[str, ComplexArray]) -> Picture:
    """Draw the relative difference of the receptances."""
    figure = new_figure(7.0, 3.8)
    axes = figure.subplots()
    difference = np.abs(found["waveguide"] / found["beam"] - 1) * 100
    for row, x, colour in zip(difference, at_m.tolist(), COLOURS, strict=False):
        axes.plot(frequency_hz, row, color=colour, label=f"{x * 100:.0f} cm after the sleeper")
    axes.axhline(5, color=GREY, linestyle=":", linewidth=1)
    axes.set(yscale="log", ylabel="difference of receptance, %", ylim=(0.1, 500))
    _over_frequency(axes, frequency_hz)
    axes.legend(frameon=False, loc="upper left")
    return Picture("rail-differences", "Where beam and finite elements differ", "Dotted: five per cent.", figure)


def peak_forces(forces: Sequence[RailForces]) -> Picture:
    """Draw the force against speed, the worst position at each, over every weld."""
    rows = -(-len(forces) // 2)
    figure = new_figure(7.0, 2.2 * rows + 0.6)
    panels = figure.subplots(rows, 2, sharex=True).ravel()
    for axes, one in zip(panels, forces, strict=False):
        for name, force in zip(_STYLES, one.worst, strict=True):
            label, colour, style = _STYLES[name]
            axes.plot(one.speeds_kmh, force / 1e3, style, color=colour, label=label)
        axes.set_title(one.weld, fontsize="small")
        axes.set(ylabel="kN")
    for axes in panels[-2:]:
        axes.set(xlabel="speed, km/h")
    legend_above(figure, 2, panels[0])
    return Picture(
        "rail-forces", "Peak force over the welds",
        "The worst position in the span at each speed, fits of both tracks by the same engine.", figure,
    )  # fmt: skip


def wave_shapes(shapes: Sequence[Shape]) -> Picture:
    """Draw the whole cross-section as waves deform it, mirrored from the half that was computed."""
    columns = min(_COLUMNS, len(shapes))
    rows = -(-len(shapes) // columns)
    figure = new_figure(7.0, 2.5 * rows)
    panels = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
    for axes in panels:
        axes.set_axis_off()
        axes.set_aspect("equal")
    for axes, shape in zip(panels, shapes, strict=False):
        _draw_shape(axes, shape)
    return Picture(
        "rail-waves", "Waves of the cross-section",
        "Grey: at rest. Displacements in its plane, greatly enlarged; above each its share along the rail.",
        figure,
    )  # fmt: skip


def _draw_shape(axes: "Axes", shape: Shape) -> None:
    along, in_section = shape.wave.displacement[0], shape.wave.displacement[1:]
    largest = float(np.abs(shape.wave.displacement).max())
    moved = shape.mesh.nodes + in_section * _LARGEST_M / max(float(np.abs(in_section).max()), 0.3 * largest)
    for nodes, colour, width in ((shape.mesh.nodes, "#cccccc", 0.6), (moved, BLUE, 0.9)):
        for side in (1, -1):
            y, z = nodes[:, shape.mesh.lines()]
            axes.plot(side * y * 1e3, z * 1e3, color=colour, linewidth=width)
    share = float(np.sum(along**2) / np.sum(shape.wave.displacement**2))
    named = f"{shape.frequency_hz / 1e3:.1f} kHz, {shape.wave.wavenumber_per_m:.1f} rad/m"
    axes.set_title(f"{named}\n{share * 100:.0f} % along the rail", fontsize="x-small")


def _over_frequency(axes: "Axes", frequency_hz: FloatArray) -> None:
    axes.set(xscale="log", xlabel="frequency, Hz", xlim=(20, frequency_hz[-1]))
    axes.set_xticks([20, 50, 100, 200, 500, 1000, 2000, 5000], ["20", "50", "100", "200", "500", "1k", "2k", "5k"])
    axes.minorticks_off()
