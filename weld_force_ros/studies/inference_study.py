"""Study `infer`: several shapes of each of the paper's welds, searched for with its text, and the one that ships."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.physics.analysis.geometry import classify
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies import StartProgress, claims, increment_study, inferred_shapes, shape_prior
from weld_force_ros.studies.figure_style import COLOURS
from weld_force_ros.studies.inference import GENERATIONS, SEARCHES, Inference, Solution, most_typical
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.shape_prior import Prior
from weld_force_ros.studies.study_context import Picture, Profile, StudyContext, StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "infer"
_WRITABLE = "name a writable folder with --out"
_DRAWS = 40
_HEIGHT_FACTORS = (0.2, 0.5, 1.0, 2.0, 3.0)
_OF_SECTION_5 = ("minimum_cells_ratio", "depressions_ratio", "spread_ratio")


@dataclass(frozen=True)
class Found:
    """A solution, and of each claim that was measured whether it holds.

    Claims on several welds hold as far as they ask for something of this one.
    """

    solution: Solution
    held: dict[str, bool]
    held_out: frozenset[str]

    def counted(self, *, held_out: bool) -> tuple[int, int]:
        """Return how many of the claims given, or of those held out, hold, and how many were measured."""
        mine = [holds for name, holds in self.held.items() if (name in self.held_out) is held_out]
        return sum(mine), len(mine)


def run(context: StudyContext, weld: str | None, folder: Path, start_progress: StartProgress) -> StudyResult:
    """Search for one weld or all, with all claims and without each fold, and write the shapes into an existing folder.

    A search whose result is in the folder is not run again, unless the prior has changed since.

    Raises:
        InputError: no weld of that name, or a file that cannot be read or written.
    """
    priors = shape_prior.load()
    if weld is not None and weld not in priors:
        raise InputError(f"{weld}: not a weld of the paper", f"name one of {', '.join(priors)}")
    found: dict[str, list[Found]] = {}
    for name in priors if weld is None else [weld]:
        found[name] = []
        for without_fold in (None, *range(1, claims.FOLDS + 1)):
            inference = Inference(name, priors[name], context, without_fold)
            solution = _chosen(inference, folder, start_progress)
            found[name].append(_counted(inference, solution))
            _write(folder / f"{_stem(inference)}.csv", profile_text(solution, priors[name]).encode())
    if weld is None:
        shapes = [one.solution for several in found.values() for one in several]
        _write(folder / inferred_shapes.FILE, inferred_shapes.encoded(shapes))
    tables = {
        "solutions": _solution_table(found), "claims": _claim_table(found), "shapes": _shape_table(found),
        "spread": _spread_table(found), "words": _words_table(context, priors, found, start_progress),
    }  # fmt: skip
    if "weld-1" in found:
        tables["heights"] = _height_table(context, found["weld-1"][0].solution.profile)
    return StudyResult(NAME, "Shapes inferred from the text", [_picture(found)], tables)


def _stem(inference: Inference) -> str:
    fold = inference.without_fold
    return inference.weld if fold is None else f"{inference.weld}-without-fold-{fold}"


def _chosen(inference: Inference, folder: Path, start_progress: StartProgress) -> Solution:
    """Return what one search ended with; if that meets all it is given, the most typical of several that do."""
    first = _solution(inference, 1, folder, start_progress)
    if first.cost > 0:
        return first
    others = [_solution(inference, seed, folder, start_progress) for seed in range(2, SEARCHES + 1)]
    return most_typical([first, *(other for other in others if other.cost == 0)])


def _solution(inference: Inference, seed: int, folder: Path, start_progress: StartProgress) -> Solution:
    path = folder / f"{_stem(inference)}-seed-{seed}.json"
    if path.exists():
        with os_errors_as(InputError, path, "name a readable folder with --out"):
            data = path.read_bytes()
        try:
            stored = msgspec.json.decode(data, type=Solution)
        except msgspec.DecodeError:
            raise InputError(f"{path}: not the result of a search", "remove it, and search again") from None
        if stored.prior_sha256 == inference.prior.sha256:
            return stored
    given = "all claims" if inference.without_fold is None else f"without fold {inference.without_fold}"
    title = f"{inference.weld}, {given}, seed {seed}"
    solution = inference.search(seed, start_progress(title, GENERATIONS))
    _write(path, msgspec.json.format(msgspec.json.encode(solution), indent=2) + b"\n")
    return solution


def _counted(inference: Inference, solution: Solution) -> Found:
    held, given = inference.held(solution.profile), {claim.id for claim in inference.given}
    return Found(solution, held, frozenset(held.keys() - given))


def _write(path: Path, data: bytes) -> None:
    with os_errors_as(InputError, path, _WRITABLE), whole_file(path) as stream:
        stream.write(data)


def profile_text(solution: Solution, prior: Prior) -> str:
    """Return a solution as a measurement file, whose header says how it came about."""
    x_m, z_m = solution.profile
    fold = solution.without_fold
    given = "all claims given" if fold is None else f"claims of fold {fold} held out"
    terms = "; ".join(f"{t.height_um:.1f} um at {t.place_mm:.1f} mm, {t.length_mm:.1f} mm" for t in solution.terms)
    header = (
        f"weld_id: {solution.weld}",
        "Inferred from the text of the 2018 paper on forces over welds; not measured, not digitised from its figures,",
        "which were not available. One of several shapes that meet about as many of the claims in claims.yaml.",
        f"Geometry in words - {prior.words.replace(':', ' -')}",
        f"Found by weld-force study infer, {solution.weld}, {given}, seed {solution.seed}, cost {solution.cost:.3g}",
        f"Sum of Gaussians (height, place from the centre, standard deviation), tapered at the ends - {terms}",
        "x_unit: mm",
        "z_unit: um",
        "z_positive: up",
        "detrend: none",
        "centre: 500",
        "noise: none",
        f"samples: {len(x_m)}",
    )
    rows = (f"{1e3 * (x - x_m[0]):.0f},{1e6 * z:.3f}" for x, z in zip(x_m, z_m + 0.0, strict=True))
    return "\n".join([*(f"# {line}" for line in header), "x,z", *rows]) + "\n"


def _solution_table(found: dict[str, list[Found]]) -> Table:
    columns = (
        Column("weld", "weld"), Column("without_fold", "without fold", 0), Column("cost", "cost", 3),
        Column("given_met", "given: met", 0), Column("given", "of", 0), Column("held_out_met", "held out: met", 0),
        Column("held_out", "of", 0), Column("dip_m"), Column("protrusion_m"),
        Column("rms_gradient_mrad", "RMS gradient, mrad", 2),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, several in found.items():
        for one in several:
            profile, fold = one.solution.profile, one.solution.without_fold
            geometry = classify(*profile)
            rows.append((
                name, None if fold is None else float(fold), one.solution.cost,
                *map(float, one.counted(held_out=False)), *map(float, one.counted(held_out=True)),
                geometry.dip_m, geometry.protrusion_m, 1e3 * shape_prior.rms_gradient(profile),
            ))  # fmt: skip
    title = "Shapes that the searches ended with, and claims that each meets; those given all claims ship"
    return Table(title, columns, rows)


def _words_table(
    context: StudyContext, priors: dict[str, Prior], found: dict[str, list[Found]], start_progress: StartProgress
) -> Table:
    """Return what shares of the claims on one weld hold over shapes given none of them, four fifths, or all."""
    columns = (
        Column("weld", "weld"), Column("claims", "claims", 0), Column("by_words_percent", "words alone, %", 0),
        Column("held_out_percent", "held out, %", 0), Column("given_percent", "given, %", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, (shipped, *others) in found.items():
        inference = Inference(name, priors[name], context)
        done = start_progress(f"{name}, words alone", _DRAWS)
        shares: list[float] = []
        for profile in inference.drawn(_DRAWS):
            shares.append(float(np.mean(list(inference.held(profile, coarse=True).values()))))
            done()
        held_out = np.sum([one.counted(held_out=True) for one in others], axis=0)
        given, claims_count = shipped.counted(held_out=False)
        percent = 100 * np.array([np.mean(shares), held_out[0] / held_out[1], given / claims_count])
        rows.append((name, float(claims_count), *percent.tolist()))
    title = f"Claims on one weld that hold: over {_DRAWS} shapes drawn from the prior and the words, held out, given"
    return Table(title, columns, rows)


def _claim_table(found: dict[str, list[Found]]) -> Table:
    """Return of each claim whether the shape that ships meets it, the one that was not given it, and how many do."""
    columns = (
        Column("weld", "weld"), Column("claim", "claim"), Column("fold", "fold", 0), Column("shipped", "shipped"),
        Column("held_out", "held out"), Column("solutions_met", "met", 0), Column("solutions", "of", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, (shipped, *others) in found.items():
        for claim in shipped.held:
            (without,) = [one for one in others if claim in one.held_out]
            met = sum(one.held[claim] for one in (shipped, *others))
            fold = float(without.solution.without_fold or 0)
            rows.append((name, claim, fold, shipped.held[claim], without.held[claim], float(met), 1.0 + len(others)))
    return Table("Shapes that meet each claim, as far as it concerns one weld alone", columns, rows)


def _shape_table(found: dict[str, list[Found]]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (name, None if one.solution.without_fold is None else float(one.solution.without_fold), float(x), float(z))
        for name, several in found.items()
        for one in several
        for x, z in zip(*one.solution.profile, strict=True)
    ]
    columns = (
        Column("weld", "weld"), Column("without_fold", "without fold", 0), Column("x_m", "m", 3),
        Column("height_m", "m"),
    )  # fmt: skip
    return Table("Heights of the shapes; x from the weld's centre", columns, rows)


def _spread_table(found: dict[str, list[Found]]) -> Table:
    columns = (
        Column("weld", "weld"), Column("solutions", "solutions", 0), Column("met_all", "that meet all given", 0),
        Column("mean_rms_m"), Column("spread_rms_m"), Column("spread_ratio", "spread over height", 2),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, several in found.items():
        heights = _heights(several)
        mean, spread = shape_prior.rms(heights.mean(axis=0)), shape_prior.rms(heights.std(axis=0))
        complete = sum(one.solution.cost == 0 for one in several)
        rows.append((name, float(len(several)), float(complete), mean, spread, spread / mean))
    return Table(
        "How far the shapes of one weld differ: RMS of their mean and of their standard deviation", columns, rows
    )


def _height_table(context: StudyContext, profile: Profile) -> Table:
    """Return what section 5 says of weld 1, for the shipped shape made lower and higher: its height is not given."""
    columns = (
        Column("height_factor", "height, times", 1), Column("lowest_m"),
        Column("minimum_cells_ratio", "cells in local minima left", 2),
        Column("depressions_ratio", "depressions left", 2), Column("spread_ratio", "spread over positions left", 2),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    x_m, z_m = profile
    for factor in _HEIGHT_FACTORS:
        measured = increment_study.quantities_over_weld_1(context, (x_m, factor * z_m))
        ratios = (measured[f"increment.{name}"] for name in _OF_SECTION_5)
        rows.append((factor, factor * float(z_m.min()), *(float(r) for r in ratios if isinstance(r, float))))
    return Table("Increment over dynamic force, weld 1 at other heights", columns, rows)


def _heights(several: Sequence[Found]) -> FloatArray:
    return np.array([one.solution.profile[1] for one in several])


def _picture(found: dict[str, list[Found]]) -> Picture:
    caption = (
        "Thick: the shape that ships, searched for with all claims. Thin: those searched for without one fold of the "
        "claims each; shaded: from the lowest to the highest. Above each panel: claims met, as far as they concern "
        "this weld alone, by the shape that ships, and by the one that was not given them. Where lines part, the text "
        "does not say."
    )
    return Picture("shapes", "Shapes inferred from the text", caption, _draw(found))


def _draw(found: dict[str, list[Found]]) -> "Figure":
    figure = new_figure(7.0, 0.4 + 1.9 * len(found))
    panels = np.atleast_1d(figure.subplots(len(found), 1, sharex=True))
    for axes, (name, several) in zip(panels, found.items(), strict=True):
        shipped, *others = several
        heights = _heights(several)
        x_cm = shipped.solution.profile[0] * 100
        axes.fill_between(x_cm, heights.min(axis=0) * 1e6, heights.max(axis=0) * 1e6, color="#00000018", linewidth=0)
        for one in several:
            thick = one is shipped
            colour, width = (COLOURS[1], 1.8) if thick else (COLOURS[0], 0.8)
            axes.plot(x_cm, one.solution.profile[1] * 1e6, color=colour, linewidth=width, zorder=3 if thick else 2)
        held_out = np.sum([one.counted(held_out=True) for one in others], axis=0)
        counts = (*shipped.counted(held_out=False), *held_out)
        title = "{}: {} of {} with all claims given, {} of {} held out".format(name, *counts)
        axes.set_title(title, fontsize=9, loc="left")
        axes.set_ylabel("height, µm")
    panels[-1].set_xlabel("distance from the weld's centre, cm")
    return figure
