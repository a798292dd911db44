"""Write a command's results: a text file, and JSON lines to standard output, a file, or nowhere."""

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import msgspec

from weld_force_ros.errors import InputError, os_errors_as


@contextlib.contextmanager
def output_file(path: Path) -> Iterator[IO[str]]:
    """Open a text file that a command writes, in a folder that exists.

    It is written in place, not renamed: it may be a pipe or a device, and somebody may follow it line by line.

    Raises:
        InputError: the place cannot be written.
    """
    with os_errors_as(InputError, path, "name a file in a writable folder"), path.open("w", encoding="utf-8") as file:
        yield file


@contextlib.contextmanager
def lines(target: str | None) -> Iterator[IO[str] | None]:
    """Open the target of JSON lines: standard output for `-`, a file, or nowhere."""
    if target is None:
        yield None
    elif target == "-":
        yield sys.stdout
        sys.stdout.flush()
    else:
        with output_file(Path(target)) as file:
            yield file


def write(out: IO[str] | None, content: object) -> None:
    """Write one line at once, or nothing without a target."""
    if out is not None:
        out.write(msgspec.json.encode(content).decode() + "\n")
        out.flush()
