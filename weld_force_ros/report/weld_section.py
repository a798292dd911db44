"""One weld's part of the page: one screen that says what to do and why, and behind it all that it rests on."""

from collections.abc import Iterator
from typing import Any

from msgspec import UnsetType

from weld_force_ros._words import Words, sentence
from weld_force_ros.assessment.criteria import sentence_in_words
from weld_force_ros.assessment.grinding_spots import side_in_words
from weld_force_ros.assessment.judge import permitted_kmh
from weld_force_ros.assessment.limits import ratio
from weld_force_ros.assessment.rule_books import limits_by_book
from weld_force_ros.messages import Answer, Criterion, GrindingAdvice, Rejection, Verdict, known
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report import weld_figures, weld_words
from weld_force_ros.report.quantities import (
    centimetres,
    hundredths,
    kilometres,
    kilonewtons,
    kmh,
    number,
    percent,
    probability,
    quantity,
)
from weld_force_ros.report.templates import render
from weld_force_ros.report.weld_detail import content, provenance_of_rejection
from weld_force_ros.report.weld_words import NOT_ASSESSED, value_of

_LONGEST_RAW_TEXT = 4_000
_MOST_DOUBTS = 2  # on the first screen; the reasoning has all of them
_MOST_RESTRICTIONS = 8

View = dict[str, Any]


def section(record: Record, words: Words, *, paper_head: str = "") -> str:
    """Return a weld's or a rejection's part of the page as HTML; the same for the same record.

    Args:
        record: of the weld or the rejection.
        words: of the page.
        paper_head: what stands above it on paper.
    """
    view = _weld(record, words) if isinstance(record, WeldRecord) else _rejected(record.rejection, words)
    return render("weld.html", words, paper_head=paper_head, **view)


def _rejected(rejection: Rejection, words: Words) -> View:
    text = rejection.raw_text
    shown = {
        "remedy": sentence(rejection.remedy),
        "reason": sentence(rejection.reason),
        "raw_text": text[:_LONGEST_RAW_TEXT],
        "truncated": rejection.raw_truncated or len(text) > _LONGEST_RAW_TEXT,
    }
    about = {"meta": words("card.no_verdict"), "provenance": provenance_of_rejection(rejection)}
    return {"name": rejection.source, "rejection": shown, **about}


def _weld(record: WeldRecord, words: Words) -> View:
    verdict, found = record.verdict, content(record)
    figures, more = _figures(found, record, words)
    sampled = any(not isinstance(c.exceeding, UnsetType) for c in verdict.criteria)
    measure = weld_words.measure_next(verdict, words)
    return {
        "name": verdict.weld_id,
        "meta": _meta(record, words),
        "rejection": None,
        "decision": verdict.decision,
        "risk": _risk(verdict, words),
        "do": weld_words.what_to_do(verdict, record.grinding, words),
        "measure": sentence(measure),
        "until": weld_words.until_then(verdict, words),
        "why": weld_words.why(verdict, words),
        "questions": list(_questions(record, words)),
        "facts": list(_facts(record, words)),
        "not_told": list(_not_told(record, words)),
        "figures": figures,
        "more_figures": more,
        "grinding": record.grinding and _grinding(record.grinding, words),
        "restrictions": _restrictions(verdict, found, words),
        "positions": _positions(verdict, words),
        "support": [sentence(one) for one in found.get("support", ())],
        "criteria": [_criterion(c, words) for c in verdict.criteria],
        "criteria_heads": ["criterion", "value", "limit", "margin", "where", *(["chance"] if sampled else [])],
        "sampled": sampled,
        "unjudged": ", ".join(weld_words.criterion_name(name, words) for name in verdict.unjudged),
        "reason": sentence(sentence_in_words(verdict.reason, verdict.criteria)),
        "advice": [sentence(one) for one in verdict.advice],
        "provenance": found["provenance"],
    }


def _meta(record: WeldRecord, words: Words) -> str:
    verdict, profile = record.verdict, record.profile
    line = known(profile.line) if profile else None
    chainage = known(verdict.chainage_m)
    return " · ".join(filter(None, [
        line and words("card.line", line=line), known(verdict.rail),
        None if chainage is None else kilometres(chainage), _measured(record, words),
    ]))  # fmt: skip


def _measured(record: WeldRecord, words: Words) -> str:
    on = known(record.profile.measured_on) if record.profile else None
    return words("card.measured_on", date=on) if on else words("card.no_date")


def _risk(verdict: Verdict, words: Words) -> str:
    risk = known(verdict.accepted_risk)
    return "" if risk is None else words("card.risk", risk=percent(risk))


def _questions(record: WeldRecord, words: Words) -> Iterator[View]:
    verdict = record.verdict
    for question, answer in (("geometry", verdict.geometry), ("force", verdict.force)):
        if isinstance(answer, UnsetType):
            continue
        shown: View = {"title": words(f"answer.{question}"), "decision": answer.decision}
        if answer.decision == NOT_ASSESSED:
            missing = weld_words.not_computed(question, verdict, words)
            chosen = words(
                "answer.not_computed", criteria=missing, how=words(f"not_computed.{question}", criteria=missing)
            )
            to_choose = words("answer.to_choose", how=words(f"not_assessed.{question}"))
            yield {**shown, "to_choose": chosen if missing else to_choose}
            continue
        yield {**shown, "to_choose": None, **_answer(answer, record, words)}


def _answer(answer: Answer, record: WeldRecord, words: Words) -> View:
    criteria = record.verdict.criteria
    nearest = weld_words.deciding_criterion(answer, criteria)
    exceeding = known(answer.exceeding)
    shown = {
        "criterion": None,
        "exceeding": None if exceeding is None else probability(exceeding, words),
        "books": ", ".join(answer.rule_books) or words("phrase.none"),
        "authority": None,
        "doubts": [sentence(sentence_in_words(doubt, criteria)) for doubt in answer.doubts[:_MOST_DOUBTS]],
    }
    if nearest is None:
        return shown
    return {
        **shown,
        "criterion": weld_words.criterion_name(nearest.name, words, nearest.base_m),
        "beyond": not nearest.passed,
        "value": value_of(nearest, nearest.value),
        "limit": value_of(nearest, nearest.limit),
        "margin": weld_words.margin(answer, nearest, record, words),
        "authority": _authority(nearest, record, words),
    }


def _authority(nearest: Criterion, record: WeldRecord, words: Words) -> str:
    stated = record.limits.limits if record.limits else ()
    same = (one for one in stated if one.name == nearest.name and one.source == nearest.source)
    return weld_words.authority(next(same, nearest), words)


def _facts(record: WeldRecord, words: Words) -> Iterator[tuple[str, str]]:
    verdict, force_map, profile = record.verdict, record.force_map, record.profile
    not_stated = words("phrase.not_stated")
    yield words("fact.vehicle"), _vehicle(record, words)
    yield words("fact.running"), _running(record, words)
    line_kmh = known(force_map.line_speed_kmh) if force_map else None
    judged = words("fact.judged_up_to", speed=kmh(verdict.judged_speed_kmh))
    yield words("fact.line_speed"), kmh(line_kmh) if line_kmh is not None else f"{not_stated}; {judged}"
    peak = words(
        "fact.peak_words", peak=kilonewtons(verdict.peak_force_n), speed=kmh(verdict.worst_speed_kmh),
        times=f"{verdict.peak_force_n / verdict.static_load_n:.2f}",
    )  # fmt: skip
    yield words("fact.peak"), peak
    yield words("fact.permitted"), weld_words.highest_speed(permitted_kmh(verdict), verdict.judged_speed_kmh, words)
    at = known(force_map.weld_position_m) if force_map else None
    yield words("fact.position"), not_stated if at is None else words("fact.after_sleeper", position=centimetres(at))
    stated = [known(getattr(profile, name)) if profile else None for name in ("operator", "instrument", "calibration")]
    yield words("fact.measured_by"), words(
        "fact.measured_words", who=stated[0] or not_stated, instrument=stated[1] or not_stated,
        calibration=stated[2] or not_stated,
    )  # fmt: skip
    yield words("fact.limits"), _limits_of(record, words)


def _vehicle(record: WeldRecord, words: Words) -> str:
    verdict, settings, force_map = record.verdict, record.settings, record.force_map
    mass = words("phrase.not_known") if settings is None else f"{number(settings.wheel_mass_kg, 4)} kg"
    load = words("fact.load", load=kilonewtons(verdict.static_load_n), mass=mass)
    name = known(verdict.vehicle) or (known(force_map.vehicle) if force_map else None)
    several = len(force_map.judged_together) if force_map else 0
    decides = words("fact.decides_of", count=several) if several > 1 else ""
    return f"{name}: {load}{decides}" if name else load


def _running(record: WeldRecord, words: Words) -> str:
    running = known(record.force_map.running) if record.force_map else None
    if running is None:
        return words("fact.running_assumed")
    said = words(f"running.{running}")
    which = known(record.verdict.worst_running)
    if which is None or running != "both":
        return said
    return words("fact.running_worst", said=said, worst=words(f"running.{which}"))


def _limits_of(record: WeldRecord, words: Words) -> str:
    if record.limits is None:
        return words("phrase.not_known")
    limits = record.limits.limits
    verified = sum(limit.verified for limit in limits)
    who = sorted({limit.verified_by for limit in limits if not isinstance(limit.verified_by, UnsetType)})
    books = ", ".join(book.name for book, _ in limits_by_book(record.limits))
    said = words("fact.limits_verified", verified=verified, count=len(limits))
    by = words("fact.by", who="; ".join(who)) if who else ""
    return f"{books}: {said}{by}" if books else f"{said}{by}"


def _not_told(record: WeldRecord, words: Words) -> Iterator[str]:
    for key in ("cracks", "hardness", "lateral"):
        yield words(f"not_told.{key}")
    support = known(record.force_map.support) if record.force_map else None
    if support is None:
        yield words("not_told.hanging" if not record.verdict.hanging else "not_told.hanging_asked")
    running = known(record.force_map.running) if record.force_map else None
    if running != "both":
        yield words("not_told.direction")


def _figures(found: View, record: WeldRecord, words: Words) -> tuple[list[View], list[View]]:
    first: list[View] = []
    more: list[View] = []

    def add(to: list[View], key: str, svg: str, legend: list[tuple[str, str]], hint: str = "", **values: str) -> None:
        to.append({"heading": words(f"figure.{key}_heading", **values), "svg": svg, "legend": legend, "hint": hint})

    def legend(*names: str) -> list[tuple[str, str]]:
        return [(css, words(f"legend.{css.replace('-', '_')}")) for css in names if css]

    profile, grinding = found.get("profile"), found.get("grinding")
    if profile:
        ground = bool(grinding and grinding["most_removed_m"] > 0)
        drawn = legend(
            "rail", "wheel" if "wheel_m" in profile else "", "likely" if "low_m" in profile else "",
            "samples" if "measured_x_m" in profile else "",
            "set-aside" if profile.get("wrong_x_m") else "", "bridged" if "underside_m" in profile else "",
            "after" if ground else "", "spot" if ground else "",
        )  # fmt: skip
        add(first, "geometry", weld_figures.geometry_figure(found, record, words), drawn)
    if "curves" in found:
        svg = weld_figures.speed_figure(found, record, words)
        permitted = "permitted" if 'class="permitted"' in svg else ""
        drawn = legend("force", "likely-best", "limit-grind", "limit-reject", permitted, "after" if grinding else "")
        add(first, "speed", svg, drawn)
        second = weld_figures.second_criterion(found, record.verdict)
        if second:
            name = weld_words.criterion_name(second, words)
            svg = weld_figures.speed_figure(found, record, words, second)
            add(more, "other", svg, legend("force", "limit-grind", "limit-reject"), criterion=name)
    if "map" in found:
        hollow = words("figure.hollow") if "1" in found["map"]["hollow"] else ""
        hint = f"{words('figure.map_hint')} {hollow}"
        add(more, "map", weld_figures.map_figure(found, record, words), _scale(found), hint)
    if "history" in found:
        at = found["history"]
        of_passage = [("force", words("figure.force")), ("wheel", words("figure.path"))]
        add(more, "passage", weld_figures.passage_figure(found, record, words), of_passage,
            speed=kmh(at["speed_kmh"]), position=centimetres(at["position_m"]))  # fmt: skip
    return first, more


def _scale(found: View) -> list[tuple[str, str]]:
    peaks = found["map"]["peak_n"]
    return [("scale", f"{kilonewtons(min(peaks))} – {kilonewtons(max(peaks))}")]


def _grinding(advice: GrindingAdvice, words: Words) -> View:
    found = "grinding.remove" if advice.reached else "grinding.none"
    spots = [
        (f"{number(1e3 * s.from_m)} … {number(1e3 * s.to_m)} mm", side_in_words(s),
         words("grinding.deepest", depth=hundredths(s.depth_m), at=number(1e3 * s.deepest_m)))
        for s in advice.spots
    ]  # fmt: skip
    hints = []
    if advice.hand_margin_m:
        hints.append(words("grinding.by_hand", margin=hundredths(advice.hand_margin_m)))
    hints.append(words("grinding.waves", band=quantity(advice.band_limit_m, "m"), radius=number(advice.stone_radius_m)))
    checked = words("grinding.reference", within=advice.reference_within, checked=advice.reference_checked)
    hints.append(checked if advice.reference_checked else words("grinding.no_reference"))
    return {
        "found": words(found, depth=hundredths(advice.most_removed_m)), "reason": sentence(advice.reason),
        "spots": spots, "before": advice.decision_before, "after": advice.decision_after, "hint": " ".join(hints),
    }  # fmt: skip


def _restrictions(verdict: Verdict, found: View, words: Words) -> list[list[str]]:
    """Return what each speed restriction would do; no change that fit error and model uncertainty hide is told."""
    curves = found.get("curves") or {}
    share, rest = curves.get("error_share", 0.0), verdict.static_load_n
    lines = []
    for one in verdict.restrictions[:_MOST_RESTRICTIONS]:
        top = verdict.restrictions[0].peak_force_n
        hidden = abs(one.peak_force_n - top) < share * (max(one.peak_force_n, top) - rest)
        change = f"{'+' if one.change > 0 else '−'}{percent(abs(one.change))}" if abs(one.change) >= 5e-4 else "–"
        lines.append([
            kmh(one.speed_kmh), kilonewtons(one.peak_force_n),
            words("restriction.hidden") if hidden and change != "–" else change,
            words("restriction.yes" if one.within_limits else "restriction.no"),
        ])  # fmt: skip
    return lines if len(lines) > 1 else []


def _positions(verdict: Verdict, words: Words) -> str:
    """Return the decision at each position in the sleeper bay, where the weld's own is not known."""
    runs: list[tuple[str, float, float]] = []
    for one in verdict.by_position:
        if runs and runs[-1][0] == one.decision:
            runs[-1] = (one.decision, runs[-1][1], one.position_m)
        else:
            runs.append((one.decision, one.position_m, one.position_m))
    if len(runs) == 1:
        return words("position.everywhere", decision=words(f"decision.{runs[0][0]}"))
    return " · ".join(
        words("position.at", decision=words(f"decision.{name}"), first=centimetres(first), last=centimetres(last))
        for name, first, last in runs
    )


def _criterion(c: Criterion, words: Words) -> View:
    margin = c.limit - c.value
    reject = known(c.reject_limit)
    if not c.decides:
        state = "informative_within" if c.passed else "informative_over"
    elif c.passed:
        state = "within"
    else:
        state = "beyond_reject" if reject is not None and c.value > reject else "over"
    limit = value_of(c, c.limit)
    share = ratio(c) if c.limit > 0 else (0.0 if c.passed else 2.0)
    return {
        "name": weld_words.criterion_name(c.name, words, c.base_m),
        "state": words(f"criteria.{state}"),
        "passed": c.passed,
        "failed": not c.passed and c.decides,
        "value": value_of(c, c.value),
        "share": share,
        "interval": _interval(c, words),
        "limit": limit if reject is None else words("criteria.both_limits", limit=limit, reject=value_of(c, reject)),
        "margin": value_of(c, margin),
        "beyond": margin < 0,
        "where": _place(c, words),
        "chance": _chance(c, words),
    }  # fmt: skip


def _interval(c: Criterion, words: Words) -> str:
    if isinstance(c.low, UnsetType) or isinstance(c.high, UnsetType) or c.low == c.high:
        return ""
    return words("answer.interval", low=value_of(c, c.low), high=value_of(c, c.high))


def _place(c: Criterion, words: Words) -> str:
    if isinstance(c.speed_kmh, UnsetType):
        return words("criteria.of_geometry") if weld_words.is_of_geometry(c) else "–"
    if isinstance(c.position_m, UnsetType):
        return kmh(c.speed_kmh)
    return words("criteria.place", speed=kmh(c.speed_kmh), position=centimetres(c.position_m))


def _chance(c: Criterion, words: Words) -> str:
    if isinstance(c.exceeding, UnsetType):
        return "–"
    said = probability(c.exceeding, words)
    if isinstance(c.driver, UnsetType):
        return said
    return words("criteria.driver", chance=said, driver=c.driver)
