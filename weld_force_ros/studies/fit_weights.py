"""The effect of the weights of a fit on the speeds that the paper names for its cosine dips.

The paper weights errors so that low frequencies are fitted more accurately (section 1), by a vector that it does not
give. Weights 1 / (|h| f^n) do so, more with every n: which n the paper's second kinks ask for, and what that costs.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies import dip_speeds
from weld_force_ros.studies.dip_speeds import LABELS, PAPERS_KMH, DipSpeeds
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.paper_variant import fractions_of, relative_difference
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, StudyContext

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPONENTS = (0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0)


@dataclass(frozen=True)
class WeightEffect:
    """A fit of the continuous track with weights 1 / (|h| f^exponent).

    Attributes:
        exponent: n.
        fit_error: RMS of the relative error of the receptance over the fit's band.
        speeds_kmh: over both dips.
    """

    exponent: float
    fit_error: float
    speeds_kmh: DipSpeeds


def weight_effects(context: StudyContext) -> list[WeightEffect]:
    """Fit the continuous track with each exponent, and roll over both dips at 20 to 300 km/h."""
    track, effects = context.track(CONTINUOUS).track, []
    for exponent in EXPONENTS:
        model = fractions_of(track, favour_low=exponent)
        speeds = dip_speeds.dip_speeds(context, model)
        effects.append(WeightEffect(exponent, relative_difference(model, track), speeds))
    return effects


def weight_table(effects: list[WeightEffect]) -> Table:
    """Return a row an exponent."""
    columns = (Column("exponent", "n", 1), Column("fit_error", "RMS error of the receptance", 3), *dip_speeds.COLUMNS)
    rows: list[tuple[Cell, ...]] = [(one.exponent, one.fit_error, *dip_speeds.cells(one.speeds_kmh)) for one in effects]
    return Table("Weights that favour low frequencies, 1 / (|h| f^n)", columns, rows)


def weight_figure(effects: list[WeightEffect]) -> "Figure":
    """Draw the speeds over the exponent, the paper's dashed."""
    figure = new_figure(7.0, 6.0)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (dip, papers_kmh) in zip(panels, PAPERS_KMH.items(), strict=True):
        for number, (label, colour) in enumerate(zip(LABELS, COLOURS, strict=False)):
            found = [one.speeds_kmh[dip][number] for one in effects]
            axes.plot([one.exponent for one in effects], found, "o-", color=colour, label=label)
            axes.axhline(papers_kmh[number], color=GREY, linewidth=0.8, linestyle="--", zorder=0)
        label_panel(axes, dip)
        axes.set_ylabel("speed, km/h")
    panels[-1].set_xlabel("n, of weights 1 / (|h| f^n)")
    legend_above(figure, 3, panels[0])
    return figure
