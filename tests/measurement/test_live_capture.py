"""Live capture: every weld that is marked ends in one file with the rail as it is, or in one rejection."""

import itertools
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from weld_force_ros.errors import InputError
from weld_force_ros.measurement import capture_folder, live_capture
from weld_force_ros.measurement.live_capture import GIVEN_UP_M, LiveCapture
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.measurement.rail_stream import KEPT_M
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.measurement.synthetic_rail import Handling, SampleBatch, SyntheticRail, run
from weld_force_ros.measurement.weld_detection import APART_M
from weld_force_ros.messages import RailSurface, WeldMarker, WeldProfile

NOISE_M, JITTER_M = 1e-6, 0.1e-3
RAIL_M = 40.0  # with two welds
RAILS = {seed: SyntheticRail(RAIL_M, seed) for seed in range(3)}
TIMEOUT_S = 600.0


@dataclass
class Bench:
    """A folder, and what a `LiveCapture` said of it."""

    folder: Path
    now_s: float = 0.0
    rejected: list[tuple[str, InputError, str]] = field(default_factory=list)
    announced: list[str] = field(default_factory=list)

    def live(self, **options: Any) -> LiveCapture:
        return LiveCapture(
            self.folder,
            reject=self.reject,
            announce=self.announced.append,
            clock=lambda: self.now_s,
            **options,
        )

    def reject(self, source: str, error: InputError, text: str) -> None:
        self.rejected.append((source, error, text))

    @property
    def profiles(self) -> list[WeldProfile]:
        """The captures as they were written: the rail of these tests is exact, and often flat."""
        exact = [(path.name, path.read_text("utf-8")) for path in sorted(self.folder.glob("*.csv"))]
        return [parse_profile(text.replace("# noise: auto\n", "# noise: none\n"), name) for name, text in exact]

    @property
    def places_m(self) -> list[float]:
        return sorted(float(profile.chainage_m) for profile in self.profiles)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Bench]:
    """For each example of hypothesis its own."""
    return lambda: Bench(tmp_path_factory.mktemp("live"))


def level(chainage_m: np.ndarray) -> np.ndarray:
    """A rail with a dip of 0.2 mm, 0.2 m long, every 18 m from 0 on, and 1 mm of slope per metre."""
    return cosine_dip((chainage_m + 9.0) % 18.0 - 9.0, 0.2, 0.2e-3) + 1e-3 * chainage_m


def drive(
    live: LiveCapture, *places_m: float, lost: tuple[float, float] = (np.inf, np.inf), step_m: float = 1e-3
) -> None:
    """From place to place, without a sample between the two `lost` ones."""
    for first, last in itertools.pairwise(places_m):
        x = np.linspace(first, last, round(abs(last - first) / step_m) + 1)
        x = x[(x < lost[0]) | (x > lost[1])]
        for part in np.array_split(x, max(len(x) // 120, 1)):
            live.push_samples(part, level(part))


def assert_tells_the_rail(profile: WeldProfile, height_m: Callable[[np.ndarray], np.ndarray], worst_m: float) -> None:
    x = np.array(profile.x_m)
    z = height_m(profile.chainage_m + x)
    np.testing.assert_allclose(profile.z_m, z - np.interp(x, x[[0, -1]], z[[0, -1]]), atol=worst_m)
    assert (x[0], x[-1], len(x)) == (-0.5, 0.5, 1001)


def split(batch: SampleBatch, parts: Sequence[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    ends = sorted({min(part, len(batch.chainage_m)) for part in parts} | {0, len(batch.chainage_m)})
    for first, last in itertools.pairwise(ends):
        yield batch.chainage_m[first:last], batch.height_m[first:last]


@pytest.mark.slow
@settings(deadline=None, max_examples=8)
@given(
    st.sampled_from(list(RAILS)),
    st.floats(0.3, 5.0),
    st.floats(5.0, 40.0),
    st.integers(0, 60),
    st.lists(st.integers(1, 400), max_size=4),
    st.booleans(),
)
def test_every_marked_weld_is_captured_once_and_as_it_is(
    fresh: Callable[[], Bench],
    seed: int,
    speed_m_per_s: float,
    turn_every_m: float,
    overlap: int,
    parts: list[int],
    by_name: bool,
):
    bench, rail = fresh(), RAILS[seed]
    live = bench.live(rail="left")
    handling = Handling(speed_m_per_s, 0.1, overlap, turn_every_m, noise_m=NOISE_M, jitter_m=JITTER_M)
    for batch in run(rail, seed, handling):
        for samples in split(batch, parts):
            live.push_samples(*samples)
        if batch.weld:
            place_m, name = batch.weld.chainage_m, batch.weld.weld_id
            live.mark(WeldMarker(chainage_m=place_m, weld_id=name) if by_name else None)
    assert bench.rejected == []
    assert live.waiting == 0
    assert bench.places_m == pytest.approx([w.chainage_m for w in rail.welds], abs=1e-6 if by_name else 5e-3)
    steepest = np.abs(np.gradient(rail.height_m(rail.first_m + np.arange(0.0, RAIL_M, 1e-3)), 1e-3)).max()
    for profile in bench.profiles:
        assert_tells_the_rail(profile, rail.height_m, 2 * 6 * (NOISE_M + JITTER_M * steepest))
    names = {w.weld_id for w in rail.welds} if by_name else {f"left-km{p / 1e3:.6f}" for p in bench.places_m}
    assert {profile.weld_id for profile in bench.profiles} == names


@pytest.mark.slow
@settings(deadline=None, max_examples=12)
@given(st.integers(0, 10_000), st.floats(0.02, 0.4), st.floats(5.0, 40.0))
def test_whatever_is_lost_every_mark_has_one_outcome(
    fresh: Callable[[], Bench], seed: int, lost_share: float, turn_every_m: float
):
    bench, rail = fresh(), RAILS[seed % len(RAILS)]
    live, marked = bench.live(), []
    for batch in run(rail, seed, Handling(2.0, turn_every_m=turn_every_m, lost_share=lost_share)):
        live.push_samples(batch.chainage_m, batch.height_m)
        if batch.weld:
            live.mark(WeldMarker(weld_id=batch.weld.weld_id))
            marked.append(batch.weld.weld_id)
    bench.now_s += TIMEOUT_S
    live.check_marks()
    refused = [json.loads(text)["weld_id"] for _, _, text in bench.rejected]
    assert sorted([*refused, *(profile.weld_id for profile in bench.profiles)]) == sorted(marked)


class Killed(BaseException):
    """The process ends here."""


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(st.integers(0, 45))
def test_killed_at_any_step_to_the_disk_a_mark_that_was_accepted_has_one_outcome(
    fresh: Callable[[], Bench], steps: int
):
    bench = fresh()
    left, accepted = steps, []

    def step(real: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            nonlocal left
            if left == 0:
                raise Killed
            left -= left > 0
            return real(*arguments, **options)

        return counted

    with pytest.MonkeyPatch.context() as patch:
        # Nothing is tidied up after a kill.
        patch.setattr(Path, "unlink", step(Path.unlink))
        patch.setattr(Path, "replace", step(Path.replace))
        patch.setattr("os.fsync", step(lambda _: None))
        patch.setattr(Bench, "reject", step(Bench.reject))
        live = bench.live()
        for begin in range(0, 28, 2):  # about 40 steps
            try:
                gap = (begin + 1.6, begin + 1.7) if begin % 12 == 0 else (np.inf, np.inf)
                drive(live, begin, begin + 2, step_m=5e-3, lost=gap)
                if begin % 6 == 0:
                    live.mark(WeldMarker(chainage_m=begin + 1.9, weld_id=f"w{begin}"))
                    accepted.append(f"w{begin}")
            except Killed:
                left = -1
                live = bench.live()
    left = -1
    bench.now_s += TIMEOUT_S
    live.check_marks()
    refused = {(source, text) for source, _, text in bench.rejected}
    outcomes = [profile.weld_id for profile in bench.profiles]
    outcomes += [json.loads(text)["weld_id"] for _, text in refused]
    assert len(outcomes) == len(set(outcomes))
    assert set(accepted) <= set(outcomes)


def test_a_mark_survives_a_restart_and_is_captured_where_the_trolley_goes_over_it_again(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 5.2)
    live.mark(WeldMarker(chainage_m=5.0, weld_id="w", line_speed_kmh=120.0, weld_position_m=0.3))
    live = bench.live()
    assert any("w at 5.000 m" in text and "before the restart" in text for text in bench.announced)
    drive(live, 5.2, 8.0)
    assert bench.profiles == []
    drive(live, 8.0, 3.0)
    (profile,) = bench.profiles
    assert (profile.weld_id, profile.line_speed_kmh, profile.weld_position_m) == ("w", 120.0, 0.3)
    assert_tells_the_rail(profile, level, 1e-9)
    again = bench.live()
    assert again.waiting == 0
    drive(again, 3.0, 8.0)
    assert "captured in" in again.mark(WeldMarker(chainage_m=5.05))


def test_a_mark_whose_rail_never_comes_is_refused_when_its_time_is_over(bench: Bench):
    live = bench.live(mark_timeout_s=60.0)
    live.mark(WeldMarker(chainage_m=7.0))
    bench.now_s = 59.0
    live.check_marks()
    assert bench.rejected == []
    bench.now_s = 60.0
    live.check_marks()
    live.check_marks()
    ((source, error, text),) = bench.rejected
    assert source.startswith("km0.007000-")
    assert "not measured within 60 s" in error.reason
    assert '"chainage_m":7.0' in text
    assert bench.live().waiting == 0


def test_words_say_what_was_marked_and_what_it_waits_for(bench: Bench):
    live = bench.live()
    with pytest.raises(InputError, match="nothing was measured yet; start the trolley"):
        live.mark()
    drive(live, 100.0, 103.0)
    words = live.mark(WeldMarker(weld_id="KM0-7"))
    assert "weld KM0-7 at 102.998 m is marked" in words
    assert "from 102.498 to 103.498 m" in words
    assert "captured in km0.101000" in live.mark(WeldMarker(chainage_m=101.0))


def test_the_marker_may_stand_apart_from_the_instrument(bench: Bench):
    live = bench.live(marker_offset_m=0.5)
    drive(live, 0.0, 10.0)
    live.mark()
    drive(live, 10.0, 12.0)
    assert bench.places_m == pytest.approx([10.498], abs=1e-6)


def test_marks_near_each_other_are_one_weld(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 2.0)
    live.mark()
    assert "not measured twice" in live.mark(WeldMarker(chainage_m=2.09))
    live.mark(WeldMarker(chainage_m=2.2))
    drive(live, 2.0, 4.0)
    assert "not measured twice" in live.mark(WeldMarker(chainage_m=1.95))
    assert bench.places_m == pytest.approx([1.998, 2.2], abs=1e-6)


def test_after_the_trolley_was_away_a_weld_is_measured_anew(bench: Bench):
    live = bench.live()
    for _ in range(2):
        drive(live, 0.0, 2.0)
        live.mark(WeldMarker(chainage_m=1.0))
        drive(live, 2.0, 3.0 + KEPT_M)
    assert bench.places_m == [1.0, 1.0]


def test_a_gap_is_mended_by_going_back(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 5.0, lost=(4.7, 4.8))
    live.mark(WeldMarker(chainage_m=5.0))
    drive(live, 5.0, 5.0 + GIVEN_UP_M - 1.0)
    (told,) = bench.announced
    assert "to 4.801 m" in told
    assert "go over it again" in told
    assert (bench.profiles, bench.rejected) == ([], [])
    drive(live, 14.0, 4.0)
    (profile,) = bench.profiles
    assert_tells_the_rail(profile, level, 1e-9)


def test_a_gap_that_is_not_mended_is_refused_when_the_trolley_has_gone(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 5.0, lost=(4.7, 4.8))
    live.mark(WeldMarker(chainage_m=5.0))
    drive(live, 5.0, 30.0)
    ((_, error, _),) = bench.rejected
    assert "to 4.801 m" in error.reason
    assert error.remedy.startswith("take the trolley over")
    with pytest.raises(InputError, match="over the place again, then mark it"):
        live.mark(WeldMarker(chainage_m=5.0))
    drive(live, 30.0, 3.0)
    live.mark(WeldMarker(chainage_m=5.0))
    assert bench.places_m == [5.0]


def test_the_last_pass_counts_while_the_trolley_is_over_the_weld(bench: Bench):
    live = bench.live()
    x = np.arange(0.0, 2.0, 1e-3)
    live.push_samples(x[:1505], level(x[:1505]) + 1e-3 * np.sin(20 * x[:1505]))
    live.mark(WeldMarker(chainage_m=1.0))
    live.push_samples(x[1505:300:-1], level(x[1505:300:-1]))
    live.push_samples(x[300:], level(x[300:]))
    (profile,) = bench.profiles
    assert_tells_the_rail(profile, level, 1e-9)


def test_a_stray_chainage_does_not_send_the_trolley_away(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 5.0, lost=(4.7, 4.8))
    live.mark(WeldMarker(chainage_m=5.0))
    live.push_samples([9e5, np.nan, 5.001], [0.0, 0.0, level(np.array([5.001]))[0]])
    drive(live, 5.002, 5.3)
    assert bench.rejected == []
    assert live.position_m == pytest.approx(5.298)


@pytest.mark.parametrize(
    ("weld_id", "expected"),
    [
        ("../../etc/x", "../../etc/x"),
        ("a\0b\nweld_id: c", "a b weld_id: c"),
        ("/" * 200, "/" * 200),
        ("Schweißstoß č. 7 左", "Schweißstoß č. 7 左"),
        ("\0\r\n\t", "km0.001000"),
        ("# x_unit: m", "# x_unit: m"),
        ("\u2028\u202e", "km0.001000"),
    ],
)
@pytest.mark.parametrize("rail", [None, "../left\0", "左"])
def test_hostile_names_stay_in_the_folder_and_are_read_back(
    bench: Bench, weld_id: str, expected: str, rail: str | None
):
    bench.folder = bench.folder / "in" / "here"
    bench.folder.mkdir(parents=True)
    live = bench.live(rail=rail)
    drive(live, 0.0, 2.0)
    live.mark(WeldMarker(chainage_m=1.0, weld_id=weld_id))
    (profile,) = bench.profiles
    assert profile.weld_id.removeprefix("../left-").removeprefix("左-") == expected
    assert len([path for path in bench.folder.parent.parent.rglob("*") if path.is_file()]) == 2


def test_units_and_sign_are_those_stated(bench: Bench):
    live = bench.live()
    x = np.arange(0.0, 2.0, 1e-3)
    live.push(
        RailSurface(
            chainage=(1e3 * x).tolist(),
            height=(-1e6 * level(x)).tolist(),
            chainage_unit="mm",
            height_unit="um",
            height_positive="down",
        )
    )
    live.mark(WeldMarker(chainage_m=1.0))
    assert_tells_the_rail(bench.profiles[0], level, 1e-9)


def surface(x: np.ndarray, **stated: Any) -> RailSurface:
    form = {"chainage_unit": "m", "height_unit": "m", "height_positive": "up"}
    return RailSurface(chainage=x.tolist(), height=level(x).tolist(), **form, **stated)


def test_how_trains_run_is_what_the_stream_said_last_and_else_what_the_node_says(bench: Bench):
    """Three welds: none stated yet, stated in a batch, and after that in none, measured backwards."""
    live = bench.live(running="both")
    for place_m in (1.0, 3.0, 5.0):
        live.mark(WeldMarker(chainage_m=place_m))
    x = np.arange(0.0, 2.0, 1e-3)
    live.push(surface(x))
    live.push(surface(x + 2.0, running="against"))
    live.push(surface(x[::-1] + 4.0))
    live.finish()
    assert [profile.running for profile in bench.profiles] == ["both", "against", "against"]
    assert {profile.chainage_direction for profile in bench.profiles} == {"with"}


def test_where_nobody_says_how_trains_run_the_capture_leaves_it_to_the_settings(bench: Bench):
    live = bench.live()
    live.mark(WeldMarker(chainage_m=1.0))
    live.push(surface(np.arange(0.0, 2.0, 1e-3)))
    live.finish()
    assert bench.profiles[0].running is UNSET


def test_a_batch_longer_than_the_rail_that_is_kept_captures_all_its_welds(bench: Bench):
    live = bench.live()
    for place_m in (2.0, 20.0, 44.0):
        live.mark(WeldMarker(chainage_m=place_m))
    x = np.arange(0.0, 50.0, 1e-3)
    live.push_samples(x, level(x))
    assert bench.places_m == [2.0, 20.0, 44.0]


def test_what_is_no_number_is_left_out_and_counted(bench: Bench):
    live = bench.live()
    x = np.arange(0.0, 3.0, 1e-3)
    z = np.where(np.arange(len(x)) % 5 == 0, np.nan, level(x))
    live.push_samples(x, z)
    live.mark(WeldMarker(chainage_m=1.0))
    assert live.unusable == 600
    assert_tells_the_rail(bench.profiles[0], level, 2e-8)
    live.push_samples(np.full(100, np.nan), np.zeros(100))
    live.push_samples([], [])
    assert live.position_m == pytest.approx(2.997, abs=2e-3)


def test_a_geometry_that_cannot_be_is_refused(bench: Bench):
    live = bench.live()
    x = np.arange(0.0, 3.0, 1e-3)
    live.push_samples(x, level(x) + 0.1 * (np.abs(x - 1.1) < 5e-4))
    live.mark(WeldMarker(chainage_m=1.0))
    ((_, error, _),) = bench.rejected
    assert "amplitude 100 mm" in error.reason
    assert bench.profiles == []


@pytest.mark.slow
def test_welds_are_found_once_and_those_marked_are_not_found(bench: Bench):
    """True welds at 18, 36 and 54 m; the second is marked."""
    live = bench.live(detect=True)
    drive(live, 1.0, 36.3)
    live.mark(WeldMarker(weld_id="marked"))
    drive(live, 36.3, 58.0, 50.0, 62.0)
    assert bench.places_m == pytest.approx([18.0, 36.298, 54.0], abs=0.05)
    assert [p.weld_id for p in bench.profiles if p.weld_id == "marked"] == ["marked"]
    assert bench.rejected == []
    assert "captured in" in live.mark(WeldMarker(chainage_m=54.0 + 0.9 * APART_M))
    again = bench.live(detect=True)
    drive(again, 62.0, 45.0, 65.0)
    assert len(bench.profiles) == 3


def test_a_mark_takes_the_place_of_a_find_that_waits(bench: Bench):
    live = bench.live(detect=True)
    drive(live, 1.0, 22.0, lost=(17.6, 17.7))
    assert live.waiting == 1
    live.mark(WeldMarker(chainage_m=18.1, weld_id="mine"))
    assert live.waiting == 1
    drive(live, 22.0, 16.0)
    (profile,) = bench.profiles
    assert (profile.weld_id, profile.chainage_m) == ("mine", 18.1)


@pytest.mark.untraced
def test_a_find_that_was_refused_is_not_found_again(bench: Bench):
    live = bench.live(detect=True)
    drive(live, 1.0, 22.0, lost=(17.6, 17.7))
    drive(live, 22.0, 44.0)
    assert len(bench.rejected) == 1
    assert bench.places_m == pytest.approx([36.0], abs=0.05)


@pytest.mark.slow
def test_the_detector_finds_the_welds_of_a_synthetic_run(bench: Bench):
    rail = SyntheticRail(62.0, 11, level_db=-12.0)
    live = bench.live(detect=True)
    for batch in run(rail, 11):
        live.push_samples(batch.chainage_m, batch.height_m)
    hits = [any(abs(p - w.chainage_m) < 0.5 for p in bench.places_m) for w in rail.welds]
    assert sum(hits) >= len(rail.welds) - 1
    assert all(any(abs(p - w.chainage_m) < 0.5 for w in rail.welds) for p in bench.places_m)


def test_a_mark_that_cannot_be_kept_is_not_accepted(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 2.0)
    shutil.rmtree(bench.folder)
    with pytest.raises(InputError, match="No such file or directory; free space or make the folder writable"):
        live.mark()
    assert live.waiting == 0


def test_a_capture_that_cannot_be_written_waits_and_is_announced_once(bench: Bench, monkeypatch: pytest.MonkeyPatch):
    live = bench.live()
    drive(live, 0.0, 2.0)
    live.mark()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(capture_folder, "whole_file", full)
        drive(live, 2.0, 4.0)
    assert live.waiting == 1
    (told,) = bench.announced
    assert "No space left on device" in told
    drive(live, 4.0, 4.2)
    assert bench.places_m == pytest.approx([1.998])
    assert [path.name for path in bench.folder.iterdir() if path.suffix == ".part"] == []


def test_nothing_is_overwritten(bench: Bench):
    live = bench.live()
    drive(live, 0.0, 1.2)
    live.mark(WeldMarker(chainage_m=1.0))
    noted = json.loads((bench.folder / ".weld-marks.json").read_text())
    file = bench.folder / noted["waiting"][0]["file"]
    file.write_text("someone else's")
    drive(live, 1.2, 3.0)
    assert file.read_text() == "someone else's"
    bench.now_s = TIMEOUT_S
    live.check_marks()
    ((_, error, _),) = bench.rejected
    assert "exists" in error.reason


def test_marks_that_wait_are_bounded(bench: Bench, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(live_capture, "MOST_WAITING", 5)
    live = bench.live()
    for number in range(5):
        live.mark(WeldMarker(chainage_m=float(number)))
    with pytest.raises(InputError, match="5 welds wait for their rail"):
        live.mark(WeldMarker(chainage_m=-5.0))


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b'{"waiting": [{"file": "../x.csv"}]}', b"[" * 2000])
def test_a_damaged_note_is_announced_and_does_no_harm(bench: Bench, content: bytes):
    (bench.folder / ".weld-marks.json").write_bytes(content)
    live = bench.live()
    assert "mark the welds again" in bench.announced[0]
    drive(live, 0.0, 2.0)
    live.mark(WeldMarker(chainage_m=1.0))
    assert bench.places_m == [1.0]


@pytest.mark.parametrize("chainage_m", [np.nan, np.inf, 1e300])
def test_a_place_that_is_none_is_refused(bench: Bench, chainage_m: float):
    with pytest.raises(InputError, match="cannot be cut"):
        bench.live().mark(WeldMarker(chainage_m=chainage_m))


@pytest.mark.parametrize(("x", "z"), [([0.0, 1.0], [0.0]), ([[0.0]], [[0.0]])])
def test_a_batch_that_does_not_fit_is_refused(bench: Bench, x: Any, z: Any):
    with pytest.raises(InputError, match="one height for every chainage"):
        bench.live().push_samples(x, z)
