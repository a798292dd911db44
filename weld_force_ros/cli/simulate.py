"""Run `weld-force simulate`: forces over measured welds at every speed and position."""

from functools import partial
from typing import TYPE_CHECKING

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import (
    Json,
    MeasurementOptions,
    Plot,
    Profiles,
    SimulationOptions,
    UncertaintyOptions,
    prints_results,
    with_option_groups,
)
from weld_force_ros.cli.site import with_site
from weld_force_ros.cli.standard_error import report_problem
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.messages import ForceMap


@prints_results
@with_site
@with_option_groups()
def simulate(
    profiles: Profiles,
    simulation: SimulationOptions,
    uncertainty: UncertaintyOptions,
    measurement: MeasurementOptions,
    json: Json = None,
    plot: Plot = None,
) -> None:
    """Compute the peak force of measured welds at every speed and position."""
    from weld_force_ros.assessment.judge import deciding_history
    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.measurement.profile_file import find, read_profiles
    from weld_force_ros.simulation.simulator import Simulator

    settings = simulation.settings(uncertainty.uncertainty_of_settings())
    simulator, form = Simulator(settings, on_fit=terminal.note), measurement.form()
    maps: list[ForceMap] = []
    unreadable = 0
    with json_output.lines(json) as out, terminal.progress() as bar:
        for name in profiles:
            try:
                welds = read_profiles(find(name), form)
            except InputError as error:
                if len(profiles) == 1:
                    raise
                report_problem(error)
                unreadable += 1
                continue
            for weld in welds:
                task = bar.add_task(weld.weld_id, total=len(settings.speeds_kmh))
                force_map = simulator.force_map(weld, on_speed=partial(bar.advance, task))
                bar.remove_task(task)
                json_output.write(out, force_map)
                maps.append(force_map)
                if plot:
                    from weld_force_ros.report import figures

                    alone = len(profiles) == len(welds) == 1
                    picture = plot if alone else plot.with_stem(f"{plot.stem}-{len(maps)}")
                    history = deciding_history(weld, simulator, force_map)
                    figures.save(figures.one_weld(weld, force_map, history), picture)
    if maps:
        verdict_tables.show_maps(maps)
    if unreadable:
        raise typer.Exit(2)
