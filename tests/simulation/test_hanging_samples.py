import numpy as np
import pytest
from msgspec.structs import replace as changed

from weld_force_ros.assessment.probability import HANGING, influences
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import Uncertainty, UncertaintyResult
from weld_force_ros.simulation import hanging_samples
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

GRID = {"track": "bilbao-viscous", "speeds_kmh": [100.0, 160.0], "positions": 3}


def certain(hanging_share: float) -> Uncertainty:
    """Return samples that differ in nothing but the sleepers that hang."""
    usual = load_uncertainty(24)
    assert usual is not None
    return changed(
        usual, noise_m=0.0, support_spread=0.0, hertz_spread=0.0, radius_low_m=0.45, radius_high_m=0.45,
        hanging_share=hanging_share,
    )  # fmt: skip


def test_a_sample_in_which_sleepers_hang_is_the_weld_with_that_support():
    profile = changed(shipped_profile("weld-1-dip"), line_speed_kmh=160.0)
    unknown = certain(0.5)
    spread = Simulator(simulation_settings(**GRID, uncertainty=unknown)).force_map(profile).spread
    assert isinstance(spread, UncertaintyResult)
    which = np.array(spread.hanging)
    assert set(which.tolist()) == {0, 1, 2, 3}
    peaks = np.array(spread.peak_force_n).reshape(len(which), -1)
    for way, support in {0: "", 1: "0=0.02", 3: "0=0.02,1=0.02"}.items():  # those whose fits are bundled
        stated = Simulator(simulation_settings(**GRID, support=support)).force_map(profile)
        both = np.maximum(stated.peak_force_n, stated.against.peak_force_n).reshape(2, 3)
        np.testing.assert_allclose(peaks[which == way], np.tile(both.max(axis=0), (sum(which == way), 1)), rtol=2e-3)
    shares = influences(peaks, spread)
    assert shares[HANGING] > 0.5


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_as_many_sleepers_hang_as_is_said(share):
    which = hanging_samples.drawn(changed(certain(share), samples=4000))
    for sleeper in (1, 2):
        assert np.mean(which & sleeper > 0) == pytest.approx(share, abs=0.03)
    assert np.mean(which == 3) == pytest.approx(share**2, abs=0.03)
