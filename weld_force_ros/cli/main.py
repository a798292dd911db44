"""Run the one command, `weld-force`; each subcommand imports what it needs when it runs.

Exit codes: 0 done, 1 a verdict or comparison failed, 2 bad input or usage (one line on standard error). With
`--json -` standard output holds JSON lines and nothing else; tables and progress go to standard error.
"""

import atexit
import gc
import os
import sys
from typing import Any

import typer

from weld_force_ros.cli import bag, campaign, limits, replay, study, track
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
from weld_force_ros.cli.standard_error import discard_notes, print_notes, report_problem
from weld_force_ros.errors import InputError, WeldForceError

# Typer's usage errors, whether its click is the package or a copy of its own.
_UsageError: Any = typer.BadParameter.__base__

app = typer.Typer(
    help="Wheel-rail contact forces over rail welds: simulate, judge, record, replay.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _command in (
    assess, inspect, simulate, grind, report, show, demo, up, population, receptance, fit, schema, bench, benchmark,
):  # fmt: skip
    app.command()(_command)
app.command(context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(node)
app.add_typer(limits.app, name="limits")
app.add_typer(track.app, name="track")
app.add_typer(replay.app, name="replay")
app.add_typer(bag.app, name="bag")
app.add_typer(campaign.app, name="campaign")
app.add_typer(study.app, name="study")


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return its exit code."""
    # An interpreter that ends looks for garbage among all that was imported, which takes a fifth of a short command.
    atexit.register(gc.freeze)
    discard_notes()
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
    except BrokenPipeError:
        # The reader has what it wanted (`| head`); nothing more can be said to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    print_notes()
    return result if isinstance(result, int) else 0
