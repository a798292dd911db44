"""`weld-force show`: the welds of a recording on a terminal, and one of them with its force-speed curve."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output, result_stream
from weld_force_ros.cli.options import BagPath, Json, prints_results
from weld_force_ros.cli.quantities import speed_kmh
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from rich.text import Text

    from weld_force_ros.messages import Criterion, Rejection, Verdict
    from weld_force_ros.recording.weld_records import Record, WeldRecord

_WORST_FIRST = ("reject", "grind", "undecided", "unusable", "accept")
_UNVERIFIED = "* UNVERIFIED: engineering judgement, or not checked against the source"
_WIDTH = 80
_MOST_NAMES = 10
_SHOWN_AS = {"N": (1e-3, "kN", ".0f"), "m": (1e3, "mm", ".3g"), "s": (1e3, "ms", ".3g"), "1": (1.0, "", ".3g")}


def restriction_kmh(option: typer.CallbackParam, given: str | None) -> float | None:
    """Return the speed of a restriction.

    Raises:
        InputError: not that of a train.
    """
    value = speed_kmh(option, given)
    if value is not None and not 1 <= value <= 1000:
        raise InputError(f"--restrict {given}: no speed of a train", "give 1 to 1000 km/h")
    return value


Named = Annotated[str | None, typer.Argument(metavar="[WELD]", help="Only this weld (default: all, then the worst).")]
Restrict = Annotated[
    float | None,
    typer.Option(
        metavar="KMH",
        parser=str,
        callback=restriction_kmh,
        help="Also say what running at most at so many km/h would do.",
    ),
]


@prints_results
def show(bag: BagPath, weld: Named = None, restrict: Restrict = None, json: Json = None) -> None:
    """Show the welds of a recording, the worst first; of one weld its force over speed, criteria and advice."""
    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.recording.weld_records import WeldRecord

    entries = sorted(_read(bag), key=_severity)
    welds = [entry for entry in entries if isinstance(entry, WeldRecord)]
    if weld is not None:
        welds = [_last_of(weld, welds, bag)]
    with json_output.lines(json) as out:
        for one in welds:
            json_output.write(out, one.verdict if restrict is None else _restricted_line(one, restrict))
    if weld is None and any(verdict_tables.has_answers(one.verdict) for one in welds):
        verdict_tables.show_answers(f"Welds of {bag}, the worst first", [_message(entry) for entry in entries])
        if restrict is not None:
            for one in welds:
                terminal.say_wrapped(
                    f"{one.verdict.weld_id} running at most at {restrict:g} km/h: {_restricted(one, restrict)}"
                )
    elif weld is None:
        last = "what to do" if restrict is None else f"at most {restrict:g} km/h"
        terminal.table(
            f"Welds of {bag}, the worst first",
            [("decision", ""), ("weld", ""), ("worst criterion", ""), ("up to km/h", "right"), (last, "")],
            _front_rows(entries, restrict),
        )
    if welds and (weld is not None or result_stream.form() != "csv"):
        _show_one(welds[0], restrict)


def _message(entry: "Record") -> "Verdict | Rejection":
    from weld_force_ros.recording.weld_records import WeldRecord

    return entry.verdict if isinstance(entry, WeldRecord) else entry.rejection


def _read(bag: Path) -> "list[Record]":
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal
    from weld_force_ros.recording.recording import open_recording
    from weld_force_ros.recording.weld_records import records_of_recording

    recording = open_recording(bag)
    if recording.damage:
        terminal.note(f"{bag}: {recording.damage}; showing what is there")
    for unreadable in recording.unreadable:
        terminal.note(f"{bag}: left out: {unreadable}")
    entries = records_of_recording(recording, None, load_limits())
    if not entries:
        raise InputError(f"{bag} holds no verdict, force map or rejection", "record with `weld-force up` or `demo`")
    return entries


def _last_of(name: str, welds: "Sequence[WeldRecord]", bag: Path) -> "WeldRecord":
    """Return the weld of a name, as it was judged last."""
    found = [one for one in welds if one.verdict.weld_id == name]
    if found:
        return max(found, key=lambda one: (one.verdict.stamp.sec, one.verdict.stamp.nanosec))
    names = list(dict.fromkeys(one.verdict.weld_id for one in welds))
    more = f" or {len(names) - _MOST_NAMES} others" if len(names) > _MOST_NAMES else ""
    raise InputError(f"{bag} holds no verdict on {name!r}", f"name {', '.join(names[:_MOST_NAMES])}{more}")


def _severity(entry: "Record") -> tuple[int, float]:
    from weld_force_ros.assessment.limits import ratio, worst
    from weld_force_ros.recording.weld_records import WeldRecord

    if not isinstance(entry, WeldRecord):
        return _WORST_FIRST.index("unusable"), 0.0
    return _WORST_FIRST.index(entry.verdict.decision), -ratio(worst(entry.verdict.criteria))


def _front_rows(entries: "Sequence[Record]", restrict: float | None) -> "Iterator[tuple[str | Text, ...]]":
    from weld_force_ros.assessment.limits import worst
    from weld_force_ros.cli import verdict_tables
    from weld_force_ros.recording.weld_records import WeldRecord
    from weld_force_ros.report.table_row import row

    for number, entry in enumerate(entries, start=1):
        about = row(number, entry)
        advice = str(about["advice"])
        if not isinstance(entry, WeldRecord):
            yield verdict_tables.unreadable(), str(about["weld"]), "", "", advice
            continue
        verdict, permitted = entry.verdict, about.get("permitted_kmh")
        yield (
            verdict_tables.decision(verdict.decision),
            verdict.weld_id,
            _compared_with_limit(worst(verdict.criteria)),
            "?" if permitted is None else f"{permitted:g}" if permitted else "none",
            advice if restrict is None else _restricted(entry, restrict),
        )


def _compared_with_limit(criterion: "Criterion") -> str:
    return (
        f"{criterion.name} {_number(criterion.value, criterion.unit)} of {_quantity(criterion.limit, criterion.unit)}"
    )


def _number(value: float, unit: str) -> str:
    factor, _, form = _SHOWN_AS.get(unit, (1.0, unit, ".4g"))
    return f"{value * factor + 0.0:{form}}"


def _quantity(value: float, unit: str) -> str:
    _, shown, _ = _SHOWN_AS.get(unit, (1.0, unit, ".4g"))
    return f"{_number(value, unit)} {shown}".rstrip()


def _under_restriction(weld: "WeldRecord", kmh: float) -> "Verdict | str":
    """Return the verdict under a speed restriction, or why there is none."""
    from msgspec.structs import replace

    from weld_force_ros.assessment.judge import judge

    if weld.force_map is None or weld.limits is None:
        return f"not known, its {'force map' if weld.force_map is None else 'limits'} not recorded"
    if kmh >= weld.verdict.judged_speed_kmh:
        return f"no change, judged up to {weld.verdict.judged_speed_kmh:g} km/h"
    if kmh < weld.force_map.speeds_kmh[0]:
        return f"not known, nothing was computed below {weld.force_map.speeds_kmh[0]:g} km/h"
    try:
        return judge(replace(weld.force_map, line_speed_kmh=kmh), weld.limits)
    except InputError as error:
        return f"not known, {error.reason}"


def _restricted(weld: "WeldRecord", kmh: float) -> str:
    then = _under_restriction(weld, kmh)
    if isinstance(then, str):
        return then
    change = then.peak_force_n / weld.verdict.peak_force_n - 1
    return f"{then.decision.upper()}, peak {_quantity(then.peak_force_n, 'N')} ({100 * change:+.0f} %)"


def _restricted_line(weld: "WeldRecord", kmh: float) -> dict[str, object]:
    then = _under_restriction(weld, kmh)
    outcome = {"not_judged": then} if isinstance(then, str) else {"restricted": then}
    return {"weld_id": weld.verdict.weld_id, "at_most_kmh": kmh, "recorded": weld.verdict, **outcome}


def _show_one(weld: "WeldRecord", restrict: float | None) -> None:
    from rich.text import Text

    from weld_force_ros.cli import terminal, verdict_tables
    from weld_force_ros.report.terminal_plot import curve_plot

    verdict = weld.verdict
    terminal.say("")
    terminal.show(Text.assemble(verdict_tables.decision(verdict.decision), " ", terminal.plain(verdict.weld_id)))
    for words in verdict_tables.answers_in_words(verdict) or [verdict.reason]:
        terminal.say_wrapped(words)
    if weld.force_map is None:
        terminal.say("no curve: its force map is not in the recording")
    else:
        terminal.say(
            curve_plot(weld.force_map, verdict, width=min(terminal.width(), _WIDTH), unicode=terminal.can_draw())
        )
    _show_criteria(verdict.criteria)
    for line in (*verdict.advice, *(f"not judged, as it was not computed: {name}" for name in verdict.unjudged)):
        terminal.say_wrapped(f"- {line}")
    if restrict is not None:
        terminal.say_wrapped(f"- running at most at {restrict:g} km/h: {_restricted(weld, restrict)}")


def _show_criteria(criteria: "Sequence[Criterion]") -> None:
    from weld_force_ros.cli import terminal, verdict_tables

    columns = {
        "criterion": "", "value": "whole right", "limit": "right", "reject above": "right", "at km/h": "right",
        "running": "whole", "result": "", "prob. of exceeding": "right",
    }  # fmt: skip
    rows = [dict(zip(columns, _criterion_row(c), strict=True)) for c in criteria]
    shown = {heading: how for heading, how in columns.items() if any(row[heading] for row in rows)}
    terminal.table("Criteria", shown.items(), [[row[heading] for heading in shown] for row in rows])
    if any(row["running"] for row in rows):
        terminal.say_wrapped(verdict_tables.RUNNING)
    if not all(c.verified for c in criteria):
        terminal.say_wrapped(_UNVERIFIED)


def _criterion_row(criterion: "Criterion") -> tuple[str, ...]:
    from weld_force_ros.assessment.criteria import criterion_in_words
    from weld_force_ros.cli import terminal

    c = criterion
    name, state = c.name, ("" if c.passed else "over") + ("" if c.decides else " (informative only)")
    if isinstance(c.rule_book, str):
        name = criterion_in_words(c.name, c.base_m) + ("" if c.decides else " (informative)")
        state = "" if c.passed else "over"
    return (
        name if c.verified else f"{name}*",
        _quantity(c.value, c.unit),
        _number(c.limit, c.unit),
        _number(c.reject_limit, c.unit) if isinstance(c.reject_limit, float) else "",
        f"{c.speed_kmh:g}" if isinstance(c.speed_kmh, float) else "",
        c.running if isinstance(c.running, str) else "",
        state,
        terminal.percent(c.exceeding) if isinstance(c.exceeding, float) else "",
    )
