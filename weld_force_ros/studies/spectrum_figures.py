"""Pictures of the study `spectrum`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.analysis.spectra import Spectrum, resonances_hz
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.study_context import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TICKS_HZ = (10, 20, 50, 100, 200, 500, 1000, 2000)
_WELD_HZ = (10, 600)
_DIP_HZ = (40, 2000)  # below, the record's own length shows in the spectrum of a dip that has a mean


@dataclass(frozen=True)
class Excitation:
    """Spectra of a weld's irregularity (m) and of the force over it (N) at a speed."""

    weld: str
    speed_kmh: float
    force: Spectrum
    irregularity: Spectrum


def receptance_picture(
    frequency_hz: FloatArray, receptances: dict[str, ComplexArray], positions_m: FloatArray, where: str
) -> Picture:
    """Draw receptances of the track alone and with the wheelset; `where` names the wheelset's track or position."""
    figure = new_figure(7.0, 6.6)
    above, below = figure.subplots(2, 1, sharex=True)
    for magnitude, at_m, colour in zip(np.abs(receptances["positions"]), positions_m, COLOURS, strict=False):
        above.plot(frequency_hz, magnitude * 1e9, color=colour, label=f"{at_m * 100:.0f} cm")
    above.legend(title="after a sleeper", frameon=False, loc="lower left", ncols=2)
    shown = {"span_mean": "track, mean over the span", "simulated_track": f"track, {where}",
             "wheelset_track": f"wheelset on the track, {where}"}  # fmt: skip
    for (name, label), colour, style in zip(shown.items(), COLOURS, ("-", "--", "-"), strict=False):
        below.plot(frequency_hz, np.abs(receptances[name][0]) * 1e9, style, color=colour, label=label)
    below.legend(frameon=False, loc="lower left")
    for axes in (above, below):
        axes.set(ylabel="receptance, nm/N", yscale="log")
        mark_frequencies(axes, frequency_hz[0], frequency_hz[-1])
    above.set(xlabel="")
    return Picture(
        "spectrum-receptance", "Receptances of track and wheelset",
        "Above: positions in the span differ most near the pinned-pinned resonance. Below: the track that this study "
        "simulates, and the mean over the span; the wheelset on it has resonances of its own.", figure,
    )  # fmt: skip


def weld_pictures(weld: str, excitations: list[Excitation], wheelset: tuple[FloatArray, FloatArray]) -> list[Picture]:
    """Draw spectra at all speeds together, and speed by speed with the wheelset's receptance."""
    return [_all_speeds(weld, excitations), _by_speed(weld, excitations, wheelset)]


def _all_speeds(weld: str, excitations: list[Excitation]) -> Picture:
    figure = new_figure(7.0, 5.6)
    above, below = figure.subplots(2, 1, sharex=True)
    styles = ("-", "--", "-.", ":")
    for excitation, colour, style in zip(excitations, COLOURS, styles, strict=False):
        label = f"{excitation.speed_kmh:g} km/h"
        force, irregularity = excitation.force, excitation.irregularity
        above.plot(force.frequency_hz, force.amplitude / 1e3, style, color=colour, label=label)
        below.plot(irregularity.frequency_hz, irregularity.amplitude * 1e6, style, color=colour)
    above.set(ylabel="force, kN")
    below.set(xlabel="frequency, Hz", ylabel="irregularity, μm", xlim=_WELD_HZ)
    legend_above(figure, 4)
    return Picture(
        "spectrum-speeds", f"Spectra of force and irregularity: {weld}",
        "Below: the weld's peaks keep their wavelength and so move with speed. Above: the force has the same "
        "frequencies, strongest where they meet a resonance. Amplitudes of the whole record.", figure,
    )  # fmt: skip


def _by_speed(weld: str, excitations: list[Excitation], wheelset: tuple[FloatArray, FloatArray]) -> Picture:
    figure = new_figure(7.0, 8.0)
    panels = figure.subplots(len(excitations), 1, sharex=True, sharey=True)
    for axes, excitation in zip(panels, excitations, strict=True):
        _draw_relative(axes, excitation, wheelset, _WELD_HZ)
        label_panel(axes, f"{excitation.speed_kmh:g} km/h")
    panels[-1].set(xlabel="frequency, Hz", xlim=_WELD_HZ, ylim=(0, 1.08))
    figure.supylabel("relative to the largest", fontsize="medium")
    legend_above(figure, 3, panels[0])
    return Picture(
        "spectrum-resonance", f"Where the weld meets the resonances: {weld}",
        "Each curve relative to its largest value; the two resonances of the wheelset on the track are dotted. The "
        "force is strong at those wavelengths of the weld that come near one of them: at each speed others.", figure,
    )  # fmt: skip


def dip_picture(weld: str, excitation: Excitation, wheelset: tuple[FloatArray, FloatArray], cut_hz: float) -> Picture:
    """Draw the spectrum over the cosine dip."""
    figure = new_figure(7.0, 3.8)
    axes = figure.subplots()
    _draw_relative(axes, excitation, wheelset, _DIP_HZ)
    axes.axvline(cut_hz, color=GREY, linewidth=0.8, linestyle="--")
    axes.text(cut_hz * 1.03, 1.0, f"{cut_hz:g} Hz", va="top")
    axes.set(ylabel="relative to the largest", ylim=(0, 1.08))
    mark_frequencies(axes, *_DIP_HZ)
    legend_above(figure, 3)
    return Picture(
        "spectrum-dip", f"Spectrum at {excitation.speed_kmh:g} km/h: {weld}",
        "The short dip excites low frequencies alike: the force's first two peaks lie near the resonances of the "
        "wheelset on the track (dotted). Above 530 Hz there is none; what lies there comes from the dip.", figure,
    )  # fmt: skip


def mark_frequencies(axes: "Axes", from_hz: float, to_hz: float) -> None:
    """Make the horizontal axis logarithmic in frequency, with plain numbers."""
    ticks = [tick for tick in _TICKS_HZ if from_hz <= tick <= to_hz]
    axes.set(xscale="log", xlabel="frequency, Hz")
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.set_xlim(from_hz, to_hz)


def _draw_relative(
    axes: "Axes", excitation: Excitation, wheelset: tuple[FloatArray, FloatArray], shown_hz: tuple[int, int]
) -> None:
    curves = (
        ("force", excitation.force.frequency_hz, excitation.force.amplitude, COLOURS[0], "-"),
        ("irregularity", excitation.irregularity.frequency_hz, excitation.irregularity.amplitude, COLOURS[1], "--"),
        ("receptance, wheelset on track", *wheelset, GREY, ":"),
    )
    for label, frequency, values, colour, style in curves:
        inside = (frequency >= shown_hz[0]) & (frequency <= shown_hz[1])
        largest = values[inside].max() or 1.0  # a level weld has no spectrum
        axes.plot(frequency[inside], values[inside] / largest, style, color=colour, label=label)
    for resonance in resonances_hz(*wheelset):
        axes.axvline(resonance, color=GREY, linewidth=0.8, linestyle=":", zorder=0)
