"""A trolley's stream: what reaches a window does not depend on how it came, and what is missing is refused."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.rail_stream import KEPT_M, LARGEST_GAP_M, STEP_M, Missing, RailStream, Window

Samples = list[tuple[float, float]]
FINE = settings(max_examples=60, deadline=None)


def rail(x_m: np.ndarray) -> np.ndarray:
    return 1e-4 * np.cos(2 * np.pi * x_m / 0.4) + 3e-5 * np.sin(2 * np.pi * x_m / 0.07) + 1e-3 * x_m


def levelled(x_m: np.ndarray, z_m: np.ndarray) -> np.ndarray:
    return z_m - (z_m[0] + (z_m[-1] - z_m[0]) * (x_m - x_m[0]) / (x_m[-1] - x_m[0]))


def samples(first_m: float, last_m: float, spacing_m: float = STEP_M) -> Samples:
    x = first_m + spacing_m * np.arange(round((last_m - first_m) / spacing_m) + 1)
    return list(zip(x.tolist(), rail(x).tolist(), strict=True))


def streamed(*batches: Samples) -> RailStream:
    stream = RailStream()
    for batch in batches:
        stream.push([x for x, _ in batch], [z for _, z in batch])
    return stream


def cut(stream: RailStream, centre_m: float = 1.0, length_m: float = 1.0) -> Window:
    window = stream.window(centre_m, length_m)
    assert isinstance(window, Window), window
    return window


def refused(stream: RailStream, centre_m: float = 1.0, length_m: float = 1.0) -> Missing:
    missing = stream.window(centre_m, length_m)
    assert isinstance(missing, Missing), missing
    return missing


@st.composite
def travelled(draw: st.DrawFn, track: Samples) -> list[Samples]:
    """The same samples as a trolley may send them: jittered, partly passed again, in overlapping batches, with NaN."""
    jitter = np.random.default_rng(draw(st.integers(0, 999))).uniform(0, draw(st.integers(0, 4)), len(track))
    order = np.argsort(np.arange(len(track)) + jitter)
    sent = [track[i] for i in order]
    turn = draw(st.integers(1, len(sent)))
    back = draw(st.integers(0, turn))
    sent = sent[:turn] + sent[turn - back : turn][::-1] + sent[turn - back :]
    lost = draw(st.sampled_from([(np.nan, 0.0), (0.9, np.nan), (np.inf, 0.0), (1.1, -np.inf)]))
    sent.insert(draw(st.integers(0, len(sent))), lost)
    ends = [0, *sorted(draw(st.lists(st.integers(0, len(sent)), max_size=6))), len(sent)]
    overlap = draw(st.integers(0, 30))
    return [sent[max(0, first - overlap) : last] for first, last in pairwise(ends)]


@FINE
@given(st.data(), st.sampled_from([1e-3, 2.5e-3, 5e-3]))
def test_batches_overlap_jitter_reversal_and_nan_leave_the_window_as_it_is(data: st.DataObject, spacing_m: float):
    track = samples(0.4, 1.6, spacing_m)
    whole = cut(streamed(track))
    parts = cut(streamed(*data.draw(travelled(track))))
    np.testing.assert_array_equal(parts.x_m, whole.x_m)
    np.testing.assert_array_equal(parts.z_m, whole.z_m)


@FINE
@given(st.floats(0.6, 1.4), st.floats(0.3e-3, 9e-3), st.floats(-1e6, 1e6))
def test_a_window_is_the_rail_resampled_and_levelled(centre_m: float, spacing_m: float, from_m: float):
    x = np.arange(0.0, 2.0 + spacing_m, spacing_m)
    stream = RailStream()
    stream.push(from_m + x, 1e-4 * np.sin(2 * np.pi * x / 0.8) + 2e-3 * x)
    window = cut(stream, from_m + centre_m)
    assert len(window.x_m) == 1001
    assert (window.x_m[0], window.x_m[-1]) == (-0.5, 0.5)
    at = centre_m + window.x_m
    expected = levelled(at, 1e-4 * np.sin(2 * np.pi * at / 0.8))
    # A straight line over h strays from a sine of amplitude a by a (2 pi h / L)^2 / 8, and levelling adds as much.
    apart_m = max(spacing_m, 2 * STEP_M)
    np.testing.assert_allclose(window.z_m, expected, atol=2.1e-4 * (2 * np.pi * apart_m / 0.8) ** 2 / 8 + 2e-12)


@pytest.mark.parametrize("spacing_m", [1e-3, 1.02e-3, 5e-3])
def test_the_newest_pass_counts_and_leaves_nothing_of_the_older(spacing_m: float):
    older = [(x, z + 40e-6) for x, z in samples(0.0, 2.0, spacing_m)]
    newer = samples(0.4037, 2.0, spacing_m)[::-1]
    window = cut(streamed(older, newer))
    alone = cut(streamed(newer))
    away_from_the_turn = (window.x_m > -0.45) & (window.x_m < 0.45)
    np.testing.assert_allclose(window.z_m[away_from_the_turn], alone.z_m[away_from_the_turn], atol=1e-9)
    assert spacing_m == 1e-3 or "newer pass" in " ".join(window.conditioning)


def test_one_measurement_of_a_millimetre_replaces_another():
    window = cut(streamed(samples(0.0, 2.0), [(1.0, 5e-3)]))
    assert window.z_m[500] == pytest.approx(5e-3 - rail(np.array([0.5, 1.5])).mean(), abs=1e-12)


@FINE
@given(st.floats(0.52, 1.47), st.floats(1e-3, 30e-3))
def test_a_gap_is_bridged_or_refused_by_its_length(begin_m: float, length_m: float):
    track = [(x, z) for x, z in samples(0.0, 2.0) if not begin_m < x < begin_m + length_m]
    widest = np.diff([x for x, _ in track if 0.5 - 1e-9 <= x <= 1.5 + 1e-9]).max()
    answer = streamed(track).window(1.0, 1.0)
    if widest <= LARGEST_GAP_M + 1e-9:
        assert isinstance(answer, Window)
        assert f"the longest over {widest * 1e3:.3g} mm" in answer.conditioning[0]
    else:
        assert isinstance(answer, Missing)
        assert not answer.awaited
        assert "no samples from" in answer.reason


@pytest.mark.parametrize("beyond", [(0.0, 0.5), (1.5, 2.0)])
def test_a_gap_outside_the_window_does_not_matter(beyond: tuple[float, float]):
    track = [(x, z) for x, z in samples(0.0, 2.0) if not beyond[0] < x - 1e-9 < beyond[1] - 2e-9]
    np.testing.assert_array_equal(cut(streamed(track)).z_m, cut(streamed(samples(0.0, 2.0))).z_m)


def test_a_gap_across_the_windows_end_is_refused():
    track = [(x, z) for x, z in samples(0.0, 2.0) if not 0.492 < x < 0.508]
    assert "0.500 to 0.508" in refused(streamed(track)).reason


def test_what_the_trolley_has_not_reached_is_awaited_and_then_comes():
    stream = streamed(samples(0.0, 1.2))
    missing = refused(stream)
    assert missing.awaited
    assert "1.200 to 1.500 m" in missing.reason
    stream.push(*zip(*samples(1.201, 1.6), strict=True))
    cut(stream)


def test_nothing_yet_is_awaited():
    assert refused(RailStream()).awaited
    assert RailStream().stretches() == []


def test_what_was_overwritten_is_gone_and_not_awaited():
    stream = streamed(samples(0.0, KEPT_M + 3.0))
    assert not refused(stream).awaited
    assert cut(stream, KEPT_M + 2.0).chainage_m == KEPT_M + 2.0


def test_memory_does_not_grow():
    stream = streamed(samples(0.0, 5.0))
    before = held_bytes(stream)
    for first in range(5, 100, 5):
        stream.push(*zip(*samples(first, first + 5.0, 2e-3), strict=True))
    assert held_bytes(stream) == before < 4 * 8 * KEPT_M / STEP_M + 1
    assert sum(len(stretch.chainage_m) for stretch in stream.stretches()) <= KEPT_M / STEP_M


def held_bytes(stream: RailStream) -> int:
    values = vars(stream).values()
    assert not any(isinstance(value, list | dict | set) for value in values)
    return sum(value.nbytes for value in values if isinstance(value, np.ndarray))


def test_sections_part_at_gaps():
    track = [(x, z) for x, z in samples(0.0, 6.0, 2e-3) if not (1.0 < x < 1.5 or 3.0 < x < 3.005)]
    first, second = streamed(track).stretches()
    assert (first.chainage_m[0], second.chainage_m[-1]) == (0.0, pytest.approx(6.0))
    assert first.chainage_m[-1] == pytest.approx(1.0, abs=2.1e-3)
    assert second.chainage_m[0] == pytest.approx(1.5, abs=2.1e-3)
    np.testing.assert_allclose(np.diff(second.chainage_m), STEP_M, atol=1e-9)
    np.testing.assert_allclose(first.height_m, rail(first.chainage_m), atol=1e-6)


def test_after_a_jump_of_the_chainage_the_rail_before_it_is_gone_but_a_stray_sample_takes_a_slot_only():
    stream = streamed(samples(0.0, 2.0), [(9e5 + 1.5, 0.0)])
    assert [stretch.chainage_m[0] for stretch in stream.stretches()] == pytest.approx([9e5 + 1.5])
    stream.push(*zip(*samples(2.001, 2.1), strict=True))
    assert [stretch.chainage_m[0] for stretch in stream.stretches()] == [0.0]
    cut(stream)


def test_what_is_no_number_is_counted():
    stream = RailStream()
    stream.push([0.0, np.nan, 0.001, 1e300], [np.nan, 0.0, 0.0, 0.0])
    assert stream.unusable == 3


@pytest.mark.parametrize(("x", "z"), [([0.0, 1.0], [0.0]), ([[0.0]], [[0.0]]), (0.0, 0.0)])
def test_a_batch_that_does_not_fit_is_refused(x: object, z: object):
    with pytest.raises(InputError, match="one height for every chainage"):
        RailStream().push(x, z)  # type: ignore[arg-type]


@pytest.mark.parametrize(("centre_m", "length_m"), [(np.nan, 1.0), (0.0, 0.0), (0.0, np.nan), (0.0, KEPT_M + 1)])
def test_a_window_that_cannot_be_is_refused(centre_m: float, length_m: float):
    with pytest.raises(InputError, match="cannot be cut"):
        RailStream().window(centre_m, length_m)
