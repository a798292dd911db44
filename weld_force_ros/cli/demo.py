"""Run `weld-force demo`: the whole suite on this machine."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, Track, in_existing_folder, prints_results, ros_module
from weld_force_ros.cli.report import report

if TYPE_CHECKING:
    from weld_force_ros.recording.recording import Recording


@prints_results
def demo(
    out: Annotated[
        Path | None, typer.Option(callback=in_existing_folder, help="New folder for files, bag and picture.")
    ] = None,
    track: Track = None,
    trolley: Annotated[bool, typer.Option("--trolley", help="A simulated trolley measures instead of files.")] = False,
    json: Json = None,
) -> None:
    """Run the whole suite on this machine over the bundled welds, or a trolley's, and show the verdicts."""
    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.simulation.settings import DEFAULT_TRACK

    suite = ros_module("demo")
    folder = out or Path("weld-force-demo") / datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    with terminal.progress() as bar:
        task = bar.add_task("measuring, simulating, judging", total=None if trolley else len(suite.demo_profiles()))
        result = suite.run_demo(
            folder, track=track or DEFAULT_TRACK, on_outcome=lambda _: bar.advance(task), trolley=trolley
        )
    recording = result.recording
    with json_output.lines(json) as lines:
        for outcome in (*recording.verdicts, *recording.rejections):
            json_output.write(lines, outcome)
    verdict_tables.show_answers("Verdicts", [*recording.verdicts, *recording.rejections], reasons=False)
    page, picture = folder / "report.html", folder / "force-maps.png"
    _draw_maps(recording, picture)
    report(result.bag, page, grinding=True)
    terminal.say(
        f"open {page}: what to do with each weld, and why\n"
        f"     {picture}\n"
        f"next: weld-force show {result.bag}\n"
        f"      weld-force replay verify {result.bag}\n"
        f"      weld-force limits check {_rule_books(recording)}: what the welds are judged by\n"
        "      weld-force up --folder MEASUREMENTS --bag BAG: the same beside your own trolley"
    )
    if result.left:
        terminal.say(f"{terminal.counted(result.left, 'weld')} got no outcome")
        raise typer.Exit(1)


def _rule_books(recording: "Recording") -> str:
    from weld_force_ros.assessment.rule_books import titles

    return " ".join(dict.fromkeys(book.name for settings in recording.limits.values() for book in titles(settings)))


def _draw_maps(recording: "Recording", picture: Path) -> None:
    from weld_force_ros.report import figures

    maps = {m.weld_id: m for m in recording.force_maps}
    shown = [name for name in ("weld-1-dip", "weld-4-steep-ramp") if name in maps] or list(maps)[:2]
    rows = [(recording.profiles[name, maps[name].profile_sha256], maps[name]) for name in shown]
    figures.save(figures.compare_maps(rows), picture)
