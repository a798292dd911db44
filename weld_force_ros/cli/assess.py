"""Run `weld-force assess`: measurement files to verdicts, without ROS."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.json_output import output_file
from weld_force_ros.cli.options import (
    Json,
    Limits,
    MeasurementOptions,
    Profiles,
    SimulationOptions,
    UncertaintyOptions,
    with_option_groups,
)
from weld_force_ros.errors import InputError, WeldForceError

if TYPE_CHECKING:
    from weld_force_ros.messages import Rejection
    from weld_force_ros.recording.weld_records import Record


@with_option_groups()
def assess(
    profiles: Profiles,
    simulation: SimulationOptions,
    uncertainty: UncertaintyOptions,
    measurement: MeasurementOptions,
    limits: Limits = None,
    report: Annotated[Path | None, typer.Option(help="Also write the report page (HTML).")] = None,
    json: Json = None,
) -> None:
    """Judge measured welds: what to do with each, and why; exit code 1 if a weld is not accepted.

    Of several vehicles, --vehicle passenger,freight-22.5t, the one that decides is named.
    """
    from weld_force_ros.assessment import judge
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import find, read_profiles
    from weld_force_ros.recording.weld_records import RejectedRecord, WeldRecord
    from weld_force_ros.simulation.simulator import Simulator

    chosen = dataclasses.replace(uncertainty, uncertainty_samples=uncertainty.samples_or_default)
    unknown, applied, form = chosen.uncertainty_of_settings(), load_limits(limits), measurement.form()
    vehicles = [None] if simulation.vehicle is None else simulation.vehicle.split(",")
    settings = [dataclasses.replace(simulation, vehicle=vehicle).settings(unknown) for vehicle in vehicles]
    simulators = [Simulator(one, on_fit=terminal.say) for one in settings]
    settings_by_sha256 = {one.config_sha256: one for one in settings}
    records: list[Record] = []
    with json_output.lines(json) as out, terminal.progress() as bar:
        for name in bar.track(profiles, description="assessing"):
            try:
                welds = read_profiles(find(name), form)
            except InputError as error:
                rejection = _rejection(name, error)
                json_output.write(out, rejection)
                records.append(RejectedRecord(rejection))
                continue
            for weld in welds:
                try:
                    assessed = judge.assess_vehicles(weld, simulators, applied)
                except WeldForceError as error:
                    rejection = _rejection(name, error)
                    json_output.write(out, rejection)
                    records.append(RejectedRecord(rejection))
                    continue
                json_output.write(out, assessed.verdict)
                own = settings_by_sha256[assessed.verdict.config_sha256]
                records.append(WeldRecord(assessed.verdict, assessed.force_map, weld, assessed.history, own, applied))
    verdicts = [record.verdict for record in records if isinstance(record, WeldRecord)]
    rejections = [record.rejection for record in records if isinstance(record, RejectedRecord)]
    terminal.show_verdicts(verdicts, rejections)
    if report is not None:
        from weld_force_ros.report.html_page import page_of_records

        with output_file(report) as file:
            file.write(page_of_records(records, about="assessed files"))
        terminal.say(f"written: {report}")
    if rejections:
        raise typer.Exit(2)
    if any(verdict.decision != "accept" for verdict in verdicts):
        raise typer.Exit(1)


def _rejection(name: str, error: WeldForceError) -> "Rejection":
    from weld_force_ros.messages import Rejection

    reason, remedy = (error.reason, error.remedy) if isinstance(error, InputError) else (str(error), "")
    return Rejection(source=Path(name).name[-200:] or name[-200:], reason=reason, remedy=remedy)
