"""Studies of this software by command: `weld-force study NAME --out DIR`.

Each study is a module `NAME_study` that computes its data; where drawing takes more than a few lines, `NAME_figures`
beside it draws them. Slow results are stored in the output folder, so that a second run is quick.
"""

from collections.abc import Callable

StartProgress = Callable[[str, int], Callable[[], object]]
"""Called with the name of some work and its number of steps; returns a function to call after each step."""


def no_progress(_name: str, _steps: int) -> Callable[[], object]:
    """Return a function that does nothing: a `StartProgress` for callers that show no progress."""
    return lambda: None
