"""Fits of common poles to what a moving contact finds, at several speeds at once.

Starts from poles and shapes of point receptances (vector fitting), with the signs of shapes that have nodes chosen by
the error at speed; then poles, shapes and changes with speed are moved together by least squares (Gauss-Newton with
Levenberg's damping). Residuals are relative errors of a force:

- receptances that a moving force finds, over |h + c| as in `common_poles`; less above some hundred hertz, as
  irregularities hold less the shorter they are;
- the deflection under the static load on its way along the span, harmonic by harmonic: what is wrong of it acts on the
  wheel as an irregularity does; over `DYNAMIC_SHARE` of the load, about what welds add to it.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.common_poles import BAND_HZ, PoleModel, fit_track
from weld_force_ros.physics.engines.greens_function import DEFLECTIONS, GreensFunctionModel, MovingReceptance
from weld_force_ros.physics.engines.moving_poles import SPEED_M_S, MovingPoleModel, Symmetry
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.local_support import LocalSupports

SPEEDS_KMH = (100.0, 200.0, 300.0)
BETWEEN_KMH = (250.0,)
"""Where the first fit is not made: one that holds at `SPEEDS_KMH` may be far off here. Then it is made here, too."""
DYNAMIC_SHARE = 0.2
ORDERS = (16, 20)
RESOLUTION = 0.005
"""Of the dynamic part: what a dozen passages, and the time steps of both engines, leave open of how good a fit is."""
_TRIALS_M = ((0.2e-3, 0.12), (-0.4e-3, 0.8), (-40e-6, 0.048))  # height and length of a cosine
_GOOD_ENOUGH = 0.01
_CLEARLY = 0.75  # of the usual fit's error, below which another takes its place
_NEARER = 0.9  # likewise, with the speeds between
_PLACES = 16
_FREQUENCIES = np.concatenate([[0.0, 1.0, 2.5], np.linspace(np.sqrt(BAND_HZ[0]), np.sqrt(BAND_HZ[1]), 160) ** 2])
_LOW_HZ = 400.0  # above which errors count less
_HARMONICS = 24  # of the span, of the deflection
_SLOW_M_S = 30 / 3.6
_MEAN_WEIGHT_N_PER_M = 1e8
_TERMS, _POINTS = 10, 256
_NODE = 0.35  # of a residue's greatest, below which its shape may have a node
_LEAST_DAMPING = 0.004  # of critical; between two fitted frequencies less would not be seen
_LEAST_DAMPING_ABOVE = 0.02  # likewise, of poles above the band
_ITERATIONS, _ATTEMPTS, _SETTLED = 30, 8, 5e-3
_PRIOR_AT_REST, _PRIOR_CHANGE = 2e-4, 1e-3  # weights of staying as they are, of poles and of strengths


@dataclass(frozen=True)
class Target:
    """What a moving contact finds, and what errors of it matter.

    Attributes:
        track: which.
        wheel: by whose contact errors are weighed.
        found: speed by speed, at rest first.
        weights: (n_at, n_frequency) of each, N/m.
        deflection_weights: (n_harmonic,) of each, N/m, from the mean on.
    """

    track: Track
    wheel: Wheel
    found: tuple[MovingReceptance, ...]
    weights: tuple[FloatArray, ...]
    deflection_weights: tuple[FloatArray, ...]

    @classmethod
    def of(cls, exact: GreensFunctionModel, speeds_kmh: tuple[float, ...] = SPEEDS_KMH) -> "Target":
        """Compute the receptances of a track at rest and at speeds, some seconds."""
        track, wheel = exact.track, exact.wheel
        at = track.spacing_m / _PLACES * (np.arange(_PLACES) + 0.25)
        static = beam.static_compliance(track, at)
        resting = beam.static_compliance(track, track.spacing_m / DEFLECTIONS * np.arange(DEFLECTIONS))
        point = beam.receptance(track, np.maximum(_FREQUENCIES, BAND_HZ[0]), at, threads=1)
        at_rest = np.where(
            _FREQUENCIES == 0.0, static[:, None], beam.receptance(track, np.maximum(_FREQUENCIES, 0.1), at)
        )
        found = [MovingReceptance(0.0, at, at_rest, resting)]
        found += [exact.moving_receptance(speed, _FREQUENCIES, _PLACES) for speed in speeds_kmh]
        seen = point + wheel.compliance(2 * np.pi * np.maximum(_FREQUENCIES, BAND_HZ[0]))
        weight = np.asarray(_by_frequency(_FREQUENCIES) / np.abs(seen))
        deflection_weights = []
        for one in found:
            passed = np.arange(_HARMONICS) * max(one.speed_m_s, _SLOW_M_S) / track.spacing_m
            near = np.interp(passed, _FREQUENCIES, np.abs(1 / seen).mean(axis=0))
            deflection_weights.append(np.maximum(near, _MEAN_WEIGHT_N_PER_M) / DYNAMIC_SHARE)
        return cls(track, wheel, tuple(found), (weight,) * len(found), tuple(deflection_weights))

    def error(self, model: MovingPoleModel) -> float:
        """Return the RMS of both over places, frequencies and speeds."""
        return float(np.sqrt(sum(np.sum(_linear(model, self, n).off ** 2) for n in range(len(self.found)))))


def _by_frequency(frequency_hz: FloatArray) -> FloatArray:
    return np.asarray(1 / np.hypot(1.0, frequency_hz / _LOW_HZ))


def moving_fit(track: Track, wheel: Wheel, usual: PoleModel) -> tuple[PoleModel | MovingPoleModel, float]:
    """Return the fit of lowest order whose peak forces are good enough, or the best, and how far they are off.

    Args:
        track: on sleepers, without loss factors.
        wheel: by whose contact errors are weighed.
        usual: the fit to point receptances, which is taken where it is good enough.

    Returns:
        The fit, one to moving receptances only if it is nearer with `BETWEEN_KMH`, too, and if none is, one that is
        made at those as well; its error at `SPEEDS_KMH`: RMS of the difference of its peak forces from the reference's
        over the RMS of their dynamic part, together with `RESOLUTION`.

    Raises:
        NumericalError: vector fitting did not end with finite poles.
    """
    trial, whole = _Trial(GreensFunctionModel(track, wheel, threads=1)), SPEEDS_KMH + BETWEEN_KMH
    best: PoleModel | MovingPoleModel = usual
    usual_off = off = trial.off(usual, SPEEDS_KMH)
    for speeds_kmh in (SPEEDS_KMH, whole):
        if off <= _GOOD_ENOUGH:
            break
        model, model_off = _nearest(trial, speeds_kmh)
        if model_off <= _CLEARLY * usual_off and trial.off(model, whole) <= _NEARER * trial.off(usual, whole):
            best, off = model, model_off
            break
    return best, float(np.hypot(off, RESOLUTION))


def _nearest(trial: "_Trial", speeds_kmh: tuple[float, ...]) -> tuple[MovingPoleModel, float]:
    """Return the fit at some speeds of lowest order that is good enough, or the best, and how far it is off."""
    target, fits = Target.of(trial.exact, speeds_kmh), list[tuple[MovingPoleModel, float]]()
    for order in ORDERS:
        model = refined(start(target, order), target)
        fits.append((model, trial.off(model, SPEEDS_KMH)))
        if fits[-1][1] <= _GOOD_ENOUGH:
            break
    return min(fits, key=lambda fit: fit[1])


def peaks_off(model: StateModel, track: Track, wheel: Wheel, supports: LocalSupports) -> float:
    """Return how far the peak forces of a track are off of which a few supports differ; see `moving_fit`."""
    trial = _Trial(GreensFunctionModel(track, wheel, supports, threads=1))
    return float(np.hypot(trial.off(model, SPEEDS_KMH), RESOLUTION))


@dataclass(frozen=True)
class _Trial:
    """Passages by which fits are compared with the reference."""

    exact: GreensFunctionModel
    _references_n: dict[float, FloatArray] = field(default_factory=dict, repr=False)

    def off(self, model: StateModel, speeds_kmh: tuple[float, ...]) -> float:
        """Return how far peak forces are off, relative to their dynamic part; infinite where none can be had."""
        wheel = self.exact.wheel
        fast, positions_m = VehicleTrackModel(model, wheel, threads=1), _trial_positions(self.exact.track)
        try:
            found = [fast.peak_map(path, speeds_kmh, positions_m).peak_force_n for path in _trial_paths(wheel)]
        except NumericalError:
            return float("inf")
        reference_n = np.stack([self._reference_n(speed) for speed in speeds_kmh], axis=1)
        return float(np.linalg.norm(found - reference_n) / np.linalg.norm(reference_n - wheel.static_load_n))

    def _reference_n(self, speed_kmh: float) -> FloatArray:
        """Return the reference's peak forces at a speed, (n_path, n_position)."""
        if speed_kmh not in self._references_n:
            paths, positions_m = _trial_paths(self.exact.wheel), _trial_positions(self.exact.track)
            maps = self.exact.peak_maps(paths, [speed_kmh], positions_m)
            self._references_n[speed_kmh] = np.stack([one.peak_force_n[0] for one in maps])
        return self._references_n[speed_kmh]


def _trial_paths(wheel: Wheel) -> list[WheelPath]:
    """Return a rise, a long dip and a short one."""
    paths = []
    for height_m, length_m in _TRIALS_M:
        x = np.arange(-0.6 * length_m, 0.6 * length_m, 1e-3)
        wave = 0.5 * height_m * (1 + np.cos(2 * np.pi * x / length_m))
        paths.append(wheel_path_over(x, np.where(np.abs(x) < length_m / 2, wave, 0.0), wheel.radius_m))
    return paths


def _trial_positions(track: Track) -> FloatArray:
    return track.spacing_m * np.array([0.0, 0.4])


def start(target: Target, order: int) -> MovingPoleModel:
    """Return poles and shapes of point receptances, the signs of shapes with nodes by the error at speed."""
    fit = fit_track(target.track, target.wheel.compliance, order, emphasis=_by_frequency)
    count, mid_span = len(fit.poles_rad_s), len(fit.section_m) // 2
    share = np.abs(fit.residues) / np.abs(fit.residues).max(axis=0)
    nodes = [(share[0, k], k, Symmetry.NODE_AT_SLEEPERS) for k in range(count)]
    nodes += [(share[mid_span, k], k, Symmetry.NODE_AT_MID_SPAN) for k in range(count)]
    symmetries = np.full(count, Symmetry.ALIKE, dtype=np.intp)
    best = as_moving(fit, symmetries)
    for _, k, symmetry in sorted(node for node in nodes if node[0] < _NODE):
        tried = symmetries.copy()
        tried[k] = symmetry
        model = as_moving(fit, tried)
        if target.error(model) < target.error(best):
            best, symmetries = model, tried
    return best


def as_moving(fit: PoleModel, symmetries: NDArray[np.intp] | None = None) -> MovingPoleModel:
    """Return a fit to point receptances as one that does not change with speed; no shape has nodes, if not given."""
    count = len(fit.poles_rad_s)
    model = MovingPoleModel(
        rates=np.log(-fit.poles_rad_s.real) + 1j * fit.poles_rad_s.imag,
        rate_changes=np.zeros(count, dtype=np.complex128),
        strengths=np.ones(count),
        strength_changes=np.zeros(count, dtype=np.complex128),
        series=np.zeros((count, _TERMS), dtype=np.complex128),
        symmetries=np.full(count, Symmetry.ALIKE, dtype=np.intp) if symmetries is None else symmetries,
        spacing_m=fit.spacing_m,
    )
    at = fit.spacing_m / _POINTS * np.arange(_POINTS)
    for k, shape in enumerate(fit.shapes_at(at).T):
        series = np.linalg.lstsq(model.terms_at(k, at), _signed(shape, model.symmetries[k]), rcond=None)[0]
        if model.real[k] and np.sum(series**2).real < 0:
            series, model.strengths[k] = series / 1j, -1.0
        model.series[k] = series.real if model.real[k] else series
    return model


def _signed(shape: ComplexArray, symmetry: int) -> ComplexArray:
    """Return a shape over a span (n_at,) with the signs of its symmetry."""
    after_mid_span = np.arange(len(shape)) > len(shape) // 2
    return np.where(after_mid_span & (symmetry == Symmetry.NODE_AT_MID_SPAN), -shape, shape)


def refined(model: MovingPoleModel, target: Target) -> MovingPoleModel:
    """Return a model with smaller errors, found from a nearby one."""
    began, damping = _unknowns(model), 1e-3
    model = _bounded(model)
    normal, right, cost = _normal_equations(model, target, began)
    for _ in range(_ITERATIONS):
        free = np.flatnonzero(normal.diagonal() > 0)
        scale = np.sqrt(normal.diagonal()[free])
        system, side = normal[np.ix_(free, free)] / scale[:, None] / scale, right[free] / scale
        for _ in range(_ATTEMPTS):
            step = np.zeros(len(right))
            step[free] = -np.linalg.solve(system + damping * np.eye(len(free)), side) / scale
            tried = _bounded(_with_unknowns(model, _unknowns(model) + step))
            found = _normal_equations(tried, target, began)
            if found[2] < cost:
                break
            damping *= 5
        else:
            return model
        settled = cost - found[2] < _SETTLED * cost
        model, (normal, right, cost), damping = tried, found, max(damping / 5, 1e-8)
        if settled:
            break
    return model


def _unknowns(model: MovingPoleModel) -> FloatArray:
    """Return all that is fitted: series, rates and changes pole by pole, all real parts first, then imaginary ones."""
    own = np.column_stack([model.series, model.rates, model.rate_changes, model.strength_changes]).ravel()
    return np.concatenate([own.real, own.imag])


def _with_unknowns(model: MovingPoleModel, unknowns: FloatArray) -> MovingPoleModel:
    real, imag = unknowns.reshape(2, len(model.rates), -1)
    own = real + 1j * imag
    return replace(
        model, series=own[:, :-3], rates=own[:, -3], rate_changes=own[:, -2], strength_changes=own[:, -1], _grids={}
    )


def _bounded(model: MovingPoleModel) -> MovingPoleModel:
    """Return a model whose poles have some damping at every speed."""
    frequency = np.abs(model.rates.imag)
    share = np.where(frequency > 2 * np.pi * BAND_HZ[1], _LEAST_DAMPING_ABOVE, _LEAST_DAMPING)
    least = np.log(np.maximum(share * frequency, 1.0))
    decay = np.maximum(model.rates.real, least)
    change = np.maximum(model.rate_changes.real, least - decay)
    return replace(model, rates=decay + 1j * model.rates.imag, rate_changes=change + 1j * model.rate_changes.imag)


def _normal_equations(
    model: MovingPoleModel, target: Target, began: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return the least squares' matrix and right side, zero for what is fixed, and the sum of squares."""
    shape = (2, len(model.rates), model.series.shape[1] + 3)
    prior = np.zeros(shape)
    size = np.abs(-np.exp(model.rates.real) + 1j * model.rates.imag)
    prior[0, :, -3], prior[1, :, -3] = _PRIOR_AT_REST, _PRIOR_AT_REST / size
    prior[0, :, -2], prior[1, :, -2] = _PRIOR_CHANGE, _PRIOR_CHANGE / size
    prior[:, :, -1] = _PRIOR_CHANGE
    away = prior.ravel() * (_unknowns(model) - began)
    normal, right = np.diag(prior.ravel() ** 2), prior.ravel() * away
    cost = float(np.sum(away**2))
    for n in range(len(target.found)):
        linear = _linear(model, target, n)
        normal += linear.rows @ linear.rows.T
        right += linear.rows @ linear.off
        cost += float(np.sum(linear.off**2))
    fixed = np.zeros(shape, dtype=np.bool_)
    fixed[1] = model.real[:, None]
    normal[fixed.ravel()], normal[:, fixed.ravel()], right[fixed.ravel()] = 0.0, 0.0, 0.0
    return normal, right, cost


class _Linear(NamedTuple):
    """Residuals at a speed, and how they change with the unknowns.

    Attributes:
        off: (n_residual,).
        rows: (n_unknown, n_residual).
    """

    off: FloatArray
    rows: FloatArray


def _linear(model: MovingPoleModel, target: Target, n: int) -> _Linear:
    found, weight = target.found[n], target.weights[n] / np.sqrt(target.weights[n].size * len(target.found))
    harmonics = np.fft.rfft(np.eye(DEFLECTIONS))[:, :_HARMONICS] / DEFLECTIONS
    harmonics = harmonics * np.sqrt(2 / len(target.found)) * target.deflection_weights[n]
    heavy = np.concatenate([harmonics.real, harmonics.imag], axis=1)
    receptance, deflection = -found.receptance, -found.deflection
    rows: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    for k, series in enumerate(model.series):
        changes = _changes(model, k, found.speed_m_s, found.at_m)
        for part, own, (moved, deflected) in zip(rows, (series.real, series.imag), changes, strict=True):
            # Twice, as the shape is in it twice.
            receptance = receptance + 0.5 * np.tensordot(own, moved[: len(own)], 1)
            deflection = deflection + 0.5 * own @ deflected[: len(own)]
            weighed = (moved * weight).reshape(len(moved), -1)
            part.append(np.concatenate([weighed.real, weighed.imag, deflected @ heavy], axis=1))
    off = (receptance * weight).ravel()
    return _Linear(np.concatenate([off.real, off.imag, deflection @ heavy]), np.concatenate([*rows[0], *rows[1]]))


def _changes(
    model: MovingPoleModel, pole: int, speed_m_s: float, at_m: FloatArray
) -> tuple[tuple[ComplexArray, FloatArray], tuple[ComplexArray, FloatArray]]:
    """Return how receptance (n, n_at, n_frequency) and deflection (n, n_at) change with a pole's n unknowns.

    First with the unknowns' real parts, then with their imaginary ones.
    """
    p, strength = model.poles_at(speed_m_s)[pole], model.strengths_at(speed_m_s)[pole]
    squared, weight = (speed_m_s / SPEED_M_S) ** 2, 0.5 * model.pair_weight[pole]
    series, through = model.series[pole], model.spacing_m / DEFLECTIONS * np.arange(DEFLECTIONS)
    s, still = 2j * np.pi * _FREQUENCIES, np.zeros(1, dtype=np.complex128)

    def product(places_m: FloatArray, ahead: ComplexArray, by_pole: ComplexArray) -> ComplexArray:
        """Return the changes of strength x shape x shape ahead, the rate's as the pole's."""
        terms = model.terms_at(pole, places_m).T
        shape = series @ terms
        whole = np.tensordot(series, ahead, 1)
        by_series = strength * (terms[:, :, None] * whole + shape[:, None] * ahead)
        by_rate = strength * shape[:, None] * np.tensordot(series, by_pole, 1)
        return np.concatenate([by_series, [by_rate, squared * by_rate, squared * shape[:, None] * whole]])

    plus, minus = (weight * product(at_m, *_ahead(model, pole, speed_m_s, at_m, p, sign * s)) for sign in (1, -1))
    resting = 2 * weight * product(through, *_ahead(model, pole, -speed_m_s, through, p, still))[:, :, 0]
    slower = np.ones((len(plus), 1))
    slower[-3:-1] = p.real  # the real part of a rate is the decay's logarithm
    return (
        (slower[:, :, None] * (plus + minus.conj()), slower * resting.real),
        (1j * (plus - minus.conj()), -resting.imag),
    )


def _ahead(
    model: MovingPoleModel, pole: int, speed_m_s: float, at_m: FloatArray, p: complex, s: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the transform of exp(p t) times the terms of a shape at x + v t, (n_term, n_at, n_s), and its change by p.

    As exponentials, of which cosines and sines are the halves.
    """
    k = model.wavenumbers(pole)[:, None]
    wave, moved = np.exp(1j * k * at_m), 1j * k * speed_m_s
    odd = model.symmetries[pole] == Symmetry.NODE_AT_SLEEPERS
    halves = (0.5 / 1j, -0.5 / 1j) if odd else (0.5, 0.5)
    left, right = halves[0] * wave[:, :, None], halves[1] * wave.conj()[:, :, None]
    onward, back = 1 / (s - p - moved)[:, None], 1 / (s - p + moved)[:, None]
    return left * onward + right * back, left * onward**2 + right * back**2
