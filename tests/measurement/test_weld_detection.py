"""Welds are found where they are, whatever the rail's height, slope and roughness, and the same in a stream."""

import numpy as np
import pytest

from benchmarks.detection import cosine_welds, detection_outcome
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.rail_stream import KEPT_M, RailStream
from weld_force_ros.measurement.roughness import rail_roughness
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.measurement.weld_detection import APART_M, LEAST_M, RUNNING_M, SETTLED_M, THRESHOLD, detect

STEP_M = 1e-3
WELDS_M = (13.2, 31.7, 48.1)


@pytest.fixture(scope="module")
def rail() -> tuple[np.ndarray, np.ndarray]:
    """60 m of track, rough by the limit less 3 dB, with a dip, a protrusion and a dip of 0.3 mm."""
    x = STEP_M * np.arange(60_001)
    z = rail_roughness(60.0, STEP_M, 2, level_db=-3.0)
    for centre, sign, length in zip(WELDS_M, (1, -1, 1), (0.15, 0.3, 0.45), strict=True):
        z += cosine_dip(x - centre, length, sign * 0.3e-3)
    return x, z


def places(x_m: np.ndarray, z_m: np.ndarray) -> list[float]:
    return [weld.centre_m for weld in detect(x_m, z_m)]


def test_welds_are_found_where_they_are(rail: tuple[np.ndarray, np.ndarray]):
    best = sorted(detect(*rail), key=lambda weld: -weld.score)[: len(WELDS_M)]
    assert sorted(weld.centre_m for weld in best) == pytest.approx(WELDS_M, abs=0.1)
    assert min(weld.score for weld in best) >= THRESHOLD


@pytest.mark.parametrize("times", [1e-1, 10.0, -1.0])
def test_a_score_counts_in_roughness(rail: tuple[np.ndarray, np.ndarray], times: float):
    x, z = rail
    assert [w.score for w in detect(x, times * z)] == pytest.approx([w.score for w in detect(x, z)], rel=1e-6)


def test_height_slope_and_vertical_curve_do_not_matter(rail: tuple[np.ndarray, np.ndarray]):
    x, z = rail
    lifted = z + 5e-3 + 1e-3 * x + x**2 / (2 * 2000.0)
    assert places(x, lifted) == pytest.approx(places(x, z), abs=1e-3)


def test_the_spacing_hardly_matters(rail: tuple[np.ndarray, np.ndarray]):
    x, z = rail
    assert places(x[::5], z[::5]) == pytest.approx(places(x, z), abs=0.02)


def test_what_a_stream_keeps_tells_the_same_as_the_whole_run(rail: tuple[np.ndarray, np.ndarray]):
    x, z = rail
    settled: list[tuple[float, float]] = []
    stream = RailStream()
    for first in range(0, len(x), 2000):
        stream.push(x[first : first + 2000], z[first : first + 2000])
        (stretch,) = stream.stretches()
        until = stretch.chainage_m[-1] - SETTLED_M
        known = settled[-1][0] if settled else -np.inf
        found = detect(stretch.chainage_m, stretch.height_m)
        settled += [(w.centre_m, w.score) for w in found if known + APART_M < w.centre_m < until]
    # Before a stream has run for as long as the level is told from, it knows less of the roughness than it will.
    judged = RUNNING_M + SETTLED_M
    whole = [(w.centre_m, w.score) for w in detect(x, z) if judged < w.centre_m < x[-1] - SETTLED_M]
    streamed = [weld for weld in settled if weld[0] > judged]
    np.testing.assert_allclose(streamed, whole, rtol=1e-6)
    assert [centre for centre, _ in streamed] == pytest.approx(WELDS_M[1:], abs=0.1)
    assert x[-1] > KEPT_M


def test_no_two_are_nearer_than_stated(rail: tuple[np.ndarray, np.ndarray]):
    x, z = rail
    twice = z + cosine_dip(x - WELDS_M[0] - 0.6, 0.1, 0.3e-3)
    assert len(places(x, twice)) == len(places(x, z))


def test_a_rail_without_roughness():
    x = STEP_M * np.arange(30_001)
    assert detect(x, np.zeros(len(x))) == []
    assert places(x, cosine_dip(x - 12.0, 0.2, 1e-4)) == pytest.approx([12.0], abs=1e-2)


def test_too_short_a_stretch_tells_nothing():
    x = STEP_M * np.arange(round(LEAST_M / STEP_M) - 10)
    assert detect(x, cosine_dip(x - 1.5, 0.2, 1e-3)) == []
    assert detect([], []) == []


def test_roughness_alone_raises_few_alarms():
    assert detection_outcome(0.0, [], seed=3).false_alarms <= 5


@pytest.mark.parametrize("height_m", [0.3e-3, -0.3e-3])
def test_large_welds_on_smooth_track_are_all_found(height_m: float):
    outcome = detection_outcome(-6.0, cosine_welds(height_m, 4, 19), seed=4, length_m=400.0)
    assert (outcome.missed, outcome.welds) == (0, 19)
    assert outcome.false_alarms <= 3
    assert outcome.centre_error_m < 0.03


@pytest.mark.parametrize(
    ("x", "z"),
    [
        ([0.0, 0.001, 0.02], [0.0, 0.0, 0.0]),
        ([0.0, 0.001, 0.001], [0.0, 0.0, 0.0]),
        ([0.0, 0.001], [0.0, np.nan]),
        ([0.0, np.nan], [0.0, 0.0]),
        ([0.0, 0.001], [0.0]),
    ],
)
def test_a_stretch_with_gaps_is_refused(x: list[float], z: list[float]):
    with pytest.raises(InputError, match="chainages that increase by 5 mm at most"):
        detect(x, z)
