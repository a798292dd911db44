"""Run the one command, `weld-force`; each subcommand imports what it needs when it runs.

Exit codes: 0 done, 1 a verdict or comparison failed, 2 bad input or usage (one line on standard error). With
`--json -` standard output holds JSON lines and nothing else. Results go to standard output, progress and notes to
standard error.
"""

import atexit
import gc
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from weld_force_ros import SOFTWARE
from weld_force_ros.cli import bag, campaign, limits, replay, result_stream, study, track
from weld_force_ros.cli.assess import assess
from weld_force_ros.cli.bench import bench
from weld_force_ros.cli.benchmark import benchmark
from weld_force_ros.cli.demo import demo
from weld_force_ros.cli.fit import fit
from weld_force_ros.cli.grind import grind
from weld_force_ros.cli.inspect import inspect
from weld_force_ros.cli.nodes import node, up
from weld_force_ros.cli.population import population
from weld_force_ros.cli.receptance import receptance
from weld_force_ros.cli.report import report
from weld_force_ros.cli.schema import schema
from weld_force_ros.cli.show import show
from weld_force_ros.cli.simulate import simulate
from weld_force_ros.cli.site import init
from weld_force_ros.cli.standard_error import discard_notes, print_notes, report_problem
from weld_force_ros.errors import InputError, WeldForceError

# Typer's usage errors, whether its click is the package or a copy of its own.
_UsageError: Any = typer.BadParameter.__base__

_SECTIONS = {
    "Assess": ("assess", "inspect", "grind", "report", "show", "limits", "init"),
    "In the field": ("up", "node", "demo"),
    "Recordings": ("bag", "replay"),
    "Network": ("campaign", "population"),
    "Research": ("simulate", "track", "receptance", "fit", "study", "benchmark", "bench", "schema"),
}


class _Sections(TyperGroup):
    """Lists the commands by what somebody wants to do, each with its whole first sentence."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for section, names in _SECTIONS.items():
            with formatter.section(section):
                formatter.write_dl([(name, self.commands[name].get_short_help_str(limit=1000)) for name in names])


app = typer.Typer(
    cls=_Sections,
    help="Wheel-rail contact forces over rail welds: simulate, judge, record, replay.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _command in (
    assess, inspect, simulate, grind, report, show, demo, up, population, receptance, fit, schema, bench, benchmark,
):  # fmt: skip
    app.command()(_command)
app.command(context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(node)
app.command()(init)
app.add_typer(limits.app, name="limits")
app.add_typer(track.app, name="track")
app.add_typer(replay.app, name="replay")
app.add_typer(bag.app, name="bag")
app.add_typer(campaign.app, name="campaign")
app.add_typer(study.app, name="study")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(SOFTWARE)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Take what stands before a command."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return its exit code."""
    # An interpreter that ends looks for garbage among all that was imported, which takes a fifth of a short command.
    atexit.register(gc.freeze)
    discard_notes()
    result_stream.choose("table")
    try:
        result = app(args=arguments, standalone_mode=False, prog_name="weld-force")
    except _UsageError as error:
        command = error.ctx.command_path if error.ctx else "weld-force"
        report_problem(InputError(error.format_message().rstrip("."), f"see `{command} --help`"))
        return 2
    except WeldForceError as error:
        report_problem(error)
        return 2
    except (typer.Abort, KeyboardInterrupt):
        return 130
    except SystemExit as ended:
        if not isinstance(ended.__context__, BrokenPipeError):
            raise
        result_stream.discard(sys.stdout)  # Typer exits with 1 when the reader has what it wanted (`| head`)
        return 0
    print_notes()
    return result if isinstance(result, int) else 0
