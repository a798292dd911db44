"""The front table's row of a weld: what to do, and the criterion nearest to or farthest beyond its limit."""

from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import UnsetType

from weld_force_ros._words import Words, english
from weld_force_ros.assessment.judge import permitted_kmh
from weld_force_ros.assessment.limits import ratio, worst
from weld_force_ros.assessment.rule_books import titles
from weld_force_ros.messages import Answer, Criterion, GrindingAdvice, Verdict, known
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report import weld_words
from weld_force_ros.report.numbers import significant, without_none
from weld_force_ros.report.quantities import hundredths, kilometres, prose_kmh
from weld_force_ros.report.templates import SIGNS, render

COLUMNS = ("decision", "geometry", "force", "weld", "worst", "peak", "permitted", "advice")
"""Of the front table; the page's script sorts by them and by what the rows hold beside."""
_LONGEST_LINE = 200


def row(number: int, record: Record, words: Words | None = None) -> dict[str, Any]:
    """Return the row of a weld or a rejection as JSON content.

    Args:
        number: by which the page knows it, from 1 on.
        record: of the weld or the rejection.
        words: of the page; English if not given.
    """
    words = words or english()
    if not isinstance(record, WeldRecord):
        rejection = record.rejection
        return {"n": number, "weld": rejection.source, "decision": "unusable",
                "advice": _one_line(f"{rejection.reason}: {rejection.remedy}")}  # fmt: skip
    verdict, profile = record.verdict, record.profile
    return without_none({
        "n": number,
        "weld": verdict.weld_id,
        "decision": verdict.decision,
        "worst": _worst(verdict.criteria),
        "peak_n": significant(verdict.peak_force_n),
        "judged_kmh": verdict.judged_speed_kmh,
        "permitted_kmh": permitted_kmh(verdict),
        "advice": _one_line(_advice(verdict, record.grinding, words)),
        "line": known(profile.line) if profile else None,
        "rail": known(verdict.rail),
        "chainage_m": known(verdict.chainage_m),
        "date": known(profile.measured_on) if profile else None,
        "vehicle": known(verdict.vehicle),
        "geometry": _answer(verdict.geometry),
        "force": _answer(verdict.force),
        "basis": basis(record),
    })  # fmt: skip


def row_html(content: dict[str, Any], words: Words) -> str:
    """Return a row as HTML, with all that a page sorts, filters and exports by in one attribute."""
    worst_one = content.get("worst")
    permitted = weld_words.highest_speed(content.get("permitted_kmh"), content.get("judged_kmh"), words)
    base_m = worst_one.get("base_m", msgspec.UNSET) if worst_one else msgspec.UNSET
    values = {
        "place": place_in_words(content, words),
        "worst_name": weld_words.criterion_name(worst_one["name"], words, base_m) if worst_one else "",
        "worst_words": _times(worst_one, words) if worst_one else "",
        "permitted": permitted if "judged_kmh" in content else "–",
        "flat": _attribute(_flat(content)),
    }
    shown = {"geometry": None, "force": None, "worst": None, **content}
    return render("row.html", words, row=shown, **values)


def severity(content: dict[str, Any]) -> tuple[int, float, int]:
    """Return what rows are put in order by, the worst first."""
    worst_one = content.get("worst")
    share = -1.0 if worst_one is None else float("inf") if worst_one["ratio"] is None else worst_one["ratio"]
    decisions = list(SIGNS)
    return decisions.index(content["decision"]) if content["decision"] in decisions else 9, -share, content["n"]


def place_in_words(content: dict[str, Any], words: Words) -> str:
    """Return line, rail and chainage of a row."""
    line, chainage = content.get("line"), content.get("chainage_m")
    parts = (
        line and words("card.line", line=line), content.get("rail"), None if chainage is None else kilometres(chainage),
    )  # fmt: skip
    return " · ".join(filter(None, parts))


def _flat(content: dict[str, Any]) -> dict[str, Any]:
    worst_one = content.get("worst", {})
    return without_none({
        "weld": content["weld"],
        "line": content.get("line"),
        "rail": content.get("rail"),
        "chainage_m": content.get("chainage_m"),
        "measured_on": content.get("date"),
        "decision": content["decision"],
        "geometry": content.get("geometry", {}).get("decision"),
        "force": content.get("force", {}).get("decision"),
        "vehicle": content.get("vehicle"),
        "worst_criterion": worst_one.get("name"),
        "times_limit": worst_one.get("ratio"),
        "peak_force_n": content.get("peak_n"),
        "forces_within_limits_up_to_kmh": content.get("permitted_kmh"),
        "computed_up_to_kmh": content.get("judged_kmh"),
        "what_to_do": content["advice"],
    })  # fmt: skip


def _attribute(content: dict[str, Any]) -> str:
    """Return JSON as the content of an attribute in single quotes: its double quotes need no escape."""
    from markupsafe import Markup

    text = msgspec.json.encode(content).decode()
    for character in "&<>'":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)  # noqa: S704 - none of the characters that markup is made of is left


def _answer(answer: Answer | UnsetType) -> dict[str, Any] | None:
    if isinstance(answer, UnsetType):
        return None
    exceeding = known(answer.exceeding)
    return without_none(
        {"decision": answer.decision, "exceeding": None if exceeding is None else significant(exceeding, 3)}
    )


def basis(record: WeldRecord) -> dict[str, Any]:
    """Return what a verdict rests on, as far as it is known."""
    verdict, force_map, settings, profile = record.verdict, record.force_map, record.settings, record.profile
    found: dict[str, Any] = {
        "risk": known(verdict.accepted_risk),
        "track": force_map.track if force_map else settings.track if settings else None,
        "running": known(force_map.running) if force_map else None,
        "vehicle": known(verdict.vehicle) or (known(force_map.vehicle) if force_map else None),
        "static_n": verdict.static_load_n,
        "unsprung_kg": settings.wheel_mass_kg if settings else None,
        "line_kmh": known(force_map.line_speed_kmh) if force_map else None,
        "software": verdict.software,
        "limits": verdict.limits_sha256,
        "unknown": True if force_map is None or profile is None else None,
    }
    if profile is not None:
        stated = {"line": profile.line, "date": profile.measured_on, "inspector": profile.operator,
                  "instrument": profile.instrument, "calibration": profile.calibration}  # fmt: skip
        found |= {name: known(value) for name, value in stated.items()}
    if isinstance(verdict.geometry, Answer) and isinstance(verdict.force, Answer):
        books = titles(record.limits) if record.limits else []
        applied = {*verdict.geometry.rule_books, *verdict.force.rule_books}
        found["rule_books"] = [f"{b.name}: {b.title}" for b in books if b.name in applied] or sorted(applied)
    return without_none(found)


def _worst(criteria: Sequence[Criterion]) -> dict[str, Any]:
    criterion = worst(criteria)
    share = ratio(criterion)
    content = {"name": criterion.name, "ratio": significant(share, 3) if share != float("inf") else None,
               "passed": criterion.passed, "verified": criterion.verified}  # fmt: skip
    return content if isinstance(criterion.base_m, UnsetType) else {**content, "base_m": criterion.base_m}


def _times(worst_one: dict[str, Any], words: Words) -> str:
    share = worst_one["ratio"]
    return words("phrase.limit_is_0") if share is None else words("phrase.times_limit", ratio=f"{share:.2f}")


def _advice(verdict: Verdict, grinding: GrindingAdvice | None, words: Words) -> str:
    match verdict.decision:
        case "accept":
            return words("row.accept")
        case "undecided":
            measure = weld_words.measure_next(verdict, words)
            if isinstance(verdict.geometry, UnsetType):
                return words("row.undecided", measure=measure)
            return measure[:1].upper() + measure[1:]
    if grinding is not None and grinding.reached:
        action = words("row.grind_by", depth=hundredths(grinding.most_removed_m))
    elif grinding is not None and verdict.decision == "grind":
        action = words("row.grind_helps_not")
    else:
        action = words(f"row.{verdict.decision}")
    return action + _until(verdict, words)


def _until(verdict: Verdict, words: Words) -> str:
    permitted = permitted_kmh(verdict)
    if permitted is None or permitted >= verdict.judged_speed_kmh:
        return ""
    if not permitted:
        return words("row.below_first")
    if isinstance(verdict.geometry, UnsetType):
        return words("row.until_old", speed=prose_kmh(permitted))
    return words("row.up_to", speed=prose_kmh(permitted))


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_LINE else line[:_LONGEST_LINE] + "…"
