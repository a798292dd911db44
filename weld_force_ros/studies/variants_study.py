"""Study `variants`: what explains the exact claims that differ.

All of them are evaluated with the paper's fit and with its continuous track fitted, beside ours; and each that differs
has an experiment of its own: readings of the continuous track, the paper's fit as its text describes it, weights that
favour low frequencies, the contact's stiffness over speed, receptances along the span over frequency, harmonics of the
sleeper passing, and the parts of the force at its peak.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from weld_force_ros.physics.analysis.spectra import resonances_hz, wheelset_track_receptance
from weld_force_ros.physics.track import beam
from weld_force_ros.report.figures import GREY, new_figure
from weld_force_ros.studies import (
    StartProgress,
    claims,
    continuous_readings,
    dip_speeds,
    force_parts,
    hertz_change,
    papers_fit,
    passage_curves,
    position_ratio,
    sleeper_harmonics,
)
from weld_force_ros.studies.claims import EvaluatedClaim
from weld_force_ros.studies.dip_speeds import PAPERS_KMH
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.fit_weights import weight_effects, weight_figure, weight_table
from weld_force_ros.studies.paper_variant import ALIKE_BAND_HZ, PaperVariant
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import (
    BILBAO,
    CONTINUOUS,
    DIP_48,
    Picture,
    Quantities,
    StudyContext,
    StudyResult,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STUDIES = ("validation", "smooth", "length", "hertz", "spectrum", "bands")
OURS, OURS_FITTED = "ours", "ours, fitted continuous"
EXPERIMENTS = ("tracks", "fits", "weights", "hertz", "positions", "harmonics", "parts")
"""Each is a table, some a picture as well."""
_FREQUENCIES_HZ = np.arange(20.0, 1500.5, 2.0)
_RESONANCE_HZ = np.arange(10.0, 1500.5, 1.0)


def run(coarse: bool, start_progress: StartProgress) -> StudyResult:
    """Evaluate the claims of exact geometry with our model and with each variant, and run the experiments."""
    contexts = {
        OURS: StudyContext(coarse=coarse),
        OURS_FITTED: PaperVariant(coarse=coarse, fitted_continuous=True, fractions=False),
        "fractions": PaperVariant(coarse=coarse),
        "fractions, fitted continuous": PaperVariant(coarse=coarse, fitted_continuous=True),
    }
    done = start_progress("studies", len(contexts) * len(STUDIES))
    # On contexts of their own: each keeps gigabytes of tables of its passages.
    evaluated = {name: _evaluated(replace(context), done) for name, context in contexts.items()}
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
    ]  # fmt: skip
    tables = {"counts": _counts(evaluated), "claims": _claim_table(evaluated), "tracks": _track_table(contexts)}
    advance = start_progress("experiments", len(EXPERIMENTS))
    more_pictures, more_tables = _experiments(contexts, advance)
    return StudyResult(
        "variants", "The paper's fit and its continuous track", pictures + more_pictures, tables | more_tables
    )


def _experiments(
    contexts: Mapping[str, StudyContext], advance: Callable[[], object]
) -> tuple[list[Picture], dict[str, Table]]:
    """Return what explains each claim that differs: pictures, and tables by name."""
    ours, tables, pictures = contexts[OURS], {}, []
    tables["readings"] = continuous_readings.table(continuous_readings.readings(ours))
    advance()
    both = {
        name: papers_fit.papers_fits(contexts[variant])
        for name, variant in (("smeared", OURS), ("fitted", OURS_FITTED))
    }
    tables["papers_fit"] = papers_fit.table(both)
    advance()
    weights = weight_effects(ours)
    tables["weights"] = weight_table(weights)
    pictures.append(Picture(
        "weights", "Fits that favour low frequencies",
        "First maximum and kinks over the dips of 48 mm (above) and 96 mm, by fractions of degree 7 over 8 whose "
        "errors are weighted with 1 / (|h| f^n). Dashed: the paper's speeds. Its second kinks, over both dips, are "
        "those of n = 0.9, where the first kinks come late and the receptance is off.", weight_figure(weights),
    ))  # fmt: skip
    advance()
    tables["hertz"] = hertz_change.table(hertz_change.hertz_changes(ours))
    advance()
    ratios = position_ratio.position_ratios(ours)
    tables["positions"] = position_ratio.table(ratios)
    pictures.append(Picture(
        "positions", "How much receptances differ along the span",
        "Largest over smallest magnitude among the positions of the paper's Fig. 5, the rail as a beam and by 2.5-D "
        "finite elements. Dashed: 300 Hz, where the criterion asks for less than 1.5 (line), and the pinned-pinned "
        "resonance, about which they differ most.", position_ratio.figure(ratios),
    ))  # fmt: skip
    advance()
    harmonics = sleeper_harmonics.sleeper_harmonics(ours)
    tables["harmonics"] = sleeper_harmonics.table(harmonics)
    resonance_hz = _resonances_hz(ours)[1]
    pictures.append(Picture(
        "harmonics", "The force on smooth rail, by harmonics of the sleeper passing",
        f"Grey: the four speeds of the paper's Fig. 13. Dashed: where a harmonic meets {resonance_hz:.0f} Hz, the "
        "second resonance of the wheelset on its track. Where the second harmonic nears it, it outgrows the first.",
        sleeper_harmonics.figure(harmonics, resonance_hz),
    ))  # fmt: skip
    advance()
    parts = force_parts.force_parts(ours)
    tables["parts"] = force_parts.table(parts)
    maximum_kmh, _, kink_kmh = dip_speeds.dip_speeds(ours, ours.model(CONTINUOUS))[DIP_48]
    pictures.append(Picture(
        "parts", "Over the 48 mm dip: both parts of the force at its peak, and its spectral peaks",
        "Above: the parts below and above 530 Hz where the whole force is largest; beyond the curve's second kink "
        "(dashed; the other one: its first maximum) the peak is the high part's. Below: the strongest spectral peak "
        "below 530 Hz stays, that above it (from 80 km/h on) rises with speed, though less than in proportion.",
        force_parts.figure(parts, (maximum_kmh, kink_kmh)),
    ))  # fmt: skip
    advance()
    return pictures, tables


def _evaluated(context: StudyContext, done: Callable[[], object]) -> list[EvaluatedClaim]:
    measured: Quantities = {}
    for name in STUDIES:
        measured |= import_module(f"weld_force_ros.studies.{name}_study").run(context).measured
        done()
    return claims.evaluate([claim for claim in claims.load() if claim.geometry == "exact"], measured)


def _counts(evaluated: Mapping[str, Sequence[EvaluatedClaim]]) -> Table:
    results = ("agrees", "partly", "differs")
    columns = (
        Column("variant", "variant"), *(Column(result, result, 0) for result in results),
        Column("agrees_corrected", "agrees, criteria corrected", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (name, *(float(sum(claim.result == result for claim in several)) for result in results),
         float(sum(claim.corrected_result == "agrees" for claim in several)))
        for name, several in evaluated.items()
    ]  # fmt: skip
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
        track, discrete = context.track(CONTINUOUS).track, context.track(BILBAO).track
        mean = np.abs(beam.receptance(discrete, frequency_hz, beam.sections(discrete, 15)).mean(axis=0))
        ratio = np.abs(beam.receptance(track, frequency_hz, 0.0)[0]) / mean
        first, second = _resonances_hz(context)
        pad, ballast = track.support.springs
        rows.append((
            name, pad.stiffness_n_per_m, getattr(pad, "loss_factor", None), track.support.mass_kg,
            ballast.stiffness_n_per_m, getattr(ballast, "loss_factor", None),
            float(np.sqrt(np.mean((ratio - 1) ** 2))), first, second,
        ))  # fmt: skip
    return Table("The continuous track", columns, rows)


def _resonances_hz(context: StudyContext) -> tuple[float, float]:
    """Return the first two resonances of the wheelset on the continuous track."""
    definition = context.track(CONTINUOUS)
    with_wheel = wheelset_track_receptance(definition.track, definition.wheel, _RESONANCE_HZ, 0.0)[0]
    first, second, *_ = [*resonances_hz(_RESONANCE_HZ, with_wheel), np.nan, np.nan]
    return float(first), float(second)


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
        axes.set_title(dip, loc="left", fontsize="medium")
        axes.set_ylabel("peak force, kN")
    panels[-1].set_xlabel("speed, km/h")
    legend_above(figure, 2, panels[0])
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
