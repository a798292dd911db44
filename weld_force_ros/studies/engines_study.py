"""Study `engines`: peak forces of the fitted engines and of the `reference`, over shapes, speeds and tracks."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Protocol, cast

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros import SOFTWARE
from weld_force_ros._files import write_whole
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.physics.track.causality import acausal
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.settings import ENGINES, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.studies import StartProgress, no_progress
from weld_force_ros.studies.fit_orders import (
    KINK_SPEEDS_KMH,
    ORDERS,
    PAPERS_SECOND_KINK_KMH,
    OrderEffect,
    order_effects,
    order_table,
)
from weld_force_ros.studies.gallery import make_folder
from weld_force_ros.studies.grids import Grid, GridEvaluator, ReferenceGrid, peaks, with_reference
from weld_force_ros.studies.peak_comparison import (
    ComparedPassage,
    PeakDifference,
    difference_table,
    grouped_differences,
    passage_table,
)
from weld_force_ros.studies.reference_peaks import ReferencePeaks
from weld_force_ros.studies.result_table import Cell, Column, Table

FLATS = ("wheel-flat-0.9mm", "wheel-flat-1mm", "wheel-flat-2mm")
_WELDS = (
    "cosine-dip-48mm", "cosine-dip-96mm", "cosine-rise-48mm", "weld-1-dip", "weld-2-rise-between-shrinkages",
    "weld-3-long-ground-dip", "weld-4-steep-ramp", "weld-5-ramp-protrusion",
)  # fmt: skip
_SPEEDS_KMH = (20.0, 40.0, 60.0, 80.0, 100.0, 130.0, 160.0, 200.0, 250.0, 300.0)
# Finer where the force over a flat turns.
_FLAT_SPEEDS_KMH = tuple(sorted((*_SPEEDS_KMH, 30.0, 50.0, 90.0, 180.0)))
GRIDS = (
    Grid("johansson-nielsen", (*FLATS, "protrusion-0.3mm", "long-dip-0.2mm"), _FLAT_SPEEDS_KMH, 5),
    Grid("bilbao-viscous", _WELDS, _SPEEDS_KMH, 5),
    Grid("bilbao", _WELDS, _SPEEDS_KMH, 5),
)
QUICK_GRIDS = (
    Grid("johansson-nielsen", FLATS[:2], (80.0, 120.0, 160.0), 2),
    Grid("bilbao", _WELDS[:1], (120.0,), 2),
)
_QUICK_ORDERS = (8, 12)
_CURVE_STEP_KMH = 5.0
_HYSTERETIC = "bilbao"
_RECEPTANCE_HZ = np.geomspace(10.0, 2500.0, 600)

# Targets for an engine on a track: RMS and largest difference, % of the reference's peak force.
TARGETS = {
    ("johansson-nielsen", "common-poles"): (0.5, 1.2),
    ("johansson-nielsen", "rfp"): (2.0, 5.0),
    ("bilbao-viscous", "common-poles"): (0.6, 1.8),
    ("bilbao-viscous", "rfp"): (2.5, 6.0),
}


@dataclass(frozen=True)
class Outcome:
    """An engine on a track against the reference; no target where there is none to reach."""

    track: str
    engine: str
    passages: int
    passages_not_finite: int
    rms_percent: float
    max_percent: float
    target_rms_percent: float | None
    target_max_percent: float | None
    target_reached: bool | None
    worst_shape: str
    worst_speed_kmh: float
    worst_position_m: float


@dataclass(frozen=True)
class FlatCurve:
    """Largest peak force of all positions against speed, as in the paper's Fig. 8."""

    engine: str
    shape: str
    speeds_kmh: list[float]
    peak_force_n: list[float]


@dataclass(frozen=True)
class PointReceptance:
    """A hysteretic track's receptance at a position, m/N, each (n_frequency,).

    Attributes:
        track: its name.
        at_m: after the sleeper.
        frequency_hz: increasing.
        exact: as the loss factors have it.
        causal: what is left when the response is cut at the impulse.
        contact: compliance of contact spring and wheel, in series with the track.
        engines: as the engines fit it.
    """

    track: str
    at_m: float
    frequency_hz: FloatArray
    exact: ComplexArray
    causal: ComplexArray
    contact: ComplexArray
    engines: dict[str, ComplexArray]


@dataclass(frozen=True)
class EnginesStudy:
    """The results of the study; `tables` by the name of their file."""

    passages: list[ComparedPassage]
    outcomes: list[Outcome]
    flats: list[FlatCurve]
    orders: list[OrderEffect]
    receptances: list[PointReceptance]
    tables: dict[str, Table]


class _ReceptanceModel(Protocol):
    def receptance(self, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray: ...


def run(
    out: Path,
    *,
    quick: bool = False,
    start_progress: StartProgress = no_progress,
    on_fit: Callable[[str], None] | None = None,
) -> EnginesStudy:
    """Compare every engine that can be built with the reference, and write what is found.

    Args:
        out: folder for CSV tables, `engines.json`, and the reference's results, which a second run finds there.
        quick: a small grid, to see whether it works.
        start_progress: starts the display of progress.
        on_fit: called with a sentence if an engine has to fit a track first.

    Raises:
        InputError: the folder cannot be written.
    """
    make_folder(out)
    reference_peaks = ReferencePeaks(out / "reference")
    engines = [engine for engine in ENGINES if engine != "reference"]
    grids = [
        with_reference(grid, reference_peaks, start_progress(f"reference on {grid.track}", len(grid.speeds_kmh)))
        for grid in (QUICK_GRIDS if quick else GRIDS)
    ]
    passages: list[ComparedPassage] = []
    flats: list[FlatCurve] = []
    step = start_progress("fitted engines", len(grids) * len(engines))
    for grid in grids:
        flats += _reference_curves(grid)
        for engine in engines:
            vehicle_track = _simulator(grid.grid.track, engine, on_fit).vehicle_track
            passages += grid.compared(engine, vehicle_track)
            flats += _engine_curves(grid, engine, vehicle_track)
            step()
    orders = order_effects(
        grids,
        reference_peaks,
        start_progress,
        orders=_QUICK_ORDERS if quick else ORDERS,
        speeds_kmh=KINK_SPEEDS_KMH[::8] if quick else KINK_SPEEDS_KMH,
    )
    outcomes = [_outcome(error) for error in grouped_differences(passages, "track", "engine").values()]
    tables = {
        "outcomes": outcome_table(outcomes),
        "errors-by-shape": difference_table("Difference in peak force by shape", passages, "track", "engine", "shape"),
        "errors-by-speed": difference_table("The same by speed", passages, "track", "engine", "speed_kmh"),
        "errors-by-position": difference_table("The same by position", passages, "track", "engine", "position_m"),
        "orders": order_table(orders),
        "flats": _flat_table(flats),
        "passages": passage_table(passages),
    }
    study = EnginesStudy(passages, outcomes, flats, orders, _receptances(engines, on_fit), tables)
    for name, table in tables.items():
        table.write_csv(out / f"{name}.csv")
    _write_summary(study, grids, out / "engines.json")
    return study


def _simulator(track: str, engine: str, on_fit: Callable[[str], None] | None) -> Simulator:
    return Simulator(
        simulation_settings(track=track, engine=engine, contact_patch="off", running="with"), on_fit=on_fit
    )


def _reference_curves(reference: ReferenceGrid) -> list[FlatCurve]:
    grid = reference.grid
    return [
        FlatCurve("reference", shape, list(grid.speeds_kmh), peak_n.max(axis=1).tolist())
        for shape, peak_n in zip(grid.shapes, reference.peak_n, strict=True)
        if shape in FLATS
    ]


def _engine_curves(reference: ReferenceGrid, engine: str, vehicle_track: GridEvaluator) -> list[FlatCurve]:
    grid = reference.grid
    speeds: list[float] = np.arange(grid.speeds_kmh[0], grid.speeds_kmh[-1] + 1, _CURVE_STEP_KMH).tolist()
    return [
        FlatCurve(
            engine, shape, speeds, peaks(vehicle_track, wheel_path, speeds, reference.positions_m).max(axis=1).tolist()
        )
        for shape, wheel_path in zip(grid.shapes, reference.wheel_paths, strict=True)
        if shape in FLATS
    ]


def _receptances(engines: Sequence[str], on_fit: Callable[[str], None] | None) -> list[PointReceptance]:
    """Compute receptances over the sleeper and at mid-span."""
    models = {
        engine: cast(VehicleTrackModel, _simulator(_HYSTERETIC, engine, on_fit).vehicle_track).model
        for engine in engines
    }
    definition = track_file.load(_HYSTERETIC)
    track, contact = definition.track, definition.wheel.compliance(2 * np.pi * _RECEPTANCE_HZ)
    points = []
    for at_m in (0.0, track.spacing_m / 2):
        split = acausal(track, at_m)
        causal = np.interp(_RECEPTANCE_HZ, split.frequency_hz, split.causal)
        fitted = {e: cast(_ReceptanceModel, m).receptance(_RECEPTANCE_HZ, at_m)[0] for e, m in models.items()}
        exact = receptance(track, _RECEPTANCE_HZ, at_m)[0]
        points.append(PointReceptance(track.name, at_m, _RECEPTANCE_HZ, exact, causal, contact, fitted))
    return points


def _outcome(error: PeakDifference) -> Outcome:
    worst = error.worst
    rms, largest = TARGETS.get((worst.track, worst.engine), (None, None))
    reached = None
    if rms is not None and largest is not None:
        reached = error.not_finite == 0 and error.rms_percent <= rms and error.max_percent <= largest
    return Outcome(
        worst.track, worst.engine, error.passages, error.not_finite, error.rms_percent, error.max_percent,
        rms, largest, reached, worst.shape, worst.speed_kmh, worst.position_m,
    )  # fmt: skip


def outcome_table(outcomes: Sequence[Outcome]) -> Table:
    """Return a row for each track and engine, the target beside what was measured."""
    columns = (
        Column("track", "track"),
        Column("engine", "engine"),
        Column("passages"),
        Column("passages_not_finite", "failed"),
        Column("rms_percent", "RMS %", 2),
        Column("max_percent", "max %", 2),
        Column("target_rms_percent", "target RMS", 1),
        Column("target_max_percent", "target max", 1),
        Column("target_reached", "reached"),
        Column("worst_shape"),
        Column("worst_speed_kmh", "at km/h"),
        Column("worst_position_m", "at m", 2),
    )
    return Table("Difference in peak force from the reference", columns, [astuple(o) for o in outcomes])


def _flat_table(curves: Sequence[FlatCurve]) -> Table:
    columns = (
        Column("engine", "engine"),
        Column("shape", "shape"),
        Column("speed_kmh", "km/h"),
        Column("largest_peak_force_n", "largest peak force N", 0),
    )
    rows: list[tuple[Cell, ...]] = [
        (curve.engine, curve.shape, speed, force)
        for curve in curves
        for speed, force in zip(curve.speeds_kmh, curve.peak_force_n, strict=True)
    ]
    return Table("Largest peak force of all positions over wheel flats", columns, rows)


def _write_summary(study: EnginesStudy, grids: Sequence[ReferenceGrid], path: Path) -> None:
    summary = {
        "study": "engines",
        "software": SOFTWARE,
        "grids": [g.grid for g in grids],
        "outcomes": study.outcomes,
        "orders": [
            {
                "track": effect.track,
                "order": effect.order,
                "fit_error_percent": effect.fit_error_percent,
                "peak_rms_percent": effect.error.rms_percent if effect.error else None,
                "peak_max_percent": effect.error.max_percent if effect.error else None,
                "kinks_kmh": effect.kinks_kmh,
            }
            for effect in study.orders
        ],
        "paper_second_kink_kmh": PAPERS_SECOND_KINK_KMH,
    }
    write_whole(path, msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n")
