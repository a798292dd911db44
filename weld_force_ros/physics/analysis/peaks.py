"""Peaks of a force history, and the forces P1 and P2."""

from dataclasses import dataclass

import numpy as np
import scipy  # loads its slow parts, such as signal, where they are first used
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.lowpass import BETWEEN_RESONANCES_HZ

P1_WITHIN_S = 5e-3
P2_WITHIN_S = 20e-3  # a period of the wheelset on the track, some 57 Hz


@dataclass(frozen=True)
class Peak:
    """A local maximum of a force history."""

    x_m: float
    force_n: float


@dataclass(frozen=True)
class ImpactForces:
    """Simulated P1 and P2, static load included, and when they act."""

    p1_n: float
    p1_s: float
    p2_n: float
    p2_s: float


def vertex(x: FloatArray, y: FloatArray, index: int) -> tuple[float, float]:
    """Return the vertex (x, y) of the parabola through three samples about an extremum; the sample at an end."""
    if not 0 < index < len(x) - 1:
        return float(x[index]), float(y[index])
    x0, x1, x2 = x[index - 1 : index + 2]
    y0, y1, y2 = y[index - 1 : index + 2]
    slope = (y1 - y0) / (x1 - x0)
    curvature = ((y2 - y1) / (x2 - x1) - slope) / (x2 - x0)
    if curvature == 0:
        return float(x1), float(y1)
    at = (x0 + x1) / 2 - slope / (2 * curvature)
    return float(at), float(y0 + (at - x0) * (slope + (at - x1) * curvature))


def local_peaks(x_m: ArrayLike, force_n: ArrayLike, prominence_n: float) -> list[Peak]:
    """Return the local maxima of a force history in the order of their place, refined by a parabola.

    Args:
        x_m: (n,), increasing.
        force_n: (n,).
        prominence_n: height over the higher of the lowest points on either side that a peak needs.
    """
    x, force = np.asarray(x_m, dtype=np.float64), np.asarray(force_n, dtype=np.float64)
    return [Peak(*vertex(x, force, index)) for index in scipy.signal.find_peaks(force, prominence=prominence_n)[0]]


def p1_p2(time_s: ArrayLike, force_n: ArrayLike, arrival_s: float) -> ImpactForces:
    """Return P1 and P2 of a simulated passage over a dipped joint or weld.

    P1 is the first peak after arrival, within 5 ms, that reaches half of the largest excess over the force at arrival
    in that time: the rail's mass against the contact spring. P2 is the largest force within 20 ms of arrival and not
    before P1, low-passed without delay at 120 Hz, between the resonances of the wheelset on the track: the wheel's
    mass on the track's stiffness.

    Args:
        time_s: (n,), equidistant.
        force_n: (n,), static load included.
        arrival_s: when the wheel meets the irregularity's sharpest place.

    Raises:
        InputError: the history does not last 20 ms from arrival, or has no peak within 5 ms.
    """
    time, force = np.asarray(time_s, dtype=np.float64), np.asarray(force_n, dtype=np.float64)
    if not time[0] <= arrival_s <= time[-1] - P2_WITHIN_S:
        raise InputError(
            f"the force history from {time[0]:g} to {time[-1]:g} s does not hold 20 ms from arrival at {arrival_s:g} s",
            "simulate a longer stretch of rail",
        )
    early = np.flatnonzero((time >= arrival_s) & (time <= arrival_s + P1_WITHIN_S))
    largest_excess = force[early].max() - force[early[0]]
    first = scipy.signal.find_peaks(force[early], height=force[early[0]] + largest_excess / 2)[0]
    if len(first) == 0:
        raise InputError(
            f"no force peak within 5 ms of {arrival_s:g} s", "check where the wheel meets the irregularity"
        )
    p1_s, p1_n = vertex(time, force, int(early[first[0]]))
    sections = scipy.signal.butter(4, BETWEEN_RESONANCES_HZ, fs=1 / np.mean(np.diff(time)), output="sos")
    low = scipy.signal.sosfiltfilt(sections, force)
    late = np.flatnonzero((time >= p1_s) & (time <= arrival_s + P2_WITHIN_S))
    p2_s, p2_n = vertex(time[late], low[late], int(np.argmax(low[late])))
    return ImpactForces(p1_n, p1_s, p2_n, p2_s)
