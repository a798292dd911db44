"""Run `weld-force fit`: fit a track now, and show its errors."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, in_existing_folder, prints_results
from weld_force_ros.errors import InputError, os_errors_as

if TYPE_CHECKING:
    from weld_force_ros.physics.engines.rational_search import Progress
    from weld_force_ros.simulation.fit_file import AnyFit, RfpFit
    from weld_force_ros.simulation.fit_store import Search
    from weld_force_ros.simulation.track_file import TrackDefinition


@prints_results
def fit(
    track: Annotated[str, typer.Argument(help="A bundled track or the path of a track file (YAML).")],
    engine: Annotated[str, typer.Option(help="rfp (searched by NSGA-II) or common-poles.")] = "rfp",
    degree: Annotated[int, typer.Option(help="rfp: the denominator's degree, 4 to 12.")] = 8,
    sections: Annotated[int, typer.Option(help="rfp: positions over the span.")] = 15,
    seed: Annotated[int, typer.Option(min=0, help="rfp: of the search.")] = 1,
    generations: Annotated[int, typer.Option(min=1, max=10_000, help="rfp: of the search.")] = 40,
    population: Annotated[int, typer.Option(min=8, max=1_000, help="rfp: fits in a generation.")] = 40,
    out: Annotated[
        Path | None, typer.Option(callback=in_existing_folder, help="Folder for the fit and its picture.")
    ] = None,
    json: Json = None,
) -> None:
    """Fit a track now and show its errors; an interrupted search continues where it stopped."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation import fit_file, fit_store, track_file

    definition = track_file.load(track)
    if engine not in ("rfp", "common-poles"):
        raise InputError(f"engine {engine!r} has no fit", "use rfp or common-poles")
    made: fit_file.AnyFit
    if engine == "rfp":
        made = _searched(definition, fit_store.Search(degree, sections, seed, generations, population))
    else:
        with terminal.progress() as bar:
            bar.add_task(f"fitting {definition.track.name}", total=None)
            made = fit_store.make_poles(definition)
    fit_store.keep(made)
    if isinstance(made, fit_file.PolesFit) and definition.moving:
        with terminal.progress() as bar:
            bar.add_task(f"fitting {definition.track.name} for a wheel that moves", total=None)
            made = fit_store.make_moving(definition, made)
        fit_store.keep(made)
    with json_output.lines(json) as target:
        json_output.write(target, made)
    _show_fit(made, moving=made.engine != "rfp" and definition.moving)
    if out:
        from weld_force_ros.report import figures
        from weld_force_ros.report.fit_figure import fit_figure

        name = f"{made.track}.{made.engine}".replace("/", "_")
        with os_errors_as(InputError, out, "name a writable folder"):
            fit_file.write(made, out / f"{name}.json")
        figures.save(fit_figure(definition, made), out / f"{name}.png")
        terminal.say(f"written: {out / name}.json and .png")
    if not definition.track.causal:
        terminal.say(
            "Loss factors are not causal, nor are tables whose loss is not that of their stiffness: "
            f"{100 * made.acausal_energy_share:.1f} % of the impulse response's energy lies before the impulse, and no "
            "model in time reproduces the receptance; the last column shows what a mere cut costs."
        )


def _searched(definition: "TrackDefinition", search: "Search") -> "RfpFit":
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation import fit_store

    name = definition.track.name
    with terminal.progress() as bar:
        task = bar.add_task(f"searching {name}", total=search.generations)

        def show(now: "Progress") -> None:
            found = f"{now.feasible} usable, least error {100 * now.least_error:.2f} %"
            description = f"searching {name}: {found}, least variation {now.least_variation:.3f}"
            bar.update(task, completed=now.population.generation, description=description)

        return fit_store.make_rfp(definition, search, on_generation=show)


def _show_fit(made: "AnyFit", *, moving: bool) -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation.fit_file import RfpFit

    bands = zip(made.bands_hz[::2], made.bands_hz[1::2], made.error_by_band, made.acausal_floor_by_band, strict=True)
    terminal.table(
        f"{made.track}: {made.engine} of order {made.order}; RMS error relative to what the contact sees",
        [("band Hz", "right"), ("fit %", "right"), ("response cut at the impulse %", "right")],
        [(f"{low:g} - {high:g}", f"{100 * error:.2f}", f"{100 * floor:.2f}") for low, high, error, floor in bands]
        + ([] if moving else [("all", f"{100 * made.error:.2f}", "")]),
    )
    if moving:
        terminal.say(
            f"under a wheel that moves: peak forces are {100 * made.error:.1f} % of their dynamic part off engine "
            "reference (RMS of trial passages at 100, 200 and 300 km/h): what maps state as fit error"
        )
    if isinstance(made, RfpFit):
        error, variation = made.front_error[made.knee], made.front_variation[made.knee]
        terminal.say(
            f"chosen of {len(made.front_error)} on the front: error {100 * error:.2f} %, variation {variation:.3f}; "
            f"weights 1/|h|: {100 * made.plain_error:.2f} %, {made.plain_variation:.3f}"
        )
