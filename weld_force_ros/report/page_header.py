"""The front of the page: what its decisions rest on, for whoever signs them, and every limit with its authority."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from msgspec import UnsetType

from weld_force_ros._words import Words
from weld_force_ros.messages import AssessmentSettings, Limit, SimulationSettings, Uncertainty, known
from weld_force_ros.report import weld_words
from weld_force_ros.report.quantities import kilonewtons, kmh, number, percent, quantity, unit_of
from weld_force_ros.report.templates import render

_MOST_SHOWN = 4

Basis = Mapping[str, Any]


def header(
    bases: Sequence[Basis],
    limits: Iterable[AssessmentSettings],
    words: Words,
    *,
    settings: Iterable[SimulationSettings] = (),
    paper: bool = False,
) -> str:
    """Return the front's header as HTML.

    Args:
        bases: of `table_row.basis`, of each weld.
        limits: that the welds were judged by, those of all of them.
        words: of the page.
        settings: that the welds were simulated with.
        paper: the limits' table is left out.
    """
    stated = list({one.limits_sha256: one for one in limits}.values())
    unknowns = {one.uncertainty.source for one in settings if isinstance(one.uncertainty, Uncertainty)}
    notes = [*((words("header.rules"), text) for text in map(_rules, stated) if text),
             *((words("header.uncertainty"), text) for text in sorted(unknowns))]  # fmt: skip
    return render(
        "header.html", words, facts=list(_facts(bases, stated, words)) if bases else [],
        unverified=_unverified(stated, words), limits=list(_limits(stated, words)), notes=notes,
        paper=paper,
    )  # fmt: skip


def _facts(
    bases: Sequence[Basis], stated: Sequence[AssessmentSettings], words: Words
) -> Iterator[tuple[str, list[str]]]:
    def texts(name: str) -> Callable[[Basis], str | None]:
        return lambda one: one.get(name)

    not_stated = words("phrase.not_stated")
    for name in ("line", "date", "inspector", "instrument", "calibration"):
        yield words(f"header.{name}"), _distinct(bases, texts(name), not_stated, words)
    speed = lambda one: kmh(one["line_kmh"]) if "line_kmh" in one else None  # noqa: E731
    yield words("header.line_speed"), _distinct(bases, speed, not_stated, words)
    yield words("header.vehicle"), _distinct(bases, lambda one: _vehicle(one, words), not_stated, words)
    running = lambda one: words(f"running.{one['running']}") if "running" in one else None  # noqa: E731
    yield words("header.running"), _distinct(bases, running, words("fact.running_assumed"), words)
    yield words("header.track"), _distinct(bases, texts("track"), words("phrase.not_known"), words)
    risk = lambda one: words("header.risk_words", risk=percent(one["risk"])) if "risk" in one else None  # noqa: E731
    yield words("header.risk"), _distinct(bases, risk, not_stated, words)
    books = sorted({book for one in bases for book in one.get("rule_books", ())})
    yield words("header.books"), books or [words("phrase.none")]
    yield words("header.limits"), _verified(stated, words)
    yield words("header.software"), _distinct(bases, texts("software"), not_stated, words)


def _vehicle(basis: Basis, words: Words) -> str:
    mass = f"{number(basis['unsprung_kg'], 4)} kg" if "unsprung_kg" in basis else words("phrase.not_known")
    load = words("fact.load", load=kilonewtons(basis["static_n"]), mass=mass)
    return f"{basis['vehicle']}: {load}" if "vehicle" in basis else load


def _distinct(bases: Sequence[Basis], of: Callable[[Basis], str | None], missing: str, words: Words) -> list[str]:
    """Return the distinct values among many, and for how many nothing was stated."""
    found = [of(one) for one in bases]
    values = sorted({one for one in found if one is not None})
    shown = values if len(values) <= _MOST_SHOWN else [words("header.from_to", first=values[0], last=values[-1])]
    lacking = found.count(None)
    if lacking:
        some = words("header.of", what=missing, n=lacking, all=len(found))
        shown = [*shown, missing if lacking == len(found) else some]
    return shown


def _verified(stated: Sequence[AssessmentSettings], words: Words) -> list[str]:
    limits = [limit for one in stated for limit in one.limits]
    if not limits:
        return [words("phrase.not_known")]
    said = words("fact.limits_verified", verified=sum(limit.verified for limit in limits), count=len(limits))
    return [said, *sorted({limit.verified_by for limit in limits if not isinstance(limit.verified_by, UnsetType)})]


def _unverified(stated: Sequence[AssessmentSettings], words: Words) -> str:
    """Return what nobody verified, a sentence, said once on the page."""
    limits = [limit for one in stated for limit in one.limits if limit.decides is not False]
    unverified = [limit for limit in limits if not limit.verified]
    if not unverified:
        return ""
    names = ", ".join(dict.fromkeys(weld_words.criterion_name(one.name, words, one.base_m) for one in unverified))
    judged = all(one.source_kind == "judgement" for one in unverified)
    key = "header.judgement" if judged else "header.unverified"
    return words(key, n=len(unverified), all=len(limits), criteria=names)


def _rules(limits: AssessmentSettings) -> str | None:
    rules = known(limits.rules)
    if rules is None:
        return None
    unknown = "undecided if it matters" if rules.unknown_position == "undecided" else "the worst one decides"
    risk = "" if isinstance(rules.accepted_risk, UnsetType) else f"accepted risk {rules.accepted_risk:.0%}; "
    return (
        f"{risk}unknown position: {unknown}; waves shown up to {rules.resolved_hz:g} Hz"
        f"{'' if rules.verified else ' (not verified)'}: {rules.source}"
    )


def _limits(stated: Sequence[AssessmentSettings], words: Words) -> Iterator[dict[str, Any]]:
    for settings in stated:
        for limit in settings.limits:
            form = {"times_static": "limits.times_static", "plus_static": "limits.plus_static"}.get(str(limit.form))
            reject = words("limits.none") if limit.beyond == "grind" else _level(limit, limit.reject_limit, form, words)
            yield {
                "criterion": weld_words.criterion_name(limit.name, words, limit.base_m),
                "decides": limit.decides is not False,
                "book": known(limit.rule_book) or "–",
                "limit": _level(limit, limit.limit, form, words),
                "reject_limit": reject,
                "holds": _holds(limit, words),
                "authority": weld_words.authority(limit, words),
                "source": limit.source,
            }


def _level(limit: Limit, value: float, form: str | None, words: Words) -> str:
    if form == "limits.times_static":
        return words(form, value=number(value))
    shown = quantity(value, unit_of(limit.name, limit.unit))
    return words(form, value=shown) if form else shown


def _holds(limit: Limit, words: Words) -> str:
    bounds = (("above_kmh", "above"), ("from_kmh", "from"), ("below_kmh", "below"), ("to_kmh", "to"))
    stated = [(key, known(getattr(limit, name))) for name, key in bounds]
    said = [words(f"limits.{key}", speed=kmh(speed)) for key, speed in stated if speed is not None]
    return ", ".join(said) or words("limits.all_lines")
