"""Read rule books: named sets of limits, each number with its source, bundled or a user's own."""

from collections.abc import Iterator, Sequence
from datetime import date as Date  # noqa: N812
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from weld_force_ros import _yaml
from weld_force_ros.assessment.limits import check
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.messages import (
    AssessmentSettings,
    Limit,
    NormPoint,
    RuleBook,
    Rules,
    SourceKind,
    encode,
    legible,
    limits_sha256,
)

FORCE = "force"
"""The bundled rule book that judges forces; its rules are those of rule books that state none."""
_REMEDY = "see `weld-force limits list`, or write a file: `weld-force limits init FILE`"
_TO_FILL_IN = """\
source:
  kind: standard # standard, quotation, vendor or judgement
  text: # title of the document
  issue: # edition or date
  place: # table, clause or page
  address: # where it is to be had
  read: # the day you read it, YYYY-MM-DD
limits:
  # Put in your document's numbers and remove the template line above.
  - name: straightedge_peak # or straightedge_dip, straightedge_abs (either), quality_index, inclination, step
    base_m: 1.0
    # below_kmh: 160.0 # line speeds it holds for: above_kmh, from_kmh, below_kmh, to_kmh
    limit: # m, positive
    unit: m
"""
_FOUND = ("standard", "quotation", "vendor")


class Source(msgspec.Struct, forbid_unknown_fields=True):
    """A text that a number was read in, so that the next reader finds it.

    Attributes:
        text: its title, or the reasoning if the kind is `judgement`.
        kind: what kind of text it is.
        issue: edition or date.
        place: table, clause or page.
        address: where it is to be had.
        read: the day it was read.
    """

    text: str
    kind: SourceKind
    issue: str = ""
    place: str = ""
    address: str = ""
    read: Date | None = None


class Verification(msgspec.Struct, forbid_unknown_fields=True):
    """Who checked a number, when, and against which document."""

    by: str
    date: Date
    document: str


class RuleBookFile(msgspec.Struct, forbid_unknown_fields=True):
    """The content of a file of limits.

    Attributes:
        name: of the rule book; a file without one is a bare list of limits, judged as its rules say.
        title: what it is.
        state: `new` for finished welds, `in_service`, or `any`.
        source: where its limits are from, but for what a limit's own source says otherwise.
        template: why it ships without numbers, and where they stand.
        limits: as `weld_force_ros.messages.Limit`; `source` may be text or parts.
        rules: how limits become a decision.
        gradient_norm: of the quality index.
    """

    limits: list[dict[str, Any]]
    name: str = ""
    title: str = ""
    state: str = ""
    source: dict[str, Any] | UnsetType = UNSET
    template: str = ""
    rules: Rules | UnsetType = UNSET
    gradient_norm: list[NormPoint] = []


def bundled() -> list[str]:
    """Return the names of the bundled rule books and templates, `force` first."""
    folder = resources.files("weld_force_ros.data") / "limits"
    names = sorted(file.name.removesuffix(".yaml") for file in folder.iterdir() if file.name.endswith(".yaml"))
    return [FORCE, *(name for name in names if name != FORCE)]


def text_of(like: str, name: str) -> str:
    """Return the text of a bundled rule book under another name: to fill in, or to change.

    Raises:
        InputError: there is no such rule book.
    """
    if like not in bundled():
        raise InputError(f"{like!r} is no rule book", f"use one of {', '.join(bundled())}")
    text = (resources.files("weld_force_ros.data") / "limits" / f"{like}.yaml").read_text(encoding="utf-8")
    text = text.replace(f"name: {like}\n", f"name: {name}\n", 1)
    return text if read_rule_book(like).limits else text.replace("limits: []\n", _TO_FILL_IN)


def load_limits(chosen: str | Path | None = None, *, folder: Path | None = None) -> AssessmentSettings:
    """Read one or several rule books, whose limits are then applied together.

    Args:
        chosen: names of bundled rule books or paths of YAML files of their form, with commas between them; `force` if
            none is given. A bare list of limits will do: the worst position then counts, and values are compared with
            limits.
        folder: that paths are relative to; the current one if not given.

    Raises:
        InputError: not readable, not of that form, a template without numbers, or a limit for a criterion that does
            not exist.
    """
    names = [name.strip() for name in str(chosen or FORCE).split(",")]
    files = [read_rule_book(name, folder or Path()) for name in names]
    for file in files:
        if not file.limits:
            raise InputError(
                f"limits {file.name}: ships without numbers ({file.template})",
                f"put the numbers of your copy into a file: `weld-force limits init FILE --like {file.name}`",
            )
    named = [file for file in files if file.name]
    rules = next((file.rules for file in files if not isinstance(file.rules, UnsetType)), UNSET)
    if named and isinstance(rules, UnsetType):
        rules = read_rule_book(FORCE).rules
    settings = AssessmentSettings(
        limits_sha256="0" * 64,
        limits=[limit for file in files for limit in limits_of(file)],
        rules=rules,
        gradient_norm=next((file.gradient_norm for file in files if file.gradient_norm), []),
        rule_books=[RuleBook(name=file.name, title=file.title, state=file.state) for file in named] or UNSET,
    )
    settings.limits_sha256 = limits_sha256(settings)
    try:
        encode(settings)
    except MessageError as error:
        raise InputError(f"limits {', '.join(names)}: {error.reason}", _REMEDY) from None
    return settings


def read_rule_book(name: str, folder: Path | None = None) -> RuleBookFile:
    """Read a bundled rule book by its name, or a file, whose path may be relative to a folder.

    Raises:
        InputError: neither is there, or it is not of that form.
    """
    file: Traversable = (folder or Path()) / Path(name).expanduser()
    if name in bundled():
        file = resources.files("weld_force_ros.data") / "limits" / f"{name}.yaml"
    elif not file.is_file() and "/" not in name and not name.endswith((".yaml", ".yml")):
        raise InputError(f"limits {name!r} is no rule book", f"use {', '.join(bundled())}, or the path of a file")
    try:
        content = _yaml.decode(_yaml.read(file), object)
        stated = msgspec.convert(content if isinstance(content, dict) else {"limits": content}, RuleBookFile)
        check(list(limits_of(stated)))
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise InputError(f"limits {name}: {legible(str(error))}", _REMEDY) from None
    except InputError as error:
        raise InputError(f"limits {name}: {error.reason}", error.remedy) from None
    return stated


def limits_of(file: RuleBookFile) -> Iterator[Limit]:
    """Yield the limits of a rule book, each with its source.

    Strict where messages are not: these may hold fields of later versions, files no misspelt ones.

    Raises:
        ValueError: a field that is unknown, or a statement that cannot be.
    """
    for number, row in enumerate(file.limits, start=1):
        where = f"limit {row.get('name', number)}"
        unknown = row.keys() - set(Limit.__struct_fields__) | row.keys() & {"rule_book", "source_kind"}
        if unknown:
            raise ValueError(f"{where}: {', '.join(sorted(unknown))} is unknown")
        stated = dict(row)
        if "reject_limit" not in stated and "limit" in stated:
            stated |= {"reject_limit": stated["limit"], "beyond": "grind"}
        if stated.get("verified") is True and "verified_by" not in stated:
            raise ValueError(f"{where}: verified takes verified_by: who (by), when (date), and against which document")
        if "verified_by" in stated:
            checked = msgspec.convert(stated["verified_by"], Verification)
            stated |= {"verified": True, "verified_by": f"{checked.by}, {checked.date}: {checked.document}"}
        if not isinstance(stated.get("source"), str):
            own = stated.pop("source", {})
            if not isinstance(own, dict):
                raise ValueError(f"{where}: source is neither text nor its parts: text, kind, place, ...")
            source = _source(where, file.source, own)
            stated |= {"source": source_in_words(source), "source_kind": source.kind}
            stated["verified"] = stated.get("verified", False) or is_found(source)
        if file.name:
            stated["rule_book"] = file.name
        yield msgspec.convert(stated, Limit)


def _source(where: str, of_file: dict[str, Any] | UnsetType, own: dict[str, Any]) -> Source:
    parts = {**({} if isinstance(of_file, UnsetType) else of_file), **own}
    if not parts:
        raise ValueError(f"{where}: source is missing")
    if empty := [name for name, value in parts.items() if value is None and name != "read"]:
        raise ValueError(f"{where}: source: nothing stands behind {', '.join(empty)}: fill in, or remove the line")
    try:
        return msgspec.convert(parts, Source)
    except msgspec.ValidationError as error:
        raise ValueError(f"{where}: source: {error}") from None


def is_found(source: Source) -> bool:
    """Return whether a number stands in a text that was read: it has a place to be found at, and a day."""
    return source.kind in _FOUND and bool(source.address and source.read)


def source_in_words(source: Source) -> str:
    """Return a source as a line of text."""
    parts = [source.text.strip().removesuffix("."), source.issue, source.place]
    if source.kind != "judgement":
        parts += [source.address, source.kind, f"read {source.read}" if source.read else ""]
    return "; ".join(part for part in parts if part)


def titles(settings: AssessmentSettings) -> Sequence[RuleBook]:
    """Return the rule books that settings were made of."""
    return [] if isinstance(settings.rule_books, UnsetType) else settings.rule_books


def limits_by_book(settings: AssessmentSettings) -> list[tuple[RuleBook, list[Limit]]]:
    """Return the limits of each of the rule books that settings were made of."""
    return [(book, [limit for limit in settings.limits if limit.rule_book == book.name]) for book in titles(settings)]


def verified_of(limits: Sequence[Limit]) -> str:
    """Return how many of limits stand in a text that was read, as `3 of 4`."""
    return f"{sum(limit.verified for limit in limits)} of {len(limits)}"
