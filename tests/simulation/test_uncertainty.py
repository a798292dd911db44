"""Samples of the unknown have the stated statistics; influences are those of functions known in closed form."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from weld_force_ros.assessment.probability import CONTACT, PLACE, RADIUS, REST, SUPPORT, influences
from weld_force_ros.messages import Uncertainty, UncertaintyResult
from weld_force_ros.simulation.settings import load_uncertainty
from weld_force_ros.simulation.uncertainty import draw, noisy


def unknown(samples: int = 400, **changes) -> Uncertainty:
    return msgspec.structs.replace(load_uncertainty(samples), **changes)


def test_factors_have_the_stated_mean_and_deviation():
    draws = draw(unknown(3000, design=UNSET, support_spread=0.3, hertz_spread=0.1, radius_low_m=0.4, radius_high_m=0.5))
    for factor, deviation in ((draws.support_factor, 0.3), (draws.hertz_factor, 0.1)):
        assert np.mean(np.log(factor)) == pytest.approx(0.0, abs=1e-3)
        assert np.std(np.log(factor)) == pytest.approx(deviation, rel=0.01)
    assert len(np.unique(draws.support_factor)) == 3
    np.testing.assert_allclose(np.quantile(draws.wheel_radius_m, [0.0, 0.5, 1.0]), [0.4, 0.45, 0.5], atol=1e-4)
    pairs = np.corrcoef([draws.support_factor, draws.hertz_factor, draws.wheel_radius_m])
    assert np.abs(pairs - np.eye(3)).max() < 0.06  # of 3000 independent ones: 0.018 deviation


def test_same_seed_same_samples_and_another_seed_others():
    one, same, other = draw(unknown()), draw(unknown()), draw(unknown(seed=2))
    np.testing.assert_array_equal(one.wheel_radius_m, same.wheel_radius_m)
    np.testing.assert_array_equal(one.noise_seed, same.noise_seed)
    assert np.any(one.wheel_radius_m != other.wheel_radius_m)


@pytest.mark.parametrize("spacing_m", [0.5e-3, 2e-3, 5e-3])
def test_noise_has_the_stated_size_and_correlation_whatever_the_sampling(spacing_m: float):
    given_noise = unknown(noise_m=4e-6, noise_length_m=0.01)
    x = np.arange(0.0, 2.0, spacing_m)
    noise = np.array([noisy(x, np.zeros_like(x), given_noise, seed) for seed in range(300)])
    middle = noise[:, len(x) // 4 : -len(x) // 4]
    # Levelling adds the line between both ends' noise: (1 - s)^2 + s^2 of a variance, over the middle half 13 / 24.
    assert np.mean(middle**2) == pytest.approx((4e-6) ** 2 * (1 + 13 / 24), rel=0.08)
    lag = round(0.01 / spacing_m)
    covariance = np.mean(middle[:, lag:] * middle[:, :-lag]) / (4e-6) ** 2
    assert covariance == pytest.approx(np.exp(-1) + 13 / 24, abs=0.08)
    assert np.abs(noise[:, [0, -1]]).max() < 1e-20


@given(seed=st.integers(0, 2**62 - 1), length_m=st.floats(1e-3, 1.0), count=st.integers(2, 400))
@settings(deadline=None)
def test_noise_leaves_both_ends_and_is_finite(seed: int, length_m: float, count: int):
    x = np.linspace(-0.3, 0.4, count)
    z = np.linspace(1e-4, -1e-4, count)
    found = noisy(x, z, unknown(noise_length_m=length_m), seed)
    assert np.all(np.isfinite(found))
    np.testing.assert_allclose(found[[0, -1]], z[[0, -1]], atol=1e-18)


def spread_of(unknowns: Uncertainty, positions_m: np.ndarray) -> UncertaintyResult:
    draws = draw(unknowns)
    cells = [0.0] * (unknowns.samples * len(positions_m))
    none = [0.0] * unknowns.samples
    return UncertaintyResult(
        positions_m=positions_m.tolist(), peak_force_n=cells, min_force_n=cells, contact_loss_s=cells,
        gradient_rad=none, straightedge_m=none, support_factor=draws.support_factor.tolist(),
        hertz_factor=draws.hertz_factor.tolist(), wheel_radius_m=draws.wheel_radius_m.tolist(),
    )  # fmt: skip


def test_influences_of_a_sum_are_its_terms_variances():
    """Standardised terms with weights 1, 2, 3, 4 and noise of 5 explain 1, 4, 9, 16 and 25 parts of 55."""
    spread = spread_of(unknown(4000), np.arange(15) * 0.04)

    def unit(values: object) -> np.ndarray:
        array = np.array(values)
        return (array - array.mean()) / array.std()

    by_sample = (
        1 * unit(np.log(spread.support_factor))
        + 2 * unit(np.log(spread.hertz_factor))
        + 3 * unit(spread.wheel_radius_m)
    )
    rest = np.random.default_rng(5).standard_normal(4000)
    values = (by_sample + 5 * unit(rest))[:, None] + 4 * unit(spread.positions_m)
    found = influences(values, spread)
    expected = {SUPPORT: 1, CONTACT: 4, RADIUS: 9, PLACE: 16, REST: 25}
    assert found == pytest.approx({name: part / 55 for name, part in expected.items()}, abs=0.02)


def test_pure_noise_has_no_influence_but_its_own():
    spread = spread_of(unknown(200), np.array([0.0]))
    values = np.random.default_rng(0).standard_normal((200, 1))
    found = influences(values, spread)
    assert max(found, key=found.__getitem__) == REST
    assert found[REST] > 0.85


def test_what_does_not_vary_has_no_driver():
    spread = spread_of(unknown(50), np.array([0.0, 0.1]))
    assert influences(np.full((50, 2), 3.0), spread) == {}
    assert influences(np.zeros((50, 2)), spread) == {}
