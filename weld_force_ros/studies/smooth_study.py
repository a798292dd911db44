"""Study `smooth`: the force on smooth rail, which only the discrete supports make (Fig. 13)."""

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies.figure_style import COLOURS, legend_above, mark_sleepers
from weld_force_ros.studies.result_table import Column, Table
from weld_force_ros.studies.study_context import BILBAO, Picture, Quantities, StudyContext, StudyResult, as_rows

SPEEDS_KMH = (100.0, 150.0, 200.0, 250.0)
_SPANS = 8
_SHOWN_SPANS = 2


def run(context: StudyContext) -> StudyResult:
    """Compute the force over whole spans at four speeds."""
    span_m = context.track(BILBAO).track.spacing_m
    histories = [context.smooth_rail(BILBAO, speed, _SPANS) for speed in SPEEDS_KMH]
    spans = [whole_spans(history.x_m, history.force_n, span_m) for history in histories]
    figure = new_figure(7.0, 4.2)
    axes = figure.subplots()
    for speed, (x, force), colour in zip(SPEEDS_KMH, spans, COLOURS, strict=False):
        shown = x <= x[0] + _SHOWN_SPANS * span_m
        axes.plot((x[shown] - x[0]) * 100, force[shown] / 1e3, color=colour, label=f"{speed:g} km/h")
    mark_sleepers(axes, span_m, _SHOWN_SPANS * span_m)
    axes.set(xlabel="distance from a sleeper, cm", ylabel="contact force, kN")
    legend_above(figure, 4)
    picture = Picture(
        "smooth-rail", "Smooth rail",
        "The force without any weld: it fluctuates about the static load, the same in each sleeper span. Its peak, "
        "the paper says, moves in the running direction as the speed rises. Dashed: sleepers.", figure,
    )  # fmt: skip
    rows = [
        (speed, *row)
        for speed, (x, force) in zip(SPEEDS_KMH, spans, strict=True)
        for row in as_rows(x[: len(x) // _SPANS] - x[0], force[: len(x) // _SPANS])
    ]
    table = Table(
        "Force on smooth rail over one span",
        (Column("speed_kmh", "km/h", 0), Column("x_m", "m", 4), Column("force_n", "N", 0)), rows,
    )  # fmt: skip
    measured = _claim_quantities(spans, span_m) if context.uses_paper_inputs else {}
    return StudyResult("smooth", "Parametric excitation", [picture], {"force": table}, measured)


def whole_spans(x_m: FloatArray, force_n: FloatArray, span_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the last whole spans from a sleeper on."""
    step_m = x_m[1] - x_m[0]
    points = round(span_m / step_m)
    first = int(np.ceil(x_m[0] / span_m - 1e-6))
    begin = round((first * span_m - x_m[0]) / step_m)
    count = (len(x_m) - begin) // points * points
    return x_m[begin : begin + count], force_n[begin : begin + count]


def _claim_quantities(spans: list[tuple[FloatArray, FloatArray]], span_m: float) -> Quantities:
    locations, wavelengths, shares = [], [], []
    for x, force in spans:
        count = round((x[-1] - x[0]) / span_m)
        lines = np.abs(np.fft.rfft(force - force.mean())) ** 2
        wavelengths.append(count * span_m / float(np.argmax(lines)))
        shares.append(float(lines[::count].sum() / lines.sum()))
        period = force[: len(force) // count]
        locations.append(span_m * float(np.argmax(period)) / len(period))
    unwrapped = np.unwrap(locations, period=span_m)
    return {
        "smooth.mean_force_n": [float(force.mean()) for _, force in spans],
        "smooth.strongest_wavelength_m": wavelengths,
        "smooth.harmonics_share": shares,
        "smooth.peak_location_m": [float(location) for location in unwrapped],
        "smooth.peak_moves_forward": bool(np.all(np.diff(unwrapped) > 0)),
    }
