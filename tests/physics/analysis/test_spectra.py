import numpy as np
import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis.spectra import (
    amplitude_spectrum,
    bands,
    phase_at_peak,
    resonances_hz,
    spectral_peaks,
    wheelset_track_receptance,
)
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.simulation.track_file import TrackDefinition

SPEED_KMH = 90.0  # 25 m/s: 100 Hz are 0.25 m


def sine(x: np.ndarray, frequency_hz: float, phase: float = 0.0) -> np.ndarray:
    return np.cos(2 * np.pi * frequency_hz * x / 25.0 + phase)


def burst(x: np.ndarray, frequency_hz: float, length_m: float, sign: float = 1.0) -> np.ndarray:
    """A wave under a Gaussian, largest or least at 0."""
    return sign * sine(x, frequency_hz) * np.exp(-((x / length_m) ** 2))


@pytest.mark.parametrize("step_m", [1e-3, 3e-3])
def test_lines_are_read_with_their_frequency_wavelength_and_amplitude(step_m: float):
    x = np.arange(0.0, 8.0, step_m)
    values = 1e5 + 40 * x + 700 * sine(x, 61.3, 0.4) + 250 * sine(x, 243.7, 1.0)
    low, high = spectral_peaks(amplitude_spectrum(x, values, SPEED_KMH), prominence=0.25)
    assert (low.frequency_hz, high.frequency_hz) == pytest.approx((61.3, 243.7), abs=0.1)
    assert (low.wavelength_m, high.wavelength_m) == pytest.approx((25 / 61.3, 25 / 243.7), rel=2e-3)
    assert (low.amplitude, high.amplitude) == pytest.approx((700, 250), rel=0.01)


def test_frequencies_of_a_fixed_shape_grow_with_speed_and_its_wavelengths_stay():
    x = np.arange(-3.0, 3.0, 1e-3)
    slow = spectral_peaks(amplitude_spectrum(x, burst(x, 100.0, 1.0), 90.0))[0]
    fast = spectral_peaks(amplitude_spectrum(x, burst(x, 100.0, 1.0), 180.0))[0]
    assert slow.frequency_hz == pytest.approx(100.0, abs=0.2)
    assert fast.frequency_hz == pytest.approx(2 * slow.frequency_hz)
    assert fast.wavelength_m == pytest.approx(slow.wavelength_m)
    assert fast.amplitude == pytest.approx(slow.amplitude)


def test_spectrum_is_that_of_the_mirrored_record():
    x = np.arange(-1.0, 1.0, 2e-3)
    chirp = np.sin(2 * np.pi * (3 * x + 5 * x**2)) * np.exp(-(x**2) / 0.1)
    there, back = amplitude_spectrum(x, chirp, SPEED_KMH), amplitude_spectrum(-x[::-1], chirp[::-1], SPEED_KMH)
    np.testing.assert_allclose(back.amplitude, there.amplitude, atol=1e-12)


def test_chirp_is_split_where_its_frequency_passes_the_cut_and_adds_up():
    x = np.arange(0.0, 50.0, 1e-3)
    time = x / 25.0
    chirp = np.cos(2 * np.pi * (50 * time + 0.5 * 500 * time**2))  # 50 to 1050 Hz in 2 s, 530 Hz at 0.96 s
    parts = bands(x, 1e5 + 1e3 * chirp, SPEED_KMH)
    np.testing.assert_array_equal(parts.low_n + parts.high_n, 1e5 + 1e3 * chirp)
    early, late = (time > 0.2) & (time < 0.6), (time > 1.4) & (time < 1.9)
    assert np.abs(parts.high_n[early]).max() < 60
    assert np.abs(parts.low_n[late] - 1e5).max() < 60
    np.testing.assert_allclose(parts.low_n[early], 1e5 + 1e3 * chirp[early], atol=60)  # no delay


def test_bands_do_not_depend_on_direction_or_sampling():
    def parts(step_m: float):
        x = np.arange(-2.0, 2.0 + step_m / 2, step_m)
        return bands(x, 1e5 + 5e3 * burst(x, 150.0, 0.1) + 2e3 * burst(x - 0.01, 800.0, 0.05), SPEED_KMH)

    fine, coarse = parts(0.5e-3), parts(1e-3)
    np.testing.assert_allclose(coarse.high_n, fine.high_n[::2], atol=30)
    mirrored = bands(fine.x_m, (fine.low_n + fine.high_n)[::-1], SPEED_KMH)
    np.testing.assert_allclose(mirrored.high_n, fine.high_n[::-1], atol=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_parts_that_meet_in_phase_or_in_anti_phase(sign: float):
    x = np.arange(-2.0, 2.0, 0.5e-3)
    force = 1e5 + 8e3 * burst(x, 150.0, 0.2) + 3e3 * burst(x, 900.0, 0.1, sign)
    found = phase_at_peak(bands(x, force, SPEED_KMH))
    assert found.x_m == pytest.approx(0.0, abs=1e-3)
    assert sign * found.correlation > 0.8
    assert found.high_n == pytest.approx(sign * 3e3, rel=0.05)
    # In anti-phase the whole force is largest beside the low part's maximum.
    assert found.high_at_maximum_n > -500
    elsewhere = phase_at_peak(bands(x, force + 9e3 * np.exp(-(((x - 1.2) / 0.1) ** 2)), SPEED_KMH), (-0.5, 0.5))
    assert elsewhere.x_m == pytest.approx(0.0, abs=1e-3)


def test_records_that_cannot_be_analysed_are_refused():
    x = np.array([0.0, 1e-3, 3e-3, 4e-3])
    with pytest.raises(InputError, match="no equidistant record"):
        amplitude_spectrum(x, np.ones(4), SPEED_KMH)
    x = np.arange(0.0, 1.0, 1e-3)
    with pytest.raises(InputError, match="cannot be split at 530 Hz"):
        bands(x, np.ones_like(x), 3.0)
    with pytest.raises(InputError, match="three periods"):
        bands(x[:50], np.ones(50), SPEED_KMH)
    with pytest.raises(InputError, match="no force from 5"):
        phase_at_peak(bands(x, np.sin(x), SPEED_KMH), (5.0, 6.0))


def test_resonances_of_a_mass_on_a_spring():
    frequency = np.arange(20.0, 400.0, 1.0)
    omega = 2 * np.pi * frequency
    stiffness, mass, damping = 100e6, 600.0, 20e3
    response = 1 / (stiffness - mass * omega**2 + 1j * omega * damping)
    peak = np.sqrt(stiffness / mass - damping**2 / (2 * mass**2)) / (2 * np.pi)
    assert resonances_hz(frequency, response) == pytest.approx([peak], abs=0.05)


def test_wheelset_on_the_track_resonates_where_the_paper_says(definitions: dict[str, TrackDefinition]):
    definition = definitions["bilbao-continuous"]
    frequency = np.arange(20.0, 500.0, 1.0)
    (moving,) = wheelset_track_receptance(definition.track, definition.wheel, frequency, 0.0)
    first, second = resonances_hz(frequency, moving)
    assert first == pytest.approx(60.0, rel=0.12)
    assert second == pytest.approx(240.0, rel=0.12)


def test_wheel_and_rail_move_alike_under_a_force_on_both(definitions: dict[str, TrackDefinition]):
    definition = definitions["bilbao"]
    frequency, at = np.array([50.0, 200.0]), np.array([0.0, 0.3])
    track, wheel = definition.track, definition.wheel
    h = receptance(track, frequency, at)
    together = wheelset_track_receptance(track, wheel, frequency, at)
    omega = 2 * np.pi * frequency
    # A unit force on both moves the rail by h (1 - f) and the wheel by -f / (M w^2), f its share: alike.
    share = 1 + wheel.mass_kg * omega**2 * together
    np.testing.assert_allclose(together, h * share, rtol=1e-12)
