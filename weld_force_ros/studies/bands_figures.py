"""Pictures of the study `bands`."""

from collections.abc import Sequence

from weld_force_ros.physics.analysis.spectra import CUT_HZ
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.report.figures import BLUE, GREEN, GREY, RED, as_text, new_figure
from weld_force_ros.studies.band_split import BandSplit
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.spectrum_figures import mark_frequencies
from weld_force_ros.studies.study_context import Picture

_SHOWN_HZ = (20, 2000)


def parts(weld: str, name: str, passages: Sequence[BandSplit], shown_m: tuple[float, float]) -> Picture:
    """Draw the dynamic force and its two parts at each speed."""
    figure = new_figure(7.0, 1.2 + 1.7 * len(passages))
    panels = figure.subplots(len(passages), 1, sharex=True)
    for axes, split in zip(panels, passages, strict=True):
        x = split.passage.x_m
        inside = (x >= shown_m[0]) & (x <= shown_m[1])
        total = split.low_n + split.parts.high_n
        for label, force, colour, style in (
            ("total", total, BLUE, "-"), ("below 530 Hz", split.low_n, GREEN, "--"),
            ("above 530 Hz", split.parts.high_n, RED, "-."),
        ):  # fmt: skip
            axes.plot(x[inside] * 1e3, force[inside] / 1e3, style, color=colour, label=label)
        axes.axhline(0, color=GREY, linewidth=0.6, zorder=0)
        label_panel(axes, f"{split.speed_kmh:g} km/h")
    panels[-1].set(xlabel="distance after the weld's centre, mm", xlim=(shown_m[0] * 1e3, shown_m[1] * 1e3))
    figure.supylabel("dynamic contact force, kN", fontsize="medium")
    legend_above(figure, 3, panels[0])
    return Picture(
        name, f"Force below and above 530 Hz: {weld}",
        "Where the parts have opposite signs at the peak, it is lowered and splits; where they have the same sign, "
        "they add up. The part below 530 Hz lengthens and moves in the running direction with speed.", figure,
    )  # fmt: skip


def curves(labels: Sequence[str], speeds_kmh: FloatArray, peak_maps: Sequence[PeakMap]) -> Picture:
    """Draw the peak force of a weld and its inverse against speed."""
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    for label, peak_map, colour, style in zip(labels, peak_maps, COLOURS, ("-", "--"), strict=False):
        axes.plot(speeds_kmh, peak_map.peak_force_n[:, 0] / 1e3, style, color=colour, label=as_text(label))
    axes.set(xlabel="speed, km/h", ylabel="peak force, kN")
    legend_above(figure, 2)
    return Picture(
        "bands-curves", "Peak force over a weld and the same upside down",
        "Over a rise, the paper says, the force keeps growing, nearly along a line; over a dip it has a maximum and a "
        "local minimum after it. Which of the two gives less depends on the speed.", figure,
    )  # fmt: skip


def spectra(weld: str, passages: Sequence[BandSplit]) -> Picture:
    """Draw spectra of the force at several speeds around the cut frequency."""
    figure = new_figure(7.0, 3.8)
    axes = figure.subplots()
    for split, colour, style in zip(passages, COLOURS, (":", "-.", "--", "-"), strict=False):
        frequency, amplitude = split.spectrum.frequency_hz, split.spectrum.amplitude
        inside = (frequency >= _SHOWN_HZ[0]) & (frequency <= _SHOWN_HZ[1])
        axes.plot(frequency[inside], amplitude[inside], style, color=colour, label=f"{split.speed_kmh:g} km/h")
    axes.axvline(CUT_HZ, color=GREY, linewidth=0.8, linestyle="--", zorder=0)
    axes.text(CUT_HZ * 1.03, axes.get_ylim()[1] * 0.97, f"{CUT_HZ:g} Hz", va="top")
    axes.set(ylabel="force, N")
    mark_frequencies(axes, *_SHOWN_HZ)
    axes.set_ylim(bottom=0)
    legend_above(figure, 4)
    return Picture(
        "bands-spectra", f"Spectra of the force about 530 Hz: {weld}",
        "Over a short dip, the paper says, peaks below the cut stay where they are at every speed, and those above it "
        "move to higher frequencies. Amplitudes of the whole record.", figure,
    )  # fmt: skip
