"""The synthetic population simulated: every weld's geometry and force-speed curves, and dips upside down."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.measurement.synthetic_welds import SyntheticWeld
from weld_force_ros.physics.analysis.geometry import Geometry, classify, quality_index
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.studies.passage_curves import SmoothRailPassage, features
from weld_force_ros.studies.study_context import BILBAO, StudyContext

POSITIONS_M = np.array([0.0, 0.30])
KINDS = ("dip", "protrusion")
THIRDS = ("smoothest third", "middle third", "roughest third")
_QUARTILES = (0.25, 0.5, 0.75)
_FREQUENCIES = 25
_SPAN_SAMPLES = 2401
_LINE_SPEED_KMH = 200.0  # any: only gradients are compared


@dataclass(frozen=True)
class CurveShape:
    """The shape of a force-speed curve at one position.

    Attributes:
        monotonic: whether it has no local minimum.
        fall: depth of its deepest local minimum, of the curve's largest less smallest force; 0 without one.
        linearity: R² of the least-squares line.
    """

    monotonic: bool
    fall: float
    linearity: float


@dataclass(frozen=True)
class SimulatedWeld:
    """A weld, its geometry's class, and its peak forces.

    Attributes:
        weld: as it was made.
        wheel_path: the wheel centre's, over it.
        geometry: its class.
        gradient_rad: largest gradient, of the quality index.
        third: of the population, by that gradient: 0 the smoothest, 2 the roughest.
        peak_map: peak forces and their locations.
        curves: one at each position.
    """

    weld: SyntheticWeld
    wheel_path: WheelPath
    geometry: Geometry
    gradient_rad: float
    third: int
    peak_map: PeakMap
    curves: list[CurveShape]


@dataclass(frozen=True)
class InvertedDips:
    """Peak forces over dips and over the same shapes upside down.

    Attributes:
        dip_n: (n_weld, n_speed, n_position), dynamic peak force over the dip.
        rise_n: the same over its inversion.
        becomes_protrusion: (n_weld,), whether the inversion is of the other class.
        frequency_hz: (n_weld, n_speed), of passing the main wave.
    """

    dip_n: FloatArray
    rise_n: FloatArray
    becomes_protrusion: NDArray[np.bool_]
    frequency_hz: FloatArray


def simulate_welds(context: StudyContext, speeds_kmh: FloatArray, welds: list[SyntheticWeld]) -> list[SimulatedWeld]:
    """Simulate welds at every speed and position."""
    wheel_paths = [context.wheel_path((weld.x_m, weld.z_m), BILBAO) for weld in welds]
    peak_maps = context.vehicle_track(BILBAO).peak_maps(wheel_paths, speeds_kmh, POSITIONS_M)
    gradients = np.array([quality_index(weld.x_m, weld.z_m, _LINE_SPEED_KMH).gradient_rad for weld in welds])
    thirds = 3 * np.argsort(np.argsort(gradients)) // len(welds)
    return [
        SimulatedWeld(
            weld, wheel_path, classify(weld.x_m, weld.z_m), float(gradient), int(third), peak_map,
            [curve_shape(speeds_kmh, force_n) for force_n in peak_map.peak_force_n.T],
        )
        for weld, wheel_path, gradient, third, peak_map in zip(
            welds, wheel_paths, gradients, thirds, peak_maps, strict=True
        )
    ]  # fmt: skip


def curve_shape(speeds_kmh: FloatArray, force_n: FloatArray) -> CurveShape:
    """Return the shape of a force-speed curve."""
    shape = features(speeds_kmh, force_n)
    fall_n = max((minimum.depth_n for minimum in shape.hollows), default=0.0)
    return CurveShape(shape.monotonic, fall_n / float(np.ptp(force_n)), shape.linearity)


def invert_dips(context: StudyContext, speeds_kmh: FloatArray, simulated_welds: list[SimulatedWeld]) -> InvertedDips:
    """Simulate the welds of the class `dip` upside down, and return both forces."""
    dips = [simulated for simulated in simulated_welds if simulated.geometry.kind == "dip"]
    vehicle_track = context.vehicle_track(BILBAO)
    wheel_paths = (context.wheel_path((simulated.weld.x_m, -simulated.weld.z_m), BILBAO) for simulated in dips)
    static_n = vehicle_track.wheel.static_load_n
    wavelengths_m = np.array([simulated.weld.parameters.wavelength_m for simulated in dips])
    return InvertedDips(
        dip_n=np.array([simulated.peak_map.peak_force_n - static_n for simulated in dips]),
        rise_n=np.array(
            [s.peak_force_n - static_n for s in vehicle_track.peak_maps(wheel_paths, speeds_kmh, POSITIONS_M)]
        ),
        becomes_protrusion=np.array(
            [classify(simulated.weld.x_m, -simulated.weld.z_m).kind == "protrusion" for simulated in dips]
        ),
        frequency_hz=speeds_kmh / 3.6 / wavelengths_m[:, None],
    )


def curves_of(
    simulated_welds: list[SimulatedWeld], kind: str | None = None, third: int | None = None
) -> list[CurveShape]:
    """Return the curves at all positions of the welds of a class, of a third, or of both."""
    return [
        curve
        for simulated in simulated_welds
        if kind in (None, simulated.geometry.kind) and third in (None, simulated.third)
        for curve in simulated.curves
    ]


def count_falling(curves: list[CurveShape]) -> int:
    """Count the curves that fall with speed somewhere: those with a local minimum."""
    return sum(not curve.monotonic for curve in curves)


def median_linearity(curves: list[CurveShape]) -> float:
    """Return the median R², NaN without a curve."""
    return float(np.median([curve.linearity for curve in curves])) if curves else float("nan")


def ratio_quartiles(pairs: InvertedDips) -> FloatArray:
    """Return quartiles of the dip's dynamic force over its inversion's, (3, n_speed)."""
    return np.asarray(np.quantile(pairs.dip_n / pairs.rise_n, _QUARTILES, axis=(0, 2)))


def ratios_by_frequency(pairs: InvertedDips) -> tuple[FloatArray, FloatArray]:
    """Return the same quartiles by frequency of passing, where the inversion is of the other class.

    Returns:
        Frequencies (n,) and quartiles (3, n), each of an equal number of passages.
    """
    other = pairs.becomes_protrusion
    ratio = (pairs.dip_n / pairs.rise_n)[other]
    frequency_hz = np.broadcast_to(pairs.frequency_hz[other][..., None], ratio.shape)
    order = np.argsort(frequency_hz, axis=None)
    groups = np.array_split(order, _FREQUENCIES)
    centres = [np.median(frequency_hz.ravel()[group]) for group in groups]
    quartiles = [np.quantile(ratio.ravel()[group], _QUARTILES) for group in groups]
    return np.array(centres), np.array(quartiles).T


def parametric_share(context: StudyContext, speeds_kmh: FloatArray, simulated_welds: list[SimulatedWeld]) -> float:
    """Return the share of the smoothest third whose increment over smooth rail stays below that rail's own range.

    Both over all speeds; the increment is the largest force less the smooth rail's at the same location and speed.
    """
    vehicle_track = context.vehicle_track(BILBAO)
    smooth = [SmoothRailPassage(context, BILBAO, float(speed)) for speed in speeds_kmh]
    span = np.linspace(0.0, vehicle_track.model.spacing_m, _SPAN_SAMPLES)
    span_n = np.array([rail.force_n(span) for rail in smooth])
    third = [simulated for simulated in simulated_welds if simulated.third == 0]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        exceeded = list(pool.map(lambda simulated: _exceeds(vehicle_track, simulated, smooth, span_n), third))
    return 1 - float(np.mean(exceeded))


def _exceeds(
    vehicle_track: VehicleTrackModel, simulated: SimulatedWeld, smooth: list[SmoothRailPassage], span_n: FloatArray
) -> bool:
    """Return whether the increment exceeds the smooth rail's range at some speed and position."""
    range_n = float(np.ptp(span_n, axis=1).max())
    peak_n, peak_x_m = simulated.peak_map.peak_force_n, simulated.peak_map.peak_x_m
    # The peak bounds the increment from both sides, so that few passages have to be looked at in full.
    at_peak_n = np.array([rail.force_n(x) for rail, x in zip(smooth, peak_x_m, strict=True)])
    if np.any(peak_n - at_peak_n > range_n):
        return True
    unclear = np.argwhere(peak_n - span_n.min(axis=1)[:, None] > range_n)
    fastest_first = unclear[::-1]  # as they are likeliest to exceed
    return any(
        _increment_n(vehicle_track, simulated, smooth[i], float(POSITIONS_M[j])) > range_n for i, j in fastest_first
    )


def _increment_n(
    vehicle_track: VehicleTrackModel, simulated: SimulatedWeld, smooth: SmoothRailPassage, position_m: float
) -> float:
    passage = vehicle_track.history(simulated.wheel_path, smooth.speed_kmh, position_m)
    return float(np.max(passage.force_n - smooth.force_n(passage.x_m)))
