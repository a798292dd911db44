"""Forces and irregularities over frequency, resonances of the wheelset on the track, and the split at 530 Hz.

Below some 530 Hz the peaks of a force's spectrum keep their frequencies and belong to the wheelset on the track, above
it they move with speed and belong to the weld; where both parts are in anti-phase at the largest force, the force falls
with speed (paper, section 6.2).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import next_fast_len
from scipy.signal import butter, detrend, find_peaks, sosfiltfilt
from scipy.signal.windows import tukey

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.peaks import vertex
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.track.beam import Track, receptance

CUT_HZ = 530.0
_TAPER = 0.1  # of the record, half of it at either end
_PADDING = 8  # times the record's length: places peaks between a record's own frequencies
_ORDER = 4  # of the low pass, twice that as it runs both ways


@dataclass(frozen=True)
class Spectrum:
    """Amplitudes over frequency, each (n,), without the constant part.

    Attributes:
        frequency_hz: increasing.
        wavelength_m: along the rail, speed over frequency.
        amplitude: in the unit of the values; a steady sine reads its own amplitude, a transient one that falls with
            the record's length.
    """

    frequency_hz: FloatArray
    wavelength_m: FloatArray
    amplitude: FloatArray


@dataclass(frozen=True)
class SpectralPeak:
    """A local maximum of a spectrum."""

    frequency_hz: float
    wavelength_m: float
    amplitude: float


@dataclass(frozen=True)
class Bands:
    """A force history in two parts, each (n,), whose sum it is; the static load is in the low one."""

    x_m: FloatArray
    low_n: FloatArray
    high_n: FloatArray
    speed_kmh: float


@dataclass(frozen=True)
class Phase:
    """The relation of both parts of a force where the low one is largest.

    Attributes:
        x_m: place of the low part's maximum.
        correlation: of both parts over one period of the high one about that place: 1 in phase, -1 in anti-phase.
        high_n: the high part at that place: what it adds to the low part's maximum, or takes from it.
        high_at_maximum_n: the high part where the whole force is largest.
    """

    x_m: float
    correlation: float
    high_n: float
    high_at_maximum_n: float


def amplitude_spectrum(x_m: ArrayLike, values: ArrayLike, speed_kmh: float) -> Spectrum:
    """Return the spectrum of what a wheel meets or does along the rail at a speed.

    The least-squares line is removed, a tenth of the record tapered (Tukey), zeros added to at least eight times its
    length, and amplitudes corrected for the taper.

    Args:
        x_m: (n,), equidistant.
        values: (n,), of any unit.
        speed_kmh: running speed.

    Raises:
        InputError: not equidistant.
    """
    array = np.asarray(values, dtype=np.float64)
    step_s = _step_s(x_m, array, speed_kmh)
    taper = tukey(len(array), _TAPER)
    count = next_fast_len(_PADDING * len(array), real=True)
    amplitude = 2 * np.abs(np.fft.rfft(detrend(array) * taper, count)) / taper.sum()
    frequency = np.fft.rfftfreq(count, step_s)[1:]
    return Spectrum(frequency, speed_kmh / 3.6 / frequency, amplitude[1:])


def spectral_peaks(spectrum: Spectrum, prominence: float = 0.05) -> list[SpectralPeak]:
    """Return the local maxima of a spectrum in the order of frequency, refined by a parabola.

    Args:
        spectrum: of a force or an irregularity.
        prominence: that a peak needs, relative to the largest amplitude; a steady wave's side lobes reach a fifth.
    """
    frequency, amplitude = spectrum.frequency_hz, spectrum.amplitude
    speed = frequency[0] * spectrum.wavelength_m[0]
    least = prominence * amplitude.max() or None  # of none, a tenth of the time
    found = find_peaks(amplitude, prominence=least)[0]
    vertices = (vertex(frequency, amplitude, int(index)) for index in found)
    return [SpectralPeak(at_hz, float(speed / at_hz), height) for at_hz, height in vertices]


def wheelset_track_receptance(track: Track, wheel: Wheel, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray:
    """Return the receptance of the wheel's mass on the rail, 1 / (1/h - M w^2), m/N, (n_at, n_frequency).

    Args:
        track: whose receptance h is at the wheel.
        wheel: of mass M.
        frequency_hz: (n_frequency,), positive.
        at_m: (n_at,), metres after a sleeper.
    """
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    return np.asarray(1 / (1 / receptance(track, frequency_hz, at_m) - wheel.mass_kg * omega**2))


def resonances_hz(frequency_hz: ArrayLike, response: ArrayLike, prominence_db: float = 0.01) -> list[float]:
    """Return the frequencies of the local maxima of a response's level, refined by a parabola.

    Args:
        frequency_hz: (n,), increasing.
        response: (n,), complex.
        prominence_db: that a peak needs; well damped resonances on a slope stand out by little.
    """
    frequency, level_db = np.asarray(frequency_hz, dtype=np.float64), 20 * np.log10(np.abs(np.asarray(response)))
    return [vertex(frequency, level_db, int(i))[0] for i in find_peaks(level_db, prominence=prominence_db)[0]]


def bands(x_m: ArrayLike, force_n: ArrayLike, speed_kmh: float, cut_hz: float = CUT_HZ) -> Bands:
    """Return a force history below and above a frequency, without delay; both parts add up to the whole.

    The low part is a Butterworth low pass run in both directions, a quarter of the power at `cut_hz`; the high part is
    what is left.

    Args:
        x_m: (n,), equidistant.
        force_n: (n,).
        speed_kmh: running speed.
        cut_hz: frequency of the split.

    Raises:
        InputError: not equidistant, too coarse for `cut_hz`, or too short.
    """
    force = np.asarray(force_n, dtype=np.float64)
    step_s = _step_s(x_m, force, speed_kmh)
    if not 0 < cut_hz < 0.5 / step_s:
        raise InputError(
            f"samples {step_s:g} s apart cannot be split at {cut_hz:g} Hz", "sample more finely, or raise the speed"
        )
    period = round(1 / (cut_hz * step_s))
    if len(force) <= 3 * period:
        raise InputError(f"{len(force)} samples are under three periods of {cut_hz:g} Hz", "give a longer history")
    low = sosfiltfilt(butter(_ORDER, cut_hz, fs=1 / step_s, output="sos"), force, padlen=3 * period)
    return Bands(np.asarray(x_m, dtype=np.float64), low, force - low, speed_kmh)


def phase_at_peak(parts: Bands, within_m: tuple[float, float] = (-np.inf, np.inf)) -> Phase:
    """Return how the high part stands to the low part where the low part is largest.

    The period is that of the high part's largest spectral amplitude.

    Args:
        parts: of a force history.
        within_m: stretch in which maxima are looked for.

    Raises:
        InputError: no sample in that stretch.
    """
    x, low, high = parts.x_m, parts.low_n, parts.high_n
    inside = np.flatnonzero((x >= within_m[0]) & (x <= within_m[1]))
    if len(inside) == 0:
        raise InputError(f"no force from {within_m[0]:g} to {within_m[1]:g} m", "look where the history is")
    summit = inside[np.argmax(low[inside])]
    largest = inside[np.argmax((low + high)[inside])]
    spectrum = amplitude_spectrum(x, high, parts.speed_kmh)
    period_m = spectrum.wavelength_m[np.argmax(spectrum.amplitude)]
    near = np.abs(x - x[summit]) <= period_m / 2
    correlation = np.corrcoef(low[near], high[near])[0, 1]
    return Phase(float(x[summit]), float(correlation), float(high[summit]), float(high[largest]))


def _step_s(x_m: ArrayLike, values: FloatArray, speed_kmh: float) -> float:
    x = np.asarray(x_m, dtype=np.float64)
    steps = np.diff(x)
    if x.shape != values.shape or len(x) < 3 or steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
        raise InputError(
            f"{len(values)} values at {len(x)} places are no equidistant record", "resample at one distance"
        )
    return float(steps.mean() / (speed_kmh / 3.6))
