"""The samples of a record: where a new one begins, what is mended in it, and what is said of it."""

from decimal import Decimal

import numpy as np
import pytest

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement import record
from weld_force_ros.measurement.profile_file import parse_profiles
from weld_force_ros.measurement.record import Record, Sample

UNITS = "# x_unit: mm\n# z_unit: um\n# z_positive: up\n"


def samples(x_mm, z_um=None) -> list[Sample]:
    heights = [0] * len(x_mm) if z_um is None else z_um
    return [
        Sample(
            line,
            Decimal(str(x)) / 1000,
            [None if z is None else Decimal(str(z)) / 10**6],
            ["" if z is None else str(z)],
        )
        for line, (x, z) in enumerate(zip(x_mm, heights, strict=True), start=1)
    ]


def heights_um(found: Record) -> list[float]:
    return [float(sample.z[0]) * 1e6 for sample in found.samples]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_new_record_begins_where_x_goes_back_50_mm(sign: int) -> None:
    once, again = [sign * x for x in range(0, 200, 5)], [sign * x for x in range(145, 345, 5)]
    assert [len(part) for part in record.divide(samples(once + again))] == [40, 40]
    assert len(record.divide(samples(once + [x + sign * 10 for x in again]))) == 1


def test_so_few_samples_are_one_record() -> None:
    assert record.divide(samples([600, 0])) == [samples([600, 0])]


def test_what_is_in_order_stays_as_it_is() -> None:
    found = record.ordered(samples([0, 5, 10, 15]))
    assert (found.samples, found.notes) == (samples([0, 5, 10, 15]), [])


def test_two_small_steps_back_in_a_short_record_are_refused() -> None:
    with pytest.raises(ProfileError, match="x does not increase from line 2 to 3"):
        record.ordered(samples([0, 5, 4, 9, 14, 13, 18]))


def test_repeated_position_with_nearly_the_same_height_is_one() -> None:
    found = record.ordered(samples([0, 5, 5, 10], [0, 1, 90, 2]))
    assert heights_um(found) == [0, 1, 2]
    assert found.notes == ["1 repeated position left out, first at line 3"]
    with pytest.raises(ProfileError, match="two heights are stated for one place"):
        record.ordered(samples([0, 5, 5, 10], [0, 1, 102, 2]))


@pytest.mark.parametrize("mark", ["-9999", "9999", "-999.99", "99999"])
def test_nothing_but_nines_far_off_is_a_missing_value(mark: str) -> None:
    found = Record(samples(range(0, 100, 5), [*range(10), mark, *range(9)]))
    record.without_nines(found)
    assert [i for i, sample in enumerate(found.samples) if sample.z[0] is None] == [10]
    assert found.notes == [f"1 height {mark} taken as missing"]


@pytest.mark.parametrize("height", ["99", "9998", "-1234", "9"])
def test_other_heights_stay(height: str) -> None:
    others = [100 * z for z in range(10)] if height in ("99", "9") else [*range(10)]
    found = Record(samples(range(0, 105, 5), [*others, height, *others]))
    record.without_nines(found)
    assert found.notes == []


def test_nines_alone_are_no_missing_values() -> None:
    found = Record(samples(range(0, 50, 5), ["999"] * 10))
    record.without_nines(found)
    assert found.notes == []


def test_missing_heights_are_those_of_the_cubic_through_the_others() -> None:
    x_mm = list(range(0, 205, 5))
    z_um = [1e-5 * (x - 100) ** 3 for x in x_mm]
    given = [None if 10 <= i <= 13 else z for i, z in enumerate(z_um)]
    found = Record(samples(x_mm, given))
    record.bridged(found)
    np.testing.assert_allclose(heights_um(found), z_um, atol=1e-6)
    assert found.notes == ["4 missing heights put by a cubic, longest gap 25 mm"]


def test_gap_in_one_of_two_passes_is_bridged_in_that_one() -> None:
    given = samples(range(0, 105, 5), [*range(21)])
    for i, sample in enumerate(given):
        sample.z.append(None if i == 7 else Decimal(2 * i) / 10**6)
    found = Record(given)
    record.bridged(found)
    assert [float(z) * 1e6 for z in found.samples[7].z] == pytest.approx([7, 14])


def test_too_few_heights_are_refused() -> None:
    with pytest.raises(ProfileError, match="3 samples with a height"):
        record.bridged(Record(samples(range(0, 50, 5), [1, 2, 3, *[None] * 7])))


def rail(welds_m: tuple[float, ...], length_m: float) -> str:
    x_m = np.arange(0.0, length_m + 1e-9, 0.005)
    z_um = np.random.default_rng(1).normal(0, 3, len(x_m))
    for weld_m in welds_m:
        z_um += np.where(abs(x_m - weld_m) < 0.15, -200 * (1 + np.cos(2 * np.pi * (x_m - weld_m) / 0.3)), 0)
    return UNITS + "x,z\n" + "".join(f"{1000 * x:.0f},{z:.0f}\n" for x, z in zip(x_m, z_um, strict=True))


def test_long_record_is_cut_into_its_welds() -> None:
    found = [understood.profile for understood in parse_profiles(rail((3.0, 9.0), 12.0), "trolley.csv")]
    assert [profile.weld_id for profile in found] == ["trolley-1", "trolley-2"]
    for profile in found:
        x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
        assert x_m[z_m.argmin()] == pytest.approx(0.0, abs=0.005)
        assert z_m.min() == pytest.approx(-400e-6, abs=15e-6)
        assert profile.conditioning[0].startswith("cut out of 12")


def test_long_record_without_a_weld_is_refused() -> None:
    with pytest.raises(ProfileError, match=r"no weld stands out in 12.* m of rail; cut the record"):
        parse_profiles(rail((), 12.0), "trolley.csv")
