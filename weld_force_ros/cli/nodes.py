"""`weld-force demo`, `up` and `node`: the nodes as programs."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from weld_force_ros import SOFTWARE
from weld_force_ros.cli.options import (
    Hertz,
    Limits,
    Samples,
    Spacing,
    StaticLoad,
    Track,
    Unknown,
    WheelMass,
    WheelRadius,
    XUnit,
    ZPositive,
    ZUnit,
    ros_module,
)
from weld_force_ros.cli.report import report
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.recording.recording import Recording

_DEFAULT = "(default: the config's, else {})"
OwnTrack = Annotated[str | None, typer.Option("--track", help=f"A track {_DEFAULT.format('bilbao')}.")]
OwnEngine = Annotated[str | None, typer.Option("--engine", help=f"Engine {_DEFAULT.format('common-poles')}.")]
OwnSpeeds = Annotated[str | None, typer.Option("--speeds", help=f"Speeds, km/h {_DEFAULT.format('20:300:5')}.")]
OwnPositions = Annotated[str | None, typer.Option("--positions", help=f"Positions {_DEFAULT.format('15')}.")]


def demo(
    out: Annotated[Path | None, typer.Option(help="New folder for files, bag and picture.")] = None,
    track: Track = "bilbao",
    trolley: Annotated[bool, typer.Option("--trolley", help="A simulated trolley measures instead of files.")] = False,
) -> None:
    """Run the whole suite on this machine over the shipped welds, or a trolley's, and show what came out."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import shipped

    run_demo = ros_module("demo").run_demo
    folder = out or Path("weld-force-demo") / datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    with terminal.progress() as bar:
        task = bar.add_task("measuring, simulating, judging", total=None if trolley else len(shipped()))
        result = run_demo(folder, track=track, on_outcome=lambda _: bar.advance(task), trolley=trolley)
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
    report(result.bag, folder / "report.html", grinding=True)
    terminal.say(f"bag:     {result.bag}  ({SOFTWARE})")
    terminal.say(
        f"next:    open {folder / 'report.html'}   what to do with each weld, and why\n"
        f"         weld-force replay {result.bag} --verify   computes every verdict again, without ROS\n"
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


def up(
    folder: Annotated[Path | None, typer.Option(help="Folder of measurement files to watch.")] = None,
    bag: Annotated[Path | None, typer.Option(help="Folder to record to; a recording there is continued.")] = None,
    config: Annotated[
        Path | None, typer.Option(help="Parameter file (YAML); what is given here goes before it.")
    ] = None,
    namespace: Annotated[str, typer.Option(help="Of the nodes, such as left: two rails run side by side.")] = "",
    processes: Annotated[
        bool, typer.Option("--processes", help="One process a node; one that dies is restarted.")
    ] = False,
    track: OwnTrack = None,
    engine: OwnEngine = None,
    speeds: OwnSpeeds = None,
    positions: OwnPositions = None,
    wheel_mass_kg: WheelMass = None,
    static_load_n: StaticLoad = None,
    wheel_radius_m: WheelRadius = None,
    hertz_n_per_m15: Hertz = None,
    uncertainty: Samples = None,
    unknown: Unknown = None,
    limits: Limits = None,
    x_unit: XUnit = None,
    z_unit: ZUnit = None,
    z_positive: ZPositive = None,
    spacing: Spacing = None,
    detect_welds: Annotated[bool | None, typer.Option(help="Look for welds in a live trolley's samples.")] = None,
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="Also show the welds on a page of this machine.")
    ] = False,
    dashboard_port: Annotated[
        int | None, typer.Option(metavar="PORT", help="Where --dashboard serves its page (default: 8765).")
    ] = None,
) -> None:
    """Run the three nodes until SIGINT or SIGTERM; each weld's outcome is shown as it comes."""
    from weld_force_ros.ros.parameters import check_values, read_parameter_file, values_of_node

    supervisor, run = ros_module("supervisor"), ros_module("launcher")
    given: dict[str, dict[str, Any]] = {
        "profile": {
            "folder": folder and str(folder.absolute()),
            "x_unit": x_unit,
            "z_unit": z_unit,
            "z_positive": z_positive,
            "spacing": spacing,
            "detect_welds": detect_welds,
        },
        "simulator": {
            "track": track,
            "engine": engine,
            "speeds": speeds,
            "positions": positions,
            "wheel_mass_kg": wheel_mass_kg,
            "static_load_n": static_load_n,
            "wheel_radius_m": wheel_radius_m,
            "hertz_n_per_m15": hertz_n_per_m15,
            "uncertainty_samples": uncertainty,
            "uncertainty": unknown and str(unknown.absolute()),
        },
        "assessment": {"limits": limits and str(limits.absolute()), "bag": bag and str(bag.absolute())},
    }
    if dashboard:
        given["dashboard"] = {"port": dashboard_port}
    elif dashboard_port is not None:
        raise InputError("--dashboard-port says where a dashboard is served", "add --dashboard")
    stated = read_parameter_file(config) if config is not None else {}
    parameters = {
        kind: values_of_node(stated, f"{kind}_node", namespace)
        | {name: value for name, value in options.items() if value is not None}
        for kind, options in given.items()
    }
    for kind, values in parameters.items():
        check_values(f"{kind}_node", values)
    if not parameters["assessment"].get("bag"):
        run.print_line("not recording (no --bag): after a restart, welds of the folder may be judged again")
    ros_args = ["--ros-args", "-r", f"__ns:=/{namespace.strip('/')}"] if namespace else []
    start = supervisor.supervise if processes else run.run_suite
    raise typer.Exit(start(parameters, ros_args))


def node(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(metavar="profile|simulator|assessment|trolley|dashboard", help="Which node.")],
) -> None:
    """Run one node until SIGINT or SIGTERM; `--ros-args …` as on any ROS command line."""
    run = ros_module("launcher")
    if kind not in run.ALL_KINDS:
        raise InputError(f"there is no node {kind!r}", f"use {', '.join(run.ALL_KINDS)}")
    if context.args and context.args[0] != "--ros-args":
        raise InputError(f"{context.args[0]!r} is not understood", "ROS arguments follow --ros-args")
    raise typer.Exit(run.run_node(kind, context.args))
