"""Synthetic roughness has the levels that are stated, by a filter bank that knows nothing of how it was made."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from scipy.stats import kurtosis

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.roughness import CONTINUED_DB, LIMIT_DB, rail_roughness

STEP_M = 1e-3


def level_db(z_m: np.ndarray, wavelength_m: float, step_m: float = STEP_M) -> float:
    """RMS behind a one-third octave Butterworth filter, dB re 1 µm; nominal wavelengths stand for exact ones."""
    middle = 10 ** (np.round(-10 * np.log10(wavelength_m)) / 10)
    sos = butter(6, (middle * 10**-0.05, middle * 10**0.05), "bandpass", fs=1 / step_m, output="sos")
    settled = sosfilt(sos, z_m)[len(z_m) // 10 :]
    return float(10 * np.log10(np.mean(settled**2) / 1e-12))


@pytest.fixture(scope="module")
def rail() -> np.ndarray:
    return rail_roughness(300.0, STEP_M, 5)


@pytest.mark.parametrize(("wavelength_m", "stated_db"), [*CONTINUED_DB.items(), *LIMIT_DB.items()])
def test_every_band_has_its_level(rail: np.ndarray, wavelength_m: float, stated_db: float):
    assert level_db(rail, wavelength_m) == pytest.approx(stated_db, abs=1.0)


def test_the_limit_is_a_straight_line_in_two_parts():
    # ISO 3095:2013 draws it as straight over the logarithm of the wavelength, broken near 3 cm.
    long_db = [LIMIT_DB[w] for w in sorted(LIMIT_DB) if w >= 0.04]
    short_db = [LIMIT_DB[w] for w in sorted(LIMIT_DB) if w <= 0.0315]
    np.testing.assert_allclose(np.diff(long_db), 2.03, atol=0.08)
    np.testing.assert_allclose(np.diff(short_db), 0.6, atol=1e-9)


def test_a_level_raises_every_height_alike(rail: np.ndarray):
    np.testing.assert_allclose(rail_roughness(300.0, STEP_M, 5, level_db=20.0), 10 * rail)


@pytest.mark.parametrize("length_m", [1.0, 30.0])
def test_a_short_rail_is_as_rough_as_a_long_one(length_m: float):
    rails = [rail_roughness(length_m, STEP_M, seed) for seed in range(20)]
    # 1.122 m is the longest wave, so that power short of it may be told even from a metre, on the average of many.
    expected = sum(10 ** (level / 10) for level in (*CONTINUED_DB.values(), *LIMIT_DB.values()))
    measured = np.mean([np.mean(rail**2) for rail in rails]) / 1e-12
    assert 10 * np.log10(measured / expected) == pytest.approx(0.0, abs=1.0)


def test_heights_are_normal_and_begin_anywhere(rail: np.ndarray):
    assert kurtosis(rail) == pytest.approx(0.0, abs=0.3)
    assert abs(rail[-1] - rail[0]) > 1e-9


def test_seeds_and_steps():
    np.testing.assert_array_equal(rail_roughness(5.0, STEP_M, 1), rail_roughness(5.0, STEP_M, 1))
    assert not np.array_equal(rail_roughness(5.0, STEP_M, 1), rail_roughness(5.0, STEP_M, 2))
    assert len(rail_roughness(5.0, STEP_M, 1)) == 5001
    coarse = rail_roughness(300.0, 5e-3, 1)
    assert level_db(coarse, 0.1, 5e-3) == pytest.approx(LIMIT_DB[0.1], abs=1.0)


@pytest.mark.parametrize(
    ("length_m", "step_m", "seed", "raised_db"),
    [(0.0, 1e-3, 0, 0.0), (1.0, 0.0, 0, 0.0), (1.0, 2.0, 0, 0.0), (1.0, 1e-3, -1, 0.0), (1.0, 1e-3, 0, np.nan)],
)
def test_what_is_no_rail_is_refused(length_m: float, step_m: float, seed: int, raised_db: float):
    with pytest.raises(InputError, match="no roughness can be made"):
        rail_roughness(length_m, step_m, seed, raised_db)
