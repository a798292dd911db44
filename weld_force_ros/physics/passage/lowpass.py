"""The contact force through low-pass filters: what of an impact reaches wheel and track as a whole.

Causal Butterworth filters of the fourth order, 24 dB an octave: at 120 Hz, which leaves the P2-type force, and at
20 Hz, as EN 14363 has forces filtered. A filter is pairs of poles, as the track is,

    H(s) = w^4 / prod(s - p_k) = sum of r_k / (s - p_k),

and steps as `physics.passage.state_space` does: without its newest force and scaled by E b + a, a state is
u[n+1] = E u[n] + f[n], and y[n] = Re(C u[n]) + g f[n] with C = 2 r (E b + a) and g = Re(sum of 2 r b). Its f is the
force's departure from the smooth rail's; what the smooth rail leaves of itself is periodic, known, and added.

A filter above the wheelset's resonance on the track lets the weld's transient pass: for it a passage goes on until that
can no longer exceed what was seen (`physics.passage.batch`). Below, the transient is swift, and all that the filter
will still notice of it is in the wheel: M v' = -f for departures from smooth rail, so that the rest of f amounts to an
impulse M v with the moment -M w about the end. A state q = (E b + a) u + b f goes on as (q + M (v + p w)) e^(p t), and
the greatest may come then, after the passage.
"""

from typing import NamedTuple

import numpy as np
import scipy  # loads its slow parts, such as signal, where they are first used
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.passage._later import add_later
from weld_force_ros.physics.passage.state_space import first_order_hold

WHEELSET_HZ = 57.0  # its lowest resonance on the track
BETWEEN_RESONANCES_HZ = 120.0  # that one and the next, some 250 Hz
CUTOFFS_HZ = (BETWEEN_RESONANCES_HZ, 20.0)
ORDER = 4
UNFILTERED = 6
"""Results of a passage without filters."""
_LATER = 16  # times at which to look after a passage
_FADING = 0.8  # of a cutoff's period: when the last of them is


class LowPass(NamedTuple):
    """Filters in the steps of some speeds; real and imaginary parts along an axis of their own.

    Attributes:
        decay: (n_speed, 2, n_filter, ORDER // 2), E.
        shapes: (n_speed, 2, n_filter, ORDER // 2), C.
        gains: (n_speed, n_filter), g.
        smooth_n: (n_speed, n_filter, n_grid), low-passed force on smooth rail at every step of the span.
        smooth_greatest_n: (n_speed, n_filter), of it.
        floors_n: (n_speed, n_filter), the level that a transient still rises from, for filters that let it pass: the
            greatest on smooth rail; minus infinity for slow filters, which no passage goes on for.
        later: (n_speed, ORDER n_slow + 3, n_slow, n_time), departure after a passage per state u, then per
            displacement, velocity and force of the wheel, of the slow filters.
        steps: (n_speed, n_slow, n_time), when that is, in steps after the end.
    """

    decay: FloatArray
    shapes: FloatArray
    gains: FloatArray
    smooth_n: FloatArray
    smooth_greatest_n: FloatArray
    floors_n: FloatArray
    later: FloatArray
    steps: NDArray[np.int64]


def low_pass(dt_s: FloatArray, smooth_wheel: FloatArray, mass_kg: float, cutoffs_hz: tuple[float, ...]) -> LowPass:
    """Return filters for a wheel at several speeds.

    Args:
        dt_s: (n_speed,), of a step.
        smooth_wheel: (n_speed, n_grid, 3), as `SteadyState` has it.
        mass_kg: of the wheel.
        cutoffs_hz: (n_filter,).
    """
    dt = dt_s[:, None, None]
    poles, residues = _modes(cutoffs_hz)
    decay, old, new = first_order_hold(poles, dt)
    input_scale = decay * new + old
    shapes, gains = 2 * residues * input_scale, (2 * residues * new).real.sum(axis=2)
    smooth_n = _periodic(decay, shapes, gains, smooth_wheel[:, :, 2])
    cutoffs = np.array(cutoffs_hz)[:, None]
    is_slow = cutoffs[:, 0] < WHEELSET_HZ
    steps = np.rint(_FADING / cutoffs[is_slow] * np.linspace(0.0, 1.0, _LATER) / dt).astype(np.int64)
    swing = 2 * residues[is_slow, :, None] * np.exp(poles[is_slow, :, None] * (steps * dt)[:, :, None])
    wheel = _of_wheel(poles[is_slow], new[:, is_slow], mass_kg, swing)
    return LowPass(
        decay=_parts(decay),
        shapes=_parts(shapes),
        gains=gains,
        smooth_n=smooth_n,
        smooth_greatest_n=smooth_n.max(axis=2),
        floors_n=np.where(is_slow, -np.inf, smooth_n.max(axis=2)),
        later=np.concatenate([_of_states(input_scale[:, is_slow], swing), wheel], axis=1),
        steps=steps,
    )


def result_columns(filters: LowPass) -> int:
    """Return how many results compiled passages have: unfiltered, of filters, and their states and wheel at the end."""
    count = filters.gains.shape[1]
    return UNFILTERED + (count * (1 + ORDER) + 3 if count else 0)


def with_filters(
    filters: LowPass,
    smooth_wheel: FloatArray,
    speeds: NDArray[np.intp],
    starts: NDArray[np.int64],
    found: FloatArray,
) -> FloatArray:
    """Return results of passages with the greatest low-passed forces during them or later, at least on smooth rail.

    Args:
        filters: of all speeds.
        smooth_wheel: (n_speed, n_grid, 3), as `SteadyState` has it.
        speeds: (n,), indices of those that the passages have.
        starts: (n,), step of the span at which they began.
        found: (n, n_column), of the compiled passages.

    Returns:
        (n, UNFILTERED + n_filter).
    """
    shown = UNFILTERED + filters.gains.shape[1]
    results = found[:, :shown].copy()
    if shown > UNFILTERED:
        grid, is_slow = filters.smooth_n.shape[2], np.isneginf(filters.floors_n[speeds[:1]]).all(axis=0)
        ends = (starts + found[:, 5].astype(np.int64)) % grid
        endings = np.ascontiguousarray(found[:, shown:][:, np.append(np.repeat(is_slow, ORDER), [True, True, True])])
        endings[:, -3:] -= smooth_wheel[speeds, ends]
        low = np.maximum(found[:, UNFILTERED:shown], filters.smooth_greatest_n[speeds])
        slow = np.flatnonzero(is_slow)
        add_later(speeds, ends, endings, slow, filters.smooth_n, filters.later, filters.steps, low)
        results[:, UNFILTERED:] = low
    return results


def low_passed(force_n: FloatArray, dt_s: float) -> FloatArray:
    """Return a force history (n,) that begins at rest, through each filter: (n_filter, n)."""
    sections = [scipy.signal.butter(ORDER, cutoff, fs=1 / dt_s, output="sos") for cutoff in CUTOFFS_HZ]
    return np.stack(
        [scipy.signal.sosfilt(sos, force_n, zi=force_n[0] * scipy.signal.sosfilt_zi(sos))[0] for sos in sections]
    )


def _modes(cutoffs_hz: tuple[float, ...]) -> tuple[ComplexArray, ComplexArray]:
    """Return the poles in the upper half plane and their residues, each (n_filter, ORDER // 2)."""
    circle = -np.exp(1j * np.pi * np.arange(1 - ORDER, ORDER, 2) / (2 * ORDER))
    poles, residues = np.empty((2, len(cutoffs_hz), ORDER // 2), dtype=np.complex128)
    for row, cutoff in enumerate(cutoffs_hz):
        whole = 2 * np.pi * cutoff * circle
        poles[row] = whole[whole.imag > 0]
        residues[row] = [(2 * np.pi * cutoff) ** ORDER / np.prod((pole - whole)[whole != pole]) for pole in poles[row]]
    return poles, residues


def _periodic(decay: ComplexArray, shapes: ComplexArray, gains: FloatArray, force_n: FloatArray) -> FloatArray:
    """Return responses (n_speed, n_filter, n_grid) to forces (n_speed, n_grid) that repeat: exact, by harmonics."""
    count = force_n.shape[1]
    z = np.exp(2j * np.pi * np.arange(count // 2 + 1) / count)
    harmonics = np.fft.rfft(force_n)[:, None]
    pairs = shapes[..., None] / (z - decay[..., None]) + shapes.conj()[..., None] / (z - decay.conj()[..., None])
    return np.fft.irfft((gains[..., None] + 0.5 * pairs.sum(axis=2)) * harmonics, count)


def _of_states(input_scale: ComplexArray, swing: ComplexArray) -> FloatArray:
    """Return the departure per state u, (n_speed, ORDER n_filter, n_filter, n_time); `swing` is 2 r e^(p t)."""
    speeds, kinds, _, times = swing.shape
    scaled = input_scale[..., None] * swing
    found = np.zeros((speeds, kinds, ORDER // 2, 2, kinds, times))
    for kind in range(kinds):
        found[:, kind, :, :, kind] = np.stack([scaled[:, kind].real, -scaled[:, kind].imag], axis=2)
    return found.reshape(speeds, ORDER * kinds, kinds, times)


def _of_wheel(poles: ComplexArray, new: ComplexArray, mass_kg: float, swing: ComplexArray) -> FloatArray:
    """Return the departure per displacement, velocity and force of the wheel, (n_speed, 3, n_filter, n_time)."""
    parts = [mass_kg * poles[..., None] * swing, mass_kg * swing, new[..., None] * swing]
    return np.stack([part.real.sum(axis=2) for part in parts], axis=1)


def _parts(values: ComplexArray) -> FloatArray:
    return np.stack([values.real, values.imag], axis=1)
