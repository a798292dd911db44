"""The report as one HTML file that loads nothing from any network, or that a server on the same machine feeds.

The table and each weld's part are HTML made here, so that the page is whole without a script. With one, the parts of
welds stand in `noscript` elements: the browser reads them as text, which takes no time, and the script opens one at a
time. All text of a recording is escaped, and a Content-Security-Policy allows one script and one style sheet, by their
hashes: should a name ever become markup, it still cannot run.
"""

import base64
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import msgspec

from weld_force_ros._words import Words, english
from weld_force_ros.messages import AssessmentSettings, SimulationSettings
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report.page_header import header
from weld_force_ros.report.table_row import COLUMNS, row, row_html, severity
from weld_force_ros.report.templates import SIGNS, read_asset, render
from weld_force_ros.report.weld_section import section

SCRIPTS = ("dom.js", "source.js", "figures.js", "table.js", "main.js")


@dataclass
class Report:
    """Welds as they are shown: a row and a part each.

    Args:
        words: of the page.
        title: of the page.
        about: a line below the title, such as the source of the welds.
    """

    words: Words = field(default_factory=english)
    title: str = ""
    about: str = ""
    rows: list[dict[str, Any]] = field(default_factory=list)
    sections: list[str] = field(default_factory=list)
    limits: dict[str, AssessmentSettings] = field(default_factory=dict)
    settings: dict[str, SimulationSettings] = field(default_factory=dict)
    hashes: list[tuple[str, str]] = field(default_factory=list)
    shared: dict[str, set[str]] = field(default_factory=dict)

    def add(self, record: Record) -> None:
        """Add a weld or a rejection."""
        content = row(len(self.rows) + 1, record, self.words)
        self.rows.append(content)
        head = " · ".join(filter(None, [self.title or self.words("page.title"), self.about]))
        self.sections.append(section(record, self.words, paper_head=head))
        if not isinstance(record, WeldRecord):
            return
        verdict = record.verdict
        if record.limits is not None:
            self.limits[verdict.limits_sha256] = record.limits
        if record.settings is not None:
            self.settings[verdict.config_sha256] = record.settings
        self.hashes.append((verdict.weld_id, verdict.profile_sha256))
        for name in ("software", "config_sha256", "limits_sha256"):
            self.shared.setdefault(name, set()).add(getattr(verdict, name))


def report_of(records: Iterable[Record], *, about: str, words: Words | None = None, title: str = "") -> Report:
    """Return welds and rejections as they are shown.

    Args:
        records: in the order of their numbers.
        about: a line below the title, such as the source of the welds.
        words: of the page; English if not given.
        title: of the page.

    Raises:
        InputError: jinja2 is not installed.
    """
    made = Report(words=words or english(), about=about, title=title)
    for record in records:
        made.add(record)
    return made


def page(report: Report, *, live: bool = False, newest: int | None = None) -> str:
    """Return the page as HTML; the same for the same report.

    Args:
        report: the welds on it.
        live: further rows and parts come from the page's server: `rows?after=N` is requested twice a second, `header`
            after new ones, and `weld/N` when a weld is opened whose part the page does not hold.
        newest: number of rows that a live page keeps; None keeps all.

    Raises:
        InputError: jinja2 is not installed.
    """
    title = report.title or report.words("page.title")
    facts = {
        "live": live, "newest": newest, "title": title,
        "signs": SIGNS, "words": {name: report.words.section(name) for name in ("script", "decision", "column")},
    }  # fmt: skip
    return self_contained(
        "page.html", SCRIPTS, report.words, title=title, about=report.about, live=live, facts=facts,
        **_content(report, paper=False),
    )  # fmt: skip


def paper(report: Report) -> str:
    """Return the page for a printer: a front, a sheet a weld, the hashes last; no script in it.

    Raises:
        InputError: jinja2 is not installed.
    """
    title = report.title or report.words("page.title")
    return self_contained(
        "page.html", (), report.words, title=title, about=report.about, paper=True, live=False,
        **_content(report, paper=True),
    )  # fmt: skip


def page_of_records(records: Iterable[Record], *, about: str) -> str:
    """Return the page of welds and rejections as HTML.

    Args:
        records: in the order of their numbers.
        about: a line below the title, such as the source of the welds.

    Raises:
        InputError: jinja2 is not installed.
    """
    return page(report_of(records, about=about))


def _content(report: Report, *, paper: bool) -> dict[str, Any]:
    ordered = sorted(report.rows, key=severity)
    sections = dict(zip((one["n"] for one in report.rows), report.sections, strict=True))
    bases = [one["basis"] for one in report.rows if "basis" in one]
    shared = [(report.words(f"annex.{name}"), sorted(values)) for name, values in report.shared.items()]
    return {
        "answered": any("geometry" in one for one in report.rows),
        "columns": COLUMNS,
        "header": header(
            bases, report.limits.values(), report.words, settings=report.settings.values(), paper=paper
        ),
        "rows": [row_html(one, report.words) for one in ordered],
        "sections": [{"n": one["n"], "html": sections[one["n"]]} for one in ordered],
        "annex": render("annex.html", report.words, shared=shared, welds=report.hashes) if report.hashes else "",
    }  # fmt: skip


def self_contained(
    template: str,
    scripts: Sequence[str],
    words: Words,
    *,
    title: str,
    about: str,
    facts: dict[str, Any] | None = None,
    live: bool = False,
    paper: bool = False,
    styles: Sequence[str] = (),
    **more: Any,
) -> str:
    """Return a page with its styles and its script in it as HTML.

    Args:
        template: file in `report/assets`.
        scripts: files in `report/assets`, in the order of their use.
        words: of the page.
        title: of the page.
        about: a line below the title.
        facts: embedded as JSON, with any content.
        live: the page may send requests to the server that it came from.
        paper: it is to be printed: there is no script in it.
        styles: further files of styles.
        more: further variables of the template.

    Raises:
        InputError: jinja2 is not installed.
    """
    script, style = _script(tuple(scripts)), "\n".join(map(read_asset, ("page.css", "print.css", *styles)))
    return render(
        template, words, title=title, about=about, policy=_policy(script, style, live), style=style, script=script,
        facts=_safe_json(facts or {}), live=live, paper=paper, **more,
    )  # fmt: skip


def _policy(script: str, style: str, live: bool) -> str:
    of_script, of_style = (_hash(text) for text in (script, style))
    connect = "; connect-src 'self'" if live else ""
    return (
        f"default-src 'none'; script-src {of_script}; style-src {of_style}; img-src data:{connect}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _script(scripts: tuple[str, ...]) -> str:
    parts = "\n".join(read_asset(name) for name in scripts)
    return f'"use strict";\n(() => {{\n{parts}\n}})();\n'


def _safe_json(content: Any) -> str:
    """Encode as JSON without `<`, so that neither an end tag nor a comment of HTML can be in it."""
    return msgspec.json.encode(content).decode().replace("<", "\\u003c")
