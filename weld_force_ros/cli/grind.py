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
    prints_results,
    with_option_groups,
)
from weld_force_ros.cli.quantities import length_m
from weld_force_ros.cli.site import with_site
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.assessment.grinding import Adviser
    from weld_force_ros.messages import GrindingAdvice

_MM, _MM2, _KN = 1e3, 1e6, 1e-3
_MOST_MARGIN_M = 1e-3


@dataclass(frozen=True)
class GrinderOptions:
    """The grinder's capabilities."""

    band_limit_m: Annotated[
        float,
        typer.Option(
            "--band-limit", parser=str, callback=length_m, metavar="LENGTH", help="Shortest wavelength that is ground."
        ),
    ] = 0.10
    stone_radius_m: Annotated[
        float,
        typer.Option("--stone-radius", parser=str, callback=length_m, metavar="LENGTH", help="Of the grinding stone."),
    ] = 0.15
    hand_margin_m: Annotated[
        float,
        typer.Option(
            "--hand-margin",
            parser=str,
            callback=length_m,
            metavar="LENGTH",
            help="By how much the depth may come out too large or too small; 0: ground by a machine.",
        ),
    ] = 0.03e-3


@prints_results
@with_site
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
            ("reference kN", "right"), ("search s", "right"), ("what to do", ""),
        ],
        [_row(advice) for advice in found],
    )  # fmt: skip
    spots = [row for advice in found for row in _spot_rows(advice)]
    if spots:
        terminal.table(
            "Where to grind, mm from the weld's centre along x",
            [("weld", ""), ("from", "right"), ("to", "right"), ("side", ""), ("deepest mm", "right"), ("at", "right")],
            spots,
        )
    if not all(advice.reached for advice in found):
        raise typer.Exit(1)


def _adviser(simulation: SimulationOptions, grinder: GrinderOptions, limits: str | None) -> "Adviser":
    from weld_force_ros.assessment.grinding import Adviser
    from weld_force_ros.assessment.grinding_search import Grinder
    from weld_force_ros.assessment.rule_books import load_limits
    from weld_force_ros.cli import terminal

    if not 0.01 <= grinder.band_limit_m <= 2.0:
        raise InputError(f"--band-limit {grinder.band_limit_m:g} m cannot be ground", "give 0.01 to 2 m")
    if not 0 <= grinder.hand_margin_m <= _MOST_MARGIN_M:
        raise InputError(f"--hand-margin {grinder.hand_margin_m * _MM:g} mm is none", "give 0 to 1mm, such as 0.03mm")
    capabilities = Grinder(
        band_limit_m=grinder.band_limit_m,
        stone_radius_m=grinder.stone_radius_m,
        hand_margin_m=grinder.hand_margin_m,
    )
    return Adviser(simulation.settings(), load_limits(limits), capabilities, on_fit=terminal.note)


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


def _spot_rows(advice: "GrindingAdvice") -> list[tuple[str, ...]]:
    from weld_force_ros.assessment.grinding_spots import side_in_words

    return [
        (
            advice.weld_id,
            f"{spot.from_m * _MM:.0f}",
            f"{spot.to_m * _MM:.0f}",
            side_in_words(spot),
            f"{spot.depth_m * _MM:.3f}",
            f"{spot.deepest_m * _MM:.0f}",
        )
        for spot in advice.spots
    ]
