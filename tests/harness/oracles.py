"""Independent ways to the numbers that the core computes: closed forms, exact assemblies and tight integrators.

Nothing here calls the code under test for anything but its plain data (parameters, poles, residues, heights).
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_banded

from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath
from weld_force_ros.physics.track.beam import Rail, Track
from weld_force_ros.physics.track.support import Spring


def winkler_stiffness(bending_nm2: float, foundation_n_per_m2: float) -> float:
    """Static stiffness of an Euler-Bernoulli beam on an elastic foundation, k = 2 sqrt(2) (EI)^(1/4) s^(3/4)."""
    return 2 * np.sqrt(2) * bending_nm2**0.25 * foundation_n_per_m2**0.75


def free_euler_beam_receptance(rail: Rail, omega: float, distance_m: np.ndarray) -> np.ndarray:
    """Infinite Euler-Bernoulli beam, force at 0: -(i e^(-ikx) + e^(-kx)) / (4 EI k^3), k^4 = m w^2 / EI."""
    bending = rail.youngs_modulus_pa * rail.second_moment_m4 * (1 + 1j * rail.loss_factor)
    k = (rail.mass_kg_per_m * omega**2 / bending) ** 0.25
    x = np.abs(distance_m)
    return -(1j * np.exp(-1j * k * x) + np.exp(-k * x)) / (4 * bending * k**3)


def spring_stiffness(spring: Spring, omega: float) -> complex:
    loss = spring.stiffness_n_per_m * spring.loss_factor + omega * spring.damping_ns_per_m
    return complex(spring.stiffness_n_per_m, loss)


def chain_receptance(
    track: Track, frequency_hz: float, at_m: np.ndarray, force_at_m: float, bays: int = 200
) -> np.ndarray:
    """Receptance of a track of 2 x `bays` bays with free ends, by its exact dynamic stiffness matrix.

    Rail nodes at the supports, the force and the points asked for; pad, sleeper and ballast are a mass-spring chain.
    """
    omega, span = 2 * np.pi * frequency_hz, track.spacing_m
    supports = span * np.arange(-200, 201)
    nodes = np.unique(np.round(np.concatenate([supports, np.atleast_1d(at_m), [force_at_m]]), 9))
    banded = np.zeros((7, 2 * len(nodes)), dtype=complex)  # three diagonals on either side

    def add(row: int, column: int, value: complex) -> None:
        banded[3 + row - column, column] += value

    for left, length in enumerate(np.diff(nodes)):
        matrix = _beam_stiffness(track.rail, omega, float(length))
        for row, column in np.ndindex(4, 4):
            add(2 * left + row, 2 * left + column, matrix[row, column])
    pad, ballast = (spring_stiffness(spring, omega) for spring in track.support.springs)
    # The sleeper's own equation, eliminated: pad (u - y) carries y, (pad + ballast - m w^2) y = pad u.
    support = pad - pad**2 / (pad + ballast - track.support.masses_kg[0] * omega**2)
    for x in supports:
        node = int(np.argmin(np.abs(nodes - x)))
        add(2 * node, 2 * node, support)
    force = np.zeros(2 * len(nodes), dtype=complex)
    force[2 * int(np.argmin(np.abs(nodes - force_at_m)))] = 1.0
    displacement = solve_banded((3, 3), banded, force)[0::2]
    return np.array([displacement[np.argmin(np.abs(nodes - x))] for x in np.atleast_1d(at_m)])


def _beam_stiffness(rail: Rail, omega: float, length_m: float) -> np.ndarray:
    """4 x 4 dynamic stiffness (w, theta at both ends) of a Timoshenko beam, from its four exponential solutions."""
    loss = 1 + 1j * rail.loss_factor
    shear = rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2 * loss
    bending = rail.youngs_modulus_pa * rail.second_moment_m4 * loss
    mass = rail.mass_kg_per_m * omega**2
    rotary = rail.mass_kg_per_m * rail.second_moment_m4 / rail.area_m2 * omega**2
    # w = W e^(-kx), theta = T e^(-kx):  S (k^2 W + k T) + mass W = 0,  B k^2 T - S (k W + T) + rotary T = 0
    half = np.sqrt(np.roots([shear * bending, shear * rotary + bending * mass, mass * (rotary - shear)]) + 0j)
    k = np.concatenate([half, -half])
    turn = -(shear * k**2 + mass) / (shear * k)
    far = np.exp(-k * length_m)
    ends = np.array([np.ones(4), turn, far, turn * far])
    force, moment = shear * (-k - turn), bending * (-k * turn)
    return np.array([-force, -moment, force * far, moment * far]) @ np.linalg.inv(ends)


def brute_force_trajectory(x_m: np.ndarray, z_m: np.ndarray, at_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Height at which a circle centred over each of `at_m` rests on the points (x, z), by the definition."""
    rest = []
    for centre in at_m:
        near = np.abs(x_m - centre) < radius_m
        drop = radius_m - np.sqrt(radius_m**2 - (x_m[near] - centre) ** 2)
        rest.append(np.max(z_m[near] - drop))
    return np.array(rest)


@dataclass(frozen=True)
class OdePassage:
    """Samples of an integrated passage over the weld (the approach left out)."""

    x_m: np.ndarray
    force_n: np.ndarray

    def peak(self) -> tuple[float, float]:
        """Largest force and its place, between the samples."""
        top = int(self.force_n.argmax())
        near = slice(top - 2, top + 3)
        vertex = np.polyfit(self.x_m[near] - self.x_m[top], self.force_n[near], 2)
        offset = -vertex[1] / (2 * vertex[0])
        return float(np.polyval(vertex, offset)), float(self.x_m[top] + offset)


def integrated_passage(
    model: PoleModel, wheel: Wheel, wheel_path: WheelPath, speed_kmh: float, position_m: float, approach_spans: int
) -> OdePassage:
    """The moving wheel's equations by `solve_ivp`, from rest over a sleeper `approach_spans` spans before the weld.

    Positive down: q_k' = p_k q_k + s_k(x) f, y = sum of Re(weight_k s_k(x) q_k) with s_k^2 = R_k and s_k continuous,
    M w'' = W - f, f = H max(w - y - r, 0)^1.5.
    """
    speed, span, poles = speed_kmh / 3.6, model.spacing_m, model.poles_rad_s
    knots = np.append(model.section_m, span)
    residue = CubicSpline(knots, np.append(model.residues, model.residues[:1], axis=0), bc_type="periodic")
    fine = np.linspace(0.0, span, 3001)
    roots = np.sqrt(residue(fine))
    for n in range(1, len(fine)):  # the branch nearest to the root before
        roots[n] *= np.where(np.abs(roots[n] - roots[n - 1]) > np.abs(roots[n] + roots[n - 1]), -1, 1)
    shape = CubicSpline(fine, roots)
    weight = np.where(poles.imag == 0, 1.0, 2.0)
    grid = wheel_path.start_m + RESAMPLED_STEP_M * np.arange(len(wheel_path.height_m))
    lift = CubicSpline(grid, wheel_path.height_m)
    start = span * (np.floor((position_m + wheel_path.start_m) / span) - approach_spans)
    end = position_m + wheel_path.end_m + max(span, 0.08 * speed)
    n = len(poles)

    def force(x: float, q: np.ndarray, w: float) -> float:
        r = -float(lift(x - position_m)) if grid[0] < x - position_m < grid[-1] else 0.0
        delta = w - float(weight @ (shape(x % span) * q).real) - r
        return wheel.hertz_n_per_m15 * max(delta, 0.0) ** 1.5

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        q = state[:n] + 1j * state[n : 2 * n]
        f = force(start + speed * t, q, state[-2])
        dq = poles * q + shape((start + speed * t) % span) * f
        return np.concatenate([dq.real, dq.imag, [state[-1], wheel.static_load_n / wheel.mass_kg - f / wheel.mass_kg]])

    rest = -shape(0.0) * wheel.static_load_n / poles
    indentation = (wheel.static_load_n / wheel.hertz_n_per_m15) ** (2 / 3)
    w0 = float(weight @ (shape(0.0) * rest).real) + indentation
    first = np.concatenate([rest.real, rest.imag, [w0, 0.0]])
    begin = (position_m + wheel_path.start_m - start) / speed
    times = np.arange(begin, (end - start) / speed, 20e-6)
    scale = np.concatenate([np.full(2 * n, np.abs(rest).max()), [w0, w0 * 300.0]])
    done = solve_ivp(
        slope, (0.0, times[-1]), first, method="LSODA", rtol=1e-8, atol=1e-9 * scale, max_step=1e-3, t_eval=times
    )
    assert done.success, done.message
    x = start + speed * times
    q = done.y[:n] + 1j * done.y[n : 2 * n]
    return OdePassage(x, np.array([force(*row) for row in zip(x, q.T, done.y[-2], strict=True)]))
