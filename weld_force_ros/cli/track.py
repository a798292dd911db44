"""Run `weld-force track`: tracks of one's own."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.physics.track.identification import Identified, MeasuredReceptance
    from weld_force_ros.simulation.identified_track import Basis

app = typer.Typer(
    no_args_is_help=True, help="Tracks of one's own: identify one from its measured receptance.", rich_markup_mode=None
)

_WORDS = {
    "pad_n_per_m": ("pad stiffness", "kN/mm", 1e-6),
    "pad_ns_per_m": ("pad dashpot", "kNs/m", 1e-3),
    "pad_loss_factor": ("pad loss factor", "", 1.0),
    "ballast_n_per_m": ("ballast stiffness", "kN/mm", 1e-6),
    "ballast_ns_per_m": ("ballast dashpot", "kNs/m", 1e-3),
    "ballast_loss_factor": ("ballast loss factor", "", 1.0),
    "half_sleeper_kg": ("half a sleeper", "kg", 1.0),
}
_POOR_MISFIT = 0.25


@app.callback()
def tracks() -> None:
    """Keep `identify` a command of its own beside those to come."""


@app.command()
def identify(
    file: Annotated[Path, typer.Argument(help="Measured receptance, mobility or accelerance (CSV, see the README).")],
    like: Annotated[
        str, typer.Option(help="Track, bundled or a file, whose rail, spacing, sleeper and wheel these are.")
    ] = "bilbao-viscous",
    rail: Annotated[str | None, typer.Option(help="Another rail section: 54E1.")] = None,
    spacing: Annotated[float | None, typer.Option(help="Another spacing of the sleepers, m.")] = None,
    half_sleeper_mass: Annotated[float | None, typer.Option(help="Another mass of half a sleeper, kg.")] = None,
    find_sleeper_mass: Annotated[
        bool, typer.Option("--find-sleeper-mass", help="Find the sleeper's mass, too.")
    ] = False,
    damping: Annotated[str, typer.Option(metavar="dashpot|loss-factor", help="Of pads and ballast.")] = "dashpot",
    band: Annotated[str, typer.Option(metavar="FROM:TO", help="Frequencies to use, Hz.")] = "30:1500",
    out: Annotated[Path | None, typer.Option(help="Track file (YAML) to write.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of both receptances: .png, .svg or .pdf.")] = None,
    json: Json = None,
) -> None:
    """Identify pads and ballast of a track from its measured receptance, as hammer tests give it."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.measurement.receptance_file import read_receptance
    from weld_force_ros.physics.track import identification
    from weld_force_ros.simulation import identified_track

    if damping not in get_args(identification.Damping):
        raise InputError(f"--damping {damping!r} is not known", "use dashpot or loss-factor")
    if out is not None and out.exists():
        raise InputError(f"{out} is there already", "name another file, or remove it")
    measured = read_receptance(file)
    used = _within(measured, band, file)
    base = identified_track.basis(like, rail, spacing)
    mass_kg = _mass(base, like) if half_sleeper_mass is None else half_sleeper_mass
    if not 5.0 < mass_kg < 1000.0:
        raise InputError(f"--half-sleeper-mass {mass_kg:g}", "give 5 to 1000 kg")
    with terminal.console.status("identifying"):
        found = identification.identify(
            used, base.definition.track.rail, base.definition.track.spacing_m,
            half_sleeper_kg=mass_kg, find_sleeper=find_sleeper_mass,
            damping=cast(identification.Damping, damping),
        )  # fmt: skip
    with json_output.lines(json) as target:
        json_output.write(target, _content(file, used, found))
    _show(measured, used, found)
    if plot is not None:
        from weld_force_ros.report import figures
        from weld_force_ros.report.identification_figure import identification_figure

        figures.save(identification_figure(measured, used, found, file.name), plot)
    if out is not None:
        digest = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
        text = identified_track.track_text(
            found, base, name=out.stem,
            measurement=f"{file.name} (sha256 {digest}), {used.frequency_hz[0]:g} to {used.frequency_hz[-1]:g} Hz",
            kept_mass_source=f"as on {like}" if half_sleeper_mass is None else "stated by the user",
        )  # fmt: skip
        with json_output.output_file(out) as written:
            written.write(text)
        terminal.say(f"written: {out}; use it with --track {out}")


def _within(measured: "MeasuredReceptance", band: str, file: Path) -> "MeasuredReceptance":
    """Return what was measured in a band.

    Raises:
        InputError: no band, or too little in it.
    """
    from weld_force_ros.measurement.receptance_file import LEAST_FREQUENCIES

    try:
        least_hz, most_hz = (float(part) for part in band.split(":"))
    except ValueError:
        raise InputError(f"--band {band!r} cannot be read", "write FROM:TO in Hz, such as 30:1500") from None
    if not 0 < least_hz < most_hz:
        raise InputError(f"--band {band}: no band of positive frequencies", "write FROM:TO in Hz, such as 30:1500")
    used = measured.within(least_hz, most_hz)
    if len(used.frequency_hz) < LEAST_FREQUENCIES:
        raise InputError(
            f"{file}: {len(used.frequency_hz)} frequencies of {least_hz:g} to {most_hz:g} Hz",
            f"give another --band: {LEAST_FREQUENCIES} are needed",
        )
    return used


def _mass(base: "Basis", like: str) -> float:
    """Return the mass of half a sleeper of a track on sleepers.

    Raises:
        InputError: the track has other supports.
    """
    support = base.definition.track.support
    if base.definition.track.continuous or len(support.masses_kg) != 1:
        raise InputError(f"track {like} has no sleepers between pad and ballast", "give --half-sleeper-mass")
    return support.mass_kg


def _content(file: Path, used: "MeasuredReceptance", found: "Identified") -> dict[str, object]:
    from weld_force_ros.physics.track.identification import misfit

    return {
        "file": file.name,
        "frequencies": len(used.frequency_hz),
        "scatter": found.scatter,
        "misfit": dict(zip(used.at_spans.tolist(), misfit(used, found.track).tolist(), strict=True)),
        "parameters": {
            one.name: {"value": one.value, "standard_error": one.standard_error, "at_bound": one.at_bound}
            for one in found.estimates
        },
    }


def _show(measured: "MeasuredReceptance", used: "MeasuredReceptance", found: "Identified") -> None:
    from weld_force_ros.cli import terminal
    from weld_force_ros.physics.track.identification import BANDS_HZ, misfit

    rows = []
    for one in found.estimates:
        words, unit, size = _WORDS[one.name]
        note = "not told by the measurement" if one.at_bound or one.standard_error > 0.5 else ""
        rows.append((words, f"{one.value * size:.4g} {unit}".rstrip(), f"{100 * one.standard_error:.2g} %", note))
    terminal.table("What was found", [("", ""), ("value", "right"), ("standard error", "right"), ("", "")], rows)
    places = ["mid-span" if at else "over a sleeper" for at in used.at_spans]
    bands = [(low, high, measured.within(low, high)) for low, high in BANDS_HZ]
    terminal.table(
        "RMS misfit, % of the measured receptance",
        [("band Hz", "right"), *((place, "right") for place in places)],
        [
            (f"{part.frequency_hz[0]:g} - {part.frequency_hz[-1]:g}",
             *(f"{100 * share:.1f}" for share in misfit(part, found.track)))
            for _, _, part in bands if len(part.frequency_hz)
        ]
        + [("used", *(f"{100 * share:.1f}" for share in misfit(used, found.track)))],
    )  # fmt: skip
    if misfit(used, found.track).max() > _POOR_MISFIT:
        terminal.say(
            "A track of pad, sleeper and ballast does not follow this measurement: look at its figure (--plot)"
        )
    terminal.say("A hammer finds the unloaded track: pads and ballast are stiffer under a train")
