"""The synthetic population rolled over: every weld, what its geometry says, what its forces did, and dips inverted."""

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
from weld_force_ros.studies.laboratory import BILBAO, StudyContext
from weld_force_ros.studies.passages import SmoothRail, features

POSITIONS_M = np.array([0.0, 0.30])
KINDS = ("dip", "protrusion")
THIRDS = ("smoothest third", "middle third", "roughest third")
_QUARTILES = (0.25, 0.5, 0.75)
_FREQUENCIES = 25
_SPAN_SAMPLES = 2401
_LINE_SPEED_KMH = 200.0  # any: only gradients are compared


@dataclass(frozen=True)
class Curve:
    """Force against speed at one position.

    Attributes:
        monotonic: whether it has no hollow.
        fall: depth of its deepest hollow, of the curve's largest less smallest force; 0 without one.
        linearity: R² of the least-squares line.
    """

    monotonic: bool
    fall: float
    linearity: float


@dataclass(frozen=True)
class Case:
    """A weld, what its geometry says, and what its forces did.

    Attributes:
        weld: as it was made.
        wheel_path: the wheel centre's, over it.
        geometry: its class.
        gradient_rad: largest gradient, of the quality index.
        third: of the population, by that gradient: 0 the smoothest, 2 the roughest.
        peak_map: peak forces and their places.
        curves: one at each position.
    """

    weld: SyntheticWeld
    wheel_path: WheelPath
    geometry: Geometry
    gradient_rad: float
    third: int
    peak_map: PeakMap
    curves: list[Curve]


@dataclass(frozen=True)
class Inverted:
    """Dips and the same shapes upside down.

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


def rolled(lab: StudyContext, speeds_kmh: FloatArray, welds: list[SyntheticWeld]) -> list[Case]:
    """Welds at every speed and position."""
    wheel_paths = [lab.wheel_path((weld.x_m, weld.z_m), BILBAO) for weld in welds]
    peak_maps = lab.vehicle_track(BILBAO).peak_maps(wheel_paths, speeds_kmh, POSITIONS_M)
    gradients = np.array([quality_index(weld.x_m, weld.z_m, _LINE_SPEED_KMH).gradient_rad for weld in welds])
    thirds = 3 * np.argsort(np.argsort(gradients)) // len(welds)
    return [
        Case(
            weld, wheel_path, classify(weld.x_m, weld.z_m), float(gradient), int(third), peak_map,
            [curve(speeds_kmh, force_n) for force_n in peak_map.peak_force_n.T],
        )
        for weld, wheel_path, gradient, third, peak_map in zip(
            welds, wheel_paths, gradients, thirds, peak_maps, strict=True
        )
    ]  # fmt: skip


def curve(speeds_kmh: FloatArray, force_n: FloatArray) -> Curve:
    """What is asked of a force-speed curve."""
    shape = features(speeds_kmh, force_n)
    fall_n = max((hollow.depth_n for hollow in shape.hollows), default=0.0)
    return Curve(shape.monotonic, fall_n / float(np.ptp(force_n)), shape.linearity)


def inverted(lab: StudyContext, speeds_kmh: FloatArray, cases: list[Case]) -> Inverted:
    """The welds of the class `dip`, and the same upside down."""
    dips = [case for case in cases if case.geometry.kind == "dip"]
    vehicle_track = lab.vehicle_track(BILBAO)
    wheel_paths = (lab.wheel_path((case.weld.x_m, -case.weld.z_m), BILBAO) for case in dips)
    static_n = vehicle_track.wheel.static_load_n
    wavelengths_m = np.array([case.weld.parameters.wavelength_m for case in dips])
    return Inverted(
        dip_n=np.array([case.peak_map.peak_force_n - static_n for case in dips]),
        rise_n=np.array(
            [s.peak_force_n - static_n for s in vehicle_track.peak_maps(wheel_paths, speeds_kmh, POSITIONS_M)]
        ),
        becomes_protrusion=np.array([classify(case.weld.x_m, -case.weld.z_m).kind == "protrusion" for case in dips]),
        frequency_hz=speeds_kmh / 3.6 / wavelengths_m[:, None],
    )


def curves_of(cases: list[Case], kind: str | None = None, third: int | None = None) -> list[Curve]:
    """Curves at all positions of the welds of a class, of a third, or of both."""
    return [
        curve
        for case in cases
        if kind in (None, case.geometry.kind) and third in (None, case.third)
        for curve in case.curves
    ]


def with_hollow(curves: list[Curve]) -> int:
    """How many of the curves have a hollow."""
    return sum(not curve.monotonic for curve in curves)


def median_linearity(curves: list[Curve]) -> float:
    """Median R², NaN of no curve."""
    return float(np.median([curve.linearity for curve in curves])) if curves else float("nan")


def ratio_quartiles(pairs: Inverted) -> FloatArray:
    """Quartiles of the dip's dynamic force over its inversion's, (3, n_speed)."""
    return np.asarray(np.quantile(pairs.dip_n / pairs.rise_n, _QUARTILES, axis=(0, 2)))


def ratios_by_frequency(pairs: Inverted) -> tuple[FloatArray, FloatArray]:
    """Quartiles of the same against the frequency of passing, where the inversion is of the other class.

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


def parametric_share(lab: StudyContext, speeds_kmh: FloatArray, cases: list[Case]) -> float:
    """Share of the smoothest third whose increment over the smooth rail keeps below that rail's own range.

    Both over all speeds; the increment is the largest force less the smooth rail's at the same place and speed.
    """
    vehicle_track = lab.vehicle_track(BILBAO)
    smooth = [SmoothRail(lab, BILBAO, float(speed)) for speed in speeds_kmh]
    span = np.linspace(0.0, vehicle_track.model.spacing_m, _SPAN_SAMPLES)
    span_n = np.array([rail.force_n(span) for rail in smooth])
    third = [case for case in cases if case.third == 0]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        exceeded = list(pool.map(lambda case: _exceeds(vehicle_track, case, smooth, span_n), third))
    return 1 - float(np.mean(exceeded))


def _exceeds(vehicle_track: VehicleTrackModel, case: Case, smooth: list[SmoothRail], span_n: FloatArray) -> bool:
    """Whether the increment exceeds the smooth rail's range at some speed and position."""
    range_n = float(np.ptp(span_n, axis=1).max())
    peak_n, peak_x_m = case.peak_map.peak_force_n, case.peak_map.peak_x_m
    # The peak bounds the increment from both sides, so that few passages have to be looked at in full.
    at_peak_n = np.array([rail.force_n(x) for rail, x in zip(smooth, peak_x_m, strict=True)])
    if np.any(peak_n - at_peak_n > range_n):
        return True
    unclear = np.argwhere(peak_n - span_n.min(axis=1)[:, None] > range_n)
    fastest_first = unclear[::-1]  # as they are likeliest to exceed
    return any(_increment_n(vehicle_track, case, smooth[i], float(POSITIONS_M[j])) > range_n for i, j in fastest_first)


def _increment_n(vehicle_track: VehicleTrackModel, case: Case, smooth: SmoothRail, position_m: float) -> float:
    passage = vehicle_track.history(case.wheel_path, smooth.speed_kmh, position_m)
    return float(np.max(passage.force_n - smooth.force_n(passage.x_m)))
