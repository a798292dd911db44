"""Peaks of a force history, their identity from speed to speed, and the forces P1 and P2.

The paper (sections 3, 6.1 and 6.2.2) explains a fall of the maximum force with speed by its peak splitting in two: one
peak stays with the weld, the other moves in the running direction, and the lead passes between them. Peaks are
therefore followed as branches, and a hand-over is where the leading branch is overtaken: a sharp angle of the
force-speed curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.signal import butter, find_peaks, sosfiltfilt

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
class Branch:
    """One peak at successive speeds, each (n,)."""

    speeds_kmh: FloatArray
    x_m: FloatArray
    force_n: FloatArray


@dataclass(frozen=True)
class ImpactForces:
    """Simulated P1 and P2, static load included, and when they act."""

    p1_n: float
    p1_s: float
    p2_n: float
    p2_s: float


def vertex(x: FloatArray, y: FloatArray, index: int) -> tuple[float, float]:
    """Abscissa and ordinate of the parabola's vertex through three samples about an extremum; the sample at an end."""
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
    """Local maxima of a force history in the order of their place, refined by a parabola.

    Args:
        x_m: (n,), increasing.
        force_n: (n,).
        prominence_n: height over the higher of the lowest points on either side that a peak needs.
    """
    x, force = np.asarray(x_m, dtype=np.float64), np.asarray(force_n, dtype=np.float64)
    return [Peak(*vertex(x, force, index)) for index in find_peaks(force, prominence=prominence_n)[0]]


def followed(speeds_kmh: ArrayLike, peaks: Sequence[Sequence[Peak]], gate_m: float = 0.01) -> list[Branch]:
    """Peaks joined from speed to speed: the pairs with the least total distance from where branches lead.

    A branch leads to its last place, or once it has two, along the line through them: a peak bound to the weld stays,
    one bound to the track lags by a constant time and so moves in proportion to speed. A branch ends at the first
    speed at which it is not met.

    Args:
        speeds_kmh: (n_speed,), increasing.
        peaks: of each speed, x measured from the weld.
        gate_m: farthest a peak may be from where its branch leads.

    Returns:
        Branches in the order in which they begin.
    """
    speeds = np.asarray(speeds_kmh, dtype=np.float64)
    branches: list[list[tuple[float, Peak]]] = []
    growing: list[list[tuple[float, Peak]]] = []
    for speed, found in zip(speeds.tolist(), peaks, strict=True):
        distance = np.array([[abs(peak.x_m - _lead(branch, speed)) for peak in found] for branch in growing])
        distance = distance.reshape(len(growing), len(found))
        # What is out of reach costs as much at any distance.
        pairs = zip(*linear_sum_assignment(np.minimum(distance, gate_m)), strict=True)
        met = {column: growing[row] for row, column in pairs if distance[row, column] < gate_m}
        growing = [met.get(column, []) for column in range(len(found))]
        branches += [branch for branch in growing if not branch]
        for branch, peak in zip(growing, found, strict=True):
            branch.append((speed, peak))
    return [_branch(sightings) for sightings in branches]


def hand_overs(branches: Sequence[Branch]) -> list[float]:
    """Speeds in km/h at which the leading branch is overtaken by another, where their forces cross.

    Forces are linear between speeds; a branch that begins or ends between two speeds is continued by a line. A leader
    that vanishes before another force has reached its own is not overtaken.
    """
    if not branches:
        return []
    speeds = np.unique(np.concatenate([branch.speeds_kmh for branch in branches]))
    force = np.full((len(branches), len(speeds)), np.nan)
    for row, branch in enumerate(branches):
        force[row, np.searchsorted(speeds, branch.speeds_kmh)] = branch.force_n
    leaders = np.argmax(np.nan_to_num(force, nan=-np.inf), axis=0)
    crossings = []
    for k in np.flatnonzero(np.diff(leaders)):
        old, new = branches[leaders[k]], branches[leaders[k + 1]]
        pair = speeds[k : k + 2]
        if not np.isin(pair[1], old.speeds_kmh) and not np.isin(pair[0], new.speeds_kmh):
            continue
        behind, ahead = (_continued(new, speed) - _continued(old, speed) for speed in pair.tolist())
        if behind <= 0 <= ahead and behind < ahead:
            crossings.append(float(pair[0] - behind / (ahead - behind) * (pair[1] - pair[0])))
    return crossings


def p1_p2(time_s: ArrayLike, force_n: ArrayLike, arrival_s: float) -> ImpactForces:
    """P1 and P2 of a simulated passage over a dipped joint or weld.

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
    first = find_peaks(force[early], height=force[early[0]] + largest_excess / 2)[0]
    if len(first) == 0:
        raise InputError(
            f"no force peak within 5 ms of {arrival_s:g} s", "check where the wheel meets the irregularity"
        )
    p1_s, p1_n = vertex(time, force, int(early[first[0]]))
    low = sosfiltfilt(butter(4, BETWEEN_RESONANCES_HZ, fs=1 / np.mean(np.diff(time)), output="sos"), force)
    late = np.flatnonzero((time >= p1_s) & (time <= arrival_s + P2_WITHIN_S))
    p2_s, p2_n = vertex(time[late], low[late], int(np.argmax(low[late])))
    return ImpactForces(p1_n, p1_s, p2_n, p2_s)


def jenkins_p1(
    static_load_n: float,
    joint_angle_rad: float,
    speed_kmh: float,
    *,
    contact_stiffness_n_per_m: float,
    unsprung_mass_kg: float,
    effective_rail_mass_kg: float,
) -> float:
    """P1 of a dipped joint after Jenkins, Stephenson, Clayton, Morland & Lyon, Railway Engineering Journal 3 (1974).

    P1 = P0 + 2a v sqrt(k_H m_e / (1 + m_e / m_u)), as railway textbooks give it. Recalled, not verified against the
    original.

    Args:
        static_load_n: P0.
        joint_angle_rad: 2a, the whole angle between both rails' ends.
        speed_kmh: v.
        contact_stiffness_n_per_m: k_H, linear.
        unsprung_mass_kg: m_u, of a wheel.
        effective_rail_mass_kg: m_e, of the rail for a short impact.
    """
    mass = effective_rail_mass_kg / (1 + effective_rail_mass_kg / unsprung_mass_kg)
    return float(static_load_n + joint_angle_rad * speed_kmh / 3.6 * np.sqrt(contact_stiffness_n_per_m * mass))


def jenkins_p2(
    static_load_n: float,
    joint_angle_rad: float,
    speed_kmh: float,
    *,
    unsprung_mass_kg: float,
    track_mass_kg: float,
    track_stiffness_n_per_m: float,
    track_damping_ns_per_m: float,
) -> float:
    """P2 of a dipped joint after Jenkins et al. (1974), see `jenkins_p1`.

    P2 = P0 + 2a v sqrt(m_u / (m_u + m_t)) (1 - pi c_t / (4 sqrt(k_t (m_u + m_t)))) sqrt(k_t m_u), as railway textbooks
    give it. Recalled, not verified against the original.

    Args:
        static_load_n: P0.
        joint_angle_rad: 2a, the whole angle between both rails' ends.
        speed_kmh: v.
        unsprung_mass_kg: m_u, of a wheel.
        track_mass_kg: m_t, equivalent at the wheel.
        track_stiffness_n_per_m: k_t, equivalent at the wheel.
        track_damping_ns_per_m: c_t, equivalent at the wheel.
    """
    mass = unsprung_mass_kg + track_mass_kg
    damped = 1 - np.pi * track_damping_ns_per_m / (4 * np.sqrt(track_stiffness_n_per_m * mass))
    impedance = np.sqrt(unsprung_mass_kg / mass) * damped * np.sqrt(track_stiffness_n_per_m * unsprung_mass_kg)
    return float(static_load_n + joint_angle_rad * speed_kmh / 3.6 * impedance)


def _lead(branch: list[tuple[float, Peak]], speed_kmh: float) -> float:
    last_kmh, last = branch[-1]
    if len(branch) == 1:
        return last.x_m
    before_kmh, before = branch[-2]
    return last.x_m + (last.x_m - before.x_m) * (speed_kmh - last_kmh) / (last_kmh - before_kmh)


def _branch(sightings: list[tuple[float, Peak]]) -> Branch:
    speeds, peaks = zip(*sightings, strict=True)
    return Branch(np.array(speeds), np.array([p.x_m for p in peaks]), np.array([p.force_n for p in peaks]))


def _continued(branch: Branch, speed_kmh: float) -> float:
    """Force of a branch at a speed, along the line through its nearest two speeds beyond its ends."""
    speeds, force = branch.speeds_kmh, branch.force_n
    if len(speeds) == 1 or speeds[0] <= speed_kmh <= speeds[-1]:
        return float(np.interp(speed_kmh, speeds, force))
    near = slice(0, 2) if speed_kmh < speeds[0] else slice(-2, None)
    return float(np.polyval(np.polyfit(speeds[near], force[near], 1), speed_kmh))
