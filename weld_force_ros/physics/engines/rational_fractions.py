"""Receptance at sections of the span as rational fractions with position-dependent coefficients: the `rfp` engine.

The paper's own model. At each section, eq. (1),

    h(s) = (b_1 s^(m-1) + ... + b_m) / (s^m + a_1 s^(m-1) + ... + a_m),

fitted by weighted least squares, eq. (2), and turned into first-order equations with the rail's displacement under the
wheel as first state, eq. (3b), (3c). Under a moving wheel the coefficients change with position. Every section may be
fitted well and stable and the moving system still be wrong or unbounded, where coefficients hop from one section to the
next; `rational_search` searches for weights that prevent it.

Least squares by Sanathanan-Koerner iteration (IEEE Trans. Autom. Control 8 (1963) 56) in a scaled frequency and with
scaled columns; all sections start from the denominator of common poles, so that neighbours end in the same minimum.
Between sections coefficients are linear: periodic cubics overshoot next to the sleeper where sections differ much (at
7/8 they double the error of the receptance between sections) and gain nothing where they do not.
"""

from dataclasses import dataclass
from itertools import accumulate
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.common_poles import common_poles
from weld_force_ros.physics.passage.state_space import Propagation, dense_propagation, exponentials

STEPS_PER_SECTION = 4

_SCALE = 2 * np.pi * 500.0  # rad/s, brings coefficients near one another
_ITERATIONS = 8
_LEAST_DAMPING = 1e-4  # of a mirrored pole, relative


@dataclass(frozen=True)
class RfpModel:
    """A track as rational fractions at equidistant sections, the first over a sleeper.

    Coefficients are those of s / `scale_rad_s`.

    Attributes:
        denominator: (n_section, m), a_1 to a_m; the leading coefficient is 1.
        numerator: (n_section, m), b_1 to b_m, m/N.
        spacing_m: the span that coefficients repeat with.
        scale_rad_s: unit of s, and of the rates of `state_space`.
    """

    denominator: FloatArray
    numerator: FloatArray
    spacing_m: float
    spans: ClassVar[int] = 1
    uniform: ClassVar[bool] = True

    @property
    def opposite_m(self) -> float:
        """Return what a place x is met at against rising x, plus x."""
        return self.spacing_m

    scale_rad_s: float = _SCALE

    @property
    def order(self) -> int:
        """Return the number of states: the denominator's degree."""
        return int(self.denominator.shape[1])

    @property
    def section_m(self) -> FloatArray:
        """Return the sections' places (n_section,), metres after the sleeper."""
        return np.arange(len(self.denominator)) * (self.spacing_m / len(self.denominator))

    def coefficients_at(self, at_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the denominator and numerator at any positions, (n_at, m) each: linear between sections, periodic."""
        count = len(self.denominator)
        place = np.mod(np.atleast_1d(np.asarray(at_m, dtype=np.float64)) / self.spacing_m, 1.0) * count
        before = np.floor(place).astype(int) % count
        part = (place % 1.0)[:, None]
        both = np.concatenate([self.denominator, self.numerator], axis=1)
        value = (1 - part) * both[before] + part * both[(before + 1) % count]
        return value[:, : self.order], value[:, self.order :]

    def receptance(self, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray:
        """Return the fitted point receptance, m/N, (n_at, n_frequency)."""
        omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        return _fraction(_powers(omega / self.scale_rad_s, self.order), *self.coefficients_at(at_m))

    def static_compliance(self, at_m: ArrayLike) -> FloatArray:
        """Return the deflection under a resting unit load, m/N, (n_at,)."""
        a, b = self.coefficients_at(at_m)
        return np.asarray(b[:, -1] / a[:, -1])

    def poles(self, at_m: ArrayLike | None = None) -> ComplexArray:
        """Return the poles at the sections, or at any positions, rad/s: (n_at, m), the slowest first."""
        a = self.denominator if at_m is None else self.coefficients_at(at_m)[0]
        poles = np.linalg.eigvals(_companion(a))
        return np.take_along_axis(poles, np.argsort(np.abs(poles), axis=1), axis=1) * self.scale_rad_s

    def state_space(self, at_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return eq. (3b): z' = scale_rad_s (A z + c f); the rail's displacement under the wheel is z[0].

        Returns:
            A (n_at, m, m), dimensionless, and c (n_at, m) by eq. (3c), m/N.
        """
        a, b = self.coefficients_at(at_m)
        return _companion(a), _inputs(a, b)

    def at_rest(self, at_m: ArrayLike) -> FloatArray:
        """Return the states under a resting unit load, (n_at, m), m/N."""
        a, b = self.coefficients_at(at_m)
        return np.concatenate([b[:, -1:] / a[:, -1:], -_inputs(a, b)[:, :-1]], axis=1)

    def propagation(self, at_m: FloatArray, dt_s: float) -> Propagation:
        """Return a step of `dt_s` from each of the equidistant points `at_m`; see `physics.passage.state_space`."""
        rates, inputs = self.state_space(at_m + 0.5 * self.spacing_m / len(at_m))
        dt = self.scale_rad_s * dt_s
        return dense_propagation(rates * dt, inputs * dt, self.at_rest(at_m[:1])[0])

    @property
    def variation(self) -> float:
        """Return how much the coefficients change along the span; 0 on continuous support.

        RMS over coefficients and sections of the slope between neighbouring sections, per span and relative to the
        coefficient's own RMS over the span. Of several such measures this one foretells best how far the moving
        wheel's peak force is off (rank correlation 0.96 and 0.83 over random weights on two tracks; the largest
        change of any coefficient: 0.90 and 0.76; the error of the fit itself: 0.63 and 0.71).
        """
        both = np.concatenate([self.denominator, self.numerator], axis=1)
        slope = (np.roll(both, -1, axis=0) - both) * len(both)
        return float(np.sqrt(np.mean((slope / np.sqrt(np.mean(both**2, axis=0))) ** 2)))


@dataclass(frozen=True)
class SmoothRail:
    """A wheel in its periodic state on smooth rail, with a linear contact.

    Attributes:
        growth: (n_speed,), of a disturbance from span to span; below 1 every passage is bounded.
        swing: (n_speed,), of the contact force over a span, highest less lowest, relative to the static load.
    """

    growth: FloatArray
    swing: FloatArray


def smooth_rail(
    model: RfpModel,
    wheel_mass_kg: float,
    contact_stiffness_n_per_m: float,
    speeds_kmh: ArrayLike,
    *,
    steps_per_section: int = STEPS_PER_SECTION,
) -> SmoothRail:
    """Return whether and how a wheel runs steadily: the monodromy matrix of a span and its periodic solution.

    Coefficients are constant within a step, each of which is advanced exactly. Results are infinite where the numbers
    are.
    """
    speeds = np.atleast_1d(np.asarray(speeds_kmh, dtype=np.float64)) / 3.6
    steps = steps_per_section * len(model.denominator)
    rail, inputs = model.state_space((np.arange(steps) + 0.5) * (model.spacing_m / steps))
    m = model.order
    # States: rail, displacement of the wheel, its velocity / scale, and 1 for the static load of 1 N
    system = np.zeros((steps, m + 3, m + 3))
    system[:, :m, :m] = rail
    system[:, :m, 0] -= inputs * contact_stiffness_n_per_m
    system[:, :m, m] += inputs * contact_stiffness_n_per_m
    system[:, m, m + 1] = 1.0
    system[:, m + 1, [0, m, m + 2]] = [contact_stiffness_n_per_m, -contact_stiffness_n_per_m, 1.0]
    system[:, m + 1] /= wheel_mass_kg * model.scale_rad_s**2
    duration = model.scale_rad_s * model.spacing_m / (steps * speeds)
    with np.errstate(over="ignore", invalid="ignore"):
        across = np.stack([exponentials(dt * system) for dt in duration], axis=1)
        passed = list(accumulate(across, lambda before, step: step @ before))
    span = passed[-1]
    growth, swing = np.full(len(speeds), np.inf), np.full(len(speeds), np.inf)
    finite = np.all(np.isfinite(span), axis=(1, 2))
    growth[finite] = np.abs(np.linalg.eigvals(span[finite, :-1, :-1])).max(axis=1)
    steady = growth < 1
    start = np.linalg.solve(np.eye(m + 2) - span[steady, :-1, :-1], span[steady, :-1, -1:])
    states = np.stack(passed)[:, steady, :-1, :] @ np.concatenate([start, np.ones_like(start[:, :1])], axis=1)
    force = contact_stiffness_n_per_m * (states[:, :, m, 0] - states[:, :, 0, 0])
    swing[steady] = np.ptp(force, axis=0)
    return SmoothRail(growth, swing)


def fit_sections(
    frequency_hz: FloatArray,
    exact: ComplexArray,
    weight: FloatArray,
    static: FloatArray,
    degree: int,
    *,
    start: FloatArray | None = None,
    regularisation: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Fit rational fractions with stable poles and exact static compliance, by weighted least squares.

    A pole that the least squares put into the right half plane is mirrored into the left and the numerator fitted anew.

    Args:
        frequency_hz: (n_frequency,), positive.
        exact: (n_section, n_frequency), receptance, m/N.
        weight: (n_section, n_frequency), N/m.
        static: (n_section,), b_m / a_m, m/N.
        degree: m, the denominator's degree.
        start: (m,), the denominator that the iteration starts from; by default that of poles common to all sections.
        regularisation: how strongly denominators are held to `start`: weight of |h (D - D_start)| beside |h D - N|.

    Returns:
        a and b, (n_section, m) each, as in `RfpModel`.

    Raises:
        NumericalError: no finite coefficients.
    """
    powers = _powers(2 * np.pi * frequency_hz / _SCALE, degree)
    unit = float(np.mean(static))
    h, w, pin = exact / unit, weight * unit, static / unit
    if start is None:
        start = common_denominator(frequency_hz, exact, weight, degree)
    a = np.broadcast_to(start, (len(exact), degree))
    b = np.zeros_like(a)
    for _ in range(_ITERATIONS):
        a, b = _linearised(powers, h, w, pin, a, start, regularisation)
    if not np.all(np.isfinite(a)):
        raise NumericalError("the fit of rational fractions did not stay finite; try another degree")
    poles = np.linalg.eigvals(_companion(a)).astype(np.complex128)
    unstable = np.any(poles.real >= 0, axis=1)
    if np.any(unstable):
        a[unstable] = [np.poly(row).real[1:] for row in _mirrored(poles[unstable])]
        b[unstable] = _numerators(powers, h[unstable], w[unstable], pin[unstable], a[unstable])
    return a, b * unit


def common_denominator(frequency_hz: FloatArray, exact: ComplexArray, weight: FloatArray, degree: int) -> FloatArray:
    """Return a_1 to a_m of the poles that fit all sections at once, (degree,)."""
    half = common_poles(frequency_hz, exact, weight, degree) / _SCALE
    return np.asarray(np.poly(np.concatenate([half, half[half.imag > 0].conj()])).real[1:])


def _powers(scaled_omega: FloatArray, degree: int) -> ComplexArray:
    """Return s^degree ... 1 at s = i omega, (n_frequency, degree + 1)."""
    return np.asarray((1j * scaled_omega)[:, None] ** np.arange(degree, -1, -1))


def _fraction(powers: ComplexArray, a: FloatArray, b: FloatArray) -> ComplexArray:
    return np.asarray((b @ powers[:, 1:].T) / _denominator(powers, a))


def _denominator(powers: ComplexArray, a: FloatArray) -> ComplexArray:
    return np.asarray(powers[:, 0] + a @ powers[:, 1:].T)


def _companion(a: FloatArray) -> FloatArray:
    count, m = a.shape
    matrix = np.zeros((count, m, m))
    matrix[:, np.arange(m - 1), np.arange(1, m)] = 1.0
    matrix[:, -1, :] = -a[:, ::-1]
    return matrix


def _inputs(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return c of eq. (3c): c_k = b_k - sum_(j<k) a_(k-j) c_j."""
    c = np.array(b)
    for k in range(1, c.shape[1]):
        c[:, k] -= np.sum(a[:, k - 1 :: -1] * c[:, :k], axis=1)
    return c


def _linearised(
    powers: ComplexArray,
    h: ComplexArray,
    w: FloatArray,
    pin: FloatArray,
    a: FloatArray,
    start: FloatArray,
    regularisation: float,
) -> tuple[FloatArray, FloatArray]:
    """Take a Sanathanan-Koerner step.

    Minimise w (N - h D) / D_before and regularisation w h (D - D_start) / D_before; b_m = pin a_m.
    """
    m = a.shape[1]
    w_d = (w / _denominator(powers, a))[:, :, None]
    numerator = _stacked(w_d * powers[:, 1:])
    denominator = _stacked(-(w_d * h[:, :, None]) * powers)
    last = denominator[:, :, -1:] + pin[:, None, None] * numerator[:, :, -1:]
    matrix = np.concatenate([numerator[:, :, :-1], denominator[:, :, 1:-1], last], axis=2)
    target = -denominator[:, :, 0]
    if regularisation > 0:
        held = regularisation * np.asarray(np.linalg.qr(denominator[:, :, 1:], mode="r"))
        matrix = np.concatenate([matrix, np.concatenate([np.zeros_like(held[:, :, 1:]), held], axis=2)], axis=1)
        target = np.concatenate([target, held @ start], axis=1)
    x = _least_squares(matrix, target)
    a = x[:, m - 1 :]
    return a, np.concatenate([x[:, : m - 1], pin[:, None] * a[:, -1:]], axis=1)


def _numerators(powers: ComplexArray, h: ComplexArray, w: FloatArray, pin: FloatArray, a: FloatArray) -> FloatArray:
    """Return numerators for given denominators, with b_m = pin a_m."""
    columns = (w / _denominator(powers, a))[:, :, None] * powers[:, 1:]
    last = pin * a[:, -1]
    target = (w * h - columns[:, :, -1] * last[:, None])[:, :, None]
    x = _least_squares(_stacked(columns[:, :, :-1]), _stacked(target)[:, :, 0])
    return np.concatenate([x, last[:, None]], axis=1)


def _stacked(matrix: ComplexArray) -> FloatArray:
    return np.concatenate([matrix.real, matrix.imag], axis=1)


def _least_squares(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Return solutions of stacked problems, (n, n_unknown); columns are scaled, deficient ranks allowed."""
    if not np.all(np.isfinite(matrix)):
        raise NumericalError("the fit of rational fractions did not stay finite; try another degree")
    column = np.linalg.norm(matrix, axis=1)
    q, r = np.linalg.qr(matrix / column[:, None, :])
    right = np.swapaxes(q, 1, 2) @ target[:, :, None]
    return np.asarray((np.linalg.pinv(r, rcond=1e-14) @ right)[:, :, 0] / column)


def _mirrored(poles: ComplexArray) -> ComplexArray:
    damping = np.maximum(np.abs(poles.real), _LEAST_DAMPING * np.abs(poles))
    return np.asarray(np.where(poles.real >= 0, -damping + 1j * poles.imag, poles))
