"""Both running directions: against rising x is over the mirror image, and what is worse counts."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from weld_force_ros.assessment.judge import assess, judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import (
    ForceMap,
    MeasurementNoise,
    OppositeDirection,
    SimulationSettings,
    WeldProfile,
    config_sha256,
    decode,
    encode,
    profile_sha256,
)
from weld_force_ros.simulation.force_map_view import relevant_range
from weld_force_ros.simulation.measured_geometry import sampled_geometries
from weld_force_ros.simulation.running import drawn_alike, mirror_image
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

COLUMNS = ("peak_force_n", "min_force_n", "contact_loss_s", "p2_force_n", "force_20hz_n")
SPEEDS = [80.0, 120.0, 160.0, 200.0, 250.0, 300.0]


def chosen(running: str = "both", **other: object) -> SimulationSettings:
    given = {"track": "bilbao-viscous", "speeds_kmh": SPEEDS, "positions": 4, "running": running} | other
    return simulation_settings(**given)


def turned(profile: WeldProfile) -> WeldProfile:
    """Return the mirror image, made by hand."""
    x, z = [-x for x in profile.x_m][::-1], profile.z_m[::-1]
    return msgspec.structs.replace(profile, x_m=x, z_m=z, profile_sha256=profile_sha256(x, z))


def matrices(of: ForceMap | OppositeDirection, positions: int, names: tuple[str, ...] = COLUMNS) -> np.ndarray:
    return np.array([np.reshape(getattr(of, name), (-1, positions)) for name in names])


def test_a_steep_ramp_is_worse_where_it_is_run_up():
    found = Simulator(chosen(contact_patch="off")).force_map(shipped_profile("weld-4-steep-ramp"))
    peaks = [matrices(of, 4)[0].max(axis=1) / 1e3 for of in (found, found.against)]
    # kN, by engine reference
    np.testing.assert_allclose(peaks[0], [134.0, 153.8, 169.1, 177.0, 191.7, 208.9], rtol=0.005)
    np.testing.assert_allclose(peaks[1], [126.9, 141.7, 149.2, 150.2, 149.8, 147.7], rtol=0.005)


@pytest.mark.parametrize("shape", ["cosine-dip-48mm", "cosine-rise-48mm"])
def test_over_a_symmetric_shape_both_directions_are_alike(shape: str):
    found = Simulator(chosen(positions=5)).force_map(shipped_profile(shape))
    alike = [0, 4, 3, 2, 1]  # the place as far before a sleeper as the other is after one
    np.testing.assert_allclose(matrices(found.against, 5), matrices(found, 5)[:, :, alike], rtol=1e-5, atol=1e-9)


def test_against_is_over_the_mirrored_profile_at_the_rest_of_the_span():
    profile, positions = shipped_profile("weld-5-ramp-protrusion"), [0.05, 0.2, 0.41]
    both = Simulator(chosen(positions=positions)).force_map(profile)
    span = both.span_m
    image = Simulator(chosen("with", positions=[span - at for at in positions[::-1]])).force_map(turned(profile))
    names = (*COLUMNS, "peak_x_m")
    expected = matrices(image, 3, names)[:, :, ::-1]
    expected[-1] = span - expected[-1]
    np.testing.assert_allclose(matrices(both.against, 3, names), expected, rtol=1e-9, atol=2e-6)
    alone = Simulator(chosen("against", positions=positions)).force_map(profile)
    np.testing.assert_array_equal(matrices(alone, 3, names), matrices(both.against, 3, names))
    one_way = Simulator(chosen("with", positions=positions)).force_map(profile)
    np.testing.assert_array_equal(matrices(one_way, 3, names), matrices(both, 3, names))
    assert (one_way.against, alone.against) == (UNSET, UNSET)


@pytest.mark.long
def test_the_reference_engine_runs_in_the_same_directions():
    profile, few = shipped_profile("weld-4-steep-ramp"), {"speeds_kmh": [120.0, 250.0], "positions": [0.1, 0.3]}
    fast, exact = (
        Simulator(chosen(**few, engine=engine)).force_map(profile) for engine in ("common-poles", "reference")
    )
    for one, other in ((fast, exact), (fast.against, exact.against)):
        np.testing.assert_allclose(one.peak_force_n, other.peak_force_n, rtol=0.02)
        np.testing.assert_allclose(one.peak_x_m, other.peak_x_m, atol=0.01)


def test_many_welds_at_a_time_run_as_one_by_one():
    profiles = [shipped_profile("weld-1-dip"), shipped_profile("weld-4-steep-ramp")]
    profiles[1].running = "against"
    simulator = Simulator(chosen(positions=[0.0, 0.25]))
    for found, profile in zip(simulator.force_maps(profiles), profiles, strict=True):
        alone = simulator.force_map(profile)
        assert msgspec.structs.replace(found, elapsed_s=0.0) == msgspec.structs.replace(alone, elapsed_s=0.0)


def test_each_cell_is_from_the_direction_in_which_it_is_worse():
    found = Simulator(chosen()).force_map(shipped_profile("weld-4-steep-ramp"))
    relevant, own, other = relevant_range(found), matrices(found, 4), matrices(found.against, 4)
    np.testing.assert_array_equal(relevant.passages.peak_force_n, np.maximum(own[0], other[0]))
    np.testing.assert_array_equal(relevant.passages.min_force_n, np.minimum(own[1], other[1]))
    for row, column in np.ndindex(own[0].shape):
        assert relevant.direction("min_force_n", row, column) == (
            "against" if other[1, row, column] < own[1, row, column] else "with"
        )
    worst = np.max([own[0].max(axis=1), other[0].max(axis=1)], axis=0)
    curve = dict(zip(found.curve.speeds_kmh, found.curve.peak_force_n, strict=True))
    assert [curve[speed] for speed in SPEEDS] == worst.tolist()
    against = dict(zip(found.curve.speeds_kmh, found.curve.against, strict=True))
    assert [against[speed] for speed in SPEEDS] == (other[0].max(axis=1) > own[0].max(axis=1)).tolist()


def test_the_verdict_says_which_direction_and_the_history_runs_in_it():
    limits, profile = load_limits(), shipped_profile("weld-4-steep-ramp")
    ramp = assess(profile, Simulator(chosen()), limits)
    descent = assess(turned(profile), Simulator(chosen()), limits)
    assert (ramp.verdict.worst_running, descent.verdict.worst_running) == ("with", "against")
    assert "running towards rising x" in ramp.verdict.reason
    assert "running against rising x" in descent.verdict.reason
    up, down = ({c.name: c for c in one.verdict.criteria}["peak_force"] for one in (ramp, descent))
    assert (up.running, down.running) == ("with", "against")
    assert up.value == pytest.approx(down.value, rel=1e-6)
    position_m = down.position_m
    simulator = Simulator(chosen())
    history = simulator.force_history(turned(profile), down.speed_kmh, position_m, running="against")
    assert max(history.force_n) == pytest.approx(down.value, rel=2e-3)
    assert history.x_m[int(np.argmax(history.force_n))] == pytest.approx(down.x_m, abs=2e-3)
    assert np.all(np.diff(history.x_m) > 0)
    encode(history)


def test_what_a_weld_states_goes_before_the_settings_and_nothing_stated_is_as_before():
    profile = shipped_profile("weld-1-dip")
    profile.running = "against"
    assert Simulator(chosen()).force_map(profile).running == "against"
    before = msgspec.structs.replace(chosen(), running=UNSET)
    before.config_sha256 = config_sha256(before)
    found = Simulator(before).force_map(shipped_profile("weld-1-dip"))
    one_way = Simulator(chosen("with")).force_map(shipped_profile("weld-1-dip"))
    assert (found.running, found.against, one_way.running) == (UNSET, UNSET, "with")
    assert matrices(found, 4).tolist() == matrices(one_way, 4).tolist()
    assert judge(found, load_limits()).worst_running is UNSET
    with pytest.raises(InputError, match="running 'up' is unknown"):
        chosen("up")


def test_a_map_of_both_directions_holds_both():
    found = Simulator(chosen(speeds_kmh=[100.0], positions=[0.1])).force_map(shipped_profile("weld-1-dip"))
    assert decode(ForceMap, encode(found)) == found
    for changed, complaint in (
        ({"against": UNSET}, "against is missing"),
        ({"running": "with"}, "running is not both"),
        ({"against": msgspec.structs.replace(found.against, peak_x_m=[0.1, 0.2])}, "against: peak_x_m has 2 values"),
    ):
        with pytest.raises(MessageError, match=complaint):
            encode(msgspec.structs.replace(found, **changed))


def test_samples_of_a_measured_geometry_are_mirrored_with_it():
    x = np.linspace(-0.3, 0.3, 121)
    z = 1e-4 * np.exp(-(((x - 0.05) / 0.06) ** 2)) + 1e-5 * np.random.default_rng(4).standard_normal(len(x))
    profile = WeldProfile(
        weld_id="measured", source="test", x_m=x.tolist(), z_m=(0.9 * z).tolist(), profile_sha256="0" * 64,
        measured_x_m=x.tolist(), measured_z_m=z.tolist(),
        noise=MeasurementNoise(method="spline", noise_m=1e-5, outliers_m=[float(x[30])]),
    )  # fmt: skip

    def draw(of: WeldProfile) -> np.ndarray:
        return sampled_geometries(of, 6, 3)

    own, image = drawn_alike(profile, draw), drawn_alike(mirror_image(profile), draw)
    np.testing.assert_array_equal(own, image[:, ::-1])
    assert np.ptp(own, axis=0).max() > 0
    assert mirror_image(mirror_image(profile)) == profile


SAMPLED = Simulator(
    simulation_settings(
        track="bilbao-viscous",
        speeds_kmh=np.arange(60.0, 261.0, 20.0).tolist(),
        positions=5,
        uncertainty=msgspec.structs.replace(load_uncertainty(4), support_spread=0.0),
    )
)


@settings(deadline=None, database=None, max_examples=8)
@given(st.lists(st.floats(-3e-4, 3e-4), min_size=5, max_size=9), st.floats(-0.1, 0.1))
def test_a_weld_and_its_mirror_image_get_one_verdict(knots: list[float], centre_m: float):
    x = np.round(np.linspace(-0.3, 0.3, 241), 6)
    z = np.interp(x, centre_m + np.linspace(-0.15, 0.15, len(knots) + 2), [0.0, *knots, 0.0])
    z = np.convolve(np.pad(z, 10), np.hanning(21) / np.hanning(21).sum(), mode="valid")
    heights = np.round(z, 9).tolist()
    sha = profile_sha256(x.tolist(), heights)
    profile = WeldProfile(weld_id="any", source="hypothesis", x_m=x.tolist(), z_m=heights, profile_sha256=sha)
    own, image = (judge(SAMPLED.force_map(one), load_limits()) for one in (profile, turned(profile)))
    assert own.decision == image.decision
    assert own.permitted_speed_kmh == image.permitted_speed_kmh
    for mine, other in zip(own.criteria, image.criteria, strict=True):
        assert (mine.name, mine.passed) == (other.name, other.passed)
        close = 1e-6 if mine.name == "unloading" else 1e-7  # of the static load, as forces agree to that
        for name in ("value", "low", "high"):
            assert getattr(mine, name) == pytest.approx(getattr(other, name), rel=1e-6, abs=close), mine.name
        assert mine.exceeding == pytest.approx(other.exceeding, abs=1e-9)  # summed in another order
