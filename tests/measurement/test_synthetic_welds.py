"""Synthetic welds: reproducible, within the contract, and drawn from what is stated."""

from itertools import islice

import numpy as np
import pytest
from scipy.stats import binomtest, kstest

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.synthetic_welds import (
    AS_WELDED,
    GROUND_SMOOTH,
    MAKING_SHARES,
    STATISTICS,
    LogNormal,
    SyntheticWeld,
    population,
    without_short_waves,
)
from weld_force_ros.messages import WeldProfile, decode, encode, profile_sha256

UNLIKELY = 1e-4  # a sample less probable than that is not from the stated distribution


@pytest.fixture(scope="module")
def welds() -> list[SyntheticWeld]:
    return list(population(1000, 11))


def test_a_weld_is_the_same_in_any_population_of_its_seed(welds: list[SyntheticWeld]):
    for small, large in zip(population(5, 11), welds, strict=False):
        assert (small.weld_id, small.parameters) == (large.weld_id, large.parameters)
        np.testing.assert_array_equal(small.x_m, large.x_m)
        np.testing.assert_array_equal(small.z_m, large.z_m)


def test_seeds_and_welds_differ(welds: list[SyntheticWeld]):
    others = list(population(20, 12))
    assert len({weld.z_m.tobytes() for weld in welds + others}) == len(welds) + len(others)
    assert len({weld.weld_id for weld in welds + others}) == len(welds) + len(others)


def test_a_population_is_made_as_it_is_asked_for():
    assert len(list(islice(population(10**9, 1), 3))) == 3
    assert list(population(0, 1)) == []


@pytest.mark.parametrize(("count", "seed"), [(-1, 0), (1, -1)])
def test_what_cannot_be_made_is_refused(count: int, seed: int):
    with pytest.raises(InputError, match="cannot be made"):
        population(count, seed)


@pytest.mark.untraced
def test_every_profile_keeps_the_contract_and_lies_level_at_both_ends(welds: list[SyntheticWeld]):
    for weld in welds:
        x, z = weld.x_m.tolist(), weld.z_m.tolist()
        message = WeldProfile(
            weld_id=weld.weld_id, source="synthetic", x_m=x, z_m=z, profile_sha256=profile_sha256(x, z)
        )
        assert decode(WeldProfile, encode(message)).z_m == z
        assert (x[0], x[-1]) == (-0.5, 0.5)
        assert (z[0], z[-1]) == (0, 0)


def test_shares_of_what_welds_are_made_as(welds: list[SyntheticWeld]):
    for making, share in MAKING_SHARES.items():
        made = sum(weld.parameters.making == making for weld in welds)
        assert binomtest(made, len(welds), share).pvalue > UNLIKELY
    reversed_ = sum(weld.parameters.reversed for weld in welds)
    assert binomtest(reversed_, len(welds), 0.5).pvalue > UNLIKELY


@pytest.mark.parametrize("statistics", [AS_WELDED, GROUND_SMOOTH], ids=["as welded", "ground smooth"])
@pytest.mark.parametrize("name", list(AS_WELDED.__annotations__))
def test_parameters_are_distributed_as_stated(welds: list[SyntheticWeld], statistics: object, name: str):
    stated = getattr(statistics, name)
    drawn = [
        abs(weld.parameters.height_m) if name == "amplitude_m" else getattr(weld.parameters, name)
        for weld in welds
        if STATISTICS[weld.parameters.making] is statistics
    ]
    if isinstance(stated, LogNormal):
        cumulative = ("lognorm", (stated.deviation, 0, stated.median))
    else:
        cumulative = ("uniform", (stated.low, stated.high - stated.low))
    assert kstest(drawn, *cumulative).pvalue > UNLIKELY


def test_sign_follows_what_a_weld_is_made_as(welds: list[SyntheticWeld]):
    heights = {m: [w.parameters.height_m for w in welds if w.parameters.making == m] for m in MAKING_SHARES}
    assert max(heights["dip"]) < 0 < min(heights["protrusion"])
    assert min(heights["ground"]) < 0 < max(heights["ground"])


def test_short_waves_have_the_stated_rms(welds: list[SyntheticWeld]):
    ratios = [np.std(weld.z_m - without_short_waves(weld).z_m) / weld.parameters.roughness_m for weld in welds]
    # Half-cosine fades of 5 cm at either end leave 1 - 2 * 0.05 * (1 - 3 / 8) of the mean square.
    assert np.mean(np.square(ratios)) == pytest.approx(1 - 0.0625, rel=0.03)


def test_main_wave_stands_where_its_parameters_say(welds: list[SyntheticWeld]):
    clear = [w for w in welds if w.parameters.height_m < -4 * abs(w.parameters.ramp_m) - 4 * 50e-6]
    assert len(clear) > 20
    for weld in clear:
        p = weld.parameters
        deepest_m = weld.x_m[np.argmin(without_short_waves(weld).z_m)] * (-1 if p.reversed else 1)
        assert deepest_m == pytest.approx(p.centre_m + p.asymmetry * p.wavelength_m / 2, abs=0.1 * p.wavelength_m)
