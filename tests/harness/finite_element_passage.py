"""A wheel over finite elements of the track, in the time domain.

Time steps are those of Hilber, Hughes and Taylor (Earthquake Eng. Struct. Dyn. 5 (1977) 283): implicit, of second
order, with one factorisation. The forces of contact and of sleepers that hang over their ballast are unknowns of each
step, solved together to rounding.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import cho_solve_banded, cholesky_banded

from tests.harness.finite_elements import AS_BUILT, BAND, FiniteElementTrack, Supports
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track.beam import Track

PEAK_WINDOW_SPANS = (-2.5, 3.5)
"""Where peaks count: from 1.5 spans before sleeper -1 to 1.5 spans behind sleeper 2."""
_UNSEEN_M = 0.2e-6  # of a sleeper far from the wheel: some 10 N on its ballast


@dataclass(frozen=True)
class Resolution:
    """How finely a passage is computed.

    Attributes:
        elements: a bay.
        step_s: greatest time step.
        step_m: greatest way of the wheel in a step.
        lead_in_spans, lead_in_s: the least way and time from rest to the first changed sleeper, or to the window.
        beyond_spans: track behind the start and after the end.
        dissipation: alpha of the time steps, 0 to 1/3: how strongly motion faster than a step dies out.
    """

    elements: int = 24
    step_s: float = 25e-6
    step_m: float = 1e-3
    lead_in_spans: float = 10.0
    lead_in_s: float = 0.12
    beyond_spans: int = 16
    dissipation: float = 0.1


CONVERGED = Resolution()


@dataclass(frozen=True)
class Passage:
    """One passage, each (n,): the wheel's place, contact force, and displacements, positive down."""

    x_m: FloatArray
    force_n: FloatArray
    wheel_m: FloatArray
    rail_m: FloatArray


@dataclass(frozen=True)
class Peak:
    """Greatest contact force, its place, and least contact force within a window."""

    force_n: float
    at_m: float
    least_n: float


def passage(
    track: Track,
    wheel: Wheel,
    wheel_path: WheelPath | None,
    speed_kmh: float,
    position_m: float = 0.0,
    supports: Supports = AS_BUILT,
    resolution: Resolution = CONVERGED,
) -> Passage:
    """Return a passage from rest to the end of the window in which peaks count.

    Args:
        track: with viscous damping, on discrete supports.
        wheel: mass, static load and contact.
        wheel_path: of the wheel's centre over the weld; None: smooth rail.
        speed_kmh: constant.
        position_m: the weld's centre after sleeper 0.
        supports: what differs at single sleepers.
        resolution: how finely.
    """
    span, speed = track.spacing_m, speed_kmh / 3.6
    dt = min(resolution.step_s, resolution.step_m / speed)
    lead_in = max(resolution.lead_in_spans * span, resolution.lead_in_s * speed)
    start = min(PEAK_WINDOW_SPANS[0], supports.first) * span - lead_in
    steps = int(np.ceil((PEAK_WINDOW_SPANS[1] * span - start) / (speed * dt))) + 2
    x = start + speed * dt * np.arange(steps)
    sleepers = (
        int(np.floor(x[0] / span)) - resolution.beyond_spans,
        int(np.ceil(x[-1] / span)) + resolution.beyond_spans,
    )
    model = FiniteElementTrack(track, supports, sleepers, resolution.elements)
    height = np.zeros(steps) if wheel_path is None else wheel_path.at(x - position_m)
    if height[0] != 0.0:
        raise ValueError("the wheel does not rest on smooth rail at the start")
    force, of_wheel, of_rail = in_time(model, wheel, x, height, dt, resolution.dissipation)
    return Passage(x, force, of_wheel, of_rail)


def peak(done: Passage, span_m: float) -> Peak:
    """Return the greatest and least contact force within the window, by a parabola between steps."""
    first, last = (spans * span_m for spans in PEAK_WINDOW_SPANS)
    inside = np.flatnonzero((done.x_m >= first) & (done.x_m <= last))
    n = int(inside[np.argmax(done.force_n[inside])])
    before, top, after = done.force_n[n - 1 : n + 2]
    curvature = before - 2 * top + after
    offset = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    place = done.x_m[n] + offset * (done.x_m[1] - done.x_m[0])
    return Peak(float(top - 0.25 * (before - after) * offset), float(place), float(done.force_n[inside].min()))


def in_time(
    model: FiniteElementTrack, wheel: Wheel, x_m: FloatArray, height_m: FloatArray, dt: float, dissipation: float
) -> FloatArray:
    """Return contact force and displacements of wheel and rail at every step, (3, n)."""
    beta, gamma = (1 + dissipation) ** 2 / 4, 0.5 + dissipation
    now = 1 - dissipation
    step_matrix = model.mass + now * (gamma * dt * model.damping + beta * dt**2 * model.stiffness)
    factor = cholesky_banded(step_matrix, lower=True)
    unknowns, shapes, local = model.under(x_m)
    resting, rail = model.at_rest(float(x_m[0]), wheel.static_load_n)
    hanging = sorted(model.supports.gap_m)
    sleepers = np.array([model.sleeper(s) for s in hanging], dtype=np.int64)
    gaps = np.array([model.supports.gap_m[s] for s in hanging], dtype=np.float64)
    factors = np.array([model.supports.ballast.get(s, 1.0) for s in hanging], dtype=np.float64)
    if np.any(resting[sleepers] > gaps + _UNSEEN_M):
        raise ValueError("a hanging sleeper rests on its ballast at the start")
    pushed = np.zeros((len(hanging), model.unknowns))
    for row, sleeper in enumerate(sleepers):
        unit = np.zeros(model.unknowns)
        unit[sleeper] = now
        pushed[row] = cho_solve_banded((factor, True), unit)
    inverse_pivots = _rows(factor)
    inverse_pivots[: model.unknowns, 0] **= -1
    result = np.empty((3, len(x_m)))
    result[:, 0] = wheel.static_load_n, rail + wheel.static_indentation_m, rail
    ballast = model.track.support.springs[-1]
    _march(
        inverse_pivots, _rows(model.stiffness), _rows(model.damping), unknowns, shapes, local, height_m,
        resting, sleepers, gaps, factors * ballast.stiffness_n_per_m, factors * ballast.damping_ns_per_m, pushed,
        np.array([wheel.mass_kg, wheel.static_load_n, wheel.hertz_n_per_m15]), dt, dissipation, result,
    )  # fmt: skip
    return result


def _rows(lower: FloatArray) -> FloatArray:
    """Return lower bands by row, (n + `BAND`, `BAND` + 1): [i, k] is the entry of row i, column i - k."""
    rows = np.zeros((lower.shape[1] + BAND, BAND + 1))
    for k in range(BAND + 1):
        rows[k : lower.shape[1], k] = lower[k, : lower.shape[1] - k]
    return rows


@njit(fastmath={"contract"})
def _contact_force(approach, compliance, hertz):  # type: ignore[no-untyped-def]
    """Return the force that Hertz' law gives where each newton takes `compliance` from the approach."""
    if approach <= 0.0:
        return 0.0
    depth = approach  # above the root of a convex function: each step of Newton's falls towards it
    for _ in range(60):
        root = np.sqrt(depth)
        change = (depth + compliance * hertz * depth * root - approach) / (1 + 1.5 * compliance * hertz * root)
        depth -= change
        if abs(change) <= 1e-14 * approach:
            break
    return hertz * depth**1.5


@njit(fastmath={"contract"})
def _ballast_force(free, compliance, predicted, velocity, rate, gap, spring, dashpot):  # type: ignore[no-untyped-def]
    """Return the force of a ballast that pushes only.

    Args:
        free: the sleeper's displacement without it.
        compliance: by how much each newton lessens that.
        predicted: displacement and ...
        velocity: ... velocity before this step's acceleration.
        rate: velocity per displacement beyond those.
        gap: displacement at which the ballast is met.
        spring: its stiffness.
        dashpot: its damping.
    """
    if free <= gap:
        return 0.0
    lasting = spring * (free - gap) + dashpot * (velocity + rate * (free - predicted))
    force = lasting / (1 + compliance * (spring + dashpot * rate))
    # A dashpot that is met at speed acts at once: it may stop the sleeper at the gap, but not before.
    return max(0.0, min(force, (free - gap) / compliance))


@njit(fastmath={"contract"})
def _internal_forces(stiffness, damping, u, v, result):  # type: ignore[no-untyped-def]
    for i in range(len(u) - 2 * BAND):
        total = 0.0
        for k in range(BAND + 1):
            total += stiffness[i, k] * u[BAND + i - k] + damping[i, k] * v[BAND + i - k]
        for k in range(1, BAND + 1):
            total += stiffness[i + k, k] * u[BAND + i + k] + damping[i + k, k] * v[BAND + i + k]
        result[BAND + i] = total


@njit(fastmath={"contract"})
def _solve_two(factor, x, y):  # type: ignore[no-untyped-def]
    """Solve for two right sides at once, in place, which takes the time of one; `factor` holds inverse pivots."""
    n = len(x) - 2 * BAND
    for i in range(n):
        p, q = x[BAND + i], y[BAND + i]
        for k in range(BAND, 0, -1):
            p -= factor[i, k] * x[BAND + i - k]
            q -= factor[i, k] * y[BAND + i - k]
        x[BAND + i], y[BAND + i] = p * factor[i, 0], q * factor[i, 0]
    for i in range(n - 1, -1, -1):
        p, q = x[BAND + i], y[BAND + i]
        for k in range(BAND, 0, -1):
            p -= factor[i + k, k] * x[BAND + i + k]
            q -= factor[i + k, k] * y[BAND + i + k]
        x[BAND + i], y[BAND + i] = p * factor[i, 0], q * factor[i, 0]


@njit(fastmath={"contract"})
def _march(  # type: ignore[no-untyped-def]
    factor, stiffness, damping, unknowns, shapes, local, height, resting, sleepers, gaps, spring, dashpot, pushed,
    physics, dt, dissipation, result,
):  # fmt: skip
    """Follow the wheel through all steps; arrays along the track are padded by `BAND` zeros at both ends."""
    mass, load, hertz = physics
    beta, gamma, now = (1 + dissipation) ** 2 / 4, 0.5 + dissipation, 1 - dissipation
    size, of_u, of_v = len(resting) + 2 * BAND, beta * dt**2, gamma * dt
    u, v, a = np.zeros(size), np.zeros(size), np.zeros(size)
    free, unit = np.zeros(size), np.zeros(size)
    u[BAND:-BAND] = resting
    force, wheel_u, _ = result[:, 0]
    wheel_v, wheel_a = 0.0, 0.0
    hanging = len(sleepers)
    reaction = np.zeros(hanging)
    for step in range(1, len(height)):
        nodes, shape = BAND + unknowns[step], shapes[step]
        # Predicted: what this step's accelerations add to.
        more_u, more_v = dt * v + dt**2 * (0.5 - beta) * a, dt * (1 - gamma) * a
        _internal_forces(stiffness, damping, u + now * more_u, v + now * more_v, free)
        u += more_u
        v += more_v
        free[:] = -free
        free[BAND + unknowns[step - 1]] += dissipation * force * shapes[step - 1]
        for s in range(hanging):
            free[BAND + sleepers[s]] -= dissipation * reaction[s]
        unit[:] = 0.0
        unit[nodes] = now * shape
        _solve_two(factor, free, unit)
        wheel_u += dt * wheel_v + dt**2 * (0.5 - beta) * wheel_a
        wheel_v += dt * (1 - gamma) * wheel_a
        wheel_a = (load - dissipation * force) / mass
        # The forces of this step, in turn until none changes.
        rail_free = np.sum(shape * (u[nodes] + of_u * free[nodes]))
        rail_compliance = local[step] + of_u * np.sum(shape * unit[nodes])
        wheel_compliance = of_u * now / mass
        for _ in range(200):
            before, change = force, 0.0
            rail = rail_free
            for s in range(hanging):
                rail -= of_u * np.sum(shape * pushed[s, unknowns[step]]) * reaction[s]
            approach = wheel_u + of_u * wheel_a - rail + height[step]
            force = _contact_force(approach, rail_compliance + wheel_compliance, hertz)
            change = abs(force - before)
            for s in range(hanging):
                i = sleepers[s]
                down = u[BAND + i] + of_u * (free[BAND + i] + unit[BAND + i] * force)
                for other in range(hanging):
                    if other != s:
                        down -= of_u * pushed[other, i] * reaction[other]
                before = reaction[s]
                reaction[s] = _ballast_force(
                    down, of_u * pushed[s, i], u[BAND + i], v[BAND + i], gamma / (beta * dt),
                    gaps[s], spring[s], dashpot[s],
                )  # fmt: skip
                change = max(change, abs(reaction[s] - before))
            if hanging == 0 or change < 1e-9 * load:
                break
        a[:] = free + force * unit
        for s in range(hanging):
            a[BAND:-BAND] -= reaction[s] * pushed[s]
        u += of_u * a
        v += of_v * a
        wheel_a -= now * force / mass
        wheel_u += of_u * wheel_a
        wheel_v += of_v * wheel_a
        result[0, step], result[1, step] = force, wheel_u
        result[2, step] = np.sum(shape * u[nodes]) + local[step] * force
