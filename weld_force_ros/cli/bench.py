"""Run `weld-force bench`: the benchmarks of a clone."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

import weld_force_ros
from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, prints_results
from weld_force_ros.errors import InputError


@prints_results
def bench(
    repetitions: Annotated[int, typer.Option(min=1, max=50, help="Interleaved repetitions of each timing.")] = 3,
    quick: Annotated[bool, typer.Option("--quick", help="Without what takes minutes.")] = False,
    json: Json = None,
) -> None:
    """Measure speed and accuracy on this machine, against a general solver in the same run."""
    from weld_force_ros.cli import terminal

    benchmarks = _benchmarks()
    with terminal.notes.status("measuring") as status:
        found = benchmarks.run(repetitions=repetitions, quick=quick, on_step=status.update)
    with json_output.lines(json) as out:
        json_output.write(out, found)
    terminal.table(
        "Benchmark",
        [("what", ""), ("median", "right"), ("least to most", "right")],
        [
            (name, f"{value:.4g}", " to ".join(f"{end:.4g}" for end in found.get(f"{name}_spread", [])))
            for name, value in found.items()
            if not name.endswith("_spread")
        ],
    )


def _benchmarks() -> Any:
    """Import the folder `benchmarks` beside the package, which only a clone has.

    Raises:
        InputError: there is none.
    """
    clone = Path(weld_force_ros.__file__).parents[1]
    if not (clone / "benchmarks" / "__init__.py").is_file():
        raise InputError("benchmarks do not come with the installed package", "run `make bench` in a clone")
    sys.path.insert(0, str(clone))
    return import_module("benchmarks")
