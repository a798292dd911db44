"""`weld-force study`: the paper's investigation, each part by a command of its own."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, in_existing_folder, prints_results

if TYPE_CHECKING:
    from weld_force_ros.studies.gallery import RenderedStudy

app = typer.Typer(
    help="The paper's studies on this software or on a weld of your own, and the engines compared.",
    rich_markup_mode=None,
)

Out = Annotated[
    Path,
    typer.Option(callback=in_existing_folder, help="Folder for figures, data, and what a second run need not compute."),
]
Profile = Annotated[Path | None, typer.Option(help="A weld of your own in place of the paper's.")]
OwnTrack = Annotated[str | None, typer.Option("--track", help="Instead of the paper's: a bundled track, or a file.")]
Quick = Annotated[bool, typer.Option("--quick", help="A third of the speeds and positions, to see whether it works.")]

# The names and the order of `studies.paper_studies.STUDIES`, which is not imported before a command runs.
_SUMMARIES = {
    "validation": "Wheel flats: the envelope over positions, and speeds up to 300 km/h (figures 7, 8).",
    "map": "Peak force over speed and position of the five welds (figures 10, 16, 17, 20, 21).",
    "curve": "Force against speed, with the passages at chosen speeds (figure 11).",
    "motion": "Force, weld, wheel and rail along the track (figure 12).",
    "smooth": "The force without a weld (figure 13).",
    "increment": "The force over that of smooth rail (figure 22).",
    "length": "Two dips, one twice as long (figure 23).",
    "hertz": "The contact's stiffness (section 6.1).",
    "spectrum": "Spectra of force and weld, and the track's resonances (figures 25, 26).",
    "bands": "The force below and above 530 Hz (figures 27, 28).",
    "population": "Synthetic welds: class of geometry against shape of the force-speed curve (sections 4, 7).",
}


def _study(name: str) -> Callable[..., None]:
    def run(out: Out, profile: Profile = None, track: OwnTrack = None, quick: Quick = False, json: Json = None) -> None:
        from weld_force_ros.cli import terminal
        from weld_force_ros.measurement import profile_file
        from weld_force_ros.studies import paper_studies, study_context

        weld = None if profile is None else profile_file.read_profile(profile)
        context = study_context.StudyContext(own_weld=weld, own_track=track, coarse=quick)
        with terminal.notes.status(f"study {name}"):
            studied = paper_studies.run_one(name, context, out)
        with json_output.lines(json) as lines:
            json_output.write(lines, studied.measured)
        _say_where(studied.rendered, out)

    run.__doc__ = _SUMMARIES[name]
    return run


for _name in _SUMMARIES:
    app.command(_name)(prints_results(_study(_name)))


@app.command("all")
@prints_results
def study_all(out: Out, quick: Quick = False, json: Json = None) -> None:
    """Run every study of the paper, evaluate its claims one by one (claims.json), and put all figures on one page."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import claims, paper_studies, study_context

    with terminal.progress() as bar:
        studied = paper_studies.run_all(
            study_context.StudyContext(coarse=quick),
            out,
            start_progress=lambda name, steps: partial(bar.advance, bar.add_task(name, total=steps)),
        )
    with json_output.lines(json) as lines:
        for claim in studied.claims:
            json_output.write(lines, claim)
    terminal.show_table(claims.table(studied.claims))
    terminal.show_table(claims.summary(studied.claims))
    _say_where(studied.rendered, out)
    if quick:
        terminal.say(paper_studies.COARSE.strip())
    terminal.say(f"claims:  {out / 'claims.json'}")
    terminal.say(f"gallery: {out / 'gallery.html'}")


@app.command("engines")
@prints_results
def study_engines(
    out: Out,
    quick: Annotated[bool, typer.Option("--quick", help="A small grid, to see whether it works.")] = False,
    json: Json = None,
) -> None:
    """Compare the fitted engines with the reference over shapes, speeds, positions and tracks (some minutes)."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import engines_figures, engines_study

    with terminal.progress() as bar:
        found = engines_study.run(
            out,
            quick=quick,
            start_progress=lambda name, steps: partial(bar.advance, bar.add_task(name, total=steps)),
            on_fit=terminal.note,
        )
    with json_output.lines(json) as lines:
        for outcome in found.outcomes:
            json_output.write(lines, outcome)
    for name in ("errors-by-shape", "orders", "outcomes"):
        terminal.show_table(found.tables[name])
    pictures = engines_figures.write(found, out)
    terminal.say(f"{out}: {len(found.tables)} tables (CSV), engines.json, {len(pictures)} figures (PNG, SVG)")


@app.command("rail")
@prints_results
def study_rail(
    out: Out,
    track: Annotated[str, typer.Option("--track", help="A bundled track, or a file.")] = "bilbao",
    section: Annotated[str, typer.Option(help="Rail section (2.5-D FE), if the track's rail is a beam.")] = "60E1",
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Compare beam and cross-section: waves, receptances to 5 kHz, peak forces (a minute or two)."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import gallery, rail_study

    gallery.make_folder(out / "rail")  # before anything is computed
    with terminal.progress() as bar:
        found = rail_study.run(
            track,
            section,
            coarse=quick,
            start_progress=lambda name, steps: partial(bar.advance, bar.add_task(name, total=steps)),
            on_fit=terminal.note,
        )
    rendered = gallery.write_alone(found, out, "One track with either rail.")
    with json_output.lines(json) as lines:
        json_output.write(lines, found.measured)
    for name in ("differences", "forces"):
        terminal.show_table(found.tables[name])
    _say_page(rendered, out)


@app.command("support")
@prints_results
def study_support(out: Out, quick: Quick = False, json: Json = None) -> None:
    """Show what hanging sleepers do to the peak force on two tracks, and sleepers that bend (a minute)."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import gallery, support_study

    gallery.make_folder(out / "support")  # before anything is computed
    with terminal.progress() as bar:
        found = support_study.run(
            coarse=quick,
            start_progress=lambda name, steps: partial(bar.advance, bar.add_task(name, total=steps)),
            on_fit=terminal.note,
        )
    rendered = gallery.write_alone(
        found, out, "A sleeper that hangs has 2 % of the track's stiffness and damping beneath it."
    )
    with json_output.lines(json) as lines:
        json_output.write(lines, found.measured)
    terminal.show_table(support_study.summary(found))
    terminal.show_table(found.tables["bending-sleepers"])
    _say_page(rendered, out)


@app.command("infer")
@prints_results
def study_infer(
    out: Out,
    weld: Annotated[int | None, typer.Option(min=1, max=5, help="One of the paper's welds; all, if not given.")] = None,
    json: Json = None,
) -> None:
    """Infer shapes of the paper's five welds from its text, with and without parts of it (an hour)."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import gallery, inference_study, study_context

    folder = gallery.make_folder(out / inference_study.NAME)  # before anything is computed
    with terminal.progress() as bar:
        found = inference_study.run(
            study_context.StudyContext(),
            None if weld is None else f"weld-{weld}",
            folder,
            lambda name, steps: partial(bar.advance, bar.add_task(name, total=steps)),
        )
    rendered = gallery.write_alone(
        found, out,
        "Of the paper's welds only the text is known. These shapes were searched for with what it says of the forces "
        "over them. To see what that is worth, each claim is held out of one search in five.",
    )  # fmt: skip
    solutions = found.tables["solutions"]
    with json_output.lines(json) as lines:
        for row in solutions.rows:
            json_output.write(lines, dict(zip((column.name for column in solutions.columns), row, strict=True)))
    terminal.show_table(solutions)
    terminal.show_table(found.tables["spread"])
    terminal.show_table(found.tables["words"])
    if "heights" in found.tables:
        terminal.show_table(found.tables["heights"])
    _say_page(rendered, out)


@app.command("variants")
@prints_results
def study_variants(out: Out, quick: Quick = False, json: Json = None) -> None:
    """Evaluate the exact claims with the paper's fit and continuous track, too; explain what differs (some minutes)."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import gallery, variants_study

    gallery.make_folder(out / "variants")  # before anything is computed
    with terminal.progress() as bar:
        found = variants_study.run(quick, lambda name, steps: partial(bar.advance, bar.add_task(name, total=steps)))
    rendered = gallery.write_alone(
        found, out,
        "Where the paper's text says how, its way beside ours: rational fractions of degree 7 over 8, and "
        "a continuous track that is fitted to the discrete one instead of its supports smeared. And for each claim of "
        "exact geometry that differs an experiment.",
    )  # fmt: skip
    counts, differing = found.tables["counts"], found.tables["claims"]
    with json_output.lines(json) as lines:
        for table in (counts, differing):
            for row in table.rows:
                json_output.write(lines, dict(zip((column.name for column in table.columns), row, strict=True)))
    for name in ("claims", *(name for name in found.tables if name not in ("claims", "counts")), "counts"):
        terminal.show_table(found.tables[name])
    _say_page(rendered, out)


def _say_page(rendered: "RenderedStudy", out: Path) -> None:
    from weld_force_ros.cli import terminal

    _say_where([rendered], out)
    terminal.say(f"page: {out / rendered.name}.html")


def _say_where(rendered: "list[RenderedStudy]", out: Path) -> None:
    from weld_force_ros.cli import terminal

    figures = sum(len(study.pictures) for study in rendered)
    tables = sum(len(study.tables) for study in rendered)
    terminal.say(f"{out}: {terminal.counted(figures, 'figure')} (PNG, SVG), {terminal.counted(tables, 'table')} (CSV)")
