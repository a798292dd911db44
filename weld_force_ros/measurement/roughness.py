"""Synthetic roughness of a rail's running surface, with the spectrum of the ISO 3095 limit.

`LIMIT_DB` are the levels of the upper limit for the rail of a reference track, ISO 3095:2013, figure 2, in one-third
octave bands of wavelength. Unverified: recalled, and equal to a public transcription of that figure and of the listing
in EN 15610:2009, annex B (github.com/jmrplens/phonometry); the standards themselves were not read. Bands over 0.4 m, of
which the limit says nothing, are continued by the slope that it ends with, 2 dB a band.
"""

from collections.abc import Mapping

import numpy as np
from scipy.fft import irfft, next_fast_len, rfftfreq

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import FloatArray

REFERENCE_M = 1e-6

LIMIT_DB: Mapping[float, float] = {
    0.4: 17.1, 0.315: 15.0, 0.25: 13.0, 0.2: 11.0, 0.16: 9.0, 0.125: 7.0, 0.1: 4.9, 0.08: 2.9, 0.063: 0.9, 0.05: -1.1,
    0.04: -3.2, 0.0315: -5.0, 0.025: -5.6, 0.02: -6.2, 0.016: -6.8, 0.0125: -7.4, 0.01: -8.0, 0.008: -8.6,
    0.0063: -9.2, 0.005: -9.8, 0.004: -10.4, 0.00315: -11.0,
}  # fmt: skip
"""Wavelength in m of each band's middle, nominal, to the RMS of the height in it, dB re 1 µm."""
CONTINUED_DB: Mapping[float, float] = {1.0: 25.1, 0.8: 23.1, 0.63: 21.1, 0.5: 19.1}
"""The same for longer waves: an assumption."""

_LONGEST_BANDS_LINES = 100  # of frequency, that the longest band's phases are many


def rail_roughness(length_m: float, step_m: float, seed: int, level_db: float = 0.0) -> FloatArray:
    """Return heights in m, positive up, `step_m` apart from 0 to `length_m`, (n,): the limit's spectrum, random phases.

    Power is spread evenly over the wavenumbers of a band; there is none at waves over 1.12 m or under two steps.

    Args:
        length_m: of the rail.
        step_m: between samples.
        seed: the same seed gives the same rail.
        level_db: added to every band.

    Raises:
        InputError: a length, step, seed or level that no rail can be made of.
    """
    if not (0 < step_m <= length_m < np.inf and seed >= 0 and abs(level_db) < np.inf):
        raise InputError(
            f"no roughness can be made of length {length_m:g} m, step {step_m:g} m, seed {seed}, level {level_db:g} dB",
            "give a step up to the length, a seed from 0 on and a finite level",
        )
    count = int(np.floor(length_m / step_m + 1e-9)) + 1
    lines = next_fast_len(max(count, round(_LONGEST_BANDS_LINES / 0.23 / step_m)), real=True)  # 0.23: its width, per m
    wavenumber = rfftfreq(lines, step_m)
    amplitude = _amplitudes_m(wavenumber) * 10 ** (level_db / 20)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(wavenumber))
    heights: FloatArray = irfft(amplitude * np.exp(1j * phase), lines)[:count] * (lines / 2)
    return heights


def band_edges_per_m(wavelength_m: float) -> tuple[float, float]:
    """Return the wavenumbers that bound a one-third octave band, given its nominal middle (base ten, IEC 61260)."""
    middle = 10 ** (round(-10 * np.log10(wavelength_m)) / 10)
    return float(middle * 10**-0.05), float(middle * 10**0.05)


def _amplitudes_m(wavenumber_per_m: FloatArray) -> FloatArray:
    """Return amplitudes of the sine at each wavenumber, (n,); zero at the highest one, whose phase is not free."""
    power = np.zeros(len(wavenumber_per_m))
    for wavelength_m, level_db in {**CONTINUED_DB, **LIMIT_DB}.items():
        low, high = band_edges_per_m(wavelength_m)
        inside = (wavenumber_per_m >= low) & (wavenumber_per_m < high)
        spacing = wavenumber_per_m[1]
        power[inside] = REFERENCE_M**2 * 10 ** (level_db / 10) * spacing / (high - low)
    power[-1] = 0.0
    return np.sqrt(2 * power)
