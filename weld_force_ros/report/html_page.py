"""The report as one HTML file that loads nothing from any network, or that a server on the same machine feeds.

All text of a recording goes into the page as JSON or as text, never as markup, and a Content-Security-Policy allows
exactly two scripts, by their hashes: should a name ever become markup, it still cannot run.
"""

import base64
import gzip
import hashlib
from collections.abc import Iterable, Sequence
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import msgspec

from weld_force_ros.errors import InputError
from weld_force_ros.recording.weld_records import Record
from weld_force_ros.report.table_row import row
from weld_force_ros.report.weld_detail import detail

_SCRIPTS = ("words.js", "source.js", "table.js", "charts.js", "weld.js", "main.js")


def page(
    rows: Sequence[dict[str, Any]],
    details: Sequence[bytes],
    *,
    title: str,
    about: str = "",
    live: bool = False,
    newest: int | None = None,
) -> str:
    """Return the page as HTML; the same for the same arguments.

    Args:
        rows: of `table_row.row`, numbered from 1.
        details: of `weld_detail.detail`, one for each row.
        title: of the page.
        about: a line below the title, such as the source of the welds.
        live: further rows and details come from the page's server: `rows?after=N` is requested twice a second, and
            `weld/N` when a weld is opened whose details the page does not hold.
        newest: number of rows that a live page keeps; None keeps all.

    Raises:
        InputError: plotly or jinja2 is not installed.
    """
    return self_contained(
        "page.html",
        _SCRIPTS,
        title=title,
        about=about,
        live=live,
        facts={"live": live, "title": title, "newest": newest},
        rows=list(rows),
        details=[
            {"number": r["n"], "packed": base64.b64encode(d).decode()} for r, d in zip(rows, details, strict=True)
        ],
    )


def page_of_records(records: Iterable[Record], *, about: str) -> str:
    """Return the page of welds and rejections as HTML.

    Args:
        records: in the order of their rows.
        about: a line below the title, such as the source of the welds.

    Raises:
        InputError: plotly or jinja2 is not installed.
    """
    rows, details = [], []
    for number, record in enumerate(records, start=1):
        rows.append(row(number, record))
        details.append(detail(record))
    return page(rows, details, title="Rail welds", about=about)


def self_contained(
    template: str,
    scripts: tuple[str, ...],
    *,
    title: str,
    about: str,
    facts: dict[str, Any],
    rows: list[dict[str, Any]],
    live: bool = False,
    **more: Any,
) -> str:
    """Return a page with the report's styles and Plotly in it as HTML.

    Args:
        template: file in `report/assets`.
        scripts: files in `report/assets`, in the order of their use.
        title: of the page.
        about: a line below the title.
        facts: embedded as JSON, with any content.
        rows: embedded as JSON, with any content.
        live: the page may send requests to the server that it came from.
        more: further variables of the template, inserted as text.

    Raises:
        InputError: plotly or jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise _missing("jinja2") from None
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_read), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    script = _script(scripts)
    return environment.get_template(template).render(
        title=title,
        about=about,
        policy=_policy(script, live),
        style=_read("page.css"),
        script=script,
        facts=_safe_json(facts),
        rows=_safe_json(rows),
        plotly=_plotly_packed(),
        **more,
    )


def _policy(script: str, live: bool) -> str:
    hashes = (hashlib.sha256(text.encode()).digest() for text in (script, _plotly()))
    scripts = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in hashes)
    connect = "; connect-src 'self'" if live else ""
    # Plotly draws with styles on elements and puts maps into pictures of its own.
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:{connect}; "
        "base-uri 'none'; form-action 'none'"
    )


@cache
def _script(scripts: tuple[str, ...]) -> str:
    parts = "\n".join(_read(name) for name in scripts)
    return f'"use strict";\n(() => {{\n{parts}\n}})();\n'


@cache
def _plotly() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise _missing("plotly") from None
    text: str = get_plotlyjs()
    return text


@cache
def _plotly_packed() -> str:
    return base64.b64encode(gzip.compress(_plotly().encode(), mtime=0)).decode()


def _missing(package: str) -> InputError:
    return InputError(f"the report needs {package}", "install it with `pip install 'weld_force_ros[report]'`")


def _read(name: str) -> str:
    folder: Traversable = resources.files("weld_force_ros.report") / "assets"
    return (folder / name).read_text(encoding="utf-8")


def _safe_json(content: Any) -> str:
    """Encode as JSON without `<`, so that neither an end tag nor a comment of HTML can be in it."""
    return msgspec.json.encode(content).decode().replace("<", "\\u003c")
