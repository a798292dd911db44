"""The figure of a fit: receptances, Pareto front or error, coefficients or poles (extra: report)."""

from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.engines.moving_poles import MovingPoleModel
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.report.figures import BLUE, GREEN, GREY, ORANGE, RED, new_figure
from weld_force_ros.simulation.fit_file import AnyFit, RfpFit
from weld_force_ros.simulation.track_file import TrackDefinition

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The sections of the paper's Fig. 5, as shares of its 60 cm span.
_SECTIONS = np.array([32, 40, 44, 52, 60]) / 60
_COLOURS = (BLUE, ORANGE, GREEN, RED, "#CC79A7")


def fit_figure(definition: TrackDefinition, fit: AnyFit) -> "Figure":
    """Draw the fit's receptance beside the exact one at five positions of the span.

    Below it stand a rational fit's Pareto front and coefficients; of common poles, the error by band and the poles.
    """
    figure = new_figure(11, 8)
    (magnitude, phase), (left, right) = figure.subplots(2, 2)
    _draw_receptances(magnitude, phase, definition, fit)
    if isinstance(fit, RfpFit):
        _draw_front(left, fit)
        _draw_coefficients(right, fit)
    else:
        _draw_error(left, fit)
        model = fit.model()
        poles = model.poles_at(0.0) if isinstance(model, MovingPoleModel) else model.poles_rad_s
        right.plot(poles.real / (2 * np.pi), poles.imag / (2 * np.pi), "x", color=BLUE)
        right.axvline(0, color=GREY, linewidth=0.6)
        right.set(xlabel="real part / 2π, Hz", ylabel="imaginary part / 2π, Hz", title="poles, shared by all sections")
    figure.suptitle(f"{fit.track}: {fit.engine} of order {fit.order}", fontweight="bold")
    return figure


def _draw_receptances(magnitude: "Axes", phase: "Axes", definition: TrackDefinition, fit: AnyFit) -> None:
    frequency = np.geomspace(5.0, 2500.0, 500)
    at = _SECTIONS * fit.spacing_m
    exact, fitted = receptance(definition.track, frequency, at), fit.model().receptance(frequency, at)
    for row, colour in enumerate(_COLOURS[: 1 if definition.track.continuous else None]):
        label = "everywhere" if definition.track.continuous else f"{100 * at[row]:.0f} cm"
        magnitude.loglog(frequency, np.abs(exact[row]), color=colour, linewidth=1, label=label)
        magnitude.loglog(frequency, np.abs(fitted[row]), color=colour, linewidth=1.6, linestyle="--")
        phase.semilogx(frequency, np.degrees(np.angle(exact[row])), color=colour, linewidth=1)
        phase.semilogx(frequency, np.degrees(np.angle(fitted[row])), color=colour, linewidth=1.6, linestyle="--")
    magnitude.set(xlabel="frequency, Hz", ylabel="receptance, m/N", title="exact (solid) and fitted (dashed)")
    magnitude.legend(fontsize=8, title="after the sleeper", title_fontsize=8)
    phase.set(xlabel="frequency, Hz", ylabel="phase, degrees", title="exact (solid) and fitted (dashed)")


def _draw_front(axes: "Axes", fit: RfpFit) -> None:
    axes.plot(fit.front_variation, 100 * np.array(fit.front_error), "o-", color=BLUE, markersize=4, label="front")
    axes.plot(
        fit.front_variation[fit.knee], 100 * fit.front_error[fit.knee], "o", color=RED, markersize=9, label="chosen"
    )
    axes.plot(fit.plain_variation, 100 * fit.plain_error, "s", color=GREY, label="weights 1/|h|")
    axes.set(
        xlabel="variation of the coefficients along the span", ylabel="error of the fit, %",
        title=f"NSGA-II, seed {fit.seed}, {fit.generations} generations of {fit.population}",
    )  # fmt: skip
    if fit.plain_variation > 20 * max(fit.front_variation):
        axes.set_xscale("log")
    axes.legend(fontsize=8)


def _draw_coefficients(axes: "Axes", fit: RfpFit) -> None:
    denominator = fit.model().denominator
    closed = np.vstack([denominator, denominator[:1]]) / np.mean(denominator, axis=0)
    at_cm = 100 * fit.spacing_m * np.arange(len(closed)) / len(denominator)
    for k in range(fit.order):
        axes.plot(at_cm, closed[:, k], color=_COLOURS[k % 5], linestyle=("-", "--", ":")[k // 5], label=f"a{k + 1}")
    axes.set(xlabel="distance from the sleeper, cm", ylabel="coefficient / its mean", title="denominator over the span")
    axes.legend(fontsize=7, ncols=3)


def _draw_error(axes: "Axes", fit: AnyFit) -> None:
    names = [f"{low:g}-{high:g}" for low, high in zip(fit.bands_hz[::2], fit.bands_hz[1::2], strict=True)]
    place = np.arange(len(names))
    axes.bar(place - 0.2, 100 * np.array(fit.error_by_band), 0.4, color=BLUE, label="fit")
    axes.bar(place + 0.2, 100 * np.array(fit.acausal_floor_by_band), 0.4, color=GREY, label="cut at the impulse")
    axes.set(xticks=place, xticklabels=names, xlabel="band, Hz", ylabel="RMS error, %", title="what the contact sees")
    axes.legend(fontsize=8)
