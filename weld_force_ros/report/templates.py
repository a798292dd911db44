"""Fill the report's templates: everything is escaped but what a template names as markup of ours."""

from functools import cache, partial
from importlib import resources
from importlib.resources.abc import Traversable
from typing import TYPE_CHECKING, Any

from weld_force_ros._words import Words
from weld_force_ros.errors import InputError
from weld_force_ros.report.quantities import kilonewtons, probability

if TYPE_CHECKING:
    import jinja2
    import markupsafe

SIGNS = {"reject": "✕", "grind": "◐", "undecided": "?", "unusable": "!", "accept": "✓"}
"""What marks a decision beside its colour, the worst first."""


def read_asset(name: str) -> str:
    """Return the text of a file of `report/assets`."""
    folder: Traversable = resources.files("weld_force_ros.report") / "assets"
    return (folder / name).read_text(encoding="utf-8")


def render(template: str, words: Words, **values: Any) -> str:
    """Return a template of `report/assets` filled in; `t` in it are the words.

    Raises:
        InputError: jinja2 is not installed.
    """
    return _environment(words).get_template(template).render(**values)


@cache
def _environment(words: Words) -> "jinja2.Environment":
    try:
        import jinja2
    except ImportError:
        raise InputError("the report needs jinja2", "install it with `pip install 'weld_force_ros[report]'`") from None
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(read_asset), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    environment.globals.update(
        t=words, signs=SIGNS, code=_code, kilonewtons=kilonewtons, probability=partial(probability, words=words)
    )
    return environment


def _code(text: str) -> "markupsafe.Markup":
    """Return text whose commands stand between backticks as markup, all of it escaped."""
    from markupsafe import Markup, escape

    parts = (f"<code>{escape(part)}</code>" if i % 2 else escape(part) for i, part in enumerate(text.split("`")))
    return Markup("".join(parts))  # noqa: S704 - each part is escaped
