"""Tables and progress for people, always on standard error: standard output is for machines."""

import sys
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table as Grid
from rich.text import Text

from weld_force_ros.messages import Answer, AssessmentSettings, Decision, ForceMap, Rejection, Verdict
from weld_force_ros.studies.result_table import Table

if TYPE_CHECKING:
    from weld_force_ros.recording.what_if import Changed

# Piped into a file, tables keep a width that people can read.
console = Console(stderr=True, highlight=False, width=None if sys.stderr.isatty() else 120)

_COLOURS = {"accept": "green", "grind": "yellow", "reject": "red", "undecided": "blue"}
_ANSWERS = {"reject": "replace"}
"""What is to be done with a weld, where the answer's own word does not say it."""
_WIDTH = 80
_NAME_WIDTH = 15


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
    """Print a table; each column is its heading and its alignment.

    Args:
        title: above it.
        columns: heading and `right`, `whole` if cells are not to be wrapped, both or nothing.
        rows: a cell for each column.
    """
    console.print(Text(plain(title), style="bold"))
    grid = Grid()
    for heading, alignment in columns:
        grid.add_column(
            heading,
            justify="right" if "right" in alignment else "left",
            overflow="fold",
            no_wrap="whole" in alignment or "\n" in heading,
        )
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
    from weld_force_ros.simulation.running import direction_in_words

    rows = []
    for force_map in maps:
        relevant = whole_map(force_map)
        speed, position = relevant.peak_index
        peak_n = float(relevant.passages.peak_force_n[speed, position])
        rows.append(
            (
                force_map.weld_id,
                f"{peak_n / 1e3:.1f}",
                _fit_error_kn(force_map, peak_n),
                f"{peak_n / force_map.static_load_n:.2f}",
                f"{force_map.speeds_kmh[speed]:g}",
                f"{force_map.positions_m[position] * 100:.0f}",
                direction_in_words(relevant.direction("peak_force_n", speed, position)),
                f"{relevant.passages.contact_loss_s.max() * 1e3:.2f}",
                f"{len(force_map.peak_force_n) * len(relevant.by_direction)}",
                f"{force_map.elapsed_s:.2f}",
            )
        )
    table(
        "Force maps: the worst passage of each",
        [
            ("weld", ""), ("peak kN", "right"), ("fit error ± kN", "right"), ("dyn. load factor", "right"),
            ("at km/h", "right"), ("cm after sleeper", "right"), ("running", ""), ("contact loss ms", "right"),
            ("passages", "right"),
            ("s", "right"),
        ],
        rows,
    )  # fmt: skip


def _fit_error_kn(force_map: ForceMap, peak_n: float) -> str:
    if not isinstance(force_map.model_error, float):
        return "?"
    return f"{force_map.model_error * (peak_n - force_map.static_load_n) / 1e3:.1f}"


def show_verdicts(verdicts: Sequence[Verdict], rejections: Sequence[Rejection] = ()) -> None:
    """Print one line a weld: the decision first, then why; of verdicts with two answers, these, and reasons below."""
    if any(has_answers(verdict) for verdict in verdicts):
        show_answers("Verdicts", [*verdicts, *rejections])
        return
    from weld_force_ros.simulation.running import direction_in_words

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
                direction_in_words(verdict.worst_running),
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


def has_answers(verdict: Verdict) -> bool:
    """Return whether a verdict answers for geometry and force apart; those of earlier versions do not."""
    return isinstance(verdict.geometry, Answer) and isinstance(verdict.force, Answer)


def show_answers(title: str, of: Iterable[Verdict | Rejection]) -> None:
    """Print one line a weld with the answers for geometry and force; below, why each is not accepted and what to do."""
    rows: list[tuple[str | Text, ...]] = []
    reasons = []
    for one in of:
        if isinstance(one, Rejection):
            rows.append((unreadable(), _broken(one.source), "", "", "", ""))
            reasons.append(f"{one.source}: unreadable. {sentence(one.reason)} {sentence(one.remedy)}")
            continue
        answers = [found for found in (one.geometry, one.force) if isinstance(found, Answer)]
        exceeding = [found.exceeding for found in answers if isinstance(found.exceeding, float)]
        rows.append(
            (
                decision(one.decision),
                _broken(one.weld_id),
                *([_answer(found) for found in answers] or [Text(), Text()]),
                f"{one.peak_force_n / 1e3:.0f}",
                percent(max(exceeding)) if exceeding else "",
            )
        )
        reasons += [] if one.decision == "accept" else [reason(one)]
        if one.hanging:
            from weld_force_ros.assessment.hanging import hanging_in_words

            reasons.append(f"{one.weld_id}: {' '.join(map(sentence, hanging_in_words(one)))}")
    table(
        title,
        [
            ("decision", "whole"), ("weld", ""), ("geometry", "whole"), ("force", "whole"), ("peak\nkN", "right"),
            ("prob. of\nexceeding", "right"),
        ],
        rows,
    )  # fmt: skip
    for words in reasons:
        say_wrapped(words)


def reason(verdict: Verdict) -> str:
    """Return why a weld is not accepted, and what to measure next, in a line."""
    from weld_force_ros.assessment.criteria import sentence_in_words

    parts = [
        f"{name.capitalize()} {answer_word(found)}: {sentence_in_words(found.reason, verdict.criteria)}."
        for name, found in (("geometry", verdict.geometry), ("force", verdict.force))
        if isinstance(found, Answer) and found.decision != "accept"
    ]
    if isinstance(verdict.measure_next, str):
        parts.append(f"Next: {sentence_in_words(verdict.measure_next, verdict.criteria)}.")
    under = f" under {verdict.vehicle}" if isinstance(verdict.vehicle, str) else ""
    return (
        f"{verdict.weld_id}{under}: {' '.join(parts) or sentence(sentence_in_words(verdict.reason, verdict.criteria))}"
    )


def answers_in_words(verdict: Verdict) -> list[str]:
    """Return both answers with what they rest on, what to measure, and the accepted risk; none of older verdicts."""
    from weld_force_ros.assessment.criteria import sentence_in_words

    if not has_answers(verdict):
        return []
    asked = (("Geometry, by standard", verdict.geometry), ("Force, by model", verdict.force))
    lines = [sentence(verdict.reason.partition("; ")[0])]
    lines += [
        f"{question} ({', '.join(found.rule_books) or 'no rule book'}): {answer_word(found)}. "
        f"{sentence(sentence_in_words(found.reason, verdict.criteria))}"
        for question, found in asked
        if isinstance(found, Answer)
    ]
    if isinstance(verdict.measure_next, str):
        lines.append(f"Next: {sentence_in_words(verdict.measure_next, verdict.criteria)}.")
    if isinstance(verdict.accepted_risk, float):
        lines.append(f"Decided at an accepted risk of {verdict.accepted_risk:.0%}.".replace("%", " %"))
    return lines


def answer_word(answer: Answer) -> str:
    """Return an answer as tables and sentences show it."""
    return _ANSWERS.get(answer.decision, answer.decision)


def _answer(answer: Answer) -> Text:
    return Text(answer_word(answer), style=_COLOURS.get(answer.decision, ""))


def percent(share: float) -> str:
    """Return a share in per cent; what is neither none nor all is not shown as such."""
    if 0 < share < 0.01:
        return "<1 %"
    return ">99 %" if 0.99 < share < 1 else f"{100 * share:.0f} %"


def sentence(clause: str) -> str:
    """Return a clause with a capital letter and a full stop; nothing of nothing."""
    return clause and clause[0].upper() + clause[1:] + ("" if clause.endswith((".", "!", "?")) else ".")


def say_wrapped(text: str) -> None:
    """Print a line, broken between words at the width of the terminal."""
    say(textwrap.fill(plain(text), min(console.width, _WIDTH), subsequent_indent="  ", break_on_hyphens=False))


def _broken(name: str) -> str:
    """Return a name in lines that break after hyphens, so that no word of it breaks in a narrow column."""
    return textwrap.fill(plain(name), max(_NAME_WIDTH, console.width - 65), break_long_words=False)


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


def show_rule_books(settings: AssessmentSettings) -> None:
    """Print the rule books applied, each with the number of its limits that stand in a text that was read."""
    from weld_force_ros.assessment.rule_books import limits_by_book, verified_of

    own = [limit for limit in settings.limits if not isinstance(limit.rule_book, str)]
    books = [(book.name, book.title, limits) for book, limits in limits_by_book(settings)]
    table(
        "Judged by",
        [("rule book", "whole"), ("what", ""), ("numbers\nverified", "right")],
        [
            (name, what, verified_of(limits))
            for name, what, limits in [*books, *([("", "limits of no rule book", own)] if own else [])]
        ],
    )
