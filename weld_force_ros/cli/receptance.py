"""Run `weld-force receptance`: point receptances of the rail."""

import cmath
import math
from typing import Annotated

import typer

from weld_force_ros.cli import json_output
from weld_force_ros.cli.options import Json, Track, prints_results
from weld_force_ros.errors import InputError


@prints_results
def receptance(
    at: Annotated[str, typer.Option(help="Metres after the sleeper: 0.0,0.30.")] = "0.0",
    freq: Annotated[str, typer.Option(help="Frequencies in Hz: 50,100,200.")] = "50,100,200,500,1000",
    track: Track = None,
    engine: Annotated[str, typer.Option(help="exact, or an engine's fit.")] = "exact",
    json: Json = None,
) -> None:
    """Compute point receptances of the rail: exact, or as an engine fits them."""
    from weld_force_ros.cli import terminal
    from weld_force_ros.simulation import track_file
    from weld_force_ros.simulation.receptances import point_receptance
    from weld_force_ros.simulation.settings import DEFAULT_TRACK

    at_m, frequency_hz = _numbers("--at", at), _numbers("--freq", freq)
    if min(frequency_hz) <= 0:
        raise InputError(f"--freq {freq}: a frequency is not positive", "give frequencies in Hz above 0")
    definition = track_file.load(track or DEFAULT_TRACK)
    with terminal.notes.status("computing receptances"):  # of a rail by strips, seconds
        h = point_receptance(definition, frequency_hz, at_m, engine=engine, on_fit=terminal.note)
    with json_output.lines(json) as out:
        json_output.write(
            out,
            {
                "track": definition.track.name,
                "engine": engine,
                "at_m": at_m,
                "frequency_hz": frequency_hz,
                "real_m_per_n": h.real.ravel().tolist(),
                "imag_m_per_n": h.imag.ravel().tolist(),
            },
        )
    terminal.table(
        f"Receptance of {definition.track.name} ({engine}): magnitude and phase",
        [("Hz", "right")] + [(text, "right") for x in at_m for text in (f"m/N at {x:g} m", "phase °")],
        [
            [f"{f:g}", *(text for v in h[:, k] for text in (f"{abs(v):.4g}", f"{math.degrees(cmath.phase(v)):.1f}"))]
            for k, f in enumerate(frequency_hz)
        ],
    )  # fmt: skip


def _numbers(option: str, text: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(math.isfinite(number) for number in numbers):
        raise InputError(f"{option} {text!r} cannot be read", "write numbers with commas between, such as 0.0,0.30")
    return numbers
