"""The front table's row of a weld: what to do, and the criterion nearest to or farthest beyond its limit."""

from collections.abc import Sequence
from typing import Any

from msgspec import UnsetType

from weld_force_ros.assessment.criteria import sentence_in_words
from weld_force_ros.assessment.judge import permitted_kmh
from weld_force_ros.assessment.limits import ratio, worst
from weld_force_ros.assessment.rule_books import titles
from weld_force_ros.assessment.speed_advice import in_prose_kmh
from weld_force_ros.messages import Answer, Criterion, GrindingAdvice, Verdict, known
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report.numbers import significant, without_none
from weld_force_ros.simulation.running import direction_in_words

NOT_ASSESSED = {
    "geometry": "choose a rule book on the geometry: `--limits force,NAME`, names by `weld-force limits list`",
    "force": "add the rule book on forces: `--limits force,NAME`",
}
"""What answers a question that no limit was chosen for."""
_LONGEST_LINE = 200


def row(number: int, record: Record) -> dict[str, Any]:
    """Return the row of a weld or a rejection as JSON content.

    Args:
        number: by which the page knows it, from 1 on.
        record: of the weld or the rejection.
    """
    if not isinstance(record, WeldRecord):
        rejection = record.rejection
        return {"n": number, "weld": rejection.source, "decision": "unusable",
                "advice": _one_line(f"{rejection.reason}: {rejection.remedy}")}  # fmt: skip
    verdict = record.verdict
    return without_none({
        "n": number,
        "weld": verdict.weld_id,
        "decision": verdict.decision,
        "worst": _worst(verdict.criteria),
        "peak_n": significant(verdict.peak_force_n),
        "judged_kmh": verdict.judged_speed_kmh,
        "permitted_kmh": permitted_kmh(verdict),
        "advice": _one_line(_advice(verdict, record.grinding)),
        "rail": known(verdict.rail),
        "chainage_m": known(verdict.chainage_m),
        "unverified": sum(not c.verified for c in verdict.criteria),
        "criteria": len(verdict.criteria),
        "geometry": _answer(verdict.geometry),
        "force": _answer(verdict.force),
        "basis": basis(record),
    })  # fmt: skip


def _answer(answer: Answer | UnsetType) -> dict[str, Any] | None:
    if isinstance(answer, UnsetType):
        return None
    exceeding = known(answer.exceeding)
    return without_none(
        {"decision": answer.decision, "exceeding": None if exceeding is None else significant(exceeding, 3)}
    )


def basis(record: WeldRecord) -> dict[str, Any] | None:
    """Return what a verdict with two answers rests on, as far as it is known; None of older verdicts."""
    verdict, force_map, settings = record.verdict, record.force_map, record.settings
    if isinstance(verdict.geometry, UnsetType) or isinstance(verdict.force, UnsetType):
        return None
    books = titles(record.limits) if record.limits else []
    applied = {*verdict.geometry.rule_books, *verdict.force.rule_books}
    return without_none({
        "rule_books": [f"{book.name}: {book.title}" for book in books if book.name in applied] or sorted(applied),
        "risk": known(verdict.accepted_risk),
        "track": force_map.track if force_map else settings.track if settings else None,
        "running": (direction_in_words(force_map.running) or None) if force_map else None,
        "vehicle": known(verdict.vehicle) or (known(force_map.vehicle) if force_map else None),
        "static_n": verdict.static_load_n,
        "unsprung_kg": settings.wheel_mass_kg if settings else None,
        "measured_on": known(record.profile.measured_on) if record.profile else None,
        "line_kmh": known(force_map.line_speed_kmh) if force_map else None,
        "unknown": True if force_map is None or record.profile is None else None,
    })  # fmt: skip


def _worst(criteria: Sequence[Criterion]) -> dict[str, Any]:
    criterion = worst(criteria)
    share = ratio(criterion)
    content = {"name": criterion.name, "ratio": significant(share, 3) if share != float("inf") else None,
               "passed": criterion.passed, "verified": criterion.verified}  # fmt: skip
    return content if isinstance(criterion.base_m, UnsetType) else {**content, "base_m": criterion.base_m}


def _advice(verdict: Verdict, grinding: GrindingAdvice | None) -> str:
    match verdict.decision:
        case "accept":
            return "Leave it as it is"
        case "undecided":
            if isinstance(verdict.geometry, UnsetType):
                return f"Further measurement required: {what_to_measure(verdict.reason)}"
            return _capital(measure_next(verdict))
    if grinding is not None and grinding.reached:
        return _until(f"Grind off up to {grinding.most_removed_m * 1e3:.2f} mm", verdict)
    if grinding is not None and verdict.decision == "grind" and not isinstance(verdict.geometry, UnsetType):
        return _until("No grinding was found that helps: replace it (re-weld)", verdict)
    return _until("Grind" if verdict.decision == "grind" else "Replace it (re-weld)", verdict)


def _until(action: str, verdict: Verdict) -> str:
    permitted = permitted_kmh(verdict)
    if permitted is None or permitted >= verdict.judged_speed_kmh:
        return action
    if not permitted:
        return f"{action}; no speed is within limits"
    if isinstance(verdict.geometry, UnsetType):
        return f"{action}; until then at most {permitted:g} km/h"
    return f"{action}; computed forces are within limits up to {in_prose_kmh(permitted):g} km/h"


def measure_next(verdict: Verdict) -> str:
    """Return what decides an undecided verdict with two answers, in words."""
    if isinstance(verdict.measure_next, str):
        return sentence_in_words(verdict.measure_next, verdict.criteria)
    for name, answer in (("geometry", verdict.geometry), ("force", verdict.force)):
        if isinstance(answer, Answer) and answer.decision == "not assessed":
            return NOT_ASSESSED[name]
    return sentence_in_words(verdict.reason, verdict.criteria)


def _capital(clause: str) -> str:
    return clause[:1].upper() + clause[1:]


def what_to_measure(reason: str) -> str:
    """Return the part of an undecided verdict's reason that says what is missing."""
    last = reason.rpartition("; ")[2]
    return last[last.index("measure ") :] if "measure " in last else last


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_LINE else line[:_LONGEST_LINE] + "…"
