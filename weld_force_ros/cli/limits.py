"""Run `weld-force limits`: the rule books that welds are judged by, and what each of their numbers rests on."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.json_output import output_file
from weld_force_ros.cli.options import Json, in_existing_folder, prints_results
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.messages import Limit

app = typer.Typer(no_args_is_help=True, help="Rule books: list them, check a file, write one to fill in.")


@app.command("list")
@prints_results
def list_(json: Json = None) -> None:
    """List the bundled rule books, and how many of their numbers stand in a text that was read."""
    from weld_force_ros.assessment.rule_books import bundled, limits_of, read_rule_book, verified_of
    from weld_force_ros.cli import terminal

    rows = []
    with json_output.lines(json) as out:
        for name in bundled():
            book = read_rule_book(name)
            limits = list(limits_of(book))
            numbers = verified_of(limits) if limits else "template: no numbers"
            rows.append((name, book.title, book.state.replace("_", " "), numbers))
            verified = sum(limit.verified for limit in limits)
            json_output.write(
                out,
                {"name": name, "title": book.title, "state": book.state, "limits": len(limits), "verified": verified},
            )
    terminal.table("Rule books", [("name", ""), ("what", ""), ("welds", ""), ("verified", "")], rows)


@app.command()
@prints_results
def check(
    files: Annotated[list[str], typer.Argument(help="Names of rule books, or files.")], json: Json = None
) -> None:
    """Check rule books: show every limit with the line speeds it holds for, and its source."""
    from weld_force_ros.assessment.rule_books import limits_of, load_limits, read_rule_book
    from weld_force_ros.cli import terminal

    for name in files:
        load_limits(name)
    books = {name: read_rule_book(name) for name in files}
    with json_output.lines(json) as out:
        for book in books.values():
            for limit in limits_of(book):
                json_output.write(out, limit)
    for number, (name, book) in enumerate(books.items()):
        if number:
            terminal.say("")
        rows = [_row(limit) for limit in limits_of(book)]
        heads = [("criterion", ""), ("line km/h", ""), ("limit", "right"), ("reject", "right"), ("source", "")]
        terminal.table(f"{name}: {book.title or 'limits'}", heads, rows)


@app.command()
def init(
    file: Annotated[Path, typer.Argument(callback=in_existing_folder, help="The file to write.")],
    like: Annotated[str | None, typer.Option(help="The rule book to begin with; asked for on a terminal.")] = None,
) -> None:
    """Write a rule book to fill in: a copy of a bundled one, under a name of its own."""
    from weld_force_ros.assessment.rule_books import FORCE, bundled, text_of
    from weld_force_ros.cli import terminal

    if file.exists():
        raise InputError(f"{file} is there already", "name another file, or remove it")
    if like is None:
        like = typer.prompt(f"Rule book ({', '.join(bundled())})", default=FORCE) if sys.stdin.isatty() else FORCE
    text = text_of(like, file.stem)
    with output_file(file) as target:
        target.write(text)
    terminal.say(f"written: {file}; judge by it with --limits force,{file}")


def _row(limit: "Limit") -> Sequence[str]:
    reject = "" if limit.beyond == "grind" else _number(limit, limit.reject_limit)
    base = f" on {limit.base_m:g} m" if isinstance(limit.base_m, float) else ""
    name = f"{limit.name}{base}" + ("" if limit.decides is not False else " (informative only)")
    source = limit.source if limit.verified else f"not verified: {limit.source}"
    return name, _line_speeds(limit), _number(limit, limit.limit), reject, source


def _number(limit: "Limit", value: float) -> str:
    from weld_force_ros.report.quantities import UNITS

    if limit.form == "times_static":
        return f"{value:g} × static load"
    factor, unit = UNITS.get(limit.unit, (1.0, limit.unit))
    number = f"{value * factor:g} {unit}"
    return number.rstrip() + (" + static load" if limit.form == "plus_static" else "")


def _line_speeds(limit: "Limit") -> str:
    bounds = (
        (limit.above_kmh, "above"), (limit.from_kmh, "from"), (limit.below_kmh, "below"), (limit.to_kmh, "to"),
    )  # fmt: skip
    return " ".join(f"{word} {bound:g}" for bound, word in bounds if isinstance(bound, float)) or "all"
