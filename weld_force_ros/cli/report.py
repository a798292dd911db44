"""`weld-force report`: a recording or force maps as one page that people read, and on paper."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli.json_output import output_file
from weld_force_ros.cli.options import Limits, in_existing_folder
from weld_force_ros.errors import InputError, WeldForceError

if TYPE_CHECKING:
    from weld_force_ros.messages import AssessmentSettings, GrindingAdvice, SimulationSettings, WeldProfile
    from weld_force_ros.recording.weld_records import Grind, Record, WeldRecord

Of = Annotated[Path, typer.Argument(metavar="BAG|MAP", help="A bag, or force maps of `simulate --json FILE`.")]
Out = Annotated[Path, typer.Option("--out", "-o", callback=in_existing_folder, help="The page (HTML).")]
Pdf = Annotated[
    Path | None, typer.Option(callback=in_existing_folder, help="Also print it, by a Chromium that is installed.")
]
Words = Annotated[Path | None, typer.Option(metavar="FILE.json", help="The words in another language: docs/report.md.")]
Grinding = Annotated[bool, typer.Option("--grinding", help="Search for the minimum grinding of what is not accepted.")]


def report(
    of: Of, out: Out, pdf: Pdf = None, limits: Limits = None, grinding: Grinding = False, words: Words = None
) -> None:
    """Write one self-contained page of welds: what to do with each and why; usable offline, on a phone and on paper."""
    from weld_force_ros._words import english, read_words
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal
    from weld_force_ros.report.html_page import page, paper, report_of
    from weld_force_ros.report.pdf import print_pdf

    if pdf is not None:
        _refuse_without_browser(pdf)
    catalogue = read_words(words) if words else english()
    entries = _entries(of, load_limits(limits) if limits else None)
    with terminal.progress() as bar:
        if grinding:
            task = bar.add_task("searching for the minimum grinding", total=len(entries))
            entries = _with_grinding(entries, lambda: bar.advance(task))
        shown = bar.track(entries, description="writing the page")
        made = report_of(shown, about=f"from {of.absolute().name}", words=catalogue)
    html = page(made)
    with output_file(out) as file:
        file.write(html)
    terminal.say(f"written: {out}, {terminal.counted(len(entries), 'weld')}, {len(html.encode()) / 1e6:.1f} MB")
    if pdf is not None:
        with terminal.notes.status("printing"):
            print_pdf(paper(made), pdf)
        terminal.say(f"written: {pdf}")


def _entries(of: Path, limits: "AssessmentSettings | None") -> "list[Record]":
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording import is_recording_file, weld_records
    from weld_force_ros.recording.recording import open_recording

    if of.is_file() and not is_recording_file(of):
        return weld_records.records_of_maps(weld_records.read_maps(of), limits or load_limits())
    recording = open_recording(of)
    if recording.damage:
        terminal.note(f"{of}: {recording.damage}; reporting what is there")
    for unreadable in recording.unreadable:
        terminal.note(f"{of}: left out: {unreadable}")
    entries = weld_records.records_of_recording(recording, limits, load_limits())
    if not entries:
        raise InputError(f"{of} holds no verdict, force map or rejection", "record with `weld-force up` or `demo`")
    return entries


def _with_grinding(entries: "list[Record]", on_done: Callable[[], None]) -> "list[Record]":
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording import weld_records

    def failed(weld: "WeldRecord", error: WeldForceError) -> None:
        terminal.note(f"no advice on grinding {weld.verdict.weld_id}: {error}")

    return list(weld_records.with_grinding(entries, _grind(), on_done=on_done, on_failed=failed))


def _grind() -> "Grind":
    """Return a function that advises on grinding, or knows the advice; one adviser for the same settings and limits."""
    from weld_force_ros.assessment.grinding import Adviser
    from weld_force_ros.assessment.kept_advice import advice_of
    from weld_force_ros.cli import terminal

    advisers: dict[tuple[str, str], Adviser] = {}

    def grind(profile: "WeldProfile", settings: "SimulationSettings", limits: "AssessmentSettings") -> "GrindingAdvice":
        def search(profile: "WeldProfile") -> "GrindingAdvice":
            key = (settings.config_sha256, limits.limits_sha256)
            if key not in advisers:
                advisers[key] = Adviser(settings, limits, on_fit=terminal.note)
            return advisers[key].advise(profile)

        return advice_of(profile, settings, limits, search)

    return grind


def _refuse_without_browser(pdf: Path) -> None:
    """Raise an InputError without a browser, before anything is computed."""
    from weld_force_ros.report.pdf import BROWSER_VARIABLE, find_browser

    if find_browser() is None:
        raise InputError(f"no Chromium was found to print {pdf}", f"install one, or name it in {BROWSER_VARIABLE}")
