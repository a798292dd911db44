"""A curve is refined by passages that can be the worst, as many of a place as are simulated side by side."""

import numpy as np
import pytest

from weld_force_ros.physics.passage._simd import SPEEDS
from weld_force_ros.simulation.curve_bounds import CurveBounds, Selection
from weld_force_ros.simulation.curve_refinement import refine
from weld_force_ros.simulation.force_map_view import Passages

KMH = np.arange(20.0, 301.0)
ON_MAP = np.arange(len(KMH)) % 5 == 0
LOAD_N = 100e3


class Asked:
    """Asks for the peak force at some speeds."""

    limits_sha256 = "0" * 64

    def __init__(self, *speeds_kmh: float) -> None:
        self.speeds = np.isin(KMH, speeds_kmh)

    def open_speeds(self, speeds_kmh, worst):
        known = worst.mildest.peak_force_n == worst.severest.peak_force_n
        unknown = self.speeds[: len(speeds_kmh)] & ~known
        return {"peak_force_n": unknown} if unknown.any() else {}


def passages() -> Passages:
    """Two places that are about as bad as each other, and two at which the force is far smaller."""
    wave_n = 2e3 * np.sin(KMH[:, None] / 9.0 + np.array([0.0, 2.0, 4.0, 1.0]))
    peak_n = LOAD_N + 20e3 + 50.0 * KMH[:, None] + wave_n - np.array([0.0, 500.0, 15e3, 15e3])
    return Passages(LOAD_N, peak_n, 2 * LOAD_N - peak_n, np.zeros_like(peak_n), None, None)


def refined(every: Passages, questions: Asked) -> tuple[CurveBounds, list[Selection]]:
    bounds, rounds = CurveBounds(every.at(ON_MAP), KMH[ON_MAP], KMH), []

    def simulate(selected: Selection) -> Passages:
        assert not (selected & ~bounds.possible(["peak_force_n"])[~ON_MAP]).any()
        rounds.append(selected)
        return every.at(~ON_MAP)

    refine(bounds, len(KMH), questions, simulate)
    return bounds, rounds


@pytest.mark.parametrize("speeds_kmh", [(101.0, 102.0, 103.0, 104.0), (57.0, 123.0, 124.0, 299.0), (21.0,)])
def test_what_is_asked_for_is_known_in_the_end(speeds_kmh):
    every, questions = passages(), Asked(*speeds_kmh)
    bounds, _ = refined(every, questions)
    found = bounds.worst.expected.peak_force_n
    np.testing.assert_array_equal(found[questions.speeds], every.peak_force_n.max(axis=1)[questions.speeds])


def test_places_that_cannot_be_the_worst_are_not_simulated():
    bounds, _ = refined(passages(), Asked(101.0, 102.0, 103.0, 104.0, 187.0))
    assert bounds.simulated[~ON_MAP, :2].any()
    assert not bounds.simulated[~ON_MAP, 2:].any()


def test_registers_are_filled_with_speeds_that_are_asked_for_before_others():
    speeds_kmh = (101.0, 102.0, 103.0, 104.0, 187.0)
    every = passages()
    _, rounds = refined(every, Asked(*speeds_kmh))
    first, asked = rounds[0], np.isin(KMH, speeds_kmh)[~ON_MAP]
    possible = CurveBounds(every.at(ON_MAP), KMH[ON_MAP], KMH).possible(["peak_force_n"])[~ON_MAP]
    assert np.count_nonzero(first, axis=0).max() == SPEEDS
    for place in np.flatnonzero(first[~asked].any(axis=0)).tolist():
        assert first[asked & possible[:, place], place].all()
