"""Options that several commands share, once each; groups of them arrive at a command as one object."""

import copy
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer
from typer.core import TyperGroup

from weld_force_ros.cli import result_stream
from weld_force_ros.cli.quantities import force_n, length_m, mass_kg, speed_kmh
from weld_force_ros.cli.standard_error import note_old_spelling
from weld_force_ros.errors import InputError
from weld_force_ros.ros import environment

if TYPE_CHECKING:
    from weld_force_ros.measurement.instruments import InstrumentFormat
    from weld_force_ros.messages import SimulationSettings, Uncertainty


def in_existing_folder(option: typer.CallbackParam, path: Path | str | None) -> Path | str | None:
    """Return where a command is to write: that it cannot is said before a long computation.

    Raises:
        InputError: the folder that it names is not there.
    """
    if path is None or path == "-" or Path(path).absolute().parent.is_dir():
        return path
    name = f"{option.opts[0]} " if option.opts[0].startswith("-") else ""
    raise InputError(f"{name}{path}: there is no folder {Path(path).parent}", "make it first, or name another place")


Track = Annotated[
    str | None, typer.Option(help="A bundled track or the path of a track file (YAML); default: bilbao-causal.")
]
As = Annotated[
    str, typer.Option("--as", metavar="table|csv|json", help="What standard output holds; json is --json -.")
]
Json = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE|-", callback=in_existing_folder, help="Write JSON lines to a file or stdout."),
]
Limits = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE[,...]",
        help="Rule books to judge by, see `weld-force limits list`: force,banenor-531; default: force.",
    ),
]
BagPath = Annotated[Path, typer.Argument(help="A bag folder, or one of its files (.mcap, .db3).")]
Profiles = Annotated[list[str], typer.Argument(help="Profile files, or names of bundled profiles.")]
Plot = Annotated[
    Path | None, typer.Option(callback=in_existing_folder, help="Picture of each weld (several: a number is added).")
]


@dataclass(frozen=True)
class SimulationOptions:
    """Settings of a simulation; None stands for a command's own default, or that of a parameter file."""

    track: Track = None
    vehicle: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Bundled vehicle or vehicle file; several: the worst decides; default: track's wheel.",
        ),
    ] = None
    engine: Annotated[str | None, typer.Option(help="How the track is represented in time; default: common-poles.")] = (
        None
    )
    speeds: Annotated[
        str | None, typer.Option(help="FIRST:LAST:STEP or a list such as 40,80, in km/h; default: 20:300:5.")
    ] = None
    positions: Annotated[
        str | None,
        typer.Option(help="N equal steps over the span, or metres after the sleeper: 0.15,0.30; default: 15."),
    ] = None
    wheel_mass_kg: Annotated[
        float | None,
        typer.Option(
            "--wheel-mass", parser=str, callback=mass_kg, metavar="600kg", help="Half a wheelset; default: the track's."
        ),
    ] = None
    static_load_n: Annotated[
        float | None,
        typer.Option("--static-load", parser=str, callback=force_n, metavar="100kN", help="Static wheel load."),
    ] = None
    wheel_radius_m: Annotated[
        float | None,
        typer.Option("--wheel-radius", parser=str, callback=length_m, metavar="460mm", help="Rolling radius."),
    ] = None
    hertz_n_per_m15: Annotated[float | None, typer.Option("--hertz", help="Hertz constant, N/m^1.5.")] = None
    crown_radius_m: Annotated[
        float | None,
        typer.Option(
            "--crown-radius",
            parser=str,
            callback=length_m,
            metavar="300mm",
            help="Transverse radius of the rail head: the Hertz constant follows.",
        ),
    ] = None
    contact_patch: Annotated[
        str | None,
        typer.Option(metavar="on|off", help="Average the rail's heights over the contact patch; default: on."),
    ] = None

    rolling: Annotated[
        str | None,
        typer.Option(
            metavar="circle|none",
            help="Whether the wheel's circle rolls over the rail and bridges it; default: circle.",
        ),
    ] = None
    running: Annotated[
        str | None,
        typer.Option(
            metavar="with|against|both",
            help="How trains run over welds that do not state it: with rising x, against it; default: both.",
        ),
    ] = None

    support: Annotated[
        str | None,
        typer.Option(
            metavar="SLEEPER=SHARE,...",
            help="Supports that differ at welds that do not state them: 0=0.02 hangs, 1=gap:0.8mm, 0=missing, 0=pad:2,"
            " 1:6=4; sleeper 0 is the last before the weld.",
        ),
    ] = None

    @property
    def vehicle_text(self) -> str | None:
        """Return the vehicles with commas between them, as the nodes' parameter has them; None if none is given."""
        return ",".join(self.vehicle) if self.vehicle else None

    def settings(self, uncertainty: "Uncertainty | None" = None) -> "SimulationSettings":
        """Return complete settings of a command that simulates one vehicle.

        Raises:
            InputError: anything that cannot be simulated, or several vehicles.
        """
        settings = self.settings_of_vehicles(uncertainty)
        if len(settings) > 1:
            raise InputError(f"--vehicle: {len(settings)} vehicles", "name one; `assess` judges a weld under several")
        return settings[0]

    def settings_of_vehicles(self, uncertainty: "Uncertainty | None" = None) -> "list[SimulationSettings]":
        """Return complete settings of each vehicle, with the defaults of `weld_force_ros.simulation.settings`.

        Raises:
            InputError: anything that cannot be simulated.
        """
        from weld_force_ros.simulation.settings import (
            parse_positions,
            parse_speeds,
            parse_vehicles,
            simulation_settings,
        )

        given: dict[str, Any] = {name: value for name, value in vars(self).items() if value is not None}
        given.pop("vehicle", None)
        if self.speeds is not None:
            given["speeds_kmh"] = parse_speeds(given.pop("speeds"))
        if self.positions is not None:
            given["positions"] = parse_positions(self.positions)
        vehicles = parse_vehicles(self.vehicle_text or "")
        return [simulation_settings(**given, vehicle=vehicle, uncertainty=uncertainty) for vehicle in vehicles]


@dataclass(frozen=True)
class UncertaintyOptions:
    """Monte-Carlo samples of what is uncertain."""

    uncertainty_samples: Annotated[
        int | None, typer.Option(help="Monte-Carlo samples of what is uncertain, such as 200: probabilities.")
    ] = None
    uncertainty_file: Annotated[
        Path | None, typer.Option(help="What is uncertain, and how much (YAML; default: the bundled file).")
    ] = None
    uncertainty: Annotated[int | None, typer.Option("--uncertainty", hidden=True)] = None
    unknown: Annotated[Path | None, typer.Option("--unknown", hidden=True)] = None

    @property
    def samples(self) -> int | None:
        """Number of samples, by either spelling of the option."""
        if self.uncertainty is not None:
            note_old_spelling("--uncertainty", "--uncertainty-samples")
        return self.uncertainty if self.uncertainty_samples is None else self.uncertainty_samples

    @property
    def samples_or_default(self) -> int:
        """Number of samples where probabilities are the default; 0 switches them off."""
        from weld_force_ros.simulation.settings import DEFAULT_UNCERTAINTY_SAMPLES

        given = self.samples
        return DEFAULT_UNCERTAINTY_SAMPLES if given is None else given

    @property
    def file(self) -> Path | None:
        """File of what is uncertain, by either spelling of the option."""
        if self.unknown is not None:
            note_old_spelling("--unknown", "--uncertainty-file")
        return self.uncertainty_file or self.unknown

    def uncertainty_of_settings(self) -> "Uncertainty | None":
        """Return what is drawn, or None if no samples are asked for.

        Raises:
            InputError: the file cannot be used.
        """
        from weld_force_ros.simulation.settings import load_uncertainty

        return load_uncertainty(self.samples or 0, self.file)


@dataclass(frozen=True)
class MeasurementOptions:
    """The form of measurement files, and what they do not state themselves."""

    format: Annotated[
        str | None,
        typer.Option("--format", metavar="NAME|FILE.yaml", help="How the instrument writes; default: recognised."),
    ] = None
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="auto|none|METRES",
            help="Measurement noise: estimated and taken out (auto, default), samples as they are (none), or stated.",
        ),
    ] = None
    x_unit: Annotated[str | None, typer.Option(help="Unit of positions that a file does not state: m, cm, mm, um.")] = (
        None
    )
    z_unit: Annotated[str | None, typer.Option(help="Unit of heights that a file does not state: m, cm, mm, um.")] = (
        None
    )
    z_positive: Annotated[
        str | None, typer.Option(help="Where a file does not state it: up if a protrusion is positive, or down.")
    ] = None
    line_speed_kmh: Annotated[
        float | None,
        typer.Option(
            "--line-speed",
            parser=str,
            callback=speed_kmh,
            metavar="160",
            help="Line speed that files do not state, km/h.",
        ),
    ] = None
    spacing: Annotated[float | None, typer.Option(help="For files with heights only: sample spacing in --x-unit.")] = (
        None
    )
    skip_rows: Annotated[int | None, typer.Option(help="Lines to skip at the top of each file.")] = None

    def form(self) -> "InstrumentFormat | None":
        """Return how files are to be read, or None if nothing is stated.

        Raises:
            InputError: a format that does not exist, or a statement that cannot be.
        """
        from weld_force_ros.measurement.instruments import format_of

        return format_of(**vars(self))


def with_option_groups(*hidden: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a command whose parameters may be option groups: dataclasses whose fields are Typer's options.

    The command line shows the options one by one, the command gets one object a group.

    Args:
        hidden: groups whose options are left out of the help.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        hints = get_type_hints(command, include_extras=True)
        groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
        parameters = []
        for name, parameter in inspect.signature(command).parameters.items():
            if name not in groups:
                parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[name]))
                continue
            options = get_type_hints(groups[name], include_extras=True)
            parameters += [
                inspect.Parameter(
                    field.name,
                    inspect.Parameter.KEYWORD_ONLY,
                    default=field.default,
                    annotation=_hidden(options[field.name]) if name in hidden else options[field.name],
                )
                for field in fields(groups[name])
            ]

        @wraps(command)
        def run(**given: Any) -> Any:
            for name, kind in groups.items():
                given[name] = kind(**{field.name: given.pop(field.name) for field in fields(kind)})
            return command(**given)

        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate


def prints_results(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a command with tables and a parameter `json`: `--as` says what standard output holds of its results."""
    signature = inspect.signature(command)
    shown_as = inspect.Parameter("shown_as", inspect.Parameter.KEYWORD_ONLY, default="table", annotation=As)

    @wraps(command)
    def run(*, shown_as: str, **given: Any) -> Any:
        if shown_as != "table" and given["json"] is not None:
            raise InputError(f"--as {shown_as} and --json exclude each other", "give one of them")
        if shown_as == "json":
            given["json"] = "-"
        result_stream.choose("json" if given["json"] == "-" else shown_as)
        return command(**given)

    keywords = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in signature.parameters.values()]
    run.__signature__ = signature.replace(parameters=[*keywords, shown_as])  # type: ignore[attr-defined]
    run.__annotations__ = {**get_type_hints(command, include_extras=True), "shown_as": As}
    return run


def _hidden(annotated: Any) -> Any:
    option = copy.copy(annotated.__metadata__[0])
    option.hidden = True
    return Annotated[annotated.__origin__, option]


def group_with_default(default: str) -> type[TyperGroup]:
    """Return a group of commands in which `group ARGUMENT` is `group DEFAULT ARGUMENT`."""

    class Group(TyperGroup):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            if args and args[0] not in self.commands and args[0] not in ("--help", "-h"):
                args = [default, *args]
            return super().parse_args(ctx, args)

    return Group


def ros_module(name: str) -> Any:
    """Import a module of the ROS side.

    Raises:
        InputError: there is no ROS, or it cannot start as the environment is; says what to do.
    """
    environment.prepare()
    try:
        return import_module(f"weld_force_ros.ros.{name}")
    except ImportError as error:
        raise InputError(
            f"ROS 2 is not there ({error})", "install it with `pip install 'weld_force_ros[ros]'` or source your ROS"
        ) from None
