"""Passages with enough rail on either side to be analysed in frequency, and what studies read from their spectra."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.physics.analysis.spectra import SpectralPeak, Spectrum, amplitude_spectrum, spectral_peaks
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History, VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath

MARGIN_M = 6.0  # the wheelset on the track has come to rest within it, and the taper's ends lie in it
CLEAR = 0.01  # of the largest amplitude: how far a spectral peak stands out


def record(vehicle_track: VehicleTrackModel, wheel_path: WheelPath, speed_kmh: float) -> History:
    """A passage with the weld's centre at 0 and smooth rail on either side.

    Its force is what the weld adds to the static load: less what sleepers do, if the track has any.
    """
    samples = round(MARGIN_M / RESAMPLED_STEP_M)
    start_m = wheel_path.start_m - samples * RESAMPLED_STEP_M
    height_m = np.pad(wheel_path.height_m, samples)
    passage, smooth = (vehicle_track.history(WheelPath(start_m, z), speed_kmh, 0.0) for z in (height_m, 0.0 * height_m))
    return replace(passage, force_n=vehicle_track.wheel.static_load_n + passage.force_n - smooth.force_n)


def force_spectrum(passage: History, speed_kmh: float) -> Spectrum:
    """Spectrum of the force, N."""
    return amplitude_spectrum(passage.x_m, passage.force_n, speed_kmh)


def irregularity_spectrum(passage: History, speed_kmh: float) -> Spectrum:
    """Spectrum of the wheel centre's way over the weld, m."""
    return amplitude_spectrum(passage.x_m, passage.irregularity_m, speed_kmh)


def peaks_between(spectrum: Spectrum, from_hz: float, to_hz: float) -> list[SpectralPeak]:
    """Clear peaks within a range of frequencies."""
    return [peak for peak in spectral_peaks(spectrum, CLEAR) if from_hz <= peak.frequency_hz <= to_hz]


def strongest_hz(spectrum: Spectrum, from_hz: float, to_hz: float) -> float:
    """Frequency of the strongest local maximum within a range, however little it stands out; nan if there is none."""
    inside = [peak for peak in spectral_peaks(spectrum, 0.0) if from_hz <= peak.frequency_hz <= to_hz]
    return max(inside, key=lambda peak: peak.amplitude).frequency_hz if inside else float("nan")


def first_two_hz(peaks: list[SpectralPeak]) -> tuple[float, float]:
    """Frequencies of the first two peaks; nan in place of one that is missing."""
    first, second, *_ = [*(peak.frequency_hz for peak in peaks), float("nan"), float("nan")]
    return first, second


def place_at(speeds_kmh: FloatArray, peak_map: PeakMap, speed_kmh: float) -> float:
    """Where the force peaks at the computed speed nearest to another, at the surface's first position."""
    if not np.isfinite(speed_kmh):
        return float("nan")
    return float(peak_map.peak_x_m[np.argmin(np.abs(speeds_kmh - speed_kmh)), 0])


def exponent(speeds_kmh: ArrayLike, quantity: ArrayLike) -> float:
    """Power of speed that a positive quantity follows: the slope of its logarithm; nan if one value is."""
    if not np.all(np.isfinite(quantity)):
        return float("nan")
    return float(np.polyfit(np.log(speeds_kmh), np.log(quantity), 1)[0])
