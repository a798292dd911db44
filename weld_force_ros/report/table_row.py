"""The front table's row of a weld: what to do, and the criterion nearest to or farthest beyond its limit."""

from collections.abc import Sequence
from typing import Any

from weld_force_ros.assessment.judge import permitted_kmh
from weld_force_ros.assessment.limits import ratio, worst
from weld_force_ros.messages import Criterion, GrindingAdvice, Verdict, known
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report.numbers import significant, without_none

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
    })  # fmt: skip


def _worst(criteria: Sequence[Criterion]) -> dict[str, Any]:
    criterion = worst(criteria)
    share = ratio(criterion)
    return {"name": criterion.name, "ratio": significant(share, 3) if share != float("inf") else None,
            "passed": criterion.passed, "verified": criterion.verified}  # fmt: skip


def _advice(verdict: Verdict, grinding: GrindingAdvice | None) -> str:
    match verdict.decision:
        case "accept":
            return "Leave it as it is"
        case "undecided":
            return f"Further measurement required: {what_to_measure(verdict.reason)}"
    if grinding is not None and grinding.reached:
        return _until(f"Grind off up to {grinding.most_removed_m * 1e3:.2f} mm", verdict)
    return _until("Grind" if verdict.decision == "grind" else "Replace it (re-weld)", verdict)


def _until(action: str, verdict: Verdict) -> str:
    permitted = permitted_kmh(verdict)
    if permitted is None or permitted >= verdict.judged_speed_kmh:
        return action
    return f"{action}; until then at most {permitted:g} km/h" if permitted else f"{action}; no speed is within limits"


def what_to_measure(reason: str) -> str:
    """Return the part of an undecided verdict's reason that says what is missing."""
    last = reason.rpartition("; ")[2]
    return last[last.index("measure ") :] if "measure " in last else last


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_LINE else line[:_LONGEST_LINE] + "…"
