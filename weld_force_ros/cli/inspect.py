"""Run `weld-force inspect`: what is understood of measurement files."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, MeasurementOptions, prints_results, with_option_groups
from weld_force_ros.cli.site import with_site
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.measurement.profile_file import Understood
    from weld_force_ros.messages import WeldProfile

Files = Annotated[list[str], typer.Argument(help="Measurement files, or names of bundled profiles.")]


@prints_results
@with_site
@with_option_groups()
def inspect(files: Files, measurement: MeasurementOptions, json: Json = None) -> None:
    """Show what is understood of measurement files: format, units, welds, noise, wrong samples, and a small plot."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.profile_file import find, inspect_file

    form, unreadable = measurement.form(), 0
    with json_output.lines(json) as out:
        for name in files:
            try:
                found = inspect_file(find(name), form)
            except InputError as error:
                unreadable += 1
                json_output.write(out, {"source": Path(name).name, "problems": [str(error)]})
                terminal.note(f"weld-force: {error}")
                continue
            for understood in found:
                json_output.write(out, as_json(understood))
                _show(understood)
    if unreadable:
        raise typer.Exit(2)


def as_json(understood: "Understood") -> dict[str, Any]:
    """Return what is understood of a weld, as `design.md` lays it down."""
    from weld_force_ros.messages import MeasurementNoise, known

    profile = understood.profile
    noise = known(profile.noise) or MeasurementNoise(method="none", noise_m=0.0)
    return {
        "source": profile.source,
        "weld_id": profile.weld_id,
        "format": known(profile.format),
        "samples": understood.samples,
        "spacing_m": round(understood.spacing_m, 9),
        "resolution_m": known(noise.resolution_m),
        "noise_m": noise.noise_m,
        "form_error_m": None if (error := known(noise.form_error)) is None else error.deviation_m,
        "outliers": noise.outliers_m,
        "conditioning": profile.conditioning,
        "problems": [],  # of a file that can be used; why another cannot stands here
    }


def _show(understood: "Understood") -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.report.terminal_plot import profile_plot

    profile, found = understood.profile, as_json(understood)
    rows = [
        ("format", found["format"]),
        ("samples", f"{understood.samples}, usually {understood.spacing_m * 1e3:.4g} mm apart"),
        ("record", f"{profile.x_m[0] * 1e3:.4g} to {profile.x_m[-1] * 1e3:.4g} mm about the weld's centre"),
        ("heights", f"{min(profile.z_m) * 1e3:.3f} to {max(profile.z_m) * 1e3:.3f} mm, up positive"),
        ("written in steps of", _micrometres(found["resolution_m"])),
        ("measurement noise", f"{_micrometres(found['noise_m'])}, standard deviation; taken out" if found["noise_m"]
         else "none: samples taken as they are"),
        ("instrument's form error", _form_error(profile)),
        ("wrong samples", f"{len(found['outliers'])} set aside" if found["outliers"] else "none"),
        *(("done", step) for step in profile.conditioning),
    ]  # fmt: skip
    terminal.table(f"{profile.source}: {profile.weld_id}", [("what", ""), ("understood", "")], rows)
    width = min(terminal.width(), 100)
    terminal.say(profile_plot(profile, width=width, unicode=terminal.can_draw()))


def _form_error(profile: "WeldProfile") -> str:
    from weld_force_ros.messages import known

    noise = known(profile.noise)
    error = noise and known(noise.form_error)
    if not error:
        return "not stated: not counted" if noise and noise.noise_m else "none"
    return f"{_micrometres(error.deviation_m)} over {error.length_m:g} m, counted in intervals; {error.source}"


def _micrometres(metres: float | None) -> str:
    return "none found" if not metres else f"{metres * 1e6:.3g} um"
