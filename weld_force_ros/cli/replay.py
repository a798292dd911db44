"""`weld-force replay`: a recording computed again without ROS, or played onto a live ROS graph."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import BagPath, Json, ros_module
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.recording.recording import Recording
    from weld_force_ros.recording.what_if import Changed


def replay(
    bag: BagPath,
    verify: Annotated[bool, typer.Option("--verify", help="Compare with what was recorded; exit 1 if it differs.")]
    = False,
    what_if: Annotated[bool, typer.Option("--what-if", help="Under other settings: which verdicts change.")]
    = False,
    publish: Annotated[bool, typer.Option("--publish", help="Play it onto a live ROS graph (this machine's, unless "
                                          "ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise) until its end or a signal.")]
    = False,
    track: Annotated[str | None, typer.Option(help="With --what-if: another track; the wheel stays.")] = None,
    speeds: Annotated[str | None, typer.Option(help="With --what-if: other speeds, as in simulate.")] = None,
    engine: Annotated[str | None, typer.Option(help="With --what-if: another engine.")] = None,
    limits: Annotated[Path | None, typer.Option(help="With --what-if: another limits file.")] = None,
    rate: Annotated[float | None, typer.Option(help="With --publish: times as fast, 0.1 to 100 (default: 1).")] = None,
    start_offset_s: Annotated[float | None, typer.Option("--start-offset", metavar="SECONDS", help="With --publish: "
                              "start so long after the first message; latched ones before it come at once.")] = None,
    loop: Annotated[bool | None, typer.Option("--loop", help="With --publish: start again at the end.")] = None,
    topics: Annotated[str | None, typer.Option(help="With --publish: only these, such as weld_profile,verdict.")]
    = None,
    clock: Annotated[bool | None, typer.Option("--clock/--no-clock", help="With --publish: publish the recorded time "
                                               "on /clock (default: yes).")] = None,
    json: Json = None,
) -> None:  # fmt: skip
    """Compute a recording again, without ROS; or play it onto a live ROS graph."""
    purposes = {"--verify": verify, "--what-if": what_if, "--publish": publish}
    asked = [name for name, given in purposes.items() if given]
    if len(asked) > 1:
        raise InputError(f"{' and '.join(asked)} exclude each other", "give one of them")
    changes = {"track": track, "speeds": speeds, "engine": engine, "limits": limits}
    options: dict[str, Any] = {
        "rate": rate,
        "start_offset": start_offset_s,
        "loop": loop,
        "topics": topics,
        "clock": clock,
    }
    if not what_if:
        _refuse(changes, "changes what was recorded", "add --what-if")
    if not publish:
        _refuse(options, "says how to play a recording", "add --publish")
        _compute(bag, verify, changes if what_if else None, json)
    elif json is not None:
        raise InputError("--publish has no result to write as JSON", "leave out --json")
    else:
        _publish(bag, **options)


def _refuse(options: dict[str, Any], reason: str, remedy: str) -> None:
    for name, value in options.items():
        if value is not None:
            raise InputError(f"--{name.replace('_', '-')} {reason}", remedy)


def _publish(
    bag: Path,
    rate: float | None,
    start_offset: float | None,
    loop: bool | None,
    topics: str | None,
    clock: bool | None,
) -> None:
    from weld_force_ros.cli import terminal

    playback, stop_signals = ros_module("playback"), ros_module("launcher").stop_signals
    options = playback.PlaybackOptions(
        rate=1.0 if rate is None else rate,
        start_offset_s=start_offset or 0.0,
        loop=bool(loop),
        topics=None if topics is None else tuple(topics.split(",")),
        clock=clock is not False,
    )
    with terminal.progress() as bar, stop_signals() as (stop, _):
        task = bar.add_task("playing, seconds")
        sent = playback.play(
            bag,
            options,
            stop=stop,
            report=terminal.say,
            on_time=lambda at_s, duration_s: bar.update(task, completed=int(at_s), total=int(duration_s)),
        )
    terminal.say(f"{bag}: {sent} messages played{', then stopped' if stop.is_set() else ''}")


def _compute(bag: Path, verify: bool, changes: dict[str, Any] | None, json: str | None) -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording.recording import open_recording

    recording = open_recording(bag)
    if recording.damage:
        terminal.say(f"{bag}: {recording.damage}; replaying what is there")
    if changes is not None:
        _what_if(recording, changes, json)
    else:
        _again(recording, verify, json)


def _again(recording: "Recording", verify: bool, json: str | None) -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.messages import Verdict
    from weld_force_ros.recording.replay import replay as replayed

    results = []
    with json_output.lines(json) as out, terminal.progress() as bar:
        task = bar.add_task("replaying", total=len(recording.force_maps))
        for result in replayed(recording, on_result=lambda: bar.advance(task)):
            results.append(result)
            if verify:
                json_output.write(out, _comparison(result))
            elif isinstance(result.computed, Verdict):
                json_output.write(out, result.computed)
    if not verify:
        terminal.show_verdicts([r.computed for r in results if isinstance(r.computed, Verdict)], recording.rejections)
        return
    differing = [r for r in results if r.differences]
    for result in differing:
        for difference in result.differences:
            terminal.say(f"DIFFERS {result.weld_id} {result.kind}: {difference}")
    for kind in ("force_map", "verdict"):
        of_kind = [r for r in results if r.kind == kind]
        terminal.say(f"{kind}: {sum(not r.differences for r in of_kind)} of {len(of_kind)} equal")
    if differing:
        raise typer.Exit(1)


def _what_if(recording: "Recording", given: dict[str, Any], json: str | None) -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording.what_if import Changed, NotComputed, latest_verdicts, read_change, what_if

    change = read_change(**given)
    changed, not_computed = [], []
    with json_output.lines(json) as out, terminal.progress() as bar:
        task = bar.add_task("replaying", total=len(latest_verdicts(recording)))
        for result in what_if(recording, change, on_result=lambda: bar.advance(task), on_fit=terminal.say):
            match result:
                case Changed():
                    changed.append(result)
                    json_output.write(out, _changed_line(result))
                case NotComputed():
                    not_computed.append(result)
                    json_output.write(out, result)
    options = " ".join(f"--{name} {value}" for name, value in given.items() if value is not None)
    terminal.show_changed(f"What if: {options}", changed)
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
