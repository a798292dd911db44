"""Investigations of this software by command: `weld-force study NAME --out DIR`.

Each study is a module that computes and writes its data (tables, a summary), and a module `NAME_figures` beside it that
draws them and alone needs matplotlib. What takes long is kept in the output folder, so that a second run is quick.
"""

from collections.abc import Callable

Stage = Callable[[str, int], Callable[[], object]]
"""Called with the name of a stage and its number of steps; gives what is to be called after each step."""


def no_progress(_name: str, _steps: int) -> Callable[[], object]:
    """A `Stage` that nobody looks at."""
    return lambda: None
