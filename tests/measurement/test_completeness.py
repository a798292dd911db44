"""A file's content says whether it is all there: a half-written one must not be judged as a whole."""

import numpy as np
import pytest

from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import is_complete

UNITS = "# x_unit: mm\n# z_unit: mm\n# z_positive: up\n"


def text(first_mm: int, last_mm: int, header: str = "") -> str:
    x_mm = np.arange(first_mm, last_mm + 1, 5)
    middle = (first_mm + last_mm) / 2
    z_mm = np.where(abs(x_mm - middle) <= 150, -0.2 * (1 + np.cos(2 * np.pi * (x_mm - middle) / 300)), 0.0)
    return UNITS + header + "x,z\n" + "".join(f"{x},{z:.3f}\n" for x, z in zip(x_mm, z_mm, strict=True))


def complete_at(whole: bytes) -> list[int]:
    """Return the lengths at which a growing file passes for a whole one: every tenth, and all near its end."""
    lengths = {*range(0, len(whole), 10), *range(len(whole) - 30, len(whole) + 1)}
    return [length for length in sorted(lengths) if is_complete(whole[:length])]


@pytest.mark.untraced
def test_record_about_zero_is_complete_at_its_end_only() -> None:
    whole = text(-600, 600).encode()
    assert complete_at(whole) == [len(whole)]


@pytest.mark.untraced
def test_record_from_zero_never_says_that_it_is_complete() -> None:
    assert complete_at(text(0, 1200).encode()) == []


@pytest.mark.untraced
def test_announced_number_of_samples_says_it() -> None:
    whole = text(0, 1200, "# samples: 241\n").encode()
    assert complete_at(whole) == [len(whole)]


def test_footer_says_it() -> None:
    assert is_complete((text(0, 1200) + "Max: 0.2\n").encode())
    assert not is_complete((text(0, 1200) + "Max: 0.2").encode())


def test_last_line_without_its_end_may_still_be_written() -> None:
    assert not is_complete(text(-600, 600).rstrip("\n").encode())


@pytest.mark.parametrize("raw", [b"", b"# x_unit: mm\n", b"\x00\x01", b"x,z\n1,2\n"])
def test_what_cannot_be_read_is_not_complete(raw: bytes) -> None:
    assert not is_complete(raw)


def test_what_the_user_states_is_needed_to_tell() -> None:
    plain = "".join(f"{x};0,{abs(x)}\n" for x in range(-600, 605, 5)).encode()
    assert not is_complete(plain)
    assert is_complete(plain, InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up"))
    assert is_complete(plain.decode().encode("utf-16"), InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up"))
