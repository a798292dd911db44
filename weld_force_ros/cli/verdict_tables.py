"""Tables of force maps, verdicts and rule books, as several commands show them."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from weld_force_ros._words import sentence
from weld_force_ros.cli import result_stream
from weld_force_ros.cli.terminal import percent, say_wrapped, table
from weld_force_ros.messages import Answer, Decision, ForceMap, Rejection, Verdict, known

if TYPE_CHECKING:
    from weld_force_ros.recording.what_if import Changed

_COLOURS = {"accept": "green", "grind": "yellow", "reject": "red", "undecided": "blue"}
_ANSWERS = {"reject": "replace"}
"""What is to be done with a weld, where the answer's own word does not say it."""


RUNNING = "running: with the direction in which x rises, or against it"


def show_maps(maps: Iterable[ForceMap]) -> None:
    """Print one line a force map: its worst passage up to the line's speed, where that is stated."""
    from weld_force_ros.simulation.force_map_view import relevant_range

    rows = []
    for force_map in maps:
        relevant = relevant_range(force_map)
        speed, position = relevant.peak_index
        peak_n = float(relevant.passages.peak_force_n[speed, position])
        rows.append(
            (
                force_map.weld_id,
                f"{peak_n / 1e3:.1f}",
                _fit_error_kn(force_map, peak_n),
                f"{peak_n / force_map.static_load_n:.2f}",
                f"{relevant.speeds_kmh[speed]:g}",
                _line_kmh(force_map),
                f"{relevant.positions_m[position] * 100:.0f}",
                known(relevant.direction("peak_force_n", speed, position)) or "",
                f"{relevant.passages.contact_loss_s.max() * 1e3:.2f}",
                f"{len(force_map.peak_force_n) * len(relevant.by_direction)}",
            )
        )
    table(
        "Force maps: the worst passage of each",
        [
            ("weld", ""), ("peak kN", "right"), ("fit error ± kN", "right"), ("dyn. load factor", "right"),
            ("at km/h", "right"), ("line km/h", "right"), ("cm after sleeper", "right"), ("running", "whole"),
            ("contact loss ms", "right"), ("passages", "right"),
        ],
        rows,
    )  # fmt: skip
    if any(running for *_, running, _, _ in rows):
        say_wrapped(RUNNING)
    say_wrapped(
        "Forces, no verdict: `weld-force assess` judges welds by limits. The worst passage is up to the line's "
        "speed where that is stated (--line-speed), else of all speeds computed."
    )


def _line_kmh(force_map: ForceMap) -> str:
    return f"{force_map.line_speed_kmh:g}" if isinstance(force_map.line_speed_kmh, float) else "not stated"


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


def show_answers(title: str, of: Iterable[Verdict | Rejection], *, reasons: bool = True) -> None:
    """Print one line a weld with the answers for geometry and force; below, why each is not accepted and what to do.

    In CSV the reasons are a column.

    Args:
        title: above the table.
        of: the welds, in the order in which they are shown.
        reasons: whether they are told.
    """
    columns = [
        ("decision", "whole"), ("weld", ""), ("geometry", "whole"), ("force", "whole"), ("peak kN", "right"),
        ("prob. of exceeding", "right"),
    ]  # fmt: skip
    told = [(_answer_row(one), _reasons(one) if reasons else []) for one in of]
    if result_stream.form() == "csv":
        table(title, [*columns, ("why", "")], [(*row, _unnamed(row, why)) for row, why in told])
        return
    table(title, columns, [row for row, _ in told])
    for _, why in told:
        for words in why:
            say_wrapped(words)


def _answer_row(one: Verdict | Rejection) -> tuple[str | Text, ...]:
    if isinstance(one, Rejection):
        return unreadable(), one.source, "", "", "", ""
    answers = [found for found in (one.geometry, one.force) if isinstance(found, Answer)]
    exceeding = [found.exceeding for found in answers if isinstance(found.exceeding, float)]
    return (
        decision(one.decision),
        one.weld_id,
        *([_answer(found) for found in answers] or [Text(), Text()]),
        f"{one.peak_force_n / 1e3:.0f}",
        percent(max(exceeding)) if exceeding else "",
    )


def _unnamed(row: tuple[str | Text, ...], reasons: list[str]) -> str:
    """Return the reasons of a row without its weld's name before each."""
    return " ".join(words.removeprefix(f"{row[1]}: ") for words in reasons)


def _reasons(one: Verdict | Rejection) -> list[str]:
    if isinstance(one, Rejection):
        return [f"{one.source}: unreadable. {sentence(one.reason)} {sentence(one.remedy)}"]
    reasons = [] if one.decision == "accept" else [reason(one)]
    if one.hanging:
        from weld_force_ros.assessment.hanging import hanging_in_words

        reasons.append(f"{one.weld_id}: {' '.join(map(sentence, hanging_in_words(one)))}")
    return reasons


def reason(verdict: Verdict) -> str:
    """Return why a weld is not accepted, and what to measure next, in a line."""
    from weld_force_ros.assessment.criteria import sentence_in_words

    parts = [
        f"{name.capitalize()} {answer_word(found)}: {sentence_in_words(found.reason, verdict.criteria)}."
        for name, found in (("geometry", verdict.geometry), ("force", verdict.force))
        if isinstance(found, Answer) and found.decision != "accept"
    ]
    if isinstance(verdict.measure_next, str) and not any(verdict.measure_next in part for part in parts):
        parts.append(sentence(sentence_in_words(verdict.measure_next, verdict.criteria)))
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
        lines.append(sentence(sentence_in_words(verdict.measure_next, verdict.criteria)))
    if isinstance(verdict.accepted_risk, float):
        lines.append(f"Decided at an accepted risk of {verdict.accepted_risk:.0%}.".replace("%", " %"))
    return lines


def answer_word(answer: Answer) -> str:
    """Return an answer as tables and sentences show it."""
    return _ANSWERS.get(answer.decision, answer.decision)


def _answer(answer: Answer) -> Text:
    return Text(answer_word(answer), style=_COLOURS.get(answer.decision, ""))


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
            ("changed", ""), ("weld", ""), ("decision", ""), ("peak kN", "whole right"), ("peak %", "right"),
            ("at km/h", "whole right"), ("cm after sleeper", "whole right"),
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
