"""The effect of the order of `common-poles` on its fit, on peak forces and on kinks of the force-speed curve.

A kink, the paper's sharp angle, is where another peak of the force history becomes the largest: the peak's location
jumps by more than a tenth of the dip. The paper finds the second one of the 48 mm cosine dip, on the continuous track,
at 112 km/h.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.common_poles import PoleModel, fit_track, relative_error
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies import StartProgress
from weld_force_ros.studies.grids import ReferenceGrid, wheel_path
from weld_force_ros.studies.peak_comparison import PeakDifference, peak_difference
from weld_force_ros.studies.reference_peaks import ReferencePeaks
from weld_force_ros.studies.result_table import Cell, Column, Table

ORDERS = (4, 6, 8, 10, 12, 14, 16)
KINK_TRACK = "bilbao-continuous"
KINK_SHAPE = "cosine-dip-48mm"
KINK_LENGTH_M = 0.048
KINK_SPEEDS_KMH = tuple(float(v) for v in range(60, 141))
PAPERS_SECOND_KINK_KMH = 112.0


@dataclass(frozen=True)
class OrderEffect:
    """A track fitted with so many states; no order: the reference.

    Attributes:
        fit_error_percent: relative to what the contact sees, RMS over band and span.
        error: of peak forces; None on the track of the kinks.
        kinks_kmh: on that track only.
    """

    track: str
    order: int | None
    fit_error_percent: float | None
    error: PeakDifference | None
    kinks_kmh: list[float]


def order_effects(
    grids: Sequence[ReferenceGrid],
    reference_peaks: ReferencePeaks,
    start_progress: StartProgress,
    *,
    orders: Sequence[int] = ORDERS,
    speeds_kmh: Sequence[float] = KINK_SPEEDS_KMH,
) -> list[OrderEffect]:
    """Fit every track with every order and compare; the reference's kinks come last.

    Args:
        grids: passages with the reference's peak forces.
        reference_peaks: where the reference's results are stored.
        start_progress: starts the display of progress.
        orders: numbers of states.
        speeds_kmh: at which kinks are looked for.
    """
    effects = []
    step = start_progress("orders of common-poles", len(orders) * (len(grids) + 1))
    for grid in grids:
        for order in orders:
            model, fit_error = _fitted(grid.definition, order)
            error = peak_difference(grid.compared(f"order {order}", VehicleTrackModel(model, grid.definition.wheel)))
            effects.append(OrderEffect(grid.grid.track, order, fit_error, error, []))
            step()
    definition = track_file.load(KINK_TRACK)
    dip = wheel_path(KINK_SHAPE, definition)
    for order in orders:
        model, fit_error = _fitted(definition, order)
        locations_m = VehicleTrackModel(model, definition.wheel).peak_map(dip, speeds_kmh, [0.0]).peak_x_m[:, 0]
        effects.append(OrderEffect(KINK_TRACK, order, fit_error, None, kinks(speeds_kmh, locations_m)))
        step()
    locations_m = _reference_peak_locations(
        definition, reference_peaks, speeds_kmh, start_progress("the reference's kinks", len(speeds_kmh))
    )
    effects.append(OrderEffect(KINK_TRACK, None, None, None, kinks(speeds_kmh, locations_m)))
    return effects


def kinks(speeds_kmh: Sequence[float], peak_x_m: FloatArray, length_m: float = KINK_LENGTH_M) -> list[float]:
    """Return the speeds, halfway between two given ones, at which the peak's location (n_speed,) jumps."""
    speeds = np.asarray(speeds_kmh)
    jumps = np.abs(np.diff(peak_x_m)) > length_m / 10
    halfway: list[float] = ((speeds[:-1] + speeds[1:]) / 2)[jumps].tolist()
    return halfway


def _fitted(definition: TrackDefinition, order: int) -> tuple[PoleModel, float]:
    with threadpool_limits(limits=1, user_api="blas"):
        model = fit_track(definition.track, definition.wheel.compliance, order)
        return model, 100 * relative_error(model, definition.track, definition.wheel.compliance)


def _reference_peak_locations(
    definition: TrackDefinition,
    reference_peaks: ReferencePeaks,
    speeds_kmh: Sequence[float],
    on_speed: Callable[[], object],
) -> FloatArray:
    dip = wheel_path(KINK_SHAPE, definition)
    locations_m = []
    for speed in speeds_kmh:
        locations_m.append(reference_peaks.at_speed(definition, [dip], speed, np.zeros(1))[0, 1, 0])
        on_speed()
    return np.array(locations_m)


def order_table(effects: Sequence[OrderEffect]) -> Table:
    """Return a row for each track and order; the reference's has `reference` as its order."""
    columns = (
        Column("track", "track"),
        Column("order", "order"),
        Column("fit_error_percent", "fit error %", 2),
        Column("peak_rms_percent", "peak RMS %", 2),
        Column("peak_max_percent", "peak max %", 2),
        Column("first_kink_kmh", "1st kink km/h", 1),
        Column("second_kink_kmh", "2nd kink km/h", 1),
    )
    rows: list[tuple[Cell, ...]] = []
    for e in effects:
        peaks = (e.error.rms_percent, e.error.max_percent) if e.error else (None, None)
        first, second = (*e.kinks_kmh, None, None)[:2]
        rows.append((e.track, "reference" if e.order is None else e.order, e.fit_error_percent, *peaks, first, second))
    return Table("Order of common-poles; 48 mm cosine dip on the continuous track: kinks", columns, rows)
