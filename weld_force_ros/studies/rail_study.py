"""Study `rail`: a beam and a rail by 2.5-D finite elements (SAFE) on the same track, under the same welds."""

from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from weld_force_ros.measurement import profile_file
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.track import beam as beam_track
from weld_force_ros.physics.track import waveguide_rail
from weld_force_ros.physics.track.beam import Rail, StripRail
from weld_force_ros.simulation import fit_store, section_file, track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies import rail_figures
from weld_force_ros.studies.rail_figures import RailForces
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import DIP_48, WELDS, Quantities, StudyResult, as_rows

HIGHEST_HZ = 5000.0
DIFFERENCES = (0.05, 0.10, 0.20)
SHAPES_HZ = (1000.0, 4800.0)
_SPANS = (0.0, 0.25, 0.5)
_STEP_HZ = 10.0
_BELOW_HZ = 500.0
_BENDING_HZ = 300.0


def with_waveguide(definition: TrackDefinition, section: str) -> TrackDefinition:
    """Return the same track, its rail by 2.5-D finite elements; named by the section, so that its fit is found.

    Raises:
        TrackError: there is no bundled section of that name, or its outline is not known.
    """
    track = definition.track
    rail = StripRail(**asdict(_beam_of(track.rail)), section=section_file.outline_of(section))
    return replace(definition, track=replace(track, name=f"{track.name}, rail {section}", rail=rail))


def with_beam(definition: TrackDefinition) -> TrackDefinition:
    """Return the same track, its rail a beam and its pads points."""
    track = replace(definition.track, rail=_beam_of(definition.track.rail), pad_width_m=0.0)
    return replace(definition, track=track)


def _beam_of(rail: Rail) -> Rail:
    return Rail(**{name: getattr(rail, name) for name in Rail.__dataclass_fields__})


def run(
    track: str,
    section: str,
    *,
    coarse: bool = False,
    start_progress: Callable[[str, int], Callable[[], None]],
    on_fit: Callable[[str], None],
) -> StudyResult:
    """Compute waves, receptances and peak forces of both rails.

    Args:
        track: name or file; a rail by finite elements in it is compared as it is.
        section: name of a cross-section, for a track whose rail is a beam.
        coarse: fewer frequencies, speeds and positions.
        start_progress: starts the display of progress.
        on_fit: called with a sentence if a fit has to be made.

    Raises:
        TrackError: a track or section that cannot be used.
    """
    given = track_file.load(track)
    beam = with_beam(given)
    waveguide = given
    if not isinstance(given.track.rail, StripRail):
        waveguide = with_waveguide(given, section)
    frequency_hz = np.arange(_STEP_HZ, HIGHEST_HZ + 1, _STEP_HZ * (5 if coarse else 1))
    advance = start_progress("waves and receptances", 4)
    waves = {name: _wavenumbers(one.track.rail, frequency_hz) for name, one in _both(beam, waveguide)}
    advance()
    at_m = np.array(_SPANS) * beam.track.spacing_m
    receptances = {}
    for name, one in _both(beam, waveguide):
        receptances[name] = beam_track.receptance(one.track, frequency_hz, at_m)
        advance()
    shapes = _shapes(waveguide.track.rail)
    advance()
    forces = _forces(beam, waveguide, coarse, start_progress, on_fit)
    pictures = [
        rail_figures.dispersion(frequency_hz, waves),
        rail_figures.receptances(frequency_hz, at_m, receptances),
        rail_figures.differences(frequency_hz, at_m, receptances),
        rail_figures.peak_forces(forces),
        rail_figures.wave_shapes(shapes),
    ]
    tables = {
        "differences": _difference_table(frequency_hz, at_m, receptances),
        "forces": _force_table(forces),
        "receptance": _receptance_table(frequency_hz, at_m, receptances),
    }
    measured = _claim_quantities(beam, waveguide, frequency_hz, receptances, forces)
    return StudyResult("rail", f"Beam and 2.5-D finite elements: {given.track.name}", pictures, tables, measured)


def _both(beam: TrackDefinition, waveguide: TrackDefinition) -> tuple[tuple[str, TrackDefinition], ...]:
    return ("beam", beam), ("waveguide", waveguide)


def _wavenumbers(rail: Rail, frequency_hz: FloatArray) -> FloatArray:
    """Return wavenumbers (n_wave, n_frequency) of the free rail's travelling waves, without loss; NaN if they decay."""
    decay = beam_track.free_decay(replace(rail, loss_factor=0.0), frequency_hz)
    return np.where(np.abs(decay.real) <= 1e-6 * np.abs(decay), np.abs(decay.imag), np.nan)


def _shapes(rail: Rail) -> list[rail_figures.Shape]:
    """Return waves of the cross-section at some frequencies."""
    if not isinstance(rail, StripRail):
        raise TypeError("a beam has no waves of a cross-section")
    free = waveguide_rail.rail(rail.section, rail.wear_m, rail.steel, refine=1)  # elements that can be seen
    return [rail_figures.Shape(hz, wave, free.mesh) for hz in SHAPES_HZ for wave in free.travelling(hz)]


def _forces(
    beam: TrackDefinition,
    waveguide: TrackDefinition,
    coarse: bool,
    start_progress: Callable[[str, int], Callable[[], None]],
    on_fit: Callable[[str], None],
) -> list[RailForces]:
    """Simulate the paper's five welds and its shorter dip on both tracks by the same engine."""
    speeds = np.arange(20.0, 301.0, 15.0 if coarse else 5.0)
    positions = np.arange(5 if coarse else 15) * beam.track.spacing_m / (5 if coarse else 15)
    names = (*WELDS, DIP_48)
    advance = start_progress("peak forces", len(names) + 1)
    vehicle_tracks = {
        name: VehicleTrackModel(fit_store.fitted(one, on_fit=on_fit).model(), one.wheel)
        for name, one in _both(beam, waveguide)
    }
    advance()
    forces = []
    for name in names:
        profile = profile_file.read_profile(profile_file.find(name))
        wheel_path = wheel_path_over(np.array(profile.x_m), np.array(profile.z_m), beam.wheel.radius_m)
        beam_map, waveguide_map = (
            vehicle_tracks[rail].peak_map(wheel_path, speeds, positions) for rail in ("beam", "waveguide")
        )
        forces.append(RailForces(name, speeds, beam_map, waveguide_map))
        advance()
    return forces


def _difference_table(frequency_hz: FloatArray, at_m: FloatArray, receptances: dict[str, ComplexArray]) -> Table:
    difference = np.abs(receptances["waveguide"] / receptances["beam"] - 1)
    columns = [Column("at_m", "after the sleeper, m", 2), Column("below_500hz", "largest below 500 Hz, %", 1)]
    columns += [
        Column(f"over_{share * 100:g}_percent_hz", f"first over {share * 100:g} %, Hz", 0) for share in DIFFERENCES
    ]
    rows: list[tuple[Cell, ...]] = []
    for x, row in zip(at_m.tolist(), difference, strict=True):
        largest = float(row[frequency_hz < _BELOW_HZ].max()) * 100
        rows.append((x, largest, *(_first_over(frequency_hz, row, share) for share in DIFFERENCES)))
    return Table("Where the receptances differ", tuple(columns), rows)


def _first_over(frequency_hz: FloatArray, difference: FloatArray, share: float) -> float | None:
    over = np.flatnonzero(difference > share)
    return float(frequency_hz[over[0]]) if len(over) else None


def _force_table(forces: list[RailForces]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for one in forces:
        row, column = np.unravel_index(np.argmax(np.abs(one.difference)), one.difference.shape)
        beam, waveguide = one.worst
        rows.append(
            (one.weld, float(beam.max()) / 1e3, float(waveguide.max()) / 1e3,
             float(np.abs(waveguide / beam - 1).max()) * 100, float(np.sqrt(np.mean(one.difference**2))) * 100,
             float(one.difference[row, column]) * 100, float(one.speeds_kmh[row]))
        )  # fmt: skip
    return Table(
        "Peak forces with beam and finite elements",
        (Column("weld", "weld"), Column("beam_kn", "beam, kN", 1), Column("waveguide_kn", "finite elements, kN", 1),
         Column("worst_position_percent", "worst position, at most %", 2),
         Column("rms_percent", "all passages, RMS %", 2),
         Column("largest_percent", "largest, %", 2), Column("largest_at_kmh", "at km/h", 0)),
        rows,
    )  # fmt: skip


def _receptance_table(frequency_hz: FloatArray, at_m: FloatArray, receptances: dict[str, ComplexArray]) -> Table:
    columns = [Column("frequency_hz", "Hz", 0)]
    columns += [Column(f"{name}_at_{x * 100:.0f}_cm_m_per_n") for name in receptances for x in at_m]
    magnitudes = [np.abs(row) for rows in receptances.values() for row in rows]
    return Table("Magnitude of receptance", tuple(columns), as_rows(frequency_hz, *magnitudes))


def _claim_quantities(
    beam: TrackDefinition,
    waveguide: TrackDefinition,
    frequency_hz: FloatArray,
    receptances: dict[str, ComplexArray],
    forces: list[RailForces],
) -> Quantities:
    difference = np.abs(receptances["waveguide"] / receptances["beam"] - 1)
    static = {
        name: beam_track.static_compliance(one.track, np.array(_SPANS) * one.track.spacing_m)
        for name, one in _both(beam, waveguide)
    }
    decay = {name: beam_track.free_decay(one.track.rail, _BENDING_HZ)[:, 0] for name, one in _both(beam, waveguide)}
    bending = {
        name: float(np.abs(rows[np.abs(rows.real) < np.abs(rows.imag)].imag).max()) for name, rows in decay.items()
    }
    return {
        "rail.static_ratio": (static["waveguide"] / static["beam"]).tolist(),
        "rail.largest_difference_below_500hz": float(difference[:, frequency_hz < _BELOW_HZ].max()),
        "rail.bending_wavenumber_ratio_300hz": bending["waveguide"] / bending["beam"],
        **{f"rail.peak_rms.{one.weld}": float(np.sqrt(np.mean(one.difference**2))) for one in forces},
        **{f"rail.peak_largest.{one.weld}": float(np.abs(one.difference).max()) for one in forces},
    }
