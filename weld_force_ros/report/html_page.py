"""The page itself: one HTML file that asks nothing of any network, or one that a server on the same machine feeds.

Everything a recording says goes into the page as JSON or as text, never as markup, and a Content-Security-Policy
allows exactly the two scripts that stand here, by their hashes: should a name ever become markup, it still cannot run.
"""

import base64
import gzip
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import msgspec

from weld_force_ros.errors import InputError

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
    """The page as HTML; the same for the same arguments.

    Args:
        rows: of `weld_force_ros.report.row`, numbered from 1.
        details: of `weld_force_ros.report.detail`, one for each row.
        title: of the page.
        about: a line below it: where this comes from.
        live: rows and details come from the server that the page is from: it asks for `rows?after=N` twice a second
            and for `weld/N` when a weld is opened. Rows and details given are then shown at once and asked for no more.
        newest: how many rows a live page keeps; None: all.

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
    """A page of this look as HTML, with Plotly in it.

    Args:
        template: of `report/assets`.
        scripts: of the same, in the order of their use.
        title: of the page.
        about: a line below it.
        facts: to be embedded as JSON, whatever they hold.
        rows: likewise.
        live: whether it may ask the server that it is from.
        more: what else the template asks for; becomes text.

    Raises:
        InputError: plotly or jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise _missing("jinja2") from None
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    script = _script(scripts)
    return environment.from_string(_read(template)).render(
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
    scripts = " ".join(f"'sha256-{_sha256(text)}'" for text in (script, _plotly()))
    connect = "; connect-src 'self'" if live else ""
    # Plotly draws with styles on elements and puts maps into pictures of its own.
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:{connect}; "
        "base-uri 'none'; form-action 'none'"
    )


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


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
    """JSON that stays inside its element: it holds no `<`, so neither an end tag nor a comment."""
    return msgspec.json.encode(content).decode().replace("<", "\\u003c")
