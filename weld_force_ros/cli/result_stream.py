"""Say who has standard output: a command's tables, its rows as CSV, or its JSON lines.

What a command found goes to standard output; progress, warnings and notes go to standard error. Where standard output
is a program's, CSV or JSON, what people read goes to standard error, too.
"""

import os
from typing import IO, Literal, get_args

from weld_force_ros.errors import InputError

Form = Literal["table", "csv", "json"]

_form: Form = "table"
_tables = 0


def form() -> Form:
    """Return in what form standard output holds results."""
    return _form


def choose(name: str) -> None:
    """Choose in what form standard output holds results.

    Raises:
        InputError: there is no such form.
    """
    global _form, _tables
    for known in get_args(Form):
        if name == known:
            _form, _tables = known, 0
            return
    raise InputError(f"--as {name!r} is not known", f"use {', '.join(get_args(Form))}")


def discard(stream: IO[str]) -> None:
    """Send what is written to a stream nowhere from now on: its reader has gone."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def between_tables() -> str:
    """Return what stands before a further table of a command in CSV: an empty line; nothing before the first."""
    global _tables
    _tables += 1
    return "\n" if _tables > 1 else ""
