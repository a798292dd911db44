"""Write the short tables that notebooks show of an object."""

from collections.abc import Mapping
from html import escape


def table(title: str, facts: Mapping[str, object]) -> str:
    """Return a title and a two-column table as HTML; facts that are None are left out."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(str(value))}</td></tr>"
        for name, value in facts.items()
        if value is not None
    )
    return f"<div><strong>{escape(title)}</strong><table>{rows}</table></div>"
