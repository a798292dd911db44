"""Tables and progress for people, always on standard error: standard output is for machines."""

import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table as Grid
from rich.text import Text

from weld_force_ros.messages import Decision, ForceMap, Limit, Rejection, Verdict
from weld_force_ros.studies.result_table import Table

if TYPE_CHECKING:
    from weld_force_ros.recording.what_if import Changed

# Piped into a file, tables keep a width that people can read.
console = Console(stderr=True, highlight=False, width=None if sys.stderr.isatty() else 120)

_COLOURS = {"accept": "green", "grind": "yellow", "reject": "red", "undecided": "blue"}


def plain(text: str) -> str:
    """Return text without control characters and changes of direction, which a terminal would obey."""
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)


def say(text: str) -> None:
    """Print one plain line; nothing in it is taken for markup."""
    console.print(Text(plain(text)), soft_wrap=True)


def progress() -> Progress:
    """Return a progress bar that leaves nothing behind, and shows nothing without a terminal."""
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def table(title: str, columns: Iterable[tuple[str, str]], rows: Iterable[Iterable[str | Text]]) -> None:
    """Print a table; each column is its heading and its alignment."""
    console.print(Text(plain(title), style="bold"))
    grid = Grid()
    for heading, alignment in columns:
        grid.add_column(heading, justify="right" if alignment == "right" else "left", overflow="fold")
    for row in rows:
        grid.add_row(*(cell if isinstance(cell, Text) else Text(plain(cell)) for cell in row))
    console.print(grid)


def show_table(found: Table) -> None:
    """Print a study's table, numbers to the right."""
    shown = [(i, column) for i, column in enumerate(found.columns) if column.heading]
    texts = [any(isinstance(row[i], str) for row in found.rows) for i, _ in shown]
    table(
        found.title,
        [(column.heading, "" if text else "right") for (_, column), text in zip(shown, texts, strict=True)],
        [[column.shown(row[i]) for i, column in shown] for row in found.rows],
    )


def show_maps(maps: Iterable[ForceMap]) -> None:
    """Print one line a force map: its worst passage."""
    from weld_force_ros.simulation.force_map_view import whole_map
    from weld_force_ros.simulation.running import in_words

    rows = []
    for force_map in maps:
        relevant = whole_map(force_map)
        speed, position = relevant.peak_index
        peak_n = float(relevant.passages.peak_force_n[speed, position])
        rows.append(
            (
                force_map.weld_id,
                f"{peak_n / 1e3:.1f}",
                _model_error_kn(force_map, peak_n),
                f"{peak_n / force_map.static_load_n:.2f}",
                f"{force_map.speeds_kmh[speed]:g}",
                f"{force_map.positions_m[position] * 100:.0f}",
                in_words(relevant.direction("peak_force_n", speed, position)).removeprefix("running "),
                f"{relevant.passages.contact_loss_s.max() * 1e3:.2f}",
                f"{len(force_map.peak_force_n) * len(relevant.by_direction)}",
                f"{force_map.elapsed_s:.2f}",
            )
        )
    table(
        "Force maps: the worst passage of each",
        [
            ("weld", ""), ("peak kN", "right"), ("model ± kN", "right"), ("dyn. load factor", "right"),
            ("at km/h", "right"), ("cm after sleeper", "right"), ("running", ""), ("contact loss ms", "right"),
            ("passages", "right"),
            ("s", "right"),
        ],
        rows,
    )  # fmt: skip


def _model_error_kn(force_map: ForceMap, peak_n: float) -> str:
    if not isinstance(force_map.model_error, float):
        return "?"
    return f"{force_map.model_error * (peak_n - force_map.static_load_n) / 1e3:.1f}"


def show_verdicts(verdicts: Iterable[Verdict], rejections: Iterable[Rejection] = ()) -> None:
    """Print one line a weld: the decision first, then why."""
    from weld_force_ros.simulation.running import in_words

    rows: list[tuple[str | Text, ...]] = []
    for verdict in verdicts:
        failed = ", ".join(c.name for c in verdict.criteria if not c.passed and c.decides)
        rows.append(
            (
                decision(verdict.decision),
                verdict.weld_id,
                f"{verdict.peak_force_n / 1e3:.0f}",
                f"{verdict.peak_force_n / verdict.static_load_n:.2f}",
                f"{verdict.worst_speed_kmh:g}",
                f"{verdict.worst_position_m * 100:.0f}",
                in_words(verdict.worst_running).removeprefix("running "),
                failed or "-",
            )
        )
    for rejection in rejections:
        cells = (unreadable(), rejection.source, "", "", "", "", "")
        rows.append((*cells, f"{rejection.reason}: {rejection.remedy}"))
    table(
        "Verdicts",
        [
            ("decision", ""), ("weld", ""), ("peak kN", "right"), ("dyn. load factor", "right"), ("at km/h", "right"),
            ("cm after sleeper", "right"), ("running", ""), ("over the limit", ""),
        ],
        rows,
    )  # fmt: skip


def show_changed(title: str, changed: Iterable["Changed"]) -> None:
    """Print one line a verdict, recorded and under other settings; those whose decision changes first.

    Several verdicts on one weld are numbered as they were recorded.
    """
    rows = []
    for name, one in sorted(_numbered(list(changed)), key=lambda named: not named[1].decision_changed):
        was, now = one.recorded, one.computed
        rows.append(
            (
                Text("CHANGED" if one.decision_changed else "", style="bold"),
                name,
                _decisions(was, now) if one.decision_changed else decision(now.decision),
                f"{was.peak_force_n / 1e3:.0f} → {now.peak_force_n / 1e3:.0f}",
                f"{one.peak_force_change_percent:+.1f}",
                f"{was.worst_speed_kmh:g} → {now.worst_speed_kmh:g}",
                f"{was.worst_position_m * 100:.0f} → {now.worst_position_m * 100:.0f}",
            )
        )
    table(
        title,
        [
            ("", ""), ("weld", ""), ("decision", ""), ("peak kN", "right"), ("%", "right"), ("at km/h", "right"),
            ("cm after sleeper", "right"),
        ],
        rows,
    )  # fmt: skip


def _numbered(changed: list["Changed"]) -> Iterator[tuple[str, "Changed"]]:
    verdicts_on = Counter(one.weld_id for one in changed)
    so_far: Counter[str] = Counter()
    for one in changed:
        so_far[one.weld_id] += 1
        yield one.weld_id + (f" ({so_far[one.weld_id]})" if verdicts_on[one.weld_id] > 1 else ""), one


def decision(of: Decision) -> Text:
    """Return a decision as tables show it."""
    return Text(of.upper(), style=f"bold {_COLOURS[of]}")


def unreadable() -> Text:
    """Return what tables show for an input that could not be read."""
    return Text("UNREADABLE", style="bold magenta")


def _decisions(was: Verdict, now: Verdict) -> Text:
    return Text.assemble(decision(was.decision), " → ", decision(now.decision))


def show_limits(limits: Iterable[Limit]) -> None:
    """Print the limits applied, and which of them are not verified."""
    table(
        "Limits applied",
        [("criterion", ""), ("grind above", "right"), ("reject above", "right"), ("unit", ""), ("source", "")],
        [
            (limit.name, f"{limit.limit:g}", f"{limit.reject_limit:g}", limit.unit,
             limit.source if limit.verified else Text(f"UNVERIFIED: {limit.source}", style="yellow"))
            for limit in limits
        ],
    )  # fmt: skip
