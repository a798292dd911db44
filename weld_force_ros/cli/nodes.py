"""Run `weld-force up` and `node`: the nodes as programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from weld_force_ros.cli.options import (
    Limits,
    MeasurementOptions,
    SimulationOptions,
    UncertaintyOptions,
    in_existing_folder,
    ros_module,
    with_option_groups,
)
from weld_force_ros.cli.site import with_site
from weld_force_ros.errors import InputError


@dataclass(frozen=True)
class SuiteOptions:
    """The suite's folders, and how its nodes run."""

    folder: Annotated[Path | None, typer.Option(help="Folder of measurement files to watch.")] = None
    bag: Annotated[
        Path | None,
        typer.Option(callback=in_existing_folder, help="Folder to record to; a recording there is continued."),
    ] = None
    config: Annotated[Path | None, typer.Option(help="Parameter file (YAML); command-line options override it.")] = None
    namespace: Annotated[str, typer.Option(help="Of the nodes, such as left: two rails run side by side.")] = ""
    processes: Annotated[bool, typer.Option("--processes", help="One process a node; one that dies is restarted.")] = (
        False
    )
    detect_welds: Annotated[
        bool | None, typer.Option(help="Detect welds in a live trolley's samples (experimental).")
    ] = None
    dashboard: Annotated[bool, typer.Option("--dashboard", help="Also show the welds on a page of this machine.")] = (
        False
    )
    dashboard_port: Annotated[
        int | None, typer.Option(metavar="PORT", help="Where --dashboard serves its page (default: 8765).")
    ] = None
    dashboard_host: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Serve the page to others on this network, such as a tablet: an address of this machine, or 0.0.0.0"
            " for all. Only who has the page's address, with its token, is answered; it is not encrypted.",
        ),
    ] = None
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Also stream all topics to Foxglove or Lichtblick on this machine.")
    ] = False
    foxglove_port: Annotated[
        int | None, typer.Option(metavar="PORT", help="Where --foxglove is connected to (default: 8766).")
    ] = None


@with_site
@with_option_groups()
def up(
    suite: SuiteOptions,
    simulation: SimulationOptions,
    uncertainty: UncertaintyOptions,
    measurement: MeasurementOptions,
    limits: Limits = None,
) -> None:
    """Run the three nodes until SIGINT or SIGTERM; each weld's verdict is shown as it comes.

    Options that are not given are the parameter file's (--config), else the defaults.
    """
    from weld_force_ros.ros.parameters import check_values, read_parameter_file, values_of_node

    supervisor, launcher = ros_module("supervisor"), ros_module("launcher")
    served = {"port": suite.dashboard_port, "host": suite.dashboard_host}
    for name, value in served.items():
        if value is not None and not suite.dashboard:
            raise InputError(f"--dashboard-{name} says where a dashboard is served", "add --dashboard")
    if suite.foxglove_port is not None and not suite.foxglove:
        raise InputError("--foxglove-port says where Foxglove connects to", "add --foxglove")
    given: dict[str, dict[str, Any]] = {
        "profile": {"folder": suite.folder, "detect_welds": suite.detect_welds, **vars(measurement)},
        "simulator": {
            **vars(simulation),
            "vehicle": simulation.vehicle_text,
            "uncertainty_samples": uncertainty.samples,
            "uncertainty": uncertainty.file,
        },
        "assessment": {"limits": limits, "bag": suite.bag},
        **({"dashboard": served} if suite.dashboard else {}),
        **({"foxglove": {"port": suite.foxglove_port}} if suite.foxglove else {}),
    }
    stated = read_parameter_file(suite.config) if suite.config is not None else {}
    parameters = {
        kind: values_of_node(stated, f"{kind}_node", suite.namespace)
        | {
            name: str(value.absolute()) if isinstance(value, Path) else value
            for name, value in options.items()
            if value is not None
        }
        for kind, options in given.items()
    }
    parameters = {kind: check_values(f"{kind}_node", values) for kind, values in parameters.items()}
    if not parameters["assessment"].get("bag"):
        launcher.print_line("not recording (no --bag): after a restart, welds of the folder may be judged again")
    ros_args = ["--ros-args", "-r", f"__ns:=/{suite.namespace.strip('/')}"] if suite.namespace else []
    start = supervisor.supervise if suite.processes else launcher.run_suite
    raise typer.Exit(start(parameters, ros_args))


def node(
    context: typer.Context,
    kind: Annotated[
        str, typer.Argument(metavar="profile|simulator|assessment|trolley|dashboard|foxglove", help="Which node.")
    ],
) -> None:
    """Run one node until SIGINT or SIGTERM; `--ros-args …` as on any ROS command line."""
    launcher = ros_module("launcher")
    if kind not in launcher.ALL_KINDS:
        raise InputError(f"there is no node {kind!r}", f"use {', '.join(launcher.ALL_KINDS)}")
    if context.args and context.args[0] != "--ros-args":
        raise InputError(f"{context.args[0]!r} is not understood", "ROS arguments follow --ros-args")
    raise typer.Exit(launcher.run_node(kind, context.args))
