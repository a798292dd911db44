"""`weld-force campaign`: the welds of a whole network assessed on Dask, shown and asked."""

import math
import os
import time
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from msgspec.structs import replace

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, group_with_default, in_existing_folder, prints_results
from weld_force_ros.cli.quantities import force_n, speed_kmh
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from rich.progress import Progress

    from weld_force_ros.campaign.batch_records import BatchRecord, Manifest
    from weld_force_ros.campaign.estimate import Estimate
    from weld_force_ros.campaign.plan import Plan
    from weld_force_ros.campaign.query import Answer


app = typer.Typer(
    cls=group_with_default("run"),
    help="The welds of a whole network on Dask: `campaign FILE.yaml` runs one, `campaign query` asks its results.",
    rich_markup_mode=None,
    no_args_is_help=True,
)

queries = typer.Typer(help="Ask the results of a campaign.", rich_markup_mode=None, no_args_is_help=True)
app.add_typer(queries, name="query")

_SHOWN = 30

File = Annotated[Path, typer.Argument(metavar="CAMPAIGN.yaml", help="What to assess, and how.")]
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", callback=in_existing_folder, help="Folder for the results (default: the file's own)."),
]
Results = Annotated[Path, typer.Argument(metavar="RESULTS", help="The folder that a campaign wrote.")]
Show = Annotated[int, typer.Option(min=0, help="Rows shown at most.")]
Workers = Annotated[
    int | None, typer.Option(min=1, max=10_000, help="Processes on this machine (default: one a core).")
]


@app.command()
@prints_results
def run(
    file: File,
    out: Out = None,
    plan: Annotated[bool, typer.Option("--plan", help="Say how long it takes and how large it gets, no more.")] = False,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler; else a cluster is made.")] = None,
    workers: Workers = None,
    page: Annotated[bool, typer.Option("--page/--no-page", help="Write the summary page.")] = True,
    json: Json = None,
) -> None:
    """Assess all welds of a campaign; interrupted, the same command continues where it stopped."""
    from weld_force_ros.cli import terminal

    campaign = _module("campaign_file").read(file)
    campaign = replace(campaign, out=(out or campaign.out).absolute())
    planned: Plan = _module("plan").make(campaign, _module("sources").find(campaign, terminal.note))
    count = workers or os.cpu_count() or 1
    with json_output.lines(json) as lines:
        if plan:
            json_output.write(lines, _plan_line(planned, _planned(planned, count)))
        else:
            json_output.write(lines, _result_line(_run(planned, campaign.out, scheduler, count), campaign.out))
            if page:
                summary(campaign.out)


@app.command()
def summary(results: Results) -> None:
    """Write the summary page of results again; it needs no network to be looked at."""
    from weld_force_ros.cli import terminal

    terminal.say(f"summary: {_module('summary').write(results)}")


@queries.command()
@prints_results
def over(
    results: Results,
    at: Annotated[
        float,
        typer.Option(
            parser=str,
            callback=speed_kmh,
            metavar="80",
            help="Speed in km/h; the nearest computed one that is not above it counts.",
        ),
    ],
    peak: Annotated[
        float | None,
        typer.Option(parser=str, callback=force_n, metavar="200kN", help="Peak force that counts as too much."),
    ] = None,
    show: Show = _SHOWN,
    json: Json = None,
) -> None:
    """List welds over a limit at a speed: of peak force, or the campaign's own for a line of that speed."""
    _tell(f"Over the limit at {at:g} km/h", _module("query").over(results, at, peak), show, json)


@queries.command()
@prints_results
def worse(
    results: Results,
    to: Annotated[
        float, typer.Option(parser=str, callback=speed_kmh, metavar="80", help="Speed of the restriction in km/h.")
    ],
    by: Annotated[float, typer.Option(help="Only those whose peak force rises by more than this share.")] = 0.0,
    show: Show = _SHOWN,
    json: Json = None,
) -> None:
    """List welds that a speed restriction would make worse."""
    _tell(f"Worse at {to:g} km/h", _module("query").worse_if_restricted(results, to, by), show, json)


@queries.command()
@prints_results
def changed(
    before: Results,
    after: Annotated[Path, typer.Argument(help="The folder of a later campaign of the same welds.")],
    by: Annotated[float, typer.Option(help="Also those whose peak force changed by more than this share.")] = math.inf,
    show: Show = _SHOWN,
    json: Json = None,
) -> None:
    """List welds that two campaigns decide differently, or that only one of them holds."""
    _tell("Changed", _module("query").changed(before, after, by), show, json)


@queries.command()
@prints_results
def sql(
    results: Results,
    text: Annotated[str, typer.Argument(help="SQL over verdicts, vehicles, speeds and rejections.")],
    show: Show = _SHOWN,
    json: Json = None,
) -> None:
    """Query anything else, in DuckDB's SQL."""
    _tell("Answer", _module("query").ask(results, text), show, json)


def _tell(title: str, answer: "Answer", at_most: int, json: str | None) -> None:
    from weld_force_ros.cli import terminal

    with json_output.lines(json) as lines:
        for record in answer.records:
            json_output.write(lines, record)
    shown = answer.as_text(at_most)
    terminal.table(title, [(name, "") for name in answer.columns], shown)
    of = terminal.counted(len(answer.rows), "row")
    if len(shown) < len(answer.rows):
        terminal.say(f"{len(shown):,} of {of}; all of them with --json FILE")
    else:
        terminal.say(of if shown else "none")


def _module(name: str) -> Any:
    """Import a module of the campaign.

    Raises:
        InputError: what it needs is not installed.
    """
    try:
        return import_module(f"weld_force_ros.campaign.{name}")
    except ImportError as error:
        raise InputError(
            f"a campaign needs {error.name}", "install it with `pip install 'weld_force_ros[campaign]'`"
        ) from None


def _planned(plan: "Plan", workers: int) -> "Estimate":
    """Time a few welds and estimate the time that all of them take."""
    from weld_force_ros.cli import terminal

    estimate = _module("estimate")
    with terminal.progress() as bar:
        task = bar.add_task("timing a few welds", total=min(estimate.TRIALS, plan.batches))
        expected: Estimate = estimate.estimate(plan, workers, on_trial=lambda: bar.advance(task))
    _show_plan(plan, expected)
    return expected


def _show_plan(plan: "Plan", expected: "Estimate") -> None:
    from weld_force_ros.campaign import estimate
    from weld_force_ros.cli import terminal
    from weld_force_ros.cli.terminal import counted

    low_s, about_s, high_s = expected.seconds
    sources, batches = counted(len(plan.sources), "source"), counted(plan.batches, "batch", "batches")
    workers = counted(expected.workers, "worker")
    terminal.table(
        f"Plan: {plan.name}",
        [("what", ""), ("value", "")],
        [
            (
                "welds",
                f"{plan.welds:,} in {sources}, {batches}",
            ),
            ("sections", ", ".join(f"{s.name} ({', '.join(s.vehicles)})" for s in plan.sections)),
            ("passages of a weld", f"{plan.passages:,} at most"),
            ("a weld under a vehicle", f"{expected.weld_s[0] * 1e3:.2f} ± {expected.weld_s[1] * 1e3:.2f} ms here"),
            (
                "time",
                f"{duration(about_s)} on {workers} ({duration(low_s)} to {duration(high_s)})",
            ),
            ("results", f"{expected.bytes / 1e6:,.1f} MB"),
        ],
    )
    terminal.say(
        f"by: {estimate.START_S:g} s to start + welds x vehicles x time of one / "
        f"(workers x {estimate.EFFICIENCY:g}), or {estimate.DRIVER_S * 1e3:g} ms a batch if that is more; "
        "timed in this process, on this machine"
    )


def _run(plan: "Plan", out: Path, scheduler: str | None, workers: int) -> "Manifest":
    from weld_force_ros.cli import terminal
    from weld_force_ros.cli.terminal import counted

    running = _module("dask_run")
    finished: list[BatchRecord] = running.prepare(plan, out)
    if finished:
        terminal.note(f"{len(finished):,} of {plan.batches:,} batches are finished already")
    began = time.perf_counter()
    if len(finished) < plan.batches:
        _planned(plan, workers)
        began = time.perf_counter()
        _assess(plan, out, finished, scheduler, workers)
    manifest: Manifest = running.complete(plan, out)
    terminal.say(
        f"{counted(manifest.welds, 'weld')}: {counted(manifest.verdicts, 'verdict')}, "
        f"{counted(manifest.rejections, 'rejection')} in {duration(time.perf_counter() - began)}; "
        f"results {manifest.results_sha256[:16]} in {out}"
    )
    return manifest


def _assess(plan: "Plan", out: Path, finished: "list[BatchRecord]", scheduler: str | None, workers: int) -> None:
    """Assess the batches that are not finished, with a progress bar."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.cli.terminal import counted

    running = _module("dask_run")
    terminal.note("starting workers" if scheduler is None else f"connecting to {scheduler}")
    with running.cluster(scheduler, workers) as client:
        terminal.note(f"dashboard: {client.dashboard_link}")
        progress = _Progress(sum(record.welds for record in finished), plan.welds)
        with progress.bar:
            failed = running.distribute(client, plan, out, {record.batch for record in finished}, progress.add)
    if failed:
        first = failed[0]
        terminal.note(f"{counted(len(failed), 'batch', 'batches')} pending; batch {first.batch}: {first.reason}")
        terminal.note("the same command tries them again; the others are finished")
        raise typer.Exit(1)


class _Progress:
    """The progress of a run: a bar with rate and time left on a terminal, elsewhere a line now and then."""

    _EVERY_S = 30.0

    def __init__(self, before: int, welds: int) -> None:
        self._before, self._welds, self._done = before, welds, before
        self._began = self._said = time.monotonic()
        self.bar = _bar()
        self._task = self.bar.add_task("", total=welds, completed=before, rate=0.0)

    def add(self, record: "BatchRecord") -> None:
        """Count a finished batch."""
        from weld_force_ros.cli import terminal

        self._done += record.welds
        now = time.monotonic()
        rate = (self._done - self._before) / (now - self._began)
        self.bar.update(self._task, completed=self._done, rate=rate)
        if self.bar.disable and now - self._said > self._EVERY_S:
            self._said = now
            left = duration((self._welds - self._done) / rate)
            terminal.note(f"{self._done:,} of {self._welds:,} welds, {rate:,.0f} welds/s, {left} left")


def _bar() -> "Progress":
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from weld_force_ros.cli import terminal

    return Progress(
        TextColumn("{task.completed:,.0f} of {task.total:,.0f} welds"),
        BarColumn(),
        TextColumn("{task.fields[rate]:,.0f} welds/s"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=terminal.notes,
        transient=True,
        disable=not terminal.notes.is_terminal,
    )


def duration(seconds: float) -> str:
    """Return a duration as `5 s`, `3 min 20 s` or `4 h 07 min`."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60:,} h {minutes % 60:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _plan_line(plan: "Plan", expected: "Estimate") -> dict[str, Any]:
    low_s, about_s, high_s = expected.seconds
    return {
        "plan_sha256": plan.sha256, "welds": plan.welds, "batches": plan.batches, "workers": expected.workers,
        "passages_per_weld": plan.passages, "weld_s": expected.weld_s[0], "seconds": about_s,
        "seconds_range": [low_s, high_s], "bytes": expected.bytes,
    }  # fmt: skip


def _result_line(manifest: "Manifest", out: Path) -> dict[str, Any]:
    names = ("plan_sha256", "batches", "welds", "verdicts", "rejections", "results_sha256")
    return {name: getattr(manifest, name) for name in names} | {"out": str(out)}
