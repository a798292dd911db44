"""The effect of the weights of a fit on the speeds that the paper names for its cosine dips.

The paper weights errors so that low frequencies are fitted more accurately (section 1), by a vector that it does not
give. Weights 1 / (|h| f^n) do so, more with every n: which n the paper's second kinks ask for, and what that costs.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies import passage_curves
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.paper_variant import fractions_of, relative_difference
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, DIP_48, DIP_96, StudyContext

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPONENTS = (0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0)
PAPERS_KMH = {DIP_48: (53.0, 74.0, 112.0), DIP_96: (107.0, 152.0, 230.0)}
"""First maximum, first and second kink of each dip."""
_LABELS = ("first maximum", "first kink", "second kink")


@dataclass(frozen=True)
class WeightEffect:
    """A fit of the continuous track with weights 1 / (|h| f^exponent).

    Attributes:
        exponent: n.
        fit_error: RMS of the relative error of the receptance over the fit's band.
        speeds_kmh: first maximum, first and second kink over each dip, km/h; NaN where there is none.
    """

    exponent: float
    fit_error: float
    speeds_kmh: dict[str, tuple[float, float, float]]


def weight_effects(context: StudyContext) -> list[WeightEffect]:
    """Fit the continuous track with each exponent, and roll over both dips at 20 to 300 km/h."""
    definition, speeds = context.track(CONTINUOUS), context.speeds(20, 300, 1)
    effects = []
    for exponent in EXPONENTS:
        model = fractions_of(definition.track, favour_low=exponent)
        fast, found = VehicleTrackModel(model, definition.wheel), {}
        for dip in PAPERS_KMH:
            peak_map = fast.peak_map(context.wheel_path(dip, CONTINUOUS), speeds, [0.0])
            maximum, _ = passage_curves.first_maximum(passage_curves.features(speeds, peak_map.peak_force_n[:, 0]))
            found[dip] = (float(maximum), *passage_curves.first_kinks_kmh(speeds, peak_map))
        effects.append(WeightEffect(exponent, relative_difference(model, definition.track), found))
    return effects


def weight_table(effects: list[WeightEffect]) -> Table:
    """Return a row an exponent."""
    columns = (
        Column("exponent", "n", 1), Column("fit_error", "RMS error of the receptance", 3),
        *(Column(f"{key}_{dip}", f"{label}, {dip}, km/h", 1)
          for dip in PAPERS_KMH for key, label in zip(("maximum", "first", "second"), _LABELS, strict=True)),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (one.exponent, one.fit_error, *(speed for dip in PAPERS_KMH for speed in one.speeds_kmh[dip]))
        for one in effects
    ]
    return Table("Weights that favour low frequencies, 1 / (|h| f^n)", columns, rows)


def weight_figure(effects: list[WeightEffect]) -> "Figure":
    """Draw the speeds over the exponent, the paper's dashed."""
    figure = new_figure(7.0, 6.0)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (dip, papers_kmh) in zip(panels, PAPERS_KMH.items(), strict=True):
        for number, (label, colour) in enumerate(zip(_LABELS, COLOURS, strict=False)):
            found = [one.speeds_kmh[dip][number] for one in effects]
            axes.plot([one.exponent for one in effects], found, "o-", color=colour, label=label)
            axes.axhline(papers_kmh[number], color=GREY, linewidth=0.8, linestyle="--", zorder=0)
        label_panel(axes, dip)
        axes.set_ylabel("speed, km/h")
    panels[-1].set_xlabel("n, of weights 1 / (|h| f^n)")
    legend_above(figure, 3, panels[0])
    return figure
