"""Run `weld-force grind`: the minimum grinding that brings measured welds within their limits."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import (
    Json,
    Limits,
    MeasurementOptions,
    Plot,
    Profiles,
    SimulationOptions,
    with_option_groups,
)
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.assessment.grinding import Adviser
    from weld_force_ros.messages import GrindingAdvice

_MM, _MM2, _KN = 1e3, 1e6, 1e-3


@dataclass(frozen=True)
class GrinderOptions:
    """The grinder's capabilities."""

    band_limit_m: Annotated[float, typer.Option("--band-limit", help="Shortest wavelength that is ground, m.")] = 0.10
    stone_radius_m: Annotated[float, typer.Option("--stone-radius", help="Of the grinding stone, m.")] = 0.15


@with_option_groups()
def grind(
    profiles: Profiles,
    simulation: SimulationOptions,
    grinder: GrinderOptions,
    measurement: MeasurementOptions,
    limits: Limits = None,
    json: Json = None,
    plot: Plot = None,
) -> None:
    """Search the minimum grinding that brings welds within their limits, and check it by the reference engine."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import find, read_profiles
    from weld_force_ros.report import figures

    adviser = _adviser(simulation, grinder, limits)
    form = measurement.form()
    welds = [weld for name in profiles for weld in read_profiles(find(name), form)]
    found = []
    with json_output.lines(json) as out, terminal.progress() as bar:
        for number, profile in enumerate(welds, start=1):
            task = bar.add_task(f"grinding {profile.weld_id}", total=None)
            advice = adviser.advise(profile)
            bar.remove_task(task)
            json_output.write(out, advice)
            found.append(advice)
            if plot:
                picture = plot if len(welds) == 1 else plot.with_stem(f"{plot.stem}-{number}")
                figures.save(figures.grinding(advice), picture)
    terminal.table(
        "Minimum grinding",
        [
            ("weld", ""), ("decision", ""), ("deepest mm", "right"), ("area mm²", "right"), ("peak kN", "right"),
            ("reference kN", "right"), ("s", "right"), ("what to do", ""),
        ],
        [_row(advice) for advice in found],
    )  # fmt: skip
    if not all(advice.reached for advice in found):
        raise typer.Exit(1)


def _adviser(simulation: SimulationOptions, grinder: GrinderOptions, limits: str | None) -> "Adviser":
    from weld_force_ros.assessment.grinding import Adviser
    from weld_force_ros.assessment.grinding_search import Grinder
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal

    if not 0.01 <= grinder.band_limit_m <= 2.0:
        raise InputError(f"--band-limit {grinder.band_limit_m:g} cannot be ground", "give 0.01 to 2 m")
    return Adviser(simulation.settings(), load_limits(limits), Grinder(**vars(grinder)), on_fit=terminal.say)


def _row(advice: "GrindingAdvice") -> tuple[str, ...]:
    reference = advice.reference_peak_n
    return (
        advice.weld_id,
        f"{advice.decision_before} → {advice.decision_after}",
        f"{advice.most_removed_m * _MM:.3f}",
        f"{advice.removed_m2 * _MM2:.1f}",
        f"{max(advice.peak_before_n) * _KN:.0f} → {max(advice.peak_after_n) * _KN:.0f}",
        f"{reference * _KN:.0f}" if isinstance(reference, float) else "",
        f"{advice.elapsed_s:.1f}",
        advice.reason,
    )
