"""Say what a verdict means: what to do, why, how near its limits, and what would decide it.

Every sentence is of the catalogue. What the verdict itself says in words (its reason, doubts and the measurement that
would decide) is recorded with it and stays as it was written.
"""

from collections.abc import Sequence

from msgspec import UNSET, UnsetType

from weld_force_ros._words import Words
from weld_force_ros.assessment.criteria import FORCE_CRITERIA, GEOMETRY_CRITERIA, sentence_in_words, value_at_rest
from weld_force_ros.assessment.judge import permitted_kmh, told_apart
from weld_force_ros.assessment.limits import ratio, worst
from weld_force_ros.messages import Answer, Criterion, GrindingAdvice, Limit, Verdict, known
from weld_force_ros.recording.weld_records import WeldRecord
from weld_force_ros.report.quantities import (
    centimetres,
    hundredths,
    kmh,
    number,
    percent,
    prose_kmh,
    quantity,
    unit_of,
)

_SYMBOLS = ("P2", "Qmax")  # which keep their capital in a sentence
_NOT_LINEAR = ("contact_loss", "hertz_pressure_index")  # in the force
NOT_ASSESSED = "not assessed"


def criterion_name(name: str, words: Words, base_m: float | UnsetType = UNSET) -> str:
    """Return a criterion's name, with the length of its straightedge or chord."""
    label = words.get("criterion", name, name)
    if isinstance(base_m, UnsetType):
        return label
    key = "of_base" if name.startswith("straightedge_") else "on_base"
    return words(f"phrase.{key}", criterion=label, base=number(base_m))


def criterion_in_sentence(criterion: Criterion, words: Words) -> str:
    """Return a criterion's name as it stands inside a sentence."""
    label = criterion_name(criterion.name, words, criterion.base_m)
    keeps = label.startswith(_SYMBOLS) or criterion.name not in words.section("criterion")
    return label if keeps else label[:1].lower() + label[1:]


def value_of(criterion: Criterion, value: float) -> str:
    """Return a value of a criterion with its unit."""
    return quantity(value, unit_of(criterion.name, criterion.unit))


def times_limit(criterion: Criterion, words: Words) -> str:
    """Return how many times its limit a criterion's value is."""
    share = ratio(criterion) if criterion.limit > 0 else float("inf")
    return words("phrase.limit_is_0") if share == float("inf") else words("phrase.times_limit", ratio=f"{share:.2f}")


def what_to_do(verdict: Verdict, grinding: GrindingAdvice | None, words: Words) -> str:
    """Return what to do with a weld, a sentence."""
    if verdict.decision == "undecided":
        return words("action.undecided")
    action = words(f"action.{verdict.decision}")
    if grinding is None or verdict.decision == "accept":
        return action
    removed = hundredths(grinding.most_removed_m)
    if grinding.reached:
        return words(f"action.{verdict.decision}_by", depth=removed)
    return words(f"action.{verdict.decision}_helps_not")


def until_then(verdict: Verdict, words: Words) -> str:
    """Return up to which speed computed forces are within limits, a sentence; empty where nothing was said of it."""
    permitted, judged = permitted_kmh(verdict), verdict.judged_speed_kmh
    if permitted is None:
        return ""
    if permitted == 0:
        return words("speed.below_first_sentence")
    if permitted >= judged:
        return words("speed.all", top=kmh(judged))
    return words("speed.up_to", speed=prose_kmh(permitted), top=kmh(judged))


def highest_speed(permitted: float | None, judged: float | None, words: Words) -> str:
    """Return the highest computed speed with forces within limits, for a table."""
    if permitted is None or judged is None:
        return words("phrase.not_known")
    if permitted == 0:
        return words("speed.below_first")
    return kmh(judged) if permitted >= judged else prose_kmh(permitted)


def why(verdict: Verdict, words: Words) -> str:
    """Return the criterion that is farthest beyond its limit, or nearest to it, in a sentence."""
    deciding = [c for c in verdict.criteria if c.decides] or verdict.criteria
    nearest = worst(verdict.criteria)
    reject = known(nearest.reject_limit)
    beyond_reject = reject is not None and nearest.value > reject
    limit = value_of(nearest, reject if beyond_reject and reject is not None else nearest.limit)
    name = criterion_in_sentence(nearest, words)
    value, at = value_of(nearest, nearest.value), _where(nearest, words)
    if nearest.passed:
        return words("why.nearest", criterion=name, value=value, limit=limit, at=at)
    of = reject if beyond_reject and reject else nearest.limit
    said = words(
        "why.beyond_reject" if beyond_reject else "why.beyond" if nearest.limit > 0 else "why.beyond_zero",
        criterion=criterion_name(nearest.name, words, nearest.base_m), value=value, at=at, limit=limit,
        share=percent(nearest.value / of - 1) if of else "",
    )  # fmt: skip
    others = [criterion_in_sentence(c, words) for c in deciding if not c.passed and c is not nearest]
    return f"{said} {words('why.also', criteria=', '.join(others))}" if others else said


def _where(criterion: Criterion, words: Words) -> str:
    if isinstance(criterion.speed_kmh, UnsetType):
        return ""
    at = words("why.at_speed", speed=kmh(criterion.speed_kmh))
    if isinstance(criterion.position_m, UnsetType):
        return at
    return at + words("why.at_position", position=centimetres(criterion.position_m))


def authority(limit: Limit | Criterion, words: Words) -> str:
    """Return on whose authority a limit stands: who verified it, or what kind of text it was read in."""
    kind = known(limit.source_kind)
    if isinstance(limit, Limit) and not isinstance(limit.verified_by, UnsetType):
        return words("authority.verified_by", who=limit.verified_by)
    if limit.verified:
        return words(f"authority.{kind}") if kind else words("authority.verified")
    return words("authority.judgement") if kind == "judgement" else words("authority.unverified")


def deciding_criterion(answer: Answer, criteria: Sequence[Criterion]) -> Criterion | None:
    """Return the criterion that an answer names, of the rule book it names."""
    of_name = [c for c in criteria if c.name == answer.criterion and c.decides and c.source == answer.source]
    return max(of_name, key=ratio) if of_name else None


def margin(answer: Answer, nearest: Criterion, record: WeldRecord, words: Words) -> str:
    """Return the distance to the limit beside what it is uncertain by: the model's error, or the measurement's."""
    distance = nearest.limit - nearest.value
    beyond = distance < 0 or not nearest.passed
    share = "" if isinstance(answer.margin, UnsetType) else f" ({percent(abs(answer.margin))})"
    said = words("answer.beyond" if beyond else "answer.left", distance=value_of(nearest, abs(distance)), share=share)
    error = _model_error(nearest, record)
    if error is not None:
        key = "answer.error_larger" if error > abs(distance) else "answer.error"
        return f"{said}; {words(key, error=value_of(nearest, error))}"
    if isinstance(nearest.low, UnsetType) or isinstance(nearest.high, UnsetType):
        return said
    low, high = value_of(nearest, nearest.low), value_of(nearest, nearest.high)
    return said if low == high else f"{said}; {words('answer.interval', low=low, high=high)}"


def _model_error(criterion: Criterion, record: WeldRecord) -> float | None:
    """Return one standard deviation of fit error and model uncertainty in a force's unit; None where not known."""
    force_map = record.force_map
    if force_map is None or criterion.name not in FORCE_CRITERIA or criterion.name in _NOT_LINEAR:
        return None
    share = told_apart(force_map, record.limits) if record.limits else known(force_map.model_error)
    rest = value_at_rest(criterion.name, record.verdict.static_load_n)
    return None if share is None else share * abs(criterion.value - rest)


def measure_next(verdict: Verdict, words: Words) -> str:
    """Return which measurement would decide an undecided weld, a clause; empty where none is asked for."""
    if isinstance(verdict.measure_next, str):
        return sentence_in_words(verdict.measure_next, verdict.criteria)
    if verdict.decision != "undecided":
        return ""
    for name, answer in (("geometry", verdict.geometry), ("force", verdict.force)):
        if isinstance(answer, Answer) and answer.decision == NOT_ASSESSED:
            missing = not_computed(name, verdict, words)
            return words(f"not_computed.{name}", criteria=missing) if missing else words(f"not_assessed.{name}")
    if isinstance(verdict.geometry, UnsetType):
        return what_to_measure(verdict.reason)
    return sentence_in_words(verdict.reason, verdict.criteria)


def not_computed(question: str, verdict: Verdict, words: Words) -> str:
    """Return the criteria of a question whose limits were chosen but could not be applied; empty if there are none."""
    names = [name for name in verdict.unjudged if (name in GEOMETRY_CRITERIA) == (question == "geometry")]
    return ", ".join(dict.fromkeys(criterion_name(name, words) for name in names))


def what_to_measure(reason: str) -> str:
    """Return the part of an undecided verdict's reason that says what is missing."""
    last = reason.rpartition("; ")[2]
    return last[last.index("measure ") :] if "measure " in last else last


def is_of_geometry(criterion: Criterion) -> bool:
    """Return whether a criterion is of the profile itself."""
    return criterion.name in GEOMETRY_CRITERIA
