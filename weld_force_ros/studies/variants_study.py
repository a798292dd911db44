"""Study `variants`: which of the exact claims depend on the fit, or on the continuous track, which is not given."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.analysis.spectra import resonances_hz, wheelset_track_receptance
from weld_force_ros.physics.track import beam
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies import StartProgress, claims, passage_curves
from weld_force_ros.studies.claims import EvaluatedClaim
from weld_force_ros.studies.figure_style import COLOURS, label_panel, legend_above
from weld_force_ros.studies.fit_weights import PAPERS_KMH, weight_effects, weight_figure, weight_table
from weld_force_ros.studies.paper_variant import ALIKE_BAND_HZ, PaperVariant
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import (
    BILBAO,
    CONTINUOUS,
    Picture,
    Quantities,
    StudyContext,
    StudyResult,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STUDIES = ("validation", "smooth", "length", "hertz", "spectrum", "bands")
OURS = "ours"
_FREQUENCIES_HZ = np.arange(20.0, 1500.5, 2.0)
_RESONANCE_HZ = np.arange(10.0, 1500.5, 1.0)


def run(coarse: bool, start_progress: StartProgress) -> StudyResult:
    """Evaluate the claims of exact geometry with our model and with each variant."""
    contexts = {
        OURS: StudyContext(coarse=coarse),
        "fractions": PaperVariant(coarse=coarse),
        "fractions, fitted continuous": PaperVariant(coarse=coarse, fitted_continuous=True),
    }
    done = start_progress("studies", len(contexts) * len(STUDIES))
    evaluated = {name: _evaluated(context, done) for name, context in contexts.items()}
    weights = weight_effects(contexts[OURS])
    pictures = [
        Picture(
            "curves", "Force over the cosine dips, by variant",
            "Peak force over the dips of 48 mm (above) and 96 mm on continuous support. Dashed: the speeds that the "
            "paper names for the first maximum and both sharp angles; triangles: kinks here.", _curves(contexts),
        ),
        Picture(
            "continuous", "The continuous track, smeared and fitted",
            "Magnitude of receptance: the mean over the span of the discrete track, its supports smeared, and the "
            f"continuous track whose supports are fitted to that mean up to {ALIKE_BAND_HZ[1]:g} Hz (dashed).",
            _receptances(contexts),
        ),
        Picture(
            "weights", "Fits that favour low frequencies",
            "First maximum and kinks over the dips of 48 mm (above) and 96 mm, by fractions of degree 7 over 8 whose "
            "errors are weighted with 1 / (|h| f^n). Dashed: the paper's speeds. Its second kinks, over both dips, are "
            "those of n = 0.9, where the first kinks come late and the receptance is off.", weight_figure(weights),
        ),
    ]  # fmt: skip
    tables = {
        "counts": _counts(evaluated),
        "claims": _claim_table(evaluated),
        "tracks": _track_table(contexts),
        "weights": weight_table(weights),
    }
    return StudyResult("variants", "The paper's fit and its continuous track", pictures, tables)


def _evaluated(context: StudyContext, done: Callable[[], object]) -> list[EvaluatedClaim]:
    measured: Quantities = {}
    for name in STUDIES:
        measured |= import_module(f"weld_force_ros.studies.{name}_study").run(context).measured
        done()
    return claims.evaluate([claim for claim in claims.load() if claim.geometry == "exact"], measured)


def _counts(evaluated: Mapping[str, Sequence[EvaluatedClaim]]) -> Table:
    columns = (Column("variant", "variant"), *(Column(r, r, 0) for r in ("agrees", "partly", "differs")))
    rows: list[tuple[Cell, ...]] = [
        (name, *(float(sum(claim.result == column.name for claim in several)) for column in columns[1:]))
        for name, several in evaluated.items()
    ]
    return Table("Claims of exact geometry by variant", columns, rows)


def _claim_table(evaluated: Mapping[str, Sequence[EvaluatedClaim]]) -> Table:
    """Return what each variant measures, of the claims that do not agree in all of them."""
    columns = (
        Column("id", "claim"), Column("where"), Column("statement"), Column("variant", "variant"),
        Column("result", "result"), Column("measured", "measured"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for several in zip(*evaluated.values(), strict=True):
        if any(claim.result != "agrees" for claim in several):
            rows += [
                (claim.id, claim.where, claim.statement, name, claim.result, claim.measured)
                for name, claim in zip(evaluated, several, strict=True)
            ]
    return Table("Claims of exact geometry that differ in one variant or more", columns, rows)


def _track_table(contexts: Mapping[str, StudyContext]) -> Table:
    columns = (
        Column("variant", "continuous track of"), Column("pad_n_per_m"), Column("pad_loss_factor"),
        Column("half_sleeper_kg"), Column("ballast_n_per_m"), Column("ballast_loss_factor"),
        Column("difference", "from the span's mean, RMS", 3), Column("first_resonance_hz", "Hz", 1),
        Column("second_resonance_hz", "Hz", 1),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    frequency_hz = np.arange(ALIKE_BAND_HZ[0], ALIKE_BAND_HZ[1] + 0.5)
    for name, context in contexts.items():
        definition, discrete = context.track(CONTINUOUS), context.track(BILBAO).track
        track, wheel = definition.track, definition.wheel
        mean = np.abs(beam.receptance(discrete, frequency_hz, beam.sections(discrete, 15)).mean(axis=0))
        ratio = np.abs(beam.receptance(track, frequency_hz, 0.0)[0]) / mean
        with_wheel = wheelset_track_receptance(track, wheel, _RESONANCE_HZ, 0.0)[0]
        first, second, *_ = [*resonances_hz(_RESONANCE_HZ, with_wheel), np.nan, np.nan]
        pad, ballast = track.support.springs
        rows.append((
            name, pad.stiffness_n_per_m, getattr(pad, "loss_factor", None), track.support.mass_kg,
            ballast.stiffness_n_per_m, getattr(ballast, "loss_factor", None),
            float(np.sqrt(np.mean((ratio - 1) ** 2))), float(first), float(second),
        ))  # fmt: skip
    return Table("The continuous track", columns, rows)


def _curves(contexts: Mapping[str, StudyContext]) -> "Figure":
    figure = new_figure(7.0, 6.0)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (dip, papers_kmh) in zip(panels, PAPERS_KMH.items(), strict=True):
        for (name, context), colour in zip(contexts.items(), COLOURS, strict=False):
            speeds = context.speeds(20, 300, 1)
            peak_map = context.peak_map(dip, CONTINUOUS, speeds, [0.0])
            force_kn = peak_map.peak_force_n[:, 0] / 1e3
            axes.plot(speeds, force_kn, color=colour, label=name)
            kinks = passage_curves.kinks_kmh(speeds, peak_map)
            axes.plot(kinks, np.interp(kinks, speeds, force_kn), "v", color=colour, fillstyle="none", markersize=8)
        for speed in papers_kmh:
            axes.axvline(speed, color=GREY, linewidth=0.8, linestyle="--", zorder=0)
        label_panel(axes, dip)
        axes.set_ylabel("peak force, kN")
    panels[-1].set_xlabel("speed, km/h")
    legend_above(figure, 3, panels[0])
    return figure


def _receptances(contexts: Mapping[str, StudyContext]) -> "Figure":
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    discrete = contexts[OURS].track(BILBAO).track
    mean = np.abs(beam.receptance(discrete, _FREQUENCIES_HZ, beam.sections(discrete, 15)).mean(axis=0))
    axes.loglog(_FREQUENCIES_HZ, mean, color=GREY, linewidth=2.5, label="discrete, mean over the span")
    fitted = [name for name, context in contexts.items() if getattr(context, "fitted_continuous", False)]
    for name, label, colour in ((OURS, "smeared", COLOURS[0]), (fitted[0], "fitted", COLOURS[1])):
        magnitude = np.abs(beam.receptance(contexts[name].track(CONTINUOUS).track, _FREQUENCIES_HZ, 0.0)[0])
        axes.loglog(_FREQUENCIES_HZ, magnitude, color=colour, label=label)
    axes.axvline(ALIKE_BAND_HZ[1], color=GREY, linewidth=0.8, linestyle="--")
    axes.set(xlabel="frequency, Hz", ylabel="receptance, m/N")
    legend_above(figure, 3)
    return figure
