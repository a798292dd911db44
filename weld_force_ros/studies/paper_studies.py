"""The paper's studies by name, one or all: figures, data, the claims and the gallery in a folder."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

import msgspec

from weld_force_ros.studies import StartProgress, claims, gallery, inferred_shapes, no_progress
from weld_force_ros.studies.claims import EvaluatedClaim
from weld_force_ros.studies.gallery import RenderedStudy
from weld_force_ros.studies.study_context import Quantities, StudyContext, StudyResult

# In the order of the paper.
STUDIES = (
    "validation", "map", "curve", "motion", "smooth", "increment", "length", "hertz", "spectrum", "bands", "population",
)  # fmt: skip
TITLE = "Forces over rail welds, study by study"
COARSE = " On a coarse grid (--quick): a third of the speeds and positions, which decides no claim."
_INTRODUCTION = (
    "The studies of the 2018 paper on wheel-rail forces over welds, computed by this software. Exact geometry: cosine "
    "dips, wheel flats, smooth rail. The five welds are inferred from the paper's text, which does not give their "
    "samples: their shapes were searched for with its claims, and again with a fifth of them held out at a time "
    "(weld-force study infer). The criteria of the claims at the end were fixed before their study was "
    "run; where a measurement was redefined since, the claim's note says so (claims.json)."
)


@dataclass(frozen=True)
class StudyRun:
    """The results of one or several studies."""

    rendered: list[RenderedStudy]
    measured: Quantities
    claims: list[EvaluatedClaim]


def run_study(name: str, context: StudyContext) -> StudyResult:
    """Run one study."""
    found: StudyResult = import_module(f"weld_force_ros.studies.{name}_study").run(context)
    return found


def run_one(name: str, context: StudyContext, out: Path) -> StudyRun:
    """Run one study and write its figures and data to `out / name`.

    Raises:
        InputError: the folder cannot be written, or matplotlib is not installed.
        WeldForceError: the study cannot be computed.
    """
    gallery.make_folder(out / name)  # before anything is computed
    result = run_study(name, context)
    return StudyRun([gallery.write_study(result, out)], result.measured, [])


def run_all(
    context: StudyContext, out: Path, *, names: Sequence[str] = STUDIES, start_progress: StartProgress = no_progress
) -> StudyRun:
    """Run all studies, then evaluate the claims and write `claims.json` and `gallery.html`.

    Drawing takes longer than computing: two processes share the studies.

    Raises:
        InputError: the folder cannot be written, or matplotlib is not installed.
        WeldForceError: a study cannot be computed.
    """
    gallery.make_folder(out)
    folds = range(1, claims.FOLDS + 1) if context.uses_paper_inputs else ()
    done = start_progress("studies", len(names) + len(folds))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(run_one, name, context, out) for name in names]
        without_folds = [pool.submit(inferred_shapes.quantities_without, fold, context) for fold in folds]
        parts, held_out = [], {}
        try:
            for future in running:
                parts.append(future.result())
                done()
            for fold, measured_without in zip(folds, without_folds, strict=True):
                held_out[fold] = measured_without.result()
                done()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    measured: Quantities = {key: value for part in parts for key, value in part.measured.items()}
    evaluated = claims.evaluate(claims.load(), measured, held_out)
    claims.write(evaluated, out / "claims.json")
    rendered = [one for part in parts for one in part.rendered]
    gallery.write_page(
        out / "gallery.html", rendered, title=TITLE, introduction=_INTRODUCTION + (COARSE if context.coarse else ""),
        claims=msgspec.to_builtins(evaluated), counts=claims.summary(evaluated),
    )  # fmt: skip
    return StudyRun(rendered, measured, evaluated)
