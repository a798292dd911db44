"""Run `weld-force benchmark`: the software against what others published."""

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, prints_results


@prints_results
def benchmark(json: Json = None) -> None:
    """Compare with published numbers, formulas and closed forms; exit code 1 if one differs by more than allowed."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.studies import benchmark_study

    with terminal.notes.status("comparing"):
        found = list(benchmark_study.run())
    with json_output.lines(json) as out:
        for one in found:
            json_output.write(out, one)
    terminal.show_table(benchmark_study.table(found))
    for source in dict.fromkeys(one.source for one in found):
        terminal.say_wrapped(source)
    outside = [one for one in found if one.within is False]
    compared = sum(one.within is not None for one in found)
    left = len(found) - compared
    terminal.say(f"{compared - len(outside)} of {compared} within what is allowed, {left} not compared")
    if outside:
        raise typer.Exit(1)
