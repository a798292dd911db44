"""Run `weld-force assess`: measurement files to verdicts, without ROS."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.json_output import output_file
from weld_force_ros.cli.options import (
    Json,
    Limits,
    MeasurementOptions,
    SimulationOptions,
    UncertaintyOptions,
    in_existing_folder,
    prints_results,
    with_option_groups,
)
from weld_force_ros.cli.site import with_site
from weld_force_ros.errors import InputError, WeldForceError

if TYPE_CHECKING:
    from weld_force_ros.recording.weld_records import Record, RejectedRecord


FailOn = Annotated[
    str | None,
    typer.Option(metavar="grind|reject", help="Exit code 1 only for these decisions; default: for all but accept."),
]
_FAILING = {None: ("undecided", "grind", "reject"), "grind": ("grind", "reject"), "reject": ("reject",)}


@prints_results
@with_site
@with_option_groups()
def assess(
    profiles: Annotated[list[str], typer.Argument(help="Files or folders of files, or names of bundled profiles.")],
    simulation: SimulationOptions,
    uncertainty: UncertaintyOptions,
    measurement: MeasurementOptions,
    limits: Limits = None,
    report: Annotated[
        Path | None, typer.Option(callback=in_existing_folder, help="Also write the report page (HTML).")
    ] = None,
    fail_on: FailOn = None,
    json: Json = None,
) -> None:
    """Judge measured welds: what to do with each, and why; exit code 1 if a weld is not accepted.

    Of several vehicles, --vehicle passenger --vehicle freight-22.5t, the one that decides is named.
    """
    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.messages import Rejection
    from weld_force_ros.recording.weld_records import RejectedRecord, WeldRecord

    if fail_on not in _FAILING:
        raise InputError(f"--fail-on {fail_on!r} is no decision", "use grind or reject")
    judged = _judge(simulation, uncertainty, measurement, limits)
    records: list[Record] = []
    with json_output.lines(json) as out, terminal.progress() as bar:
        for file in bar.track(_files(profiles), description="assessing"):
            for record in judged(file):
                json_output.write(out, record.rejection if isinstance(record, RejectedRecord) else record.verdict)
                records.append(record)
    verdicts = [record.verdict for record in records if isinstance(record, WeldRecord)]
    rejections: list[Rejection] = [record.rejection for record in records if isinstance(record, RejectedRecord)]
    verdict_tables.show_verdicts(verdicts, rejections)
    if report is not None:
        from weld_force_ros.report.html_page import page_of_records

        with output_file(report) as page:
            page.write(page_of_records(records, about="assessed files"))
        terminal.say(f"written: {report}")
    if rejections:
        raise typer.Exit(2)
    if any(verdict.decision in _FAILING[fail_on] for verdict in verdicts):
        raise typer.Exit(1)


def _judge(
    simulation: SimulationOptions, uncertainty: UncertaintyOptions, measurement: MeasurementOptions, limits: str | None
) -> Callable[[str], Iterator["Record"]]:
    """Return a function that reads a file and yields the outcome of each of its welds."""
    from weld_force_ros.assessment.assessor import Assessor
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import find, read_profiles
    from weld_force_ros.recording.weld_records import WeldRecord

    chosen = dataclasses.replace(uncertainty, uncertainty_samples=uncertainty.samples_or_default)
    unknown, applied, form = chosen.uncertainty_of_settings(), load_limits(limits), measurement.form()
    assessor = Assessor(simulation.settings_of_vehicles(unknown), applied, on_fit=terminal.note)

    def outcomes(file: str) -> Iterator["Record"]:
        try:
            welds = read_profiles(find(file), form)
        except InputError as error:
            yield _rejected(file, error)
            return
        for weld in welds:
            try:
                found = assessor.assess(weld)
            except WeldForceError as error:
                yield _rejected(file, error)
                continue
            own = assessor.settings_of(found)
            yield WeldRecord(found.verdict, found.force_map, weld, found.history, own, applied)

    return outcomes


def _files(names: Sequence[str]) -> list[str]:
    """Return files as they are named, and of folders those inside that are finished."""
    from weld_force_ros.measurement.profile_file import files_in

    found: list[str] = []
    for name in names:
        found += map(str, files_in(Path(name))) if Path(name).is_dir() else [name]
    return found


def _rejected(file: str, error: WeldForceError) -> "RejectedRecord":
    from weld_force_ros.messages import Rejection
    from weld_force_ros.recording.weld_records import RejectedRecord

    source = Path(file).name[-200:] or file[-200:]
    return RejectedRecord(Rejection(source=source, reason=error.reason, remedy=error.remedy))
