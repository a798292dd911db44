"""JSON lines of a command's results: to standard output, a file, or nowhere."""

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import msgspec

from weld_force_ros._files import writing


@contextlib.contextmanager
def lines(target: str | None) -> Iterator[IO[str] | None]:
    """Where JSON lines go: standard output for `-`, a file, or nowhere."""
    if target is None:
        yield None
    elif target == "-":
        yield sys.stdout
        sys.stdout.flush()
    else:
        with writing(Path(target)) as file:
            yield file


def write(out: IO[str] | None, content: object) -> None:
    """One line, at once; nothing where nobody listens."""
    if out is not None:
        out.write(msgspec.json.encode(content).decode() + "\n")
        out.flush()
