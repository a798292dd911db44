"""The simulated trolley: the rail is what it says, and the run is what the rail and the handling make of it."""

from itertools import islice, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.roughness import REFERENCE_M
from weld_force_ros.measurement.synthetic_rail import (
    BACK_M,
    SPACING_M,
    STEP_M,
    Handling,
    SampleBatch,
    SyntheticRail,
    run,
)
from weld_force_ros.measurement.synthetic_welds import population

SMOOTH_DB = -90.0
EXACT = Handling(noise_m=0.0, jitter_m=0.0, overlap=0, turn_every_m=np.inf)


def together(batches: list[SampleBatch]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([b.chainage_m for b in batches]), np.concatenate([b.height_m for b in batches])


def test_welds_stand_where_the_rail_says_and_are_those_of_the_population():
    rail = SyntheticRail(100.0, 5, level_db=SMOOTH_DB)
    assert [w.chainage_m for w in rail.welds] == [12_000 + SPACING_M * n for n in range(1, 6)]
    for placed, weld in zip(rail.welds, population(5, 5), strict=True):
        np.testing.assert_allclose(rail.height_m(placed.chainage_m + weld.x_m), weld.z_m, atol=1e-8)


def test_between_welds_there_is_roughness_of_the_same_size_everywhere():
    rail = SyntheticRail(1000.0, 1, level_db=0.0, spacing_m=2000.0)
    height = rail.height_m(rail.first_m + STEP_M * np.arange(1_000_000))
    parts = height.reshape(10, -1).std(axis=1)
    assert parts.max() / parts.min() < 1.5
    # The sum of all bands to 0 dB, those over 0.4 m as continued there.
    assert 10e-6 < height.std() < 40e-6
    assert height.std() > 10 * REFERENCE_M


def test_one_seed_makes_one_rail_and_one_run_and_another_seed_others():
    runs = [together(list(run(SyntheticRail(30.0, seed), seed))) for seed in (3, 3, 4)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0][1][:1000], runs[2][1][:1000])


def test_without_noise_the_rail_is_sent_millimetre_by_millimetre():
    rail = SyntheticRail(40.0, 2)
    x, z = together(list(run(rail, 2, EXACT)))
    np.testing.assert_allclose(x - rail.first_m, STEP_M * np.arange(40_001), atol=1e-8)
    np.testing.assert_array_equal(z, rail.height_m(x))


@settings(deadline=None, max_examples=10)
@given(st.floats(0.05, 20.0), st.floats(0.01, 1.0), st.floats(BACK_M + 0.1, 40.0), st.integers(0, 50))
def test_batches_come_in_time_overlap_and_end_once_at_each_weld(
    speed_m_per_s: float, batch_s: float, turn_every_m: float, overlap: int
):
    rail = SyntheticRail(45.0, 1)
    handling = Handling(speed_m_per_s, max(batch_s, 0.05 / speed_m_per_s), overlap, turn_every_m, jitter_m=0.0)
    batches = list(run(rail, 1, handling))
    marked = [b for b in batches if b.weld]
    assert [b.weld for b in marked] == list(rail.welds)
    for batch in marked:
        assert batch.chainage_m[-1] == pytest.approx(batch.weld.chainage_m, abs=STEP_M)  # type: ignore[union-attr]
    turns = len(np.arange(turn_every_m, 45.0, turn_every_m))
    assert batches[-1].at_s * speed_m_per_s == pytest.approx(45.0 + 2 * BACK_M * turns, abs=2e-3)
    assert np.all(np.diff([b.at_s for b in batches]) > 0)
    for before, after in pairwise(batches):
        again = min(overlap, len(before.chainage_m))
        own = len(after.chainage_m) - np.count_nonzero(np.isin(after.chainage_m[:again], before.chainage_m))
        assert own <= round(handling.batch_s * speed_m_per_s / STEP_M) + 1


def test_it_goes_back_and_over_the_place_again():
    chainages, _ = together(list(run(SyntheticRail(60.0, 1), 1, Handling(jitter_m=0.0, overlap=0))))
    direction = np.sign(np.diff(chainages))
    assert np.count_nonzero(direction < 0) == pytest.approx(2 * BACK_M / STEP_M, abs=4)
    assert np.count_nonzero(np.diff(direction)) == 4


def test_lost_batches_leave_gaps_in_their_share():
    rail = SyntheticRail(200.0, 1)
    every = list(run(rail, 1, Handling(turn_every_m=np.inf)))
    some = list(run(rail, 1, Handling(turn_every_m=np.inf, lost_share=0.3)))
    assert 1 - len(some) / len(every) == pytest.approx(0.3, abs=0.05)


def test_a_long_run_begins_at_once():
    batches = list(islice(run(SyntheticRail(10_000.0, 1), 1), 3))
    assert batches[0].chainage_m[0] == pytest.approx(12_000.0, abs=1e-3)


@pytest.mark.parametrize("wrong", [{"length_m": 0.0}, {"length_m": np.nan}, {"seed": -1}, {"spacing_m": 0.5}])
def test_a_rail_that_cannot_be_is_refused(wrong: dict[str, float]):
    with pytest.raises(InputError, match="give lengths over 0"):
        SyntheticRail(**({"length_m": 10.0, "seed": 1} | wrong))


@pytest.mark.parametrize("handling", [Handling(speed_m_per_s=0.0), Handling(turn_every_m=BACK_M), Handling(batch_s=-1)])
def test_a_trolley_that_gets_nowhere_is_refused(handling: Handling):
    with pytest.raises(InputError, match="does not get on"):
        run(SyntheticRail(10.0, 1), 1, handling)
