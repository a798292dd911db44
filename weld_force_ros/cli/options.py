"""Options that several commands of `weld-force` share, and the way to the ROS side."""

from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from weld_force_ros.errors import InputError

Track = Annotated[str, typer.Option(help="A shipped track or the path of a track file (YAML).")]
EngineName = Annotated[str, typer.Option(help="How the track is represented in time.")]
Speeds = Annotated[str, typer.Option(help="FIRST:LAST:STEP or a list such as 40,80, in km/h.")]
Positions = Annotated[str, typer.Option(help="N equal steps over the span, or metres after the sleeper: 0.15,0.30.")]
WheelMass = Annotated[float | None, typer.Option("--wheel-mass", help="Half a wheelset, kg (default: the track's).")]
StaticLoad = Annotated[float | None, typer.Option("--static-load", help="Static wheel load, N.")]
WheelRadius = Annotated[float | None, typer.Option("--wheel-radius", help="Rolling radius, m.")]
Hertz = Annotated[float | None, typer.Option("--hertz", help="Hertz constant, N/m^1.5.")]
Samples = Annotated[
    int | None, typer.Option("--uncertainty", help="Samples of what is not known, such as 200: probabilities.")
]
Unknown = Annotated[Path | None, typer.Option("--unknown", help="What is not known (YAML; default: the shipped one).")]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE|-", help="Write JSON lines to a file or stdout.")]
Limits = Annotated[Path | None, typer.Option(help="Limits file (YAML; default: the shipped, unverified ones).")]
BagPath = Annotated[Path, typer.Argument(help="A bag folder or an .mcap file.")]
XUnit = Annotated[str | None, typer.Option("--x-unit", help="For plain text files: m, cm, mm or um.")]
ZUnit = Annotated[str | None, typer.Option("--z-unit", help="For plain text files: m, cm, mm or um.")]
ZPositive = Annotated[str | None, typer.Option("--z-positive", help="For plain text files: up or down.")]
Spacing = Annotated[float | None, typer.Option(help="For files with heights only: sample spacing in --x-unit.")]
SkipRows = Annotated[int, typer.Option("--skip-rows", help="For plain text files: lines to skip at the top.")]


def ros_module(name: str) -> Any:
    """A module of the ROS side.

    Raises:
        InputError: there is no ROS; says how to get it.
    """
    try:
        return import_module(f"weld_force_ros.ros.{name}")
    except ImportError as error:
        raise InputError(
            f"ROS 2 is not there ({error})", "install it with `pip install 'weld_force_ros[ros]'` or source your ROS"
        ) from None
