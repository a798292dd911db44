"""The figure of a track that was identified: receptances as measured and as found (extra: report)."""

from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.physics.track.identification import Identified, MeasuredReceptance
from weld_force_ros.report.figures import BLUE, GREY, as_text, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def identification_figure(
    measured: MeasuredReceptance, used: MeasuredReceptance, found: Identified, title: str
) -> "Figure":
    """Draw magnitude and phase of the measured receptance and of the track that was found, a column a place.

    Args:
        measured: all of it.
        used: what the track was found from.
        found: the track.
        title: above the figure.
    """
    figure = new_figure(5.5 * len(measured.at_spans), 6.0)
    axes = figure.subplots(2, len(measured.at_spans), sharex=True, squeeze=False)
    ours = receptance(found.track, measured.frequency_hz, found.track.spacing_m * measured.at_spans)
    for column, (at_spans, theirs) in enumerate(zip(measured.at_spans, measured.m_per_n, strict=True)):
        for response, colour, label in ((theirs, GREY, "measured"), (ours[column], BLUE, "identified")):
            axes[0, column].plot(measured.frequency_hz, np.abs(response), color=colour, label=label)
            axes[1, column].plot(measured.frequency_hz, np.degrees(np.angle(response)), color=colour)
        for here in axes[:, column]:
            here.axvspan(used.frequency_hz[0], used.frequency_hz[-1], color=BLUE, alpha=0.06, linewidth=0)
        axes[0, column].set(
            xscale="log", yscale="log", ylabel="receptance, m/N", title="mid-span" if at_spans else "over a sleeper"
        )
        axes[1, column].set(xlabel="frequency, Hz; shaded: what was used", ylabel="phase, degrees")
    axes[0, 0].legend(fontsize=8)
    figure.suptitle(as_text(title), fontweight="bold")
    return figure
