"""Run `weld-force demo`: the whole suite on this machine."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros import SOFTWARE
from weld_force_ros.cli.options import Track, ros_module
from weld_force_ros.cli.report import report

if TYPE_CHECKING:
    from weld_force_ros.recording.recording import Recording


def demo(
    out: Annotated[Path | None, typer.Option(help="New folder for files, bag and picture.")] = None,
    track: Track = "bilbao",
    trolley: Annotated[bool, typer.Option("--trolley", help="A simulated trolley measures instead of files.")] = False,
) -> None:
    """Run the whole suite on this machine over the bundled welds, or a trolley's, and show the verdicts."""
    from weld_force_ros.cli import terminal

    suite = ros_module("demo")
    folder = out or Path("weld-force-demo") / datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    with terminal.progress() as bar:
        task = bar.add_task("measuring, simulating, judging", total=None if trolley else len(suite.demo_profiles()))
        result = suite.run_demo(folder, track=track, on_outcome=lambda _: bar.advance(task), trolley=trolley)
    recording = result.recording
    terminal.show_verdicts(recording.verdicts, recording.rejections)
    for settings in recording.limits.values():
        terminal.show_rule_books(settings)
    if result.seconds_to_verdict:
        slowest = max(result.seconds_to_verdict.values())
        passages = sum(len(m.peak_force_n) for m in recording.force_maps)
        terminal.say(f"{passages} passages; all files dropped at once, the last verdict {slowest:.1f} s later")
    picture = _demo_picture(recording, folder / "force-maps.png")
    terminal.say(f"picture: {picture}")
    report(result.bag, folder / "report.html", grinding=True)
    terminal.say(f"bag:     {result.bag}  ({SOFTWARE})")
    terminal.say(
        f"next:    open {folder / 'report.html'}   what to do with each weld, and why\n"
        f"         weld-force replay verify {result.bag}   computes every verdict again, without ROS\n"
        f"         weld-force bag info {result.bag}          or ros2 bag play {result.bag}\n"
        "         weld-force up --folder MEASUREMENTS --bag BAG      the same beside your own trolley"
    )
    if result.left:
        terminal.say(f"{result.left} welds got no outcome")
        raise typer.Exit(1)


def _demo_picture(recording: "Recording", path: Path) -> Path:
    from weld_force_ros.report import figures

    maps = {m.weld_id: m for m in recording.force_maps}
    shown = [name for name in ("weld-1-dip", "weld-4-steep-ramp") if name in maps] or list(maps)[:2]
    rows = [(recording.profiles[name, maps[name].profile_sha256], maps[name]) for name in shown]
    figures.save(figures.compare_maps(rows), path)
    return path
