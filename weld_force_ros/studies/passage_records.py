"""Passages with enough rail on either side to be analysed in frequency, and features of their spectra."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.physics.analysis.spectra import SpectralPeak, Spectrum, amplitude_spectrum, spectral_peaks
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History, VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import RESAMPLED_STEP_M, WheelPath

MARGIN_M = 6.0  # the wheelset on the track has come to rest within it, and both ends of the taper lie in it
CLEAR = 0.01  # of the largest amplitude: how far a spectral peak stands out
_LARGE = 0.1  # of the largest amplitude


def record(vehicle_track: VehicleTrackModel, wheel_path: WheelPath, speed_kmh: float, stride: int = 1) -> History:
    """Simulate a passage with the weld's centre at 0 and smooth rail on either side.

    Its force is the static load and what the weld adds to it; the effect of sleepers, if any, is subtracted.
    `stride` is as of `VehicleTrackModel.history`.
    """
    samples = round(MARGIN_M / RESAMPLED_STEP_M)
    start_m = wheel_path.start_m - samples * RESAMPLED_STEP_M
    height_m = np.pad(wheel_path.height_m, samples)
    passage, smooth = (
        vehicle_track.history(WheelPath(start_m, z), speed_kmh, 0.0, stride=stride) for z in (height_m, 0.0 * height_m)
    )
    return replace(passage, force_n=vehicle_track.wheel.static_load_n + passage.force_n - smooth.force_n)


def force_spectrum(passage: History, speed_kmh: float) -> Spectrum:
    """Return the spectrum of the force, N."""
    return amplitude_spectrum(passage.x_m, passage.force_n, speed_kmh)


def irregularity_spectrum(passage: History, speed_kmh: float) -> Spectrum:
    """Return the spectrum of the wheel centre's path over the weld, m."""
    return amplitude_spectrum(passage.x_m, passage.irregularity_m, speed_kmh)


def peaks_between(spectrum: Spectrum, from_hz: float, to_hz: float) -> list[SpectralPeak]:
    """Return the clear peaks within a range of frequencies."""
    return [peak for peak in spectral_peaks(spectrum, CLEAR) if from_hz <= peak.frequency_hz <= to_hz]


def large_peaks(spectrum: Spectrum) -> list[SpectralPeak]:
    """Return the clear peaks of at least a tenth of the largest amplitude."""
    least = _LARGE * spectrum.amplitude.max()
    return [peak for peak in spectral_peaks(spectrum, CLEAR) if peak.amplitude >= least]


def strongest_hz(spectrum: Spectrum, from_hz: float, to_hz: float) -> float:
    """Return the frequency of the strongest local maximum within a range, of any prominence; NaN without one."""
    inside = [peak for peak in spectral_peaks(spectrum, 0.0) if from_hz <= peak.frequency_hz <= to_hz]
    return max(inside, key=lambda peak: peak.amplitude).frequency_hz if inside else float("nan")


def first_two_hz(peaks: list[SpectralPeak]) -> tuple[float, float]:
    """Return the frequencies of the first two peaks; NaN in place of one that is missing."""
    first, second, *_ = [*(peak.frequency_hz for peak in peaks), float("nan"), float("nan")]
    return first, second


def peak_location_at(speeds_kmh: FloatArray, peak_map: PeakMap, speed_kmh: float) -> float:
    """Return the peak's location, m, at the computed speed nearest to another, at the peak map's first position."""
    if not np.isfinite(speed_kmh):
        return float("nan")
    return float(peak_map.peak_x_m[np.argmin(np.abs(speeds_kmh - speed_kmh)), 0])


def exponent(speeds_kmh: ArrayLike, quantity: ArrayLike) -> float:
    """Return the power of speed that a positive quantity follows: the slope of its logarithm; NaN if one value is."""
    if not np.all(np.isfinite(quantity)):
        return float("nan")
    return float(np.polyfit(np.log(speeds_kmh), np.log(quantity), 1)[0])
