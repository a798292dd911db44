"""Run `weld-force simulate`: forces over measured welds at every speed and position."""

from functools import partial
from typing import Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import (
    Json,
    PlainTextOptions,
    Plot,
    Profiles,
    SimulationOptions,
    UncertaintyOptions,
    with_option_groups,
)
from weld_force_ros.cli.standard_error import report_problem
from weld_force_ros.errors import InputError


@with_option_groups()
def simulate(
    profiles: Profiles,
    simulation: SimulationOptions,
    uncertainty: UncertaintyOptions,
    plain_text: PlainTextOptions,
    skip_rows: Annotated[int, typer.Option(help="For plain text files: lines to skip at the top.")] = 0,
    json: Json = None,
    plot: Plot = None,
) -> None:
    """Compute the peak force of measured welds at every speed and position."""
    from weld_force_ros.assessment.judge import deciding_history
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import find, read_profile
    from weld_force_ros.simulation.simulator import Simulator

    settings = simulation.settings(uncertainty.uncertainty_of_settings())
    simulator, form = Simulator(settings, on_fit=terminal.say), plain_text.form(skip_rows)
    maps, unusable = [], 0
    with json_output.lines(json) as out, terminal.progress() as bar:
        for number, name in enumerate(profiles, start=1):
            try:
                profile = read_profile(find(name), form)
                task = bar.add_task(profile.weld_id, total=len(settings.speeds_kmh))
                force_map = simulator.force_map(profile, on_speed=partial(bar.advance, task))
            except InputError as error:
                if len(profiles) == 1:
                    raise
                report_problem(error)
                unusable += 1
                continue
            bar.remove_task(task)
            json_output.write(out, force_map)
            maps.append(force_map)
            if plot:
                from weld_force_ros.report import figures

                picture = plot if len(profiles) == 1 else plot.with_stem(f"{plot.stem}-{number}")
                history = deciding_history(profile, simulator, force_map)
                figures.save(figures.one_weld(profile, force_map, history), picture)
    if maps:
        terminal.show_maps(maps)
    if unusable:
        raise typer.Exit(2)
