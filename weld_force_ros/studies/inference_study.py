"""Study `infer`: several shapes of each of the paper's welds, searched for with its text, and the one that ships."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from weld_force_ros._files import whole_file
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.physics.analysis.geometry import classify
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.report.figures import new_figure
from weld_force_ros.studies import StartProgress, increment_study, shape_prior
from weld_force_ros.studies.claims import Role
from weld_force_ros.studies.figure_style import COLOURS
from weld_force_ros.studies.inference import GENERATIONS, Also, Inference, Solution, chosen, held
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.shape_prior import Prior
from weld_force_ros.studies.study_context import Picture, Profile, StudyContext, StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "infer"
_WRITABLE = "name a writable folder with --out"
_HEIGHT_FACTORS = (0.2, 0.5, 1.0, 3.0)


@dataclass(frozen=True)
class Found:
    """A solution, and of each claim that was measured whether it holds.

    Claims on several welds hold as far as they ask for something of this one.
    """

    solution: Solution
    held: dict[str, bool]
    given: frozenset[str]

    def role(self, claim: str) -> Role:
        """Return whether the search was given a claim."""
        return "fitted" if claim in self.given else "held-out"

    def counted(self, role: Role) -> tuple[int, int]:
        """Return how many claims of a role hold, and how many were measured."""
        mine = [holds for name, holds in self.held.items() if self.role(name) == role]
        return sum(mine), len(mine)


def run(
    context: StudyContext,
    weld: str | None,
    seeds: int,
    folder: Path,
    start_progress: StartProgress,
    also: Also | None = None,
) -> StudyResult:
    """Search with seeds 1 to `seeds`, for one weld or all, and write each shape into a folder, which exists.

    Searches begin without free terms and take one more until one meets all that it is given. A search whose result is
    in the folder is not run again, unless the prior has changed since.

    Raises:
        InputError: no weld of that name, or none that `also` is a study of, or a file that cannot be read or written.
    """
    priors = shape_prior.load()
    if weld is not None and weld not in priors:
        raise InputError(f"{weld}: not a weld of the paper", f"name one of {', '.join(priors)}")
    if also not in (None, "all") and weld != "weld-1":
        raise InputError(f"the study {also} has claims on weld 1 alone", "add --weld 1")
    found: dict[str, list[Found]] = {}
    for name in priors if weld is None else [weld]:
        inference, solutions = _with_fewest_terms(
            Inference(name, priors[name], context, also), seeds, folder, start_progress
        )
        found[name] = [_counted(inference, solution) for solution in solutions]
        for solution in solutions:
            _write_profile(folder / f"{_stem(inference)}-seed-{solution.seed}.csv", solution, priors[name])
        _write_profile(folder / f"{_stem(inference)}.csv", chosen(solutions), priors[name])
    tables = {
        "solutions": _solution_table(found), "claims": _claim_table(found), "shapes": _shape_table(found),
        "spread": _spread_table(found),
    }  # fmt: skip
    if "weld-1" in found:
        tables["heights"] = _height_table(context, chosen([one.solution for one in found["weld-1"]]).profile)
    return StudyResult(NAME, "Shapes inferred from the text", [_picture(found)], tables)


def _stem(inference: Inference) -> str:
    return f"{inference.weld}-also-{inference.also}" if inference.also else inference.weld


def _with_fewest_terms(
    inference: Inference, seeds: int, folder: Path, start_progress: StartProgress
) -> tuple[Inference, list[Solution]]:
    """Return the searches with the fewest free terms of which one met all that it was given, or else got nearest."""
    found: list[tuple[Inference, list[Solution]]] = []
    for count in range(inference.prior.free_terms + 1):
        simpler = replace(inference, prior=inference.prior.with_free_terms(count))
        found.append((simpler, [_solution(simpler, seed, folder, start_progress) for seed in range(1, seeds + 1)]))
        if any(solution.cost == 0 for solution in found[-1][1]):
            return found[-1]
    return min(found, key=lambda one: min(round(solution.cost, 6) for solution in one[1]))


def _solution(inference: Inference, seed: int, folder: Path, start_progress: StartProgress) -> Solution:
    free = inference.prior.free_terms
    path = folder / f"{_stem(inference)}-free-{free}-seed-{seed}.json"
    if path.exists():
        with os_errors_as(InputError, path, "name a readable folder with --out"):
            data = path.read_bytes()
        try:
            stored = msgspec.json.decode(data, type=Solution)
        except msgspec.DecodeError:
            raise InputError(f"{path}: not the result of a search", "remove it, and search again") from None
        if stored.prior_sha256 == inference.prior.sha256:
            return stored
    solution = inference.search(seed, start_progress(f"{inference.weld}, {free} free terms, seed {seed}", GENERATIONS))
    with os_errors_as(InputError, path, _WRITABLE), whole_file(path) as stream:
        stream.write(msgspec.json.format(msgspec.json.encode(solution), indent=2) + b"\n")
    return solution


def _counted(inference: Inference, solution: Solution) -> Found:
    given = frozenset(claim.id for claim in inference.given)
    return Found(solution, held(inference.all_quantities(solution.profile)), given)


def _write_profile(path: Path, solution: Solution, prior: Prior) -> None:
    with os_errors_as(InputError, path, _WRITABLE), whole_file(path) as stream:
        stream.write(profile_text(solution, prior).encode())


def profile_text(solution: Solution, prior: Prior) -> str:
    """Return a solution as a measurement file, whose header says how it came about."""
    x_m, z_m = solution.profile
    terms = "; ".join(f"{t.height_um:.1f} um at {t.place_mm:.1f} mm, {t.length_mm:.1f} mm" for t in solution.terms)
    header = (
        f"weld_id: {solution.weld}",
        "Inferred from the text of the 2018 paper on forces over welds; not measured, not digitised from its figures,",
        "which were not available. One of several shapes found for the claims that are fitted in claims.yaml.",
        f"Geometry in words - {prior.words.replace(':', ' -')}",
        f"Found by weld-force study infer, {solution.weld}, seed {solution.seed}, cost {solution.cost:.3g}"
        + (f", given also what is held out of the study {solution.also}" if solution.also else ""),
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
        Column("weld", "weld"), Column("terms", "terms", 0), Column("seed", "seed", 0), Column("cost", "cost", 3),
        Column("fitted_met", "fitted met", 0), Column("fitted", "of", 0), Column("held_out_met", "held out met", 0),
        Column("held_out", "of", 0), Column("dip_m"), Column("protrusion_m"),
        Column("rms_gradient_mrad", "RMS gradient, mrad", 2), Column("shipped", "shipped"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for name, several in found.items():
        shipped = chosen([one.solution for one in several])
        for one in several:
            profile = one.solution.profile
            geometry = classify(*profile)
            rows.append((
                name, float(len(one.solution.terms)), float(one.solution.seed), one.solution.cost,
                *map(float, one.counted("fitted")), *map(float, one.counted("held-out")),
                geometry.dip_m, geometry.protrusion_m, 1e3 * shape_prior.rms_gradient(profile),
                one.solution is shipped,
            ))  # fmt: skip
    return Table("Shapes that the searches ended with, and claims that each meets", columns, rows)


def _claim_table(found: dict[str, list[Found]]) -> Table:
    """Return how many of a weld's solutions meet each claim: none, where no shape that was found can."""
    columns = (
        Column("weld", "weld"), Column("claim", "claim"), Column("role", "role"), Column("solutions_met", "met", 0),
        Column("solutions", "of", 0),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (name, claim, several[0].role(claim), float(sum(one.held[claim] for one in several)), float(len(several)))
        for name, several in found.items()
        for claim in several[0].held
    ]
    return Table("Solutions that meet each claim, as far as it concerns one weld alone", columns, rows)


def _shape_table(found: dict[str, list[Found]]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (name, float(one.solution.seed), float(x), float(z))
        for name, several in found.items()
        for one in several
        for x, z in zip(*one.solution.profile, strict=True)
    ]
    columns = (Column("weld", "weld"), Column("seed", "seed", 0), Column("x_m", "m", 3), Column("height_m", "m"))
    return Table("Heights of the shapes; x from the weld's centre", columns, rows)


def _spread_table(found: dict[str, list[Found]]) -> Table:
    columns = (
        Column("weld", "weld"), Column("solutions", "solutions", 0), Column("met_all", "that meet all fitted", 0),
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
        Column("minimum_cells_ratio", "local minima left", 2), Column("spread_ratio", "spread over positions left", 2),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    x_m, z_m = profile
    for factor in _HEIGHT_FACTORS:
        measured = increment_study.quantities_over_weld_1(context, (x_m, factor * z_m))
        ratios = (measured[f"increment.{name}"] for name in ("minimum_cells_ratio", "spread_ratio"))
        rows.append((factor, factor * float(z_m.min()), *(float(r) for r in ratios if isinstance(r, float))))
    return Table("Increment over dynamic force, weld 1 at other heights", columns, rows)


def _heights(several: Sequence[Found]) -> FloatArray:
    return np.array([one.solution.profile[1] for one in several])


def _picture(found: dict[str, list[Found]]) -> Picture:
    caption = (
        "Each line is the shape that one search ended with, the thick one ships; shaded: from the lowest to the "
        "highest. Claims met by the shipped shape, as far as they concern this weld alone, are counted above each "
        "panel. Where lines part, the text does not say."
    )
    return Picture("shapes", "Shapes inferred from the text", caption, _draw(found))


def _draw(found: dict[str, list[Found]]) -> "Figure":
    figure = new_figure(7.0, 0.4 + 1.9 * len(found))
    panels = np.atleast_1d(figure.subplots(len(found), 1, sharex=True))
    for axes, (name, several) in zip(panels, found.items(), strict=True):
        shipped = chosen([one.solution for one in several])
        heights = _heights(several)
        x_cm = shipped.profile[0] * 100
        axes.fill_between(x_cm, heights.min(axis=0) * 1e6, heights.max(axis=0) * 1e6, color="#00000018", linewidth=0)
        for one in several:
            thick = one.solution is shipped
            colour, width = (COLOURS[1], 1.8) if thick else (COLOURS[0], 0.8)
            axes.plot(x_cm, one.solution.profile[1] * 1e6, color=colour, linewidth=width, zorder=3 if thick else 2)
        (shown,) = [one for one in several if one.solution is shipped]
        counts = (*shown.counted("fitted"), *shown.counted("held-out"))
        title = "{}: {} of {} fitted, {} of {} held out".format(name, *counts)
        axes.set_title(title, fontsize=9, loc="left")
        axes.set_ylabel("height, µm")
    panels[-1].set_xlabel("distance from the weld's centre, cm")
    return figure
