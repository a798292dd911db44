"""Run `weld-force replay`: a recording computed again without ROS, or played onto a live ROS graph."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import BagPath, Json, group_with_default, prints_results, ros_module, with_option_groups
from weld_force_ros.cli.standard_error import note_old_spelling
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.recording.recording import Recording
    from weld_force_ros.recording.what_if import Changed


app = typer.Typer(
    cls=group_with_default("verdicts"),
    help="Compute a recording again, without ROS: `replay BAG` shows its verdicts, `replay verify BAG` compares them; "
    "or play it onto a live ROS graph with `replay publish BAG`.",
    rich_markup_mode=None,
)


@dataclass(frozen=True)
class Change:
    """Settings other than the recorded ones."""

    track: Annotated[str | None, typer.Option(help="Another track; the wheel stays.")] = None
    speeds: Annotated[str | None, typer.Option(help="Other speeds, as in simulate.")] = None
    engine: Annotated[str | None, typer.Option(help="Another engine.")] = None
    limits: Annotated[
        str | None, typer.Option(metavar="NAME|FILE[,...]", help="Other rule books, or files of limits.")
    ] = None


@dataclass(frozen=True)
class Playback:
    """Options of playing a recording."""

    rate: Annotated[float | None, typer.Option(help="Times as fast, 0.1 to 100 (default: 1).")] = None
    start_offset: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Start so long after the first message; latched ones before it come at once."
        ),
    ] = None
    loop: Annotated[bool | None, typer.Option("--loop", help="Start again at the end.")] = None
    topics: Annotated[str | None, typer.Option(help="Only these, such as weld_profile,verdict.")] = None
    clock: Annotated[
        bool | None, typer.Option("--clock/--no-clock", help="Publish the recorded time on /clock (default: yes).")
    ] = None


@app.command("verdicts")
@prints_results
@with_option_groups("change", "playback")
def show_again(
    bag: BagPath,
    change: Change,
    playback: Playback,
    verify: Annotated[bool, typer.Option("--verify", hidden=True)] = False,
    what_if: Annotated[bool, typer.Option("--what-if", hidden=True)] = False,
    publish: Annotated[bool, typer.Option("--publish", hidden=True)] = False,
    json: Json = None,
) -> None:
    """Compute a recording's verdicts again and show them: what `replay BAG` does."""
    flags = {"--verify": verify, "--what-if": what_if, "--publish": publish}
    given = [name for name, is_given in flags.items() if is_given]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} exclude each other", "give one of them")
    if not what_if:
        _refuse(change, "changes what was recorded", "add --what-if")
    if not publish:
        _refuse(playback, "says how to play a recording", "add --publish")
    elif json is not None:
        raise InputError("--publish has no result to write as JSON", "leave out --json")
    for name in given:
        note_old_spelling(f"`replay BAG {name}`", f"`replay {name.removeprefix('--')} BAG`")
    if publish:
        _publish(bag, playback)
    elif what_if:
        _what_if(bag, change, json)
    else:
        _compute(bag, verify, json)


@app.command()
@prints_results
def verify(bag: BagPath, json: Json = None) -> None:
    """Compute every force map and verdict again and compare; exit code 1 if anything differs."""
    _compute(bag, True, json)


@app.command("what-if")
@prints_results
@with_option_groups()
def what_if(bag: BagPath, change: Change, json: Json = None) -> None:
    """Compute a recording under other settings: which verdicts change."""
    _what_if(bag, change, json)


@app.command()
@with_option_groups()
def publish(bag: BagPath, playback: Playback) -> None:
    """Play a recording onto a live ROS graph until its end or a signal.

    The graph is this machine's, unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise.
    """
    _publish(bag, playback)


def _refuse(options: Change | Playback, reason: str, remedy: str) -> None:
    for name, value in vars(options).items():
        if value is not None:
            raise InputError(f"--{name.replace('_', '-')} {reason}", remedy)


def _publish(bag: Path, given: Playback) -> None:
    from weld_force_ros.cli import terminal

    playback, stop_signals = ros_module("playback"), ros_module("launcher").stop_signals
    options = playback.PlaybackOptions(
        rate=1.0 if given.rate is None else given.rate,
        start_offset_s=given.start_offset or 0.0,
        loop=bool(given.loop),
        topics=None if given.topics is None else tuple(given.topics.split(",")),
        clock=given.clock is not False,
    )
    with terminal.progress() as bar, stop_signals() as (stop, _):
        task = bar.add_task("playing, seconds")
        sent = playback.play(
            bag,
            options,
            stop=stop,
            report=terminal.note,
            on_time=lambda at_s, duration_s: bar.update(task, completed=int(at_s), total=int(duration_s)),
        )
    terminal.say(f"{bag}: {terminal.counted(sent, 'message')} played{', then stopped' if stop.is_set() else ''}")


def _opened(bag: Path) -> "Recording":
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording.recording import open_recording

    recording = open_recording(bag)
    if recording.damage:
        terminal.note(f"{bag}: {recording.damage}; replaying what is there")
    return recording


def _compute(bag: Path, verify: bool, json: str | None) -> None:
    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.messages import Verdict
    from weld_force_ros.recording.replay import replay as replayed

    recording, results = _opened(bag), []
    with json_output.lines(json) as out, terminal.progress() as bar:
        task = bar.add_task("replaying", total=len(recording.force_maps))
        for result in replayed(recording, on_result=lambda: bar.advance(task)):
            results.append(result)
            if verify:
                json_output.write(out, _comparison(result))
            elif isinstance(result.computed, Verdict):
                json_output.write(out, result.computed)
    if not verify:
        verdict_tables.show_verdicts(
            [r.computed for r in results if isinstance(r.computed, Verdict)], recording.rejections
        )
        return
    if not results:
        raise InputError(f"{bag} holds no force map and no verdict to compare", "record with `weld-force up` or `demo`")
    differing = [r for r in results if r.differences]
    for result in differing:
        for difference in result.differences:
            terminal.say(f"DIFFERS {result.weld_id} {result.kind}: {difference}")
    for kind in ("force_map", "verdict"):
        of_kind = [r for r in results if r.kind == kind]
        terminal.say(f"{kind}: {sum(not r.differences for r in of_kind)} of {len(of_kind)} equal")
    if differing:
        raise typer.Exit(1)


def _what_if(bag: Path, given: Change, json: str | None) -> None:
    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.recording import what_if as computed_again
    from weld_force_ros.recording.what_if import Changed, NotComputed, latest_verdicts, read_change

    recording, change = _opened(bag), read_change(**vars(given))
    changed, not_computed = [], []
    with json_output.lines(json) as out, terminal.progress() as bar:
        task = bar.add_task("replaying", total=len(latest_verdicts(recording)))
        for result in computed_again.what_if(
            recording, change, on_result=lambda: bar.advance(task), on_fit=terminal.note
        ):
            match result:
                case Changed():
                    changed.append(result)
                    json_output.write(out, _changed_line(result))
                case NotComputed():
                    not_computed.append(result)
                    json_output.write(out, result)
    options = " ".join(f"--{name} {value}" for name, value in vars(given).items() if value is not None)
    verdict_tables.show_changed(f"What if: {options}", changed)
    for missing in not_computed:
        terminal.say(f"NOT COMPUTED {missing.weld_id}: {missing.reason}")
    terminal.say(
        f"verdicts that change: {sum(c.decision_changed for c in changed)} of {len(changed)}; "
        f"not computed: {len(not_computed)}; rejected, as recorded: {len(recording.rejections)}"
    )
    if not_computed:
        raise typer.Exit(1)


def _changed_line(changed: "Changed") -> dict[str, Any]:
    return {
        "weld_id": changed.weld_id,
        "decision_changed": changed.decision_changed,
        "peak_force_change_percent": changed.peak_force_change_percent,
        "recorded": changed.recorded,
        "computed": changed.computed,
    }


def _comparison(result: Any) -> dict[str, Any]:
    return {
        "weld_id": result.weld_id,
        "kind": result.kind,
        "equal": not result.differences,
        "differences": list(result.differences),
    }
