"""Run `weld-force track`: tracks of one's own."""

import hashlib
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, in_existing_folder, prints_results
from weld_force_ros.cli.quantities import length_m, mass_kg
from weld_force_ros.errors import InputError

if TYPE_CHECKING:
    from weld_force_ros.physics.track.beam import Track
    from weld_force_ros.physics.track.causal_twin import CausalTwin
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
_SHOWN_HZ = (1.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
_TWIN_HZ = (5.0, 40.0, 100.0, 300.0, 1200.0, 2501.0)


@app.command()
@prints_results
def identify(
    file: Annotated[
        Path, typer.Argument(help="Measured receptance, mobility or accelerance (CSV, see docs/howto/own-track.md).")
    ],
    like: Annotated[
        str, typer.Option(help="Track, bundled or a file, whose rail, spacing, sleeper and wheel these are.")
    ] = "bilbao-viscous",
    rail: Annotated[str | None, typer.Option(help="Another rail section: 54E1.")] = None,
    spacing: Annotated[
        float | None,
        typer.Option(parser=str, callback=length_m, metavar="600mm", help="Another spacing of the sleepers."),
    ] = None,
    half_sleeper_mass: Annotated[
        float | None,
        typer.Option(parser=str, callback=mass_kg, metavar="150kg", help="Another mass of half a sleeper."),
    ] = None,
    find_sleeper_mass: Annotated[
        bool, typer.Option("--find-sleeper-mass", help="Find the sleeper's mass, too.")
    ] = False,
    damping: Annotated[str, typer.Option(metavar="dashpot|loss-factor", help="Of pads and ballast.")] = "dashpot",
    band: Annotated[str, typer.Option(metavar="FROM:TO", help="Frequencies to use, Hz.")] = "30:1500",
    out: Annotated[Path | None, typer.Option(callback=in_existing_folder, help="Track file (YAML) to write.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=in_existing_folder, help="Picture of both receptances: .png, .svg or .pdf.")
    ] = None,
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
    with terminal.notes.status("identifying"):
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


@app.command()
@prints_results
def causal(
    track: Annotated[str, typer.Argument(help="Track with loss factors: bundled, or a file.")],
    at: Annotated[
        float,
        typer.Option(metavar="HZ", help="Where the springs' stiffness stays what it is; 0: under a resting load."),
    ] = 0.0,
    out: Annotated[Path | None, typer.Option(callback=in_existing_folder, help="Track file (YAML) to write.")] = None,
    json: Json = None,
) -> None:
    """Find the causal track nearest to one with loss factors, which no model in time can have as it is."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.physics.track.beam import StripRail
    from weld_force_ros.physics.track.causal_twin import BAND_HZ, causal_twin
    from weld_force_ros.simulation import track_file
    from weld_force_ros.simulation.causal_track_file import causal_track_text

    if out is not None and out.exists():
        raise InputError(f"{out} is there already", "name another file, or remove it")
    if not 0 <= at <= BAND_HZ[1]:
        raise InputError(f"--at {at:g} Hz", f"give 0 to {BAND_HZ[1]:g} Hz")
    definition = track_file.load(track)
    if definition.track.causal:
        raise InputError(f"track {track} is causal already", "use it as it is")
    if isinstance(definition.track.rail, StripRail):
        raise InputError(f"track {track}: its rail is no beam", "write `model: timoshenko`, and find the twin of that")
    with terminal.notes.status("searching"):
        twin = causal_twin(definition.track, definition.wheel.compliance, at_hz=at)
    with json_output.lines(json) as target:
        json_output.write(target, _twin_content(track, at, twin))
    _show_twin(definition.track, twin)
    if out is not None:
        with json_output.output_file(out) as written:
            written.write(causal_track_text(definition, twin, name=out.stem, at_hz=at))
        terminal.say(f"written: {out}; use it with --track {out}")


def _twin_content(track: str, at_hz: float, twin: "CausalTwin") -> dict[str, object]:
    import numpy as np

    return {
        "track": track,
        "at_hz": at_hz,
        "difference": float(np.sqrt(np.mean(twin.difference**2))),
        "frequency_hz": twin.frequency_hz.tolist(),
        "difference_by_frequency": twin.difference.tolist(),
    }


def _show_twin(track: "Track", twin: "CausalTwin") -> None:
    import numpy as np

    from weld_force_ros.cli import terminal

    for number, (old, new) in enumerate(zip(track.support.springs, twin.track.support.springs, strict=True), 1):
        if new is old:
            continue
        was, now = (spring.dynamic_stiffness(2 * np.pi * np.array(_SHOWN_HZ)) for spring in (old, new))
        terminal.table(
            f"Spring {number} from the rail down",
            [
                ("Hz", "right"),
                ("given kN/mm", "right"),
                ("its loss factor", "right"),
                ("causal kN/mm", "right"),
                ("its loss factor", "right"),
            ],
            [
                (f"{hz:g}", *(text for k in pair for text in (f"{k.real * 1e-6:.4g}", f"{k.imag / k.real:.2f}")))
                for hz, *pair in zip(_SHOWN_HZ, was, now, strict=True)
            ],
        )
    bands = [(low, high, (twin.frequency_hz >= low) & (twin.frequency_hz < high)) for low, high in pairwise(_TWIN_HZ)]
    terminal.table(
        "RMS difference of the receptance, relative to what the contact sees",
        [("band Hz", "right"), ("difference %", "right")],
        [
            (f"{low:g} - {high:g}", f"{100 * np.sqrt(np.mean(twin.difference[own] ** 2)):.1f}")
            for low, high, own in bands
        ]
        + [("all", f"{100 * np.sqrt(np.mean(twin.difference**2)):.1f}")],
    )
    terminal.say(
        "A loss factor that is the same at all frequencies is met by no track that answers after it is pushed."
    )


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
    terminal.table(
        "What was found", [("parameter", ""), ("value", "right"), ("standard error", "right"), ("note", "")], rows
    )
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
            "A track of pad, sleeper and ballast does not follow this measurement: look at its figure (--plot)."
        )
    terminal.say("A hammer finds the unloaded track: pads and ballast are stiffer under a train.")
