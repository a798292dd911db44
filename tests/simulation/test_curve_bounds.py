"""Bounds of a force-speed curve: exact for cubics, closer with every passage, and kept by simulated welds."""

from pathlib import Path

import numpy as np
import pytest

from weld_force_ros.measurement.profile_file import read_profile
from weld_force_ros.measurement.synthetic_welds import population
from weld_force_ros.messages import WeldProfile, profile_sha256
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.simulation.curve_bounds import CurveBounds
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

KMH = np.arange(20.0, 301.0)
ON_MAP = np.arange(len(KMH)) % 5 == 0
LOAD_N = 100e3
DATA = Path(__file__).parents[1] / "data" / "instrument_files"


def passages(peak_n: np.ndarray) -> Passages:
    """Of those peaks; the wheel is unloaded by as much as it is loaded, at most whole."""
    least = np.maximum(0.0, 2 * LOAD_N - peak_n)
    return Passages(LOAD_N, peak_n, least, np.where(least > 0, 0.0, 1e-3), LOAD_N + 0.5 * (peak_n - LOAD_N), None)


def bounds_of(every: Passages) -> CurveBounds:
    return CurveBounds(every.at(ON_MAP), KMH[ON_MAP], KMH)


def hilly(seed: int, kinked: bool = True) -> np.ndarray:
    """Smooth hills at each of four places, as wide as resonances are; the larger of two, so with kinks."""
    generator = np.random.default_rng(seed)
    hills = [
        sum(
            generator.uniform(5e3, 30e3) * np.exp(-(((KMH[:, None] - centre) / generator.uniform(12.0, 60.0)) ** 2))
            for centre in generator.uniform(20.0, 300.0, (4, 1, 4))
        )
        for _ in range(2 if kinked else 1)
    ]
    return np.asarray(LOAD_N + np.max(hills, axis=0) + 30.0 * KMH[:, None])


def contains(bounds: CurveBounds, every: Passages) -> bool:
    worst, truth = bounds.worst, every.worst(axis=1)
    mildest, severest = worst.mildest.columns, worst.severest.columns
    low = {name: np.minimum(mildest[name], severest[name]) - 1e-9 for name in mildest}
    high = {name: np.maximum(mildest[name], severest[name]) + 1e-9 for name in mildest}
    return all(((low[name] <= values) & (values <= high[name])).all() for name, values in truth.columns.items())


def test_between_speeds_of_a_map_a_cubic_is_known():
    x = (KMH[:, None] - 160.0) / 140.0
    every = passages(LOAD_N + 20e3 + np.array([8e3, 5e3]) * x + np.array([-3e3, 4e3]) * x**3)
    bounds = bounds_of(every)
    np.testing.assert_allclose(bounds.expected.peak_force_n, every.peak_force_n, rtol=1e-9)
    worst = bounds.worst
    assert (worst.severest.peak_force_n - worst.mildest.peak_force_n).max() <= 2.1e-4 * LOAD_N
    assert contains(bounds, every)


@pytest.mark.parametrize("seed", range(20))
def test_smooth_hills_and_their_kinks_lie_within_bounds(seed):
    every = passages(hilly(seed))
    bounds = bounds_of(every)
    assert contains(bounds, every)
    some = (np.random.default_rng(seed).random(bounds.simulated.shape) > 0.6) & ~ON_MAP[:, None]
    before = bounds.worst
    bounds.add(some, every.at(~ON_MAP))
    assert contains(bounds, every)
    between = bounds.worst
    width = [one.severest.peak_force_n - one.mildest.peak_force_n for one in (before, between)]
    assert width[1].sum() < 0.7 * width[0].sum()


@pytest.mark.parametrize("seed", range(5))
def test_the_worst_is_simulated_or_possible(seed):
    every = passages(hilly(seed))
    bounds = bounds_of(every)
    for name, values in (("peak_force_n", every.peak_force_n), ("min_force_n", -every.columns["min_force_n"])):
        can = bounds.possible([name]) | bounds.simulated
        assert can[np.arange(len(KMH)), values.argmax(axis=1)].all()
        assert not can.all()


def test_forces_exceed_what_is_expected_by_less_at_high_speeds():
    """Of equal ripples at all speeds, of which nothing but the speed makes a difference."""
    ripple = np.tile(np.sin(2 * np.pi * KMH / 40.0)[:, None], 3)
    worst = bounds_of(passages(LOAD_N + 30e3 + 1e3 * ripple)).worst
    above, below = (
        abs(one.peak_force_n - worst.expected.peak_force_n)[~ON_MAP] for one in (worst.severest, worst.mildest)
    )
    slow, fast = KMH[~ON_MAP] < 150, KMH[~ON_MAP] > 250
    inside = (KMH[~ON_MAP] > 40) & (KMH[~ON_MAP] < 295)
    np.testing.assert_allclose(above[slow & inside], below[slow & inside])
    assert (above[fast & inside] < 0.7 * below[fast & inside]).all()


def test_what_was_simulated_is_known_and_no_longer_asked_for():
    every = passages(hilly(1))
    bounds = bounds_of(every)
    open_speeds = {"peak_force_n": KMH == 101.0}
    simulated = 0
    while (bounds.worst.severest.peak_force_n != bounds.worst.mildest.peak_force_n)[KMH == 101.0]:
        selected = bounds.deciding(open_speeds)
        assert selected.any()
        assert not (selected & bounds.simulated).any()
        assert not selected[KMH != 101.0].any()
        simulated += int(selected.sum())
        bounds.add(selected, every.at(~ON_MAP))
    assert 1 <= simulated <= 4
    assert bounds.worst.expected.peak_force_n[KMH == 101.0] == every.peak_force_n[KMH == 101.0].max()


@pytest.mark.parametrize("map_kmh", [[40.0, 50.0, 55.0, 60.0], [40.0, 60.0], [40.0]])
def test_a_coarse_map_tells_nothing_of_what_is_between(map_kmh):
    speeds = np.arange(40.0, 1 + map_kmh[-1])
    every = passages(LOAD_N + 100.0 * speeds[:, None] + np.array([0.0, 1e3]))
    bounds = CurveBounds(every.at(np.isin(speeds, map_kmh)), np.array(map_kmh), speeds)
    np.testing.assert_array_equal(bounds.unbounded, ~np.isin(speeds, map_kmh))


def test_contact_is_lost_only_where_the_wheel_may_be_unloaded():
    every = passages(LOAD_N + 30e3 + 100.0 * KMH[:, None])
    assert bounds_of(every).worst.severest.contact_loss_s.max() == 0.0
    lost = bounds_of(passages(LOAD_N + 80e3 + 100.0 * KMH[:, None])).worst.severest.contact_loss_s
    assert not lost[KMH < 195].any()
    assert lost[KMH >= 200].all()


def welds() -> list[WeldProfile]:
    """Of a seed that the bounds were not chosen on, and a measured one."""
    found = [read_profile(DATA / "base.csv")]
    for weld in population(2, seed=77):
        x, z = weld.x_m.tolist(), weld.z_m.tolist()
        sha = profile_sha256(x, z)
        found.append(WeldProfile(weld_id=weld.weld_id, source="seed 77", x_m=x, z_m=z, profile_sha256=sha))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("track", ["bilbao", "bilbao-viscous", "bilbao-causal", "johansson-nielsen", "wooden-sleepers"])
def test_simulated_welds_lie_within_bounds(track):
    simulator = Simulator(simulation_settings(track=track))
    model = simulator.vehicle_track
    assert isinstance(model, VehicleTrackModel)
    for weld in welds():
        path = simulator.wheel_path(weld)
        found = model.peak_map(path, KMH, simulator.settings.positions_m, low_passed=True)
        every = Passages.of_peak_map(found, simulator.settings.static_load_n)
        assert contains(bounds_of(every), every)
