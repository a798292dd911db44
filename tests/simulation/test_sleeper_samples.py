"""Sleepers that differ from each other, against peaks of the reference with all of them changed, and by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from weld_force_ros.assessment.probability import SLEEPERS, influences
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import Uncertainty, UncertaintyResult
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.simulation import sleeper_samples, track_file
from weld_force_ros.simulation.force_map_view import Passages
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator
from weld_force_ros.simulation.sleeper_samples import SleeperSensitivities, drawn, scattered

LOAD_N = 1e5


def unknown(samples: int, spread: float = 0.3) -> Uncertainty:
    """Return samples that differ in nothing but what lies beneath the sleepers."""
    usual = load_uncertainty(samples)
    assert usual is not None
    return changed(
        usual, noise_m=0.0, support_spread=0.0, hertz_spread=0.0, radius_low_m=0.46, radius_high_m=0.46,
        sleeper_spread=spread,
    )  # fmt: skip


def test_each_sleeper_is_drawn_by_itself_with_the_spread_that_is_said():
    logarithms = drawn(unknown(400))
    assert logarithms.shape == (400, 4)
    np.testing.assert_allclose(logarithms.std(axis=0), 0.3, rtol=1e-9)
    np.testing.assert_allclose(logarithms.mean(axis=0), 0.0, atol=1e-12)
    assert np.abs(np.corrcoef(logarithms.T) - np.eye(4)).max() < 0.15  # of 400: 0.05, three times
    assert np.array_equal(logarithms, drawn(unknown(400)))
    assert not np.array_equal(logarithms, drawn(changed(unknown(400), seed=2)))


class Track:
    """A track whose forces are powers of one sleeper's factor, with an exponent of its own at each speed and place."""

    opposite_m = 0.6

    def __init__(self, factor: float) -> None:
        self.factor = factor

    def maps_of_few(self, paths, speeds_kmh, positions_m, *, low_passed) -> list[PeakMap]:
        exponents = 0.01 * (np.arange(1, 1 + positions_m.shape[1]) + speeds_kmh[:, None])
        peaks, nothing = LOAD_N * self.factor**exponents, 0 * exponents
        return [PeakMap(peaks, nothing, 5e4 - 1e3 * np.log(self.factor) + nothing, nothing, np.stack([peaks, peaks]))]


def test_the_change_is_taken_where_the_nominal_forces_are_the_worst(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(SleeperSensitivities, "_models", [Track(1 / 1.5), Track(1.5)] * 4)
    monkeypatch.setattr(sleeper_samples, "VehicleTrackModel", lambda track, *_args, **_kwargs: track)
    peaks = np.array([[3.0, 1.0], [2.0, 4.0], [1.0, 2.0]]) * LOAD_N  # three speeds, two positions
    nominal = Passages(LOAD_N, peaks, 5e4 + 0 * peaks, 0 * peaks, np.sort(peaks, axis=0), peaks)
    relevant = SimpleNamespace(
        speeds_kmh=np.array([60.0, 80.0, 100.0]), positions_m=np.array([0.0, 0.3]), by_direction={"with": nominal}
    )
    path = SimpleNamespace()
    wheel = track_file.load("bilbao").wheel
    found = SleeperSensitivities(track_file.load("bilbao"), wheel).of(path, relevant)
    # The worst peak is at 80 km/h, the worst P2 at 100 km/h.
    np.testing.assert_allclose(found["peak_force_n"], [[0.81, 0.82]] * 4, rtol=1e-9)
    np.testing.assert_allclose(found["p2_force_n"], [[1.01, 1.02]] * 4, rtol=1e-9)
    np.testing.assert_allclose(found["min_force_n"], [[-1e3, -1e3]] * 4, rtol=1e-9)


def test_forces_grow_by_what_all_sleepers_make_of_them_and_none_falls_below_zero():
    of_peak = np.array([[0.1, 0.0], [0.2, 0.5]])
    sensitivities = {"peak_force_n": of_peak, "min_force_n": np.array([[-4e4, 0.0], [0.0, 1e3]])}
    logarithms = np.log([[1.0, 1.0], [2.0, 0.5]])
    spread = UncertaintyResult(
        positions_m=[0.0, 0.3], peak_force_n=[2e5, 1e5] * 2, min_force_n=[2e4, 3e4] * 2, contact_loss_s=[0.0] * 4,
        gradient_rad=[0.0] * 2, straightedge_m=[0.0] * 2, support_factor=[1.0] * 2, hertz_factor=[1.0] * 2,
        wheel_radius_m=[0.45] * 2,
    )  # fmt: skip
    found = scattered(spread, logarithms, sensitivities)
    assert found.peak_force_n == pytest.approx([2e5, 1e5, 2e5 * 2**0.1 * 0.5**0.2, 1e5 * 0.5**0.5], abs=0.1)
    assert found.min_force_n == pytest.approx([2e4, 3e4, 0.0, 3e4 - 1e3 * np.log(2)], abs=0.1)
    assert found.sleeper_effect == pytest.approx([1.0, (2**-0.1 + 2**-0.5) / 2], abs=1e-6)


@pytest.mark.long
@pytest.mark.slow
def test_peaks_are_those_of_the_reference_with_all_sleepers_changed():
    """Brute force on few samples: none of the linear law, of the fits and of the samples' own code is in it."""
    chosen = unknown(6, 0.2)
    profile = changed(shipped_profile("weld-1-dip"), line_speed_kmh=160.0)
    speeds, positions = [160.0], [0.0, 0.2167, 0.4333]
    given = {"track": "johansson-nielsen", "speeds_kmh": speeds, "positions": positions, "running": "with"}
    simulator = Simulator(simulation_settings(**given, uncertainty=chosen))
    force_map = simulator.force_map(profile)
    spread = force_map.spread
    assert isinstance(spread, UncertaintyResult)
    found = np.array(spread.peak_force_n).reshape(6, 3) / np.array(force_map.peak_force_n)
    definition, path = track_file.load("johansson-nielsen"), simulator.wheel_path(profile)

    def exact(factors: np.ndarray) -> np.ndarray:
        changes = zip(sleeper_samples.SLEEPERS, factors.tolist(), strict=True)
        supports = LocalSupports.of(SupportChange(sleeper, factor) for sleeper, factor in changes)
        model = GreensFunctionModel(definition.track, definition.wheel, supports)
        return model.peak_map(path, speeds, positions).peak_force_n[0]

    nominal = exact(np.ones(4))
    factors = np.exp(drawn(chosen))
    ratios = np.array([exact(factors[sample]) / nominal for sample in range(3)])
    np.testing.assert_allclose(found[:3], ratios, atol=0.01)
    assert np.std(found[:3] - ratios) < 0.6 * np.std(ratios)
    assert np.ptp(ratios) > 0.02
    shares = influences(np.array(spread.peak_force_n).reshape(6, 3), spread)
    assert SLEEPERS in shares
