"""`weld-force bag`: look into, repair and export recordings."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import BagPath, Json, in_existing_folder, prints_results
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.recording import FileSummary, OutcomeCounts, RecoveryReport

app = typer.Typer(help="Look into, repair and export recordings.", rich_markup_mode=None)

Recovered = Annotated[
    Path | None,
    typer.Argument(callback=in_existing_folder, help="Folder of the recovered bag (default: BAG-recovered)."),
]
Exported = Annotated[
    Path,
    typer.Argument(
        callback=in_existing_folder, help="New .mcap file for Foxglove or Lichtblick, or new folder for tables."
    ),
]
Formats = Annotated[list[str] | None, typer.Option("--format", help="Of tables: csv (default), parquet, or each.")]


@app.command("info")
@prints_results
def bag_info(bag: BagPath, json: Json = None) -> None:
    """Show what a recording holds, its state, and how its measurements ended."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording import count_outcomes, gap_in_words, open_bag

    opened = open_bag(bag)
    found, ended = opened.summary(), count_outcomes(opened)
    gaps = [gap._asdict() for gap in found.gaps]
    with json_output.lines(json) as out:
        json_output.write(out, {**asdict(found), "gaps": gaps, "outcomes": asdict(ended) if ended else None})
    messages = terminal.counted(found.message_count, "message")
    terminal.table(
        f"{found.path}: {messages}, {found.duration_s:.1f} s, {found.size_bytes / 1e3:.0f} kB",
        [("topic", ""), ("type", ""), ("messages", "right")],
        [(t.topic, t.type_name, str(t.message_count)) for t in found.topics],
    )
    terminal.table(
        "Files",
        [("file", ""), ("begins", "whole"), ("s", "right"), ("messages", "right"), ("kB", "right"), ("state", "")],
        map(_file_row, found.files),
    )
    for gap in found.gaps:
        terminal.say(gap_in_words(gap))
    if ended:
        terminal.say(_ended(ended))
    terminal.say(found.damage or "closed and indexed" if found.closed else f"not closed: {found.damage}")


def _file_row(file: "FileSummary") -> tuple[str, ...]:
    from weld_force_ros.recording import local_time

    return (
        file.name,
        local_time(file.start_ns) if file.message_count else "",
        f"{file.duration_s:.1f}",
        str(file.message_count),
        f"{file.size_bytes / 1e3:.0f}",
        file.damage or ("closed and indexed" if file.indexed else "closed"),
    )


def _ended(ended: "OutcomeCounts") -> str:
    from weld_force_ros.cli.terminal import counted

    return (
        f"{counted(ended.measurements, 'profile')}: {counted(ended.verdicts, 'verdict')}, "
        f"{counted(ended.rejections, 'rejection')}, "
        f"{ended.open} without either, {ended.doubled} with more than one"
    )


@app.command("recover")
def bag_recover(bag: BagPath, target: Recovered = None) -> None:
    """Write what is readable of a cut recording to a proper one. Exit codes: 0 clean, 1 failed, 3 lossy."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording import recover

    try:
        recovered = recover(bag, target)
    except InputError as error:
        _report_problem(error)
        raise typer.Exit(1) from None
    if recovered.damage:
        terminal.note(f"{bag}: {recovered.damage}")
    where = "already in" if recovered.already else "recovered to"
    messages = terminal.counted(recovered.message_count, "message")
    terminal.say(f"{messages} {where} {recovered.target}; {_lost(recovered)}")
    for clause in recovered.rewritten:
        terminal.say(f"not kept as it was: {clause}")
    if recovered.lossy or recovered.unread_by_others:
        raise typer.Exit(3)


def _lost(recovered: "RecoveryReport") -> str:
    if not recovered.lossy:
        return recovered.unread_by_others or "nothing lost"
    unsaid = "" if recovered.lost_messages else " (how many messages, the file cannot tell)"
    return f"lost: {recovered.lost_messages or 'some'} messages, {recovered.lost_bytes} bytes unreadable{unsaid}"


@app.command("export")
def bag_export(bag: BagPath, target: Exported, formats: Formats = None) -> None:
    """Write the suite's messages as JSON channels with their schemas, or as tables of CSV or Parquet."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording import export_json, export_tables

    if target.suffix == ".mcap":
        if formats:
            raise InputError(f"--format {formats[0]} is of tables, {target} is none", "name a folder, or omit --format")
        exported = export_json(bag, target, on_invalid=_report_problem)
    else:
        exported = export_tables(bag, target, formats or ["csv"], on_invalid=_report_problem)
    terminal.say(f"{terminal.counted(exported.message_count, 'message')} exported to {target}")
    if exported.layouts:
        names = " or ".join(str(path) for path in exported.layouts)
        terminal.say(f"layout: {names}  (Foxglove, Lichtblick: open the export, then import this layout)")


def _report_problem(error: InputError) -> None:
    from weld_force_ros.cli import terminal

    terminal.note("weld-force: " + " ".join(str(error).split()))
