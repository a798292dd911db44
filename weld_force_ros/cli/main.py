"""The one command, `weld-force`; each subcommand imports what it needs when it runs.

Exit codes: 0 done, 1 a verdict or comparison failed, 2 bad input or usage (one line on standard error). With
`--json -` standard output holds JSON lines and nothing else; tables and progress go to standard error.
"""

import atexit
import gc
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_args

import msgspec
import typer

from weld_force_ros.cli import bag, campaign, grind, json_output, nodes, replay, report, show, study
from weld_force_ros.cli import population as cli_population
from weld_force_ros.cli.json_output import output_file
from weld_force_ros.cli.options import (
    EngineName,
    Hertz,
    Json,
    Positions,
    Samples,
    SkipRows,
    Spacing,
    Speeds,
    StaticLoad,
    Track,
    Unknown,
    WheelMass,
    WheelRadius,
    XUnit,
    ZPositive,
    ZUnit,
)
from weld_force_ros.errors import InputError, WeldForceError, os_errors_as

if TYPE_CHECKING:
    from weld_force_ros.messages import SimulationSettings
    from weld_force_ros.simulation.fit_store import AnyFit
    from weld_force_ros.simulation.simulator import Simulator

# Typer's usage errors, whether its click is the package or a copy of its own.
_UsageError: Any = typer.BadParameter.__base__

app = typer.Typer(
    help="Wheel-rail contact forces over rail welds: simulate, judge, record, replay.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(bag.app, name="bag")
app.add_typer(campaign.app, name="campaign")
app.add_typer(study.app, name="study")
app.command()(grind.grind)
app.command()(cli_population.population)
app.command()(nodes.demo)
app.command()(nodes.up)
app.command(context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(nodes.node)
app.command()(replay.replay)
app.command()(report.report)
app.command()(show.show)


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
    uncertainty: Samples = None,
    unknown: Unknown = None,
    x_unit: XUnit = None,
    z_unit: ZUnit = None,
    z_positive: ZPositive = None,
    spacing: Spacing = None,
    skip_rows: SkipRows = 0,
    json: Json = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of each weld (several: a number is added).")] = None,
) -> None:
    """Peak force of measured welds at every speed and position."""
    from weld_force_ros.assessment.judge import deciding_history
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import PlainForm, find, read_profile

    settings = _settings(
        track, engine, speeds, positions, wheel_mass_kg, static_load_n, wheel_radius_m, hertz_n_per_m15, uncertainty,
        unknown,
    )  # fmt: skip
    stated = (x_unit, z_unit, z_positive, spacing)
    form = PlainForm(x_unit=x_unit, z_unit=z_unit, z_positive=z_positive, spacing=spacing, skip_rows=skip_rows)
    simulator = _simulator(settings)
    maps, unusable = [], 0
    with json_output.lines(json) as out, terminal.progress() as bar:
        for number, name in enumerate(profiles, start=1):
            try:
                profile = read_profile(find(name), form if any(s is not None for s in stated) else None)
                task = bar.add_task(profile.weld_id, total=len(settings.speeds_kmh))
                force_map = simulator.force_map(profile, on_speed=partial(bar.advance, task))
            except InputError as error:
                if len(profiles) == 1:
                    raise
                _report_problem(error)
                unusable += 1
                continue
            bar.remove_task(task)
            json_output.write(out, force_map)
            maps.append(force_map)
            if plot:
                from weld_force_ros.report import figures

                picture = plot if len(profiles) == 1 else plot.with_stem(f"{plot.stem}-{number}")
                figures.save(
                    figures.one_weld(profile, force_map, deciding_history(profile, simulator, force_map)), picture
                )
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
    from weld_force_ros.cli import terminal
    from weld_force_ros.physics.track.beam import receptance as exact_receptance
    from weld_force_ros.simulation import fit_store, track_file

    at_m, frequency_hz = _numbers("--at", at), _numbers("--freq", freq)
    if min(frequency_hz) <= 0:
        raise InputError(f"--freq {freq}: a frequency is not positive", "give frequencies in Hz above 0")
    definition = track_file.load(track)
    if engine == "exact":
        with terminal.console.status("computing receptances"):  # of a rail by strips, seconds
            h = exact_receptance(definition.track, frequency_hz, at_m)
    elif engine in get_args(fit_store.FittedEngine):
        h = (
            fit_store.fitted(definition, cast(fit_store.FittedEngine, engine), on_fit=terminal.say)
            .model()
            .receptance(frequency_hz, at_m)
        )
    else:
        raise InputError(f"engine {engine!r} has no receptance of its own", "use exact, common-poles or rfp")
    with json_output.lines(json) as out:
        json_output.write(
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
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation import fit_store, track_file

    definition = track_file.load(track)
    if engine not in ("rfp", "common-poles"):
        raise InputError(f"engine {engine!r} has no fit", "use rfp or common-poles")
    with terminal.progress() as bar:
        if engine == "rfp":
            task = bar.add_task(f"searching {definition.track.name}", total=generations)
            how = fit_store.Search(
                degree=degree, section_count=sections, seed=seed, generations=generations, population=population
            )
            made: fit_store.AnyFit = fit_store.make_rfp(
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
            made = fit_store.make_poles(definition)
    fit_store.keep(made)
    with json_output.lines(json) as target:
        json_output.write(target, made)
    _show_fit(made)
    if out:
        from weld_force_ros.report import figures
        from weld_force_ros.report.fit_figure import fit_figure

        name = f"{made.track}.{made.engine}".replace("/", "_")
        with os_errors_as(InputError, out, "name a writable folder"):
            fit_store.write(made, out / f"{name}.json")
        figures.save(fit_figure(definition, made), out / f"{name}.png")
        terminal.say(f"written: {out / name}.json and .png")
    if not definition.track.causal:
        terminal.say(
            f"Loss factors are not causal: {100 * made.acausal_energy_share:.1f} % of the impulse response's energy "
            "lies before the impulse, and no model in time reproduces the receptance; the last column shows what a "
            "mere cut costs."
        )


def _show_fit(made: "AnyFit") -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation.fit_store import RfpFit

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
def schema(
    write: Annotated[Path | None, typer.Option(help="Folder to write one JSON Schema a message to.")] = None,
    config: Annotated[Path | None, typer.Option(help="Folder for the parameter file and its schema.")] = None,
) -> None:
    """The messages' JSON Schemas: to standard output, or written to a folder; also those of parameter files."""
    from weld_force_ros.messages import SCHEMAS, json_schema
    from weld_force_ros.ros import parameters

    for kind in SCHEMAS:
        if write is None and config is None:
            sys.stdout.write(msgspec.json.encode(json_schema(kind)).decode() + "\n")
        elif write is not None:
            _write(write / f"{kind.__name__}.json", _indented(json_schema(kind)))
    if config is not None:
        _write(config / "schema.json", _indented(parameters.parameter_file_schema()))
        _write(config / "default.yaml", parameters.default_parameter_text())


def _indented(content: dict[str, Any]) -> str:
    return msgspec.json.format(msgspec.json.encode(content), indent=2).decode() + "\n"


def _write(path: Path, text: str) -> None:
    with output_file(path) as file:
        file.write(text)


@app.command()
def bench(
    repetitions: Annotated[int, typer.Option(min=1, max=50, help="Interleaved repetitions of each timing.")] = 3,
    quick: Annotated[bool, typer.Option("--quick", help="Without what takes minutes.")] = False,
    json: Json = None,
) -> None:
    """How fast and how exact on this machine, against a general solver in the same run."""
    import benchmarks
    from weld_force_ros.cli import terminal

    with terminal.console.status("measuring") as status:
        found = benchmarks.run(repetitions=repetitions, quick=quick, on_step=status.update)
    with json_output.lines(json) as out:
        json_output.write(out, found)
    terminal.table(
        "Benchmark",
        [("what", ""), ("median", "right"), ("least to most", "right")],
        [
            (name, f"{value:.4g}", " to ".join(f"{end:.4g}" for end in found.get(f"{name}_spread", [])))
            for name, value in found.items()
            if not name.endswith("_spread")
        ],
    )


def _settings(
    track: str,
    engine: str,
    speeds: str,
    positions: str,
    wheel_mass_kg: float | None,
    static_load_n: float | None,
    wheel_radius_m: float | None,
    hertz_n_per_m15: float | None,
    samples: int | None,
    unknown: Path | None,
) -> "SimulationSettings":
    from weld_force_ros.simulation.settings import load_uncertainty, parse_positions, parse_speeds, simulation_settings

    return simulation_settings(
        track=track,
        engine=engine,
        speeds_kmh=parse_speeds(speeds),
        positions=parse_positions(positions),
        wheel_mass_kg=wheel_mass_kg,
        static_load_n=static_load_n,
        wheel_radius_m=wheel_radius_m,
        hertz_n_per_m15=hertz_n_per_m15,
        uncertainty=load_uncertainty(samples or 0, unknown),
    )


def _simulator(settings: "SimulationSettings") -> "Simulator":
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation.simulator import Simulator

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


def _report_problem(error: Exception) -> None:
    sys.stderr.write("weld-force: " + " ".join(str(error).split()) + "\n")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit code, which the console script passes on."""
    # An interpreter that ends looks for garbage among all that was imported, which takes a fifth of a short command.
    atexit.register(gc.freeze)
    try:
        result = app(args=arguments, standalone_mode=False, prog_name="weld-force")
    except _UsageError as error:
        command = error.ctx.command_path if error.ctx else "weld-force"
        _report_problem(InputError(error.format_message().rstrip("."), f"see `{command} --help`"))
        return 2
    except WeldForceError as error:
        _report_problem(error)
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
