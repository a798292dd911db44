"""Receptance over the span as common poles and position-dependent residues: the `common-poles` engine.

h(x, s) = sum_k R_k(x) / (s - p_k), poles in the left half plane and shared by all sections, so that no position along
the span can be unstable and nothing hops from one section to the next. Poles by relaxed vector fitting of all sections
at once (Gustavsen & Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052; Gustavsen, ibid. 21 (2006) 1587; Deschrijver
et al., IEEE Microw. Wireless Compon. Lett. 18 (2008) 383), residues by least squares with the undamped static
compliance of each section held exactly.

Between two points the residue is taken as sqrt(R_k(x)) sqrt(R_k(x')), the mode-shape picture: a force drives the states
through the shape where it acts, the rail moves by the shape where it is looked at. The response is then reciprocal, as
the track's is, and right to first order in the way that the contact has moved between the two; putting R_k all on one
side is not, and costs over 2 % at 300 km/h near a sleeper.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.cubics import periodic_spline
from weld_force_ros.physics.passage.state_space import Propagation, first_order_hold
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track

SECTIONS = 32
BAND_HZ = (5.0, 2500.0)
FREQUENCIES = 400
ORDERS = (8, 10, 12, 14, 16)
_GOOD_ENOUGH = 0.005
_ITERATIONS = 40
_SHAPE_POINTS = 1200
_SCALE = 2 * np.pi * 500.0  # rad/s, conditions the least squares

ErrorBand = tuple[float, float]
REPORT_BANDS: tuple[ErrorBand, ...] = ((5.0, 40.0), (40.0, 100.0), (100.0, 300.0), (300.0, 1200.0), (1200.0, 2500.0))


@dataclass(frozen=True)
class PoleModel:
    """A track as common poles.

    Attributes:
        poles_rad_s: (n,), one of each conjugate pair (positive imaginary part) and every real pole.
        residues: (n_section, n), m rad/(N s), on `section_m` over [0, spans spacing).
        section_m: (n_section,), metres after sleeper 0.
        spacing_m: from sleeper to sleeper.
        spans: number of spans that residues repeat with; more than one where a few supports differ.
        image_m: where sleeper 0 of the track's mirror image lies; at 0 where the track is its own.
        nodes: poles by number and places in the period where their shapes change sign; see `window_signs`.
    """

    poles_rad_s: ComplexArray
    residues: ComplexArray
    section_m: FloatArray
    spacing_m: float
    spans: int = 1
    image_m: float = 0.0
    nodes: tuple[tuple[int, float], ...] = ()
    _grids: dict[bytes, tuple[ComplexArray, FloatArray]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def order(self) -> int:
        """Return the number of states: two for a conjugate pair, one for a real pole."""
        return int(np.sum(np.where(self.poles_rad_s.imag == 0, 1, 2)))

    @property
    def uniform(self) -> bool:
        """Return whether all supports are alike."""
        return self.spans == 1

    @property
    def opposite_m(self) -> float:
        """Return what a place x is met at against rising x, plus x."""
        return self.image_m + self.spacing_m

    @property
    def period_m(self) -> float:
        """Return the length that residues repeat with."""
        return self.spans * self.spacing_m

    @property
    def pair_weight(self) -> FloatArray:
        """Return 2 for a pole of a conjugate pair, 1 for a real one: z = sum_k weight_k Re(shape_k q_k)."""
        return np.where(self.poles_rad_s.imag == 0, 1.0, 2.0)

    def residues_at(self, at_m: ArrayLike) -> ComplexArray:
        """Return the residues at any positions, (n_at, n): cubic spline over the period."""
        return _periodic_spline(self.section_m, self.residues, self.period_m, at_m)

    def shapes_at(self, at_m: ArrayLike) -> ComplexArray:
        """Return sqrt(R_k), its sign continuous along the span but for `nodes`, (n_at, n)."""
        points = self.spans * _SHAPE_POINTS
        fine = self.period_m * np.arange(points) / points
        residues = self.residues_at(fine)
        phase = np.unwrap(np.angle(residues), axis=0)
        shapes = _periodic_spline(fine, np.sqrt(np.abs(residues)) * np.exp(0.5j * phase), self.period_m, at_m)
        through = np.mod(np.atleast_1d(np.asarray(at_m, dtype=np.float64)), self.period_m)
        for pole, node_m in self.nodes:
            shapes[through >= node_m, pole] *= -1
        return shapes

    def propagation(self, at_m: FloatArray, dt_s: float) -> Propagation:
        """Return a step of `dt_s` of the states q_k' = p_k q_k + shape_k f; see `physics.passage.state_space`."""
        decay, old, new = first_order_hold(self.poles_rad_s, dt_s)
        within = decay * new + old
        shape, drives = self._on_grid(at_m)
        rest = -shape[0] * (1 / self.poles_rad_s + new) / within
        return Propagation(
            decay=np.stack([decay.real, decay.imag]),
            input_scale=np.stack([within.real, within.imag]),
            transitions=np.empty((0, 2 * len(decay), 2 * len(decay))),
            drives=drives,
            shapes=in_pairs((shape * within).conj()),
            gains=(shape**2 * new).real.sum(axis=1),
            at_rest=in_pairs(rest),
        )

    def _on_grid(self, at_m: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """Return shapes times the root of the pair's weight, complex and in pairs; remembered for a few grids."""
        key = at_m.tobytes()
        if key not in self._grids:
            shapes = np.sqrt(self.pair_weight) * self.shapes_at(at_m)
            self._grids[key] = (shapes, in_pairs(shapes))
        return self._grids[key]

    def receptance(self, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray:
        """Return the fitted point receptance, m/N, (n_at, n_frequency)."""
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        residues = self.residues_at(at_m)
        paired = np.where(self.poles_rad_s.imag == 0, 0.0, 1.0)
        direct = residues @ (1 / (s - self.poles_rad_s[:, None]))
        mirrored = (paired * residues.conj()) @ (1 / (s - self.poles_rad_s.conj()[:, None]))
        return np.asarray(direct + mirrored)

    def static_compliance(self, at_m: ArrayLike) -> FloatArray:
        """Return the deflection under a resting unit load, m/N, (n_at,)."""
        return np.asarray((self.residues_at(at_m) / -self.poles_rad_s).real @ self.pair_weight)


def _periodic_spline(knots_m: FloatArray, values: ComplexArray, period_m: float, at_m: ArrayLike) -> ComplexArray:
    """Return complex columns over one period, interpolated anywhere: (n_at, n)."""
    at = np.atleast_1d(np.asarray(at_m, dtype=np.float64))
    if len(knots_m) == 1:
        return np.repeat(values, len(at), axis=0)
    closed = np.concatenate([values, values[:1]])
    cubics = periodic_spline(np.append(knots_m, knots_m[0] + period_m), closed)
    return np.asarray(cubics(knots_m[0] + np.mod(at - knots_m[0], period_m)))


def in_pairs(values: ComplexArray) -> FloatArray:
    """Return the real and imaginary parts side by side along the last axis."""
    return np.ascontiguousarray(np.stack([values.real, values.imag], axis=-1).reshape(*values.shape[:-1], -1))


def fit_track(
    track: Track,
    contact_compliance: Callable[[FloatArray], ComplexArray],
    order: int,
    *,
    section_count: int = SECTIONS,
    band_hz: tuple[float, float] = BAND_HZ,
    emphasis: Callable[[FloatArray], FloatArray] = np.ones_like,
) -> PoleModel:
    """Fit a track's receptance over the span.

    Errors are weighed by what the contact sees: 1 / |h + c|, with c(omega) the compliance of contact and wheel, as a
    relative error of that sum is a relative error of the force that an irregularity makes.

    Args:
        track: the track.
        contact_compliance: c(omega), m/N.
        order: number of poles, even or odd.
        section_count: sections over the span (one is enough for continuous support).
        band_hz: fitted frequencies.
        emphasis: of errors by frequency (Hz), beside what the contact sees.

    Raises:
        NumericalError: the fit did not end with finite, stable poles.
    """
    frequency = fit_frequencies(band_hz)
    at = beam.sections(track, section_count)
    half = at[: len(at) // 2 + 1]  # the span is symmetric about its middle
    exact = beam.receptance(track, frequency, half)
    weight = emphasis(frequency) / np.abs(exact + contact_compliance(2 * np.pi * frequency))
    poles = common_poles(frequency, exact, weight, order)
    residues = residues_of(frequency, exact, weight, poles, beam.static_compliance(track, half))
    mirror = np.minimum(np.arange(len(at)), len(at) - np.arange(len(at)))
    return PoleModel(poles, residues[mirror], at, track.spacing_m)


def fit_frequencies(band_hz: tuple[float, float] = BAND_HZ) -> FloatArray:
    """Return the fitted frequencies, Hz: equal steps of the square root, between linear and logarithmic."""
    return np.linspace(np.sqrt(band_hz[0]), np.sqrt(band_hz[1]), FREQUENCIES) ** 2


def common_poles(frequency_hz: FloatArray, receptance: ComplexArray, weight: FloatArray, order: int) -> ComplexArray:
    """Return poles, rad/s, that fit all rows of `receptance` (n_section, n_frequency), by relaxed vector fitting.

    A pole that moves into the right half plane is mirrored into the left, so that the result is always stable.
    """
    s = 2j * np.pi * frequency_hz / _SCALE
    poles = _starting_poles(2 * np.pi * frequency_hz / _SCALE, order)
    for _ in range(_ITERATIONS):
        basis = _basis(s, poles)
        moved = _relocated(poles, _sigma(basis, receptance, weight, len(frequency_hz)))
        settled = len(moved) == len(poles) and np.allclose(moved, poles, rtol=1e-10)
        poles = moved
        if settled:
            break
    if not np.all(np.isfinite(poles)):
        raise NumericalError(f"vector fitting of order {order} gave poles that are not finite; try another order")
    return poles * _SCALE


def _starting_poles(omega: FloatArray, order: int) -> ComplexArray:
    """Return weakly damped pairs over the band, a real pole at its lower end if the order is odd."""
    imaginary = np.geomspace(max(omega[0], 0.02 * omega[-1]), omega[-1], max(order // 2, 1))
    pairs = -0.05 * imaginary + 1j * imaginary
    return np.concatenate([pairs, [-imaginary[0]]]) if order % 2 else pairs


def _basis(s: ComplexArray, poles: ComplexArray) -> ComplexArray:
    """Return partial fractions with real coefficients, (n_frequency, order): two columns a pair, one a real pole."""
    columns = []
    for p in poles:
        plus = 1 / (s - p)
        if p.imag == 0:
            columns.append(plus)
        else:
            minus = 1 / (s - p.conjugate())
            columns += [plus + minus, 1j * (plus - minus)]
    return np.stack(columns, axis=1)


def _stacked(matrix: ComplexArray) -> FloatArray:
    return np.concatenate([matrix.real, matrix.imag])


def _sigma(
    basis: ComplexArray, receptance: ComplexArray, weight: FloatArray, n_frequency: int
) -> tuple[FloatArray, float]:
    """Return the coefficients and constant of the common denominator correction sigma, all sections at once."""
    order = basis.shape[1]
    with_constant = np.concatenate([basis, np.ones((n_frequency, 1))], axis=1)
    blocks, targets = [], []
    for h, w in zip(receptance, weight, strict=True):
        own = _stacked(w[:, None] * basis)
        common = _stacked(-(w * h)[:, None] * with_constant)
        # Only what the section's own residues cannot explain constrains the common poles.
        r = np.asarray(np.linalg.qr(np.concatenate([own, common], axis=1), mode="r"))
        blocks.append(r[order : 2 * order + 1, order:])
        targets.append(np.zeros(len(blocks[-1])))
    # Relaxed: sigma is 1 on average instead of at infinity.
    scale = np.linalg.norm(weight * np.abs(receptance)) / n_frequency
    blocks.append(scale * with_constant.real.sum(axis=0)[None, :])
    targets.append(np.array([scale * n_frequency]))
    a, b = np.concatenate(blocks), np.concatenate(targets)
    column = np.linalg.norm(a, axis=0)
    solution = np.linalg.lstsq(a / column, b, rcond=None)[0] / column
    constant = float(solution[-1])
    if abs(constant) < 1e-8:
        constant = float(np.copysign(1e-8, constant))
    return solution[:-1], constant


def _relocated(poles: ComplexArray, sigma: tuple[FloatArray, float]) -> ComplexArray:
    """Return the zeros of sigma, made stable, one of each conjugate pair."""
    coefficients, constant = sigma
    order = len(coefficients)
    a, b = np.zeros((order, order)), np.zeros(order)
    row = 0
    for p in poles:
        if p.imag == 0:
            a[row, row], b[row] = p.real, 1.0
            row += 1
        else:
            a[row : row + 2, row : row + 2] = [[p.real, p.imag], [-p.imag, p.real]]
            b[row] = 2.0
            row += 2
    zeros = np.linalg.eigvals(a - np.outer(b, coefficients) / constant)
    zeros = np.where(zeros.real > 0, -zeros.conj(), zeros)
    kept = zeros[zeros.imag >= 0]
    return np.asarray(kept[np.argsort(np.abs(kept))], dtype=np.complex128)


def residues_of(
    frequency_hz: FloatArray,
    receptance: ComplexArray,
    weight: FloatArray,
    poles_rad_s: ComplexArray,
    static: FloatArray,
) -> ComplexArray:
    """Return the least-squares residues (n_section, n) of given poles, each section's static compliance held exactly.

    Args:
        frequency_hz: (n_frequency,).
        receptance: (n_section, n_frequency), m/N.
        weight: of its errors, as `receptance`.
        poles_rad_s: (n,), as `PoleModel`.
        static: (n_section,), m/N.
    """
    poles = poles_rad_s / _SCALE
    basis = _basis(2j * np.pi * frequency_hz / _SCALE, poles)
    at_rest = _basis(np.zeros(1, dtype=np.complex128), poles)[0].real
    particular = at_rest / (at_rest @ at_rest)
    free = np.linalg.svd(at_rest[None, :])[2][1:].T  # directions that leave the static compliance alone
    result = []
    for h, w, rest in zip(receptance, weight, static, strict=True):
        known = rest * particular
        a = _stacked(w[:, None] * (basis @ free))
        b = _stacked((w * (h - basis @ known))[:, None])[:, 0]
        column = np.linalg.norm(a, axis=0)
        real = known + free @ (np.linalg.lstsq(a / column, b, rcond=None)[0] / column)
        result.append(_as_complex(real, poles))
    return np.stack(result) * _SCALE


def _as_complex(real: FloatArray, poles: ComplexArray) -> ComplexArray:
    values, row = [], 0
    for p in poles:
        if p.imag == 0:
            values.append(complex(real[row]))
            row += 1
        else:
            values.append(complex(real[row], real[row + 1]))
            row += 2
    return np.array(values)


class ReceptanceModel(Protocol):
    """A fitted track in the frequency domain."""

    def receptance(self, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray:
        """Return the fitted point receptance, m/N, (n_at, n_frequency)."""


def relative_error(
    model: ReceptanceModel,
    track: Track,
    contact_compliance: Callable[[FloatArray], ComplexArray],
    band_hz: ErrorBand = BAND_HZ,
) -> float:
    """Return the RMS over band and span of |fit - exact| / |exact + c|, between the fitted sections too."""
    frequency = np.geomspace(*band_hz, 200)
    at = np.linspace(0.0, track.spacing_m / 2, 1 if track.continuous else 25)
    exact = beam.receptance(track, frequency, at)
    seen = exact + contact_compliance(2 * np.pi * frequency)
    return float(np.sqrt(np.mean(np.abs((model.receptance(frequency, at) - exact) / seen) ** 2)))


def default_fit(track: Track, contact_compliance: Callable[[FloatArray], ComplexArray]) -> PoleModel:
    """Return the fit of the lowest order that is good enough; if none is, the best, or what more poles hardly improve.

    Good enough is a contact-weighted error of half a per cent. No causal model reproduces a loss factor, so on
    hysteretic tracks no order gets there; then it is the lowest order, from the paper's eight up, that two more poles
    would not improve by a quarter: beyond it, poles chase the part of the receptance that lies before time zero.
    Causal tracks have no such part: two poles may bring nothing that four do.
    """
    fits = [fit_track(track, contact_compliance, order) for order in ORDERS]
    errors = [relative_error(model, track, contact_compliance) for model in fits]
    for model, error in zip(fits, errors, strict=True):
        if error <= _GOOD_ENOUGH:
            return model
    if track.causal:
        return fits[int(np.argmin(errors))]
    for model, error, next_error in zip(fits, errors, errors[1:], strict=False):
        if next_error > 0.75 * error:
            return model
    return fits[-1]
