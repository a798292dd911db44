"""The one command, `weld-force`; each subcommand imports what it needs when it runs.

Exit codes: 0 done, 1 a verdict or comparison failed, 2 bad input or usage (one line on standard error). With
`--json -` standard output holds JSON lines and nothing else; tables and progress go to standard error.
"""

import atexit
import gc
import os
import sys
from dataclasses import asdict
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

import msgspec
import typer

from weld_force_ros import cli_study, json_lines
from weld_force_ros.errors import InputError, WeldForceError

if TYPE_CHECKING:
    from weld_force_ros.assess import Simulator
    from weld_force_ros.contract import SimulationSettings
    from weld_force_ros.fits import AnyFit
    from weld_force_ros.replay import Recording
    from weld_force_ros.what_if import Changed

# Typer's usage errors, whether its click is the package or a copy of its own.
_UsageError: Any = typer.BadParameter.__base__

app = typer.Typer(
    help="Wheel-rail contact forces over rail welds: simulate, judge, record, replay.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
bag_app = typer.Typer(help="Look into, repair and export recordings.", rich_markup_mode=None)
app.add_typer(bag_app, name="bag")
app.add_typer(cli_study.app, name="study")

Track = Annotated[str, typer.Option(help="A shipped track or the path of a track file (YAML).")]
EngineName = Annotated[str, typer.Option(help="How the track is represented in time.")]
Speeds = Annotated[str, typer.Option(help="FIRST:LAST:STEP or a list such as 40,80, in km/h.")]
Positions = Annotated[str, typer.Option(help="N equal steps over the span, or metres after the sleeper: 0.15,0.30.")]
WheelMass = Annotated[float | None, typer.Option("--wheel-mass", help="Half a wheelset, kg (default: the track's).")]
StaticLoad = Annotated[float | None, typer.Option("--static-load", help="Static wheel load, N.")]
WheelRadius = Annotated[float | None, typer.Option("--wheel-radius", help="Rolling radius, m.")]
Hertz = Annotated[float | None, typer.Option("--hertz", help="Hertz constant, N/m^1.5.")]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE|-", help="Write JSON lines to a file or stdout.")]
Limits = Annotated[Path | None, typer.Option(help="Limits file (YAML; default: the shipped, unverified ones).")]
BagPath = Annotated[Path, typer.Argument(help="A bag folder or an .mcap file.")]
XUnit = Annotated[str | None, typer.Option("--x-unit", help="For plain text files: m, cm, mm or um.")]
ZUnit = Annotated[str | None, typer.Option("--z-unit", help="For plain text files: m, cm, mm or um.")]
ZPositive = Annotated[str | None, typer.Option("--z-positive", help="For plain text files: up or down.")]
Spacing = Annotated[float | None, typer.Option(help="For files with heights only: sample spacing in --x-unit.")]
SkipRows = Annotated[int, typer.Option("--skip-rows", help="For plain text files: lines to skip at the top.")]


@app.command()
def demo(
    out: Annotated[Path | None, typer.Option(help="New folder for files, bag and picture.")] = None,
    track: Track = "bilbao",
) -> None:
    """Run the whole suite on this machine over the shipped welds, and show what came out."""
    from weld_force_ros import assess, terminal
    from weld_force_ros.profiles import shipped

    demonstrate = _ros("demo").demonstrate
    folder = out or Path("weld-force-demo") / datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    with terminal.progress() as bar:
        task = bar.add_task("measuring, simulating, judging", total=len(shipped()))
        result = demonstrate(folder, track=track, on_outcome=lambda _: bar.advance(task))
    recording = result.recording
    terminal.show_verdicts(recording.verdicts, recording.rejections)
    for settings in recording.limits.values():
        terminal.show_limits(settings.limits)
    if result.seconds_to_verdict:
        slowest = max(result.seconds_to_verdict.values())
        passages = sum(len(m.peak_force_n) for m in recording.force_maps)
        terminal.say(f"{passages} passages; all files dropped at once, the last verdict {slowest:.1f} s later")
    picture = _demo_picture(recording, folder / "force-maps.png")
    terminal.say(f"picture: {picture}")
    terminal.say(f"bag:     {result.bag}  ({assess.SOFTWARE})")
    terminal.say(
        f"next:    weld-force replay {result.bag} --verify   computes every verdict again, without ROS\n"
        f"         weld-force bag info {result.bag}          or ros2 bag play {result.bag}\n"
        "         weld-force up --folder MEASUREMENTS --bag BAG      the same beside your own trolley"
    )
    if result.left:
        terminal.say(f"{result.left} welds got no outcome")
        raise typer.Exit(1)


def _demo_picture(recording: "Recording", path: Path) -> Path:
    from weld_force_ros import report

    shown = ("weld-1-dip", "weld-4-steep-ramp")
    maps = {m.weld_id: m for m in recording.force_maps}
    rows = [(recording.profiles[name, maps[name].profile_sha256], maps[name]) for name in shown if name in maps]
    report.save(report.compare_maps(rows), path)
    return path


@app.command()
def up(
    folder: Annotated[Path, typer.Option(help="Folder of measurement files to watch.")],
    bag: Annotated[Path | None, typer.Option(help="New folder to record to (default: no recording).")] = None,
    track: Track = "bilbao",
    engine: EngineName = "common-poles",
    speeds: Speeds = "20:300:5",
    positions: Positions = "15",
    wheel_mass_kg: WheelMass = None,
    static_load_n: StaticLoad = None,
    wheel_radius_m: WheelRadius = None,
    hertz_n_per_m15: Hertz = None,
    limits: Limits = None,
    x_unit: XUnit = None,
    z_unit: ZUnit = None,
    z_positive: ZPositive = None,
    spacing: Spacing = None,
) -> None:
    """Run the three nodes in one process until SIGINT or SIGTERM; each weld's outcome is shown as it comes."""
    from weld_force_ros import terminal

    run_suite = _ros("run").run_suite
    simulator: dict[str, Any] = {
        "track": track,
        "engine": engine,
        "speeds": speeds,
        "positions": positions,
        "wheel_mass_kg": wheel_mass_kg,
        "static_load_n": static_load_n,
        "wheel_radius_m": wheel_radius_m,
        "hertz_n_per_m15": hertz_n_per_m15,
    }
    _settings(**simulator)  # refused here in one line, rather than by a node's parameter
    profile = {"folder": str(folder), "x_unit": x_unit, "z_unit": z_unit, "z_positive": z_positive, "spacing": spacing}
    assessment = {"limits": str(limits) if limits else None, "bag": str(bag) if bag else None}
    parameters: dict[str, dict[str, Any]] = {"profile": profile, "simulator": simulator, "assessment": assessment}
    code = run_suite(
        {kind: {name: v for name, v in given.items() if v is not None} for kind, given in parameters.items()},
        on_verdict=lambda verdict: terminal.say(f"{verdict.decision.upper():7} {verdict.weld_id}: {verdict.reason}"),
        on_rejection=lambda rejection: terminal.say(
            f"UNUSABLE {rejection.source}: {rejection.reason}; {rejection.remedy}"
        ),
    )
    raise typer.Exit(code)


@app.command(context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def node(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(metavar="profile|simulator|assessment", help="Which node.")],
) -> None:
    """Run one node until SIGINT or SIGTERM; `--ros-args …` as on any ROS command line."""
    run = _ros("run")
    if kind not in run.KINDS:
        raise InputError(f"there is no node {kind!r}", f"use {', '.join(run.KINDS)}")
    if context.args and context.args[0] != "--ros-args":
        raise InputError(f"{context.args[0]!r} is not understood", "ROS arguments follow --ros-args")
    raise typer.Exit(run.run_node(kind, context.args))


def _ros(module: str) -> Any:
    """A module of the ROS side, or one line that says how to get ROS."""
    from importlib import import_module

    try:
        return import_module(f"weld_force_ros.ros.{module}")
    except ImportError as error:
        raise InputError(
            f"ROS 2 is not there ({error})", "install it with `pip install 'weld_force_ros[ros]'` or source your ROS"
        ) from None


@app.command()
def simulate(
    profiles: Annotated[list[str], typer.Argument(help="Profile files, or names of shipped profiles.")],
    track: Track = "bilbao",
    engine: EngineName = "common-poles",
    speeds: Speeds = "20:300:5",
    positions: Positions = "15",
    wheel_mass_kg: WheelMass = None,
    static_load_n: StaticLoad = None,
    wheel_radius_m: WheelRadius = None,
    hertz_n_per_m15: Hertz = None,
    x_unit: XUnit = None,
    z_unit: ZUnit = None,
    z_positive: ZPositive = None,
    spacing: Spacing = None,
    skip_rows: SkipRows = 0,
    json: Json = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of each weld (several: a number is added).")] = None,
) -> None:
    """Peak force of measured welds at every speed and position."""
    from weld_force_ros import terminal
    from weld_force_ros.profiles import PlainForm, find, read_profile

    settings = _settings(
        track, engine, speeds, positions, wheel_mass_kg, static_load_n, wheel_radius_m, hertz_n_per_m15
    )
    stated = (x_unit, z_unit, z_positive, spacing)
    form = PlainForm(x_unit=x_unit, z_unit=z_unit, z_positive=z_positive, spacing=spacing, skip_rows=skip_rows)
    simulator = _simulator(settings)
    maps, unusable = [], 0
    with json_lines.lines(json) as out, terminal.progress() as bar:
        for number, name in enumerate(profiles, start=1):
            try:
                profile = read_profile(find(name), form if any(s is not None for s in stated) else None)
                task = bar.add_task(profile.weld_id, total=len(settings.speeds_kmh))
                force_map = simulator.force_map(profile, on_speed=partial(bar.advance, task))
            except InputError as error:
                if len(profiles) == 1:
                    raise
                _complain(error)
                unusable += 1
                continue
            bar.remove_task(task)
            json_lines.write(out, force_map)
            maps.append(force_map)
            if plot:
                from weld_force_ros import report

                picture = plot if len(profiles) == 1 else plot.with_stem(f"{plot.stem}-{number}")
                report.save(report.one_weld(profile, force_map, simulator.worst_history(profile, force_map)), picture)
    if maps:
        terminal.show_maps(maps)
    if unusable:
        raise typer.Exit(2)


@app.command()
def receptance(
    at: Annotated[str, typer.Option(help="Metres after the sleeper: 0.0,0.30.")] = "0.0",
    freq: Annotated[str, typer.Option(help="Frequencies in Hz: 50,100,200.")] = "50,100,200,500,1000",
    track: Track = "bilbao",
    engine: Annotated[str, typer.Option(help="exact, or an engine's fit.")] = "exact",
    json: Json = None,
) -> None:
    """Point receptance of the rail: exact, or as an engine fits it."""
    from weld_force_ros import fits, terminal, tracks
    from weld_force_ros.core.track import receptance as exact_receptance

    at_m, frequency_hz = _numbers("--at", at), _numbers("--freq", freq)
    if min(frequency_hz) <= 0:
        raise InputError(f"--freq {freq}: a frequency is not positive", "give frequencies in Hz above 0")
    definition = tracks.load(track)
    if engine == "exact":
        h = exact_receptance(definition.track, frequency_hz, at_m)
    elif engine in get_args(fits.FittedEngine):
        h = (
            fits.fitted(definition, cast(fits.FittedEngine, engine), on_fit=terminal.say)
            .model()
            .receptance(frequency_hz, at_m)
        )
    else:
        raise InputError(f"engine {engine!r} has no receptance of its own", "use exact, common-poles or rfp")
    with json_lines.lines(json) as out:
        json_lines.write(
            out,
            {
                "track": definition.track.name,
                "engine": engine,
                "at_m": at_m,
                "frequency_hz": frequency_hz,
                "real_m_per_n": h.real.ravel().tolist(),
                "imag_m_per_n": h.imag.ravel().tolist(),
            },
        )
    if out is not sys.stdout:
        terminal.table(
            f"Receptance of {definition.track.name} ({engine}), m/N: magnitude and phase",
            [("Hz", "right")] + [(f"at {x:g} m", "right") for x in at_m],
            [
                [f"{f:g}"] + [f"{abs(v):.4g}  {_degrees(v):7.1f}°" for v in h[:, k]]
                for k, f in enumerate(frequency_hz)
            ],
        )  # fmt: skip


@app.command()
def fit(
    track: Annotated[str, typer.Argument(help="A shipped track or the path of a track file (YAML).")],
    engine: Annotated[str, typer.Option(help="rfp (searched by NSGA-II) or common-poles.")] = "rfp",
    degree: Annotated[int, typer.Option(help="rfp: the denominator's degree, 4 to 12.")] = 8,
    sections: Annotated[int, typer.Option(help="rfp: sections over the span.")] = 15,
    seed: Annotated[int, typer.Option(min=0, help="rfp: of the search.")] = 1,
    generations: Annotated[int, typer.Option(min=1, max=10_000, help="rfp: of the search.")] = 40,
    population: Annotated[int, typer.Option(min=8, max=1_000, help="rfp: fits in a generation.")] = 40,
    out: Annotated[Path | None, typer.Option(help="Folder for the fit and its picture.")] = None,
    json: Json = None,
) -> None:
    """Fit a track now and say how well it came out; an interrupted search goes on where it stopped."""
    from weld_force_ros import fits, terminal, tracks

    definition = tracks.load(track)
    if engine not in ("rfp", "common-poles"):
        raise InputError(f"engine {engine!r} has no fit", "use rfp or common-poles")
    with terminal.progress() as bar:
        if engine == "rfp":
            task = bar.add_task(f"searching {definition.track.name}", total=generations)
            how = fits.Search(
                degree=degree, section_count=sections, seed=seed, generations=generations, population=population
            )
            made: fits.AnyFit = fits.make_rfp(
                definition,
                how,
                on_generation=lambda now: bar.update(
                    task,
                    completed=now.population.generation,
                    description=f"searching {definition.track.name}: {now.feasible} usable, least error "
                    f"{100 * now.least_error:.2f} %, least variation {now.least_variation:.3f}",
                ),
            )
        else:
            bar.add_task(f"fitting {definition.track.name}", total=None)
            made = fits.make_poles(definition)
    fits.keep(made)
    with json_lines.lines(json) as target:
        json_lines.write(target, made)
    _show_fit(made)
    if out:
        from weld_force_ros import report
        from weld_force_ros.fit_figure import fit_figure

        name = f"{made.track}.{made.engine}".replace("/", "_")
        try:
            fits.write(made, out / f"{name}.json")
        except OSError as error:
            raise InputError(f"{out}: {error.strerror or error}", "name a writable folder") from None
        report.save(fit_figure(definition, made), out / f"{name}.png")
        terminal.say(f"written: {out / name}.json and .png")
    if not definition.track.causal:
        terminal.say(
            f"Loss factors are not causal: {100 * made.acausal_energy_share:.1f} % of the impulse response's energy "
            "lies before the impulse, and no model in time reproduces the receptance; the last column shows what a "
            "mere cut costs."
        )


def _show_fit(made: "AnyFit") -> None:
    from weld_force_ros import terminal
    from weld_force_ros.fits import RfpFit

    bands = zip(made.bands_hz[::2], made.bands_hz[1::2], made.error_by_band, made.acausal_floor_by_band, strict=True)
    terminal.table(
        f"{made.track}: {made.engine} of order {made.order}; RMS error relative to what the contact sees",
        [("band Hz", "right"), ("fit %", "right"), ("response cut at the impulse %", "right")],
        [(f"{low:g} - {high:g}", f"{100 * error:.2f}", f"{100 * floor:.2f}") for low, high, error, floor in bands]
        + [("all", f"{100 * made.error:.2f}", "")],
    )
    if isinstance(made, RfpFit):
        error, variation = made.front_error[made.knee], made.front_variation[made.knee]
        terminal.say(
            f"chosen of {len(made.front_error)} on the front: error {100 * error:.2f} %, variation {variation:.3f}; "
            f"weights 1/|h|: {100 * made.plain_error:.2f} %, {made.plain_variation:.3f}"
        )


@app.command()
def replay(
    bag: BagPath,
    verify: Annotated[bool, typer.Option("--verify", help="Compare with what was recorded; exit 1 if it differs.")]
    = False,
    what_if: Annotated[bool, typer.Option("--what-if", help="Under other settings: which verdicts change.")]
    = False,
    track: Annotated[str | None, typer.Option(help="With --what-if: another track; the wheel stays.")] = None,
    speeds: Annotated[str | None, typer.Option(help="With --what-if: other speeds, as in simulate.")] = None,
    engine: Annotated[str | None, typer.Option(help="With --what-if: another engine.")] = None,
    limits: Annotated[Path | None, typer.Option(help="With --what-if: another limits file.")] = None,
    json: Json = None,
) -> None:  # fmt: skip
    """Compute a recording again, without ROS."""
    from weld_force_ros import terminal
    from weld_force_ros.contract import Verdict
    from weld_force_ros.replay import read
    from weld_force_ros.replay import replay as replayed

    given = {"track": track, "speeds": speeds, "engine": engine, "limits": limits}
    if what_if and verify:
        raise InputError("--verify and --what-if exclude each other", "give one of them")
    if not what_if and any(value is not None for value in given.values()):
        raise InputError(
            f"--{next(name for name, value in given.items() if value is not None)} changes what was recorded",
            "add --what-if",
        )
    recording = read(bag)
    if recording.damage:
        terminal.say(f"{bag}: {recording.damage}; replaying what is there")
    if what_if:
        _what_if(recording, given, json)
        return
    results = []
    with json_lines.lines(json) as out, terminal.progress() as bar:
        task = bar.add_task("replaying", total=len(recording.force_maps))
        for result in replayed(recording, on_result=lambda: bar.advance(task)):
            results.append(result)
            if verify:
                json_lines.write(out, _comparison(result))
            elif isinstance(result.computed, Verdict):
                json_lines.write(out, result.computed)
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
    from weld_force_ros import terminal
    from weld_force_ros.what_if import Changed, NotComputed, judged, read_change, what_if

    change = read_change(**given)
    changed, not_computed = [], []
    with json_lines.lines(json) as out, terminal.progress() as bar:
        task = bar.add_task("replaying", total=len(judged(recording)))
        for result in what_if(recording, change, on_result=lambda: bar.advance(task), on_fit=terminal.say):
            match result:
                case Changed():
                    changed.append(result)
                    json_lines.write(out, _changed_line(result))
                case NotComputed():
                    not_computed.append(result)
                    json_lines.write(out, result)
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


@app.command()
def schema(
    write: Annotated[Path | None, typer.Option(help="Folder to write one JSON Schema a message to.")] = None,
) -> None:
    """The messages' JSON Schemas: to standard output, or written to a folder."""
    from weld_force_ros.contract import TOPICS, json_schema

    for kind in TOPICS:
        text = msgspec.json.format(msgspec.json.encode(json_schema(kind)), indent=2) + b"\n"
        if write is None:
            sys.stdout.write(msgspec.json.encode(json_schema(kind)).decode() + "\n")
        else:
            with json_lines.writing(write / f"{kind.__name__}.json") as file:
                file.write(text.decode())


@app.command()
def bench(
    repetitions: Annotated[int, typer.Option(min=1, max=50, help="Interleaved repetitions of each timing.")] = 3,
    quick: Annotated[bool, typer.Option("--quick", help="Without what takes minutes.")] = False,
    json: Json = None,
) -> None:
    """How fast and how exact on this machine, against a general solver in the same run."""
    from weld_force_ros import bench as benchmark
    from weld_force_ros import terminal

    with terminal.console.status("measuring") as status:
        found = benchmark.run(repetitions=repetitions, quick=quick, on_step=status.update)
    with json_lines.lines(json) as out:
        json_lines.write(out, found)
    terminal.table(
        "Benchmark",
        [("what", ""), ("median", "right"), ("least to most", "right")],
        [
            (name, f"{value:.4g}", " to ".join(f"{end:.4g}" for end in found.get(f"{name}_spread", [])))
            for name, value in found.items()
            if not name.endswith("_spread")
        ],
    )


@bag_app.command("info")
def bag_info(bag: BagPath, json: Json = None) -> None:
    """What a recording holds and what state it is in."""
    from weld_force_ros import terminal
    from weld_force_ros.bag import summary

    found = summary(bag)
    with json_lines.lines(json) as out:
        json_lines.write(out, asdict(found))
    terminal.table(
        f"{found.path}: {found.message_count} messages, {found.duration_s:.1f} s, {found.size_bytes / 1e3:.0f} kB",
        [("topic", ""), ("type", ""), ("messages", "right")],
        [(t.topic, t.type_name, str(t.message_count)) for t in found.topics],
    )
    terminal.say(found.damage or "closed and indexed" if found.closed else f"not closed: {found.damage}")


@bag_app.command("recover")
def bag_recover(
    bag: BagPath, target: Annotated[Path, typer.Argument(help="Folder of the recovered bag; must not exist.")]
) -> None:
    """Write what is readable of a cut recording to a proper one. Exit codes: 0 clean, 1 failed, 3 lossy."""
    from weld_force_ros import terminal
    from weld_force_ros.bag import recover

    try:
        recovered = recover(bag, target)
    except InputError as error:
        _complain(error)
        raise typer.Exit(1) from None
    terminal.say(f"{recovered.message_count} messages recovered to {target}, {recovered.lost_bytes} bytes unreadable")
    if recovered.lossy:
        raise typer.Exit(3)


@bag_app.command("export")
def bag_export(
    bag: BagPath, target: Annotated[Path, typer.Argument(help="New .mcap file for Foxglove or Lichtblick.")]
) -> None:
    """Write the suite's messages as JSON channels with their schemas."""
    from weld_force_ros import terminal
    from weld_force_ros.bag import export_json

    exported = export_json(bag, target)
    for error in exported.refused:
        _complain(error)
    terminal.say(f"{exported.message_count} messages exported to {target}")


def _settings(
    track: str,
    engine: str,
    speeds: str,
    positions: str,
    wheel_mass_kg: float | None,
    static_load_n: float | None,
    wheel_radius_m: float | None,
    hertz_n_per_m15: float | None,
) -> "SimulationSettings":
    from weld_force_ros.assess import parse_positions, parse_speeds, simulation_settings

    return simulation_settings(
        track=track,
        engine=engine,
        speeds_kmh=parse_speeds(speeds),
        positions=parse_positions(positions),
        wheel_mass_kg=wheel_mass_kg,
        static_load_n=static_load_n,
        wheel_radius_m=wheel_radius_m,
        hertz_n_per_m15=hertz_n_per_m15,
    )


def _simulator(settings: "SimulationSettings") -> "Simulator":
    from weld_force_ros import terminal
    from weld_force_ros.assess import Simulator

    return Simulator(settings, on_fit=terminal.say)


def _numbers(option: str, text: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(abs(number) < float("inf") for number in numbers):
        raise InputError(f"{option} {text!r} cannot be read", "write numbers with commas between, such as 0.0,0.30")
    return numbers


def _degrees(value: complex) -> float:
    import cmath
    import math

    return math.degrees(cmath.phase(value))


def _complain(error: Exception) -> None:
    sys.stderr.write("weld-force: " + " ".join(str(error).split()) + "\n")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit code, which the console script passes on."""
    # An interpreter that ends looks for garbage among all that was imported, which takes a fifth of a short command.
    atexit.register(gc.freeze)
    try:
        result = app(args=arguments, standalone_mode=False, prog_name="weld-force")
    except _UsageError as error:
        command = error.ctx.command_path if error.ctx else "weld-force"
        _complain(InputError(error.format_message().rstrip("."), f"see `{command} --help`"))
        return 2
    except WeldForceError as error:
        _complain(error)
        return 2
    except (typer.Abort, KeyboardInterrupt):
        return 130
    except BrokenPipeError:
        # The reader has what it wanted (`| head`); nothing more can be said to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return result if isinstance(result, int) else 0


if __name__ == "__main__":
    sys.exit(main())
