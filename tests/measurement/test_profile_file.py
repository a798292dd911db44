"""Measurement files: what is read, what is refused and with which words, and what leaves a profile the same."""

import csv
import hashlib
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.profile_file import PlainForm, find, parse_profile, read_profile, shipped, write_profile
from weld_force_ros.measurement.shapes import REFERENCE_SHAPES, cosine_dip, ramp
from weld_force_ros.messages import WeldProfile, encode, profile_sha256

WHEEL_RADIUS_M = 0.45
UNITS = "# x_unit: mm\n# z_unit: um\n# z_positive: up\n"
MM_UM_UP = PlainForm(x_unit="mm", z_unit="um", z_positive="up")
unhurried = settings(deadline=None, database=None, max_examples=60)  # the processor is shared
SAMPLES = [(5 * i, (i * 7) % 11) for i in range(21)]  # (mm, um), first height 0, last 8


def rows(samples: list[tuple[object, object]] = SAMPLES, delimiter: str = ",") -> str:
    return "".join(f"{x}{delimiter}{z}\n" for x, z in samples)


def csv_text(header: str = "", samples: list[tuple[object, object]] = SAMPLES) -> str:
    return f"{UNITS}{header}x,z\n{rows(samples)}"


def refused(text: str | bytes, form: PlainForm | None = None) -> str:
    with pytest.raises(ProfileError) as caught:
        parse_profile(text, "km12.csv", form)
    message = str(caught.value)
    assert message.startswith("km12.csv: ")
    assert "\n" not in message
    assert caught.value.remedy
    return message


def sample(index: int, x: object, z: object) -> list[tuple[object, object]]:
    changed: list[tuple[object, object]] = list(SAMPLES)
    changed[index] = (x, z)
    return changed


# --- what is read ---------------------------------------------------------------------------------------------------


def test_csv_form_gives_metres_centred_and_detrended() -> None:
    profile = parse_profile(csv_text("# weld_id: KM12-L-004\n"), "km12.csv")
    assert profile.weld_id == "KM12-L-004"
    assert profile.x_m == [round(-0.05 + 0.005 * i, 6) for i in range(21)]
    # The line from 0 to 8 um over 20 intervals is taken off: 7 - 0.4 at the second sample.
    assert profile.z_m[1] == pytest.approx(6.6e-6, abs=1e-15)
    assert profile.z_m[0] == profile.z_m[-1] == 0.0
    encode(profile)  # keeps the contract


def test_design_document_example_is_read() -> None:
    text = "# weld_id: KM12-L-004\n# x_unit: mm\n# z_unit: um\n# z_positive: up\nx,z\n0,0.0\n5,1.2\n"
    text += "".join(f"{x},0.0\n" for x in range(10, 105, 5))
    profile = parse_profile(text, "km12.csv")
    assert profile.z_m[1] == 1.2e-6


def test_optional_header_lines_reach_the_profile() -> None:
    header = (
        "# weld_id: W: 7\n# rail: left\n# instrument: straightedge 1 m\n# chainage_m: 12345.5\n"
        "# line_speed_kmh: 120\n# weld_position_m: 0.3\n# measured on a wet day, at 12:30\n# operator: B.\n"
    )
    profile = parse_profile(csv_text(header), "km12.csv")
    assert (profile.weld_id, profile.rail, profile.instrument) == ("W: 7", "left", "straightedge 1 m")
    assert (profile.chainage_m, profile.line_speed_kmh, profile.weld_position_m) == (12345.5, 120.0, 0.3)


def test_absent_or_empty_options_stay_absent() -> None:
    profile = parse_profile(csv_text("# rail:\n"), "folder/km12.csv")
    assert profile.weld_id == "km12"
    assert all(
        value is msgspec.UNSET
        for value in (profile.rail, profile.instrument, profile.chainage_m, profile.line_speed_kmh)
    )


def test_file_gives_its_name_and_the_hash_of_its_bytes(tmp_path: Path) -> None:
    raw = b"\xef\xbb\xbf" + csv_text().replace("\n", "\r\n").encode() + b"\r\n\r\n"
    path = tmp_path / "km12.csv"
    path.write_bytes(raw)
    profile = read_profile(path)
    assert (profile.weld_id, profile.source) == ("km12", "km12.csv")
    assert profile.source_sha256 == hashlib.sha256(raw).hexdigest()
    assert profile.profile_sha256 == parse_profile(csv_text(), "km12.csv").profile_sha256


def test_detrend_none_keeps_offset_and_slope() -> None:
    profile = parse_profile(csv_text("# detrend: none\n"), "km12.csv")
    assert profile.z_m == [z / 1e6 for _, z in SAMPLES]


def test_conditioning_says_what_was_done() -> None:
    offset = [(x, z + 3) for x, z in SAMPLES]
    profile = parse_profile(csv_text("# centre: 40\n", offset).replace("up", "down"), "km12.csv")
    told = " | ".join(profile.conditioning)
    for expected in ("from mm", "from um", "positive up", "x = 0.04 m, as stated", "-3 um at the start", "-0.08 mm/m"):
        assert expected in told


@pytest.mark.parametrize("name", ["x,z", "X, Z", "", "# no column names\n"])
def test_column_names_are_optional(name: str) -> None:
    text = UNITS + (name + "\n" if name else "") + rows()
    assert parse_profile(text, "a").profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


@pytest.mark.parametrize("delimiter", [",", ", ", ";", "\t", " ", "    "])
def test_delimiters_give_the_same_profile(delimiter: str) -> None:
    samples = [(f"{x}.0", f"{z}.5") for x, z in SAMPLES]
    expected = parse_profile(csv_text("", samples), "a").profile_sha256
    assert parse_profile(UNITS + rows(samples, delimiter), "a").profile_sha256 == expected


@pytest.mark.parametrize("delimiter", [";", "; ", "\t", " "])
@pytest.mark.parametrize("names", [True, False])
def test_decimal_commas_are_read_where_they_cannot_be_delimiters(delimiter: str, names: bool) -> None:
    points = [(f"{x}.0", f"{z}.25") for x, z in SAMPLES]
    commas = [(x.replace(".", ","), z.replace(".", ",")) for x, z in points]
    text = UNITS + (f"x{delimiter}z\n" if names else "") + rows(commas, delimiter)
    assert parse_profile(text, "a").profile_sha256 == parse_profile(csv_text("", points), "a").profile_sha256


@pytest.mark.parametrize("micro", ["µm", "μm"])
def test_micro_signs_mean_um(micro: str) -> None:
    assert parse_profile(csv_text().replace("um", micro), "a").z_m == parse_profile(csv_text(), "a").z_m


def test_plain_columns_are_read_as_stated() -> None:
    form = PlainForm(x_unit="mm", z_unit="um", z_positive="up", skip_rows=2, weld_id="W7", line_speed_kmh=80.0)
    profile = parse_profile("Instrument 3 export\nPosition Height\n" + rows(delimiter=" "), "a.txt", form)
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256
    assert (profile.weld_id, profile.line_speed_kmh) == ("W7", 80.0)
    assert "first 2 lines skipped" in profile.conditioning[0]


def test_one_column_is_laid_out_by_its_spacing() -> None:
    heights = "".join(f"{z}\n" for _, z in SAMPLES)
    form = PlainForm(x_unit="mm", z_unit="um", z_positive="up", spacing=5.0)
    assert parse_profile(heights, "a", form).profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_what_a_file_states_itself_goes_before_the_form() -> None:
    form = PlainForm(x_unit="m", z_unit="m", z_positive="down", spacing=0.005, skip_rows=9, weld_id="other")
    form = replace(form, line_speed_kmh=80.0)
    profile = parse_profile(csv_text("# weld_id: own\n"), "a", form)
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256
    assert (profile.weld_id, profile.line_speed_kmh) == ("own", 80.0)


# --- what is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["x_unit", "z_unit", "z_positive"])
def test_missing_statement_is_named(key: str) -> None:
    text = "\n".join(line for line in csv_text().split("\n") if key not in line)
    message = refused(text)
    assert f"{key} not stated" in message
    assert f"'# {key}: " in message
    assert "plain text" in message


def test_plain_file_without_form_is_told_all_that_is_missing() -> None:
    assert "x_unit, z_unit, z_positive not stated" in refused(rows())


@pytest.mark.parametrize("bad", ["nan", "NaN", "inf", "-Infinity"])
@pytest.mark.parametrize("column", ["x", "z"])
def test_not_finite_is_refused_with_its_line(bad: str, column: str) -> None:
    samples = sample(6, bad, 1) if column == "x" else sample(6, 30, bad)
    message = refused(csv_text("", samples))
    assert f"line 11: {column} is {bad}, not a finite number" in message


@pytest.mark.parametrize("bad", ["", "abc", "1_000", "0x10", "1e", "--1", "1.2.3", "\u0661", "1e9999"])
def test_not_a_number_is_refused_with_its_line(bad: str) -> None:
    message = refused(csv_text("", sample(6, 30, bad)))
    assert "line 11: z" in message
    assert "not a number" in message


def test_text_lines_in_a_plain_file_need_skip_rows() -> None:
    message = refused("Position Height\n" + rows(delimiter=" "), MM_UM_UP)
    assert "line 1: x 'Position' is not a number" in message
    assert "skip_rows" in message


def test_fewer_than_20_samples_are_refused() -> None:
    assert "19 samples, 20 are needed; measure" in refused(csv_text("", SAMPLES[:19]))
    assert len(parse_profile(csv_text("", SAMPLES[:20]), "a").x_m) == 20


@pytest.mark.parametrize("x", [25, 24.9, -1])
def test_x_that_does_not_increase_is_refused_with_both_lines(x: float) -> None:
    message = refused(csv_text("", sample(6, x, 1)))
    assert "x does not increase from line 10 to 11" in message
    assert "running direction" in message


def test_reversed_samples_are_refused() -> None:
    assert "x does not increase from line 5 to 6" in refused(csv_text("", SAMPLES[::-1]))


def test_spacing_over_10_mm_is_refused_with_its_line() -> None:
    wide = [(x if i <= 6 else x + 5.1, z) for i, (x, z) in enumerate(SAMPLES)]
    message = refused(csv_text("", wide))
    assert "spacing 10.1 mm after line 11" in message
    assert "x_unit (stated: mm)" in message
    parse_profile(csv_text("", [(x if i <= 6 else x + 5, z) for i, (x, z) in enumerate(SAMPLES)]), "a")


def test_amplitude_over_10_mm_hints_at_the_unit() -> None:
    message = refused(csv_text("", sample(6, 30, 11)).replace("um", "mm"))
    assert "amplitude" in message
    assert "check z_unit (stated: mm)" in message


def test_tilt_of_the_instrument_does_not_count_as_amplitude() -> None:
    tilted = [(x, z + 200 * x) for x, z in SAMPLES]  # 20 mm over the record
    profile = parse_profile(csv_text("", tilted), "a")
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256
    assert "amplitude" in refused(csv_text("# detrend: none\n", tilted))


def test_length_over_5_m_is_refused() -> None:
    message = refused(csv_text("", [(10 * i, 0) for i in range(502)]))
    assert "length 5.010 m" in message
    assert "x_unit" in message
    parse_profile(csv_text("", [(10 * i, 0) for i in range(501)]), "a")


@pytest.mark.parametrize("text", ["", "\n \n", "\ufeff"])
def test_empty_file_is_refused(text: str) -> None:
    assert "empty; give a file" in refused(text)


def test_header_without_samples_is_refused() -> None:
    assert "no samples" in refused(UNITS + "x,z\n")


@pytest.mark.parametrize("raw", [b"\x89PNG\r\n\x1a\n", b"x,z\n0,\x000", "x;z".encode("utf-16"), b"\xb5m", b"0,1\x1b"])
def test_binary_or_other_encodings_are_refused(raw: bytes) -> None:
    assert "UTF-8" in refused(raw)


def test_oversized_input_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "big.csv"
    path.write_bytes(b"0" * (4 * 2**20 + 1))
    with pytest.raises(ProfileError, match=r"big\.csv: larger than 4 MB; give one weld"):
        read_profile(path)


def test_too_many_samples_are_refused() -> None:
    assert "50001 samples, at most 50000" in refused(csv_text("", [(f"{i}e-2", 0) for i in range(50_001)]))


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("30", "1 column instead of 2"),
        ("30,1,2", "3 columns instead of 2"),
        ("30,5,1,2", "semicolons between the columns"),
        ("30;1", "1 column instead of 2"),
    ],
)
def test_wrong_column_count_is_refused_with_its_line(row: str, says: str) -> None:
    message = refused(csv_text().replace("30,9\n", f"{row}\n"))
    assert "line 11: " in message
    assert says in message


def test_swapped_columns_are_refused() -> None:
    assert "give the columns in the order x,z" in refused(csv_text().replace("x,z", "z,x"))


def test_mixed_decimal_marks_are_refused() -> None:
    samples: list[tuple[object, object]] = [(f"{x},0", z) for x, z in SAMPLES[:-1]]
    message = refused(UNITS + rows([*samples, ("100,0", "8.5")], ";"))
    assert "line 24: decimal points and decimal commas in one file; use one decimal mark" in message


def test_blank_line_within_samples_is_refused() -> None:
    assert "line 11: blank line" in refused(csv_text().replace("30,9\n", "\n30,9\n"))


@pytest.mark.parametrize(("key", "meant"), [("z-unit", "z_unit"), ("center", "centre"), ("Chainage_m", "chainage_m")])
def test_misspelt_key_is_refused_with_the_right_one(key: str, meant: str) -> None:
    message = refused(csv_text(f"# {key}: 1\n"))
    assert f"line 4: unknown key '{key}'; write {meant}" in message


def test_key_stated_twice_is_refused() -> None:
    assert "line 4: x_unit is stated twice" in refused(csv_text("# x_unit: m\n"))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [("x_unit: mm", "x_unit: inch", 1), ("z_unit: um", "z_unit: nm", 2), ("z_positive: up", "z_positive: left", 3)],
)
def test_unknown_unit_or_sign_is_refused_with_the_choices(old: str, new: str, line: int) -> None:
    message = refused(csv_text().replace(old, new))
    assert f"line {line}: {new.split(':')[0]} " in message
    assert "state one of" in message


@pytest.mark.parametrize(
    "header",
    [
        *("# detrend: spline", "# centre: 101", "# centre: left", "# chainage_m: 1,5", "# line_speed_kmh: nan"),
        *("# line_speed_kmh: 0", "# line_speed_kmh: 2000", "# weld_position_m: -0.1", "# rail: " + "x" * 201),
    ],
)
def test_unusable_option_is_refused_by_name(header: str) -> None:
    assert header[2:].partition(":")[0] in refused(csv_text(header + "\n"))


@pytest.mark.parametrize("spacing", [0.0, -5.0, math.nan, math.inf])
def test_impossible_spacing_is_refused(spacing: float) -> None:
    form = PlainForm(x_unit="mm", z_unit="um", z_positive="up", spacing=spacing)
    assert "spacing" in refused("1\n" * 30, form)


def test_one_column_without_spacing_asks_for_it() -> None:
    assert "state the spacing" in refused("1.0\n" * 30, MM_UM_UP)


def test_decimal_commas_in_one_column_are_not_guessed() -> None:
    form = PlainForm(x_unit="mm", z_unit="um", z_positive="up", spacing=5.0)
    assert "decimal points" in refused("0,5\n" * 30, form)


def test_number_beyond_any_chainage_is_refused() -> None:
    assert "line 5: x is " in refused(csv_text("", sample(0, "-1e300", 0)))


@pytest.mark.parametrize("name", ["missing.csv", "."])
def test_unreadable_path_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="give the path of a readable profile file"):
        read_profile(tmp_path / name)


@unhurried
@given(
    data=st.one_of(st.binary(max_size=300), st.text(max_size=300), st.text("0123456789.,;-+e \t\nx#z:", max_size=300))
)
def test_anything_else_is_a_profile_or_a_profile_error(data: bytes | str) -> None:
    with suppress(ProfileError):
        encode(parse_profile(data, "fuzz", MM_UM_UP))


# --- what leaves a profile the same ---------------------------------------------------------------------------------

heights_um = st.lists(st.integers(-4_000_000, 4_000_000).map(lambda n: Decimal(n) / 1000), min_size=20, max_size=60)
steps_mm = st.integers(1, 10_000).map(lambda n: Decimal(n) / 1000)
geometries = st.tuples(st.integers(-2_000, 2_000), steps_mm, heights_um).map(
    lambda drawn: [(drawn[0] + i * drawn[1], z) for i, z in enumerate(drawn[2])]
)
POWER = {"m": 0, "cm": 2, "mm": 3, "um": 6}


def in_units(samples: list[tuple[Decimal, Decimal]], x_unit: str, z_unit: str, number: Callable[..., str]) -> str:
    shifted = [(number(x, POWER[x_unit] - 3), number(z, POWER[z_unit] - 6)) for x, z in samples]
    return f"# x_unit: {x_unit}\n# z_unit: {z_unit}\n# z_positive: up\n# detrend: none\n{rows(list(shifted))}"


def exact(value: Decimal, power: int) -> str:
    return f"{Decimal(value).scaleb(power):f}"


def noisy(value: Decimal, power: int) -> str:
    return repr(float(value) * 10.0**power)  # as a program prints it that multiplies floats


@unhurried
@given(geometries, st.sampled_from(sorted(POWER)), st.sampled_from(sorted(POWER)))
def test_units_do_not_change_the_hash(samples: list[tuple[Decimal, Decimal]], x_unit: str, z_unit: str) -> None:
    expected = parse_profile(in_units(samples, "m", "m", exact), "a").profile_sha256
    assert parse_profile(in_units(samples, x_unit, z_unit, exact), "a").profile_sha256 == expected
    assert parse_profile(in_units(samples, x_unit, z_unit, noisy), "a").profile_sha256 == expected


@unhurried
@given(geometries)
def test_z_positive_down_is_the_negative(samples: list[tuple[Decimal, Decimal]]) -> None:
    up = parse_profile(in_units(samples, "mm", "um", exact), "a")
    down = parse_profile(in_units(samples, "mm", "um", exact).replace("up", "down"), "a")
    assert down.x_m == up.x_m
    assert down.z_m == [-z + 0.0 for z in up.z_m]


@pytest.mark.parametrize("zero", ["-0", "-0.0000001", "0e5"])
def test_a_zero_has_no_sign(zero: str) -> None:
    a, b = (parse_profile(csv_text("# detrend: none\n", sample(6, 30, z)), "a") for z in (zero, "0"))
    assert a.profile_sha256 == b.profile_sha256


@unhurried
@given(geometries, st.integers(-3_000, 3_000))
def test_where_x_begins_does_not_matter(samples: list[tuple[Decimal, Decimal]], shift_mm: int) -> None:
    moved = [(x + shift_mm, z) for x, z in samples]
    a, b = (parse_profile(in_units(s, "mm", "um", exact), "a") for s in (samples, moved))
    assert a.profile_sha256 == b.profile_sha256
    assert a.x_m[0] == pytest.approx(-a.x_m[-1], abs=2e-12)


@unhurried
@given(geometries, st.integers(0, 19))
def test_stated_centre_is_where_x_is_zero(samples: list[tuple[Decimal, Decimal]], index: int) -> None:
    text = f"# centre: {samples[index][0]}\n" + in_units(samples, "mm", "um", exact)
    assert parse_profile(text, "a").x_m[index] == 0.0


@unhurried
@given(geometries, st.integers(-900, 900), st.integers(-50, 50))
def test_offset_and_slope_are_removed(samples: list[tuple[Decimal, Decimal]], offset: int, slope: int) -> None:
    flatter = [(x, z / 2) for x, z in samples]  # the line between the ends can double the amplitude
    tilted = [(x, z + offset + slope * x) for x, z in flatter]
    expected, found = (
        parse_profile(in_units(s, "mm", "um", exact).replace("none", "line"), "a") for s in (flatter, tilted)
    )
    assert found.profile_sha256 == expected.profile_sha256
    assert expected.z_m[0] == expected.z_m[-1] == 0.0


@st.composite
def profiles(draw: st.DrawFn) -> WeldProfile:
    steps = draw(st.lists(st.floats(1e-6, 9.9e-3), min_size=19, max_size=60))
    x_m = [float(x) for x in np.concatenate([[0.0], np.cumsum(steps)]) - sum(steps) / 2]
    z_m = draw(st.lists(st.floats(-5e-3, 5e-3), min_size=len(x_m), max_size=len(x_m)))
    text = st.text(min_size=1, max_size=30)
    number = st.floats(0.0, 900.0, exclude_min=True)
    return WeldProfile(
        weld_id=draw(text),
        source="topic",
        x_m=x_m,
        z_m=z_m,
        profile_sha256=profile_sha256(x_m, z_m),
        rail=draw(st.one_of(st.just(msgspec.UNSET), text)),
        chainage_m=draw(st.one_of(st.just(msgspec.UNSET), number)),
        line_speed_kmh=draw(st.one_of(st.just(msgspec.UNSET), number)),
        conditioning=draw(st.lists(text, max_size=3)),
    )


@settings(unhurried, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(profile=profiles())
def test_any_profile_survives_writing_and_reading(profile: WeldProfile, tmp_path: Path) -> None:
    path = tmp_path / "w.csv"
    write_profile(profile, path)
    back = read_profile(path)
    assert back.profile_sha256 == profile.profile_sha256
    assert (back.x_m, back.z_m) == (profile.x_m, profile.z_m)
    if profile.weld_id.isprintable() and profile.weld_id == profile.weld_id.strip():
        assert back.weld_id == profile.weld_id
    assert (back.chainage_m, back.line_speed_kmh) == (profile.chainage_m, profile.line_speed_kmh)


def test_written_file_is_plain_csv_in_mm_and_um(tmp_path: Path) -> None:
    path = tmp_path / "w.csv"
    write_profile(parse_profile(csv_text("# weld_id: W7\n# rail: left\n# detrend: none\n"), "a"), path)
    content = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    table = list(csv.DictReader(content))
    assert [float(row["x"]) for row in table] == [x - 50 for x, _ in SAMPLES]
    assert [float(row["z"]) for row in table] == [z for _, z in SAMPLES]
    assert (read_profile(path).weld_id, read_profile(path).rail) == ("W7", "left")


def test_profile_with_a_foreign_hash_is_not_written(tmp_path: Path) -> None:
    profile = msgspec.structs.replace(parse_profile(csv_text(), "a"), profile_sha256="0" * 64)
    with pytest.raises(ProfileError, match="profile_sha256"):
        write_profile(profile, tmp_path / "w.csv")
    assert not (tmp_path / "w.csv").exists()


# --- shipped profiles -----------------------------------------------------------------------------------------------


def table_of(name: str) -> tuple[np.ndarray, np.ndarray]:
    """A shipped file's columns in m, by NumPy's reader."""
    x_mm, z_um = np.loadtxt(shipped()[name], delimiter=",", comments=["#", "x"], unpack=True)
    return x_mm * 1e-3, z_um * 1e-6


def test_every_formula_is_shipped_and_nothing_else() -> None:
    assert set(shipped()) == set(REFERENCE_SHAPES)


@pytest.mark.parametrize("name", sorted(REFERENCE_SHAPES))
def test_shipped_file_equals_its_formula(name: str) -> None:
    x_m, z_m = table_of(name)
    rounding_m = 0.5e-9 if name.startswith("weld-") else 0.5e-12
    np.testing.assert_allclose(z_m, REFERENCE_SHAPES[name](x_m), rtol=0, atol=1.01 * rounding_m)


@pytest.mark.parametrize("name", sorted(REFERENCE_SHAPES))
def test_shipped_file_is_read_under_its_own_name(name: str) -> None:
    profile = read_profile(find(name))
    x_m, z_m = table_of(name)
    assert profile.weld_id == name
    np.testing.assert_allclose(profile.x_m, x_m - (x_m[0] + x_m[-1]) / 2, atol=1e-12)
    np.testing.assert_allclose(profile.z_m, z_m, atol=1e-12)


@pytest.mark.parametrize("name", sorted(REFERENCE_SHAPES))
def test_shipped_profile_joins_the_rail_smoothly(name: str) -> None:
    x_m, z_m = table_of(name)
    assert z_m[0] == z_m[-1] == 0.0
    slope = np.diff(z_m) / np.diff(x_m)
    assert max(abs(slope[0]), abs(slope[-1])) < 1e-4
    assert np.abs(np.diff(slope)).max() < 0.10 * np.ptp(slope)  # a corner would turn by a large share at once
    assert np.diff(x_m).max() <= 0.005 + 1e-12


def largest_jump_of_contact(heights_m: np.ndarray, x_m: np.ndarray) -> float:
    """Return the largest jump of the contact point while the wheel's centre advances by one step; a bridge is one."""
    s = x_m[None, :] - x_m[:, None]
    gap = heights_m[None, :] - (WHEEL_RADIUS_M - np.sqrt(np.maximum(WHEEL_RADIUS_M**2 - s**2, 0.0)))
    return float(np.diff(x_m[gap.argmax(axis=1)]).max())


@pytest.mark.parametrize("name", sorted(REFERENCE_SHAPES))
def test_wheel_touches_every_shipped_shape_in_one_point(name: str) -> None:
    x_m, _ = table_of(name)
    fine = np.linspace(x_m[0], x_m[-1], 1601)
    z_m = REFERENCE_SHAPES[name](fine)
    share_of_wheel_curvature = np.gradient(np.gradient(z_m, fine), fine).max() * WHEEL_RADIUS_M
    assert share_of_wheel_curvature < (0.85 if name.startswith("wheel") else 0.25)
    # Where the profile's curvature is c, the contact advances by 1 / (1 - c R) per unit of the wheel's way.
    step = fine[1] - fine[0]
    assert largest_jump_of_contact(z_m, fine) < step / (1 - share_of_wheel_curvature) + 1.5 * step


def test_a_dip_sharper_than_the_wheel_would_be_found_out() -> None:
    x_m = np.linspace(-0.06, 0.06, 1601)
    assert largest_jump_of_contact(cosine_dip(x_m, 0.048, 0.5e-3), x_m) > 0.005


def test_wheel_flat_has_the_paper_depth_and_length() -> None:
    x_m, z_m = table_of("wheel-flat-0.9mm")
    assert z_m.min() == pytest.approx(-0.9e-3, abs=1e-12)
    assert np.ptp(x_m[z_m < 0]) == pytest.approx(0.1, abs=1.1e-3)
    assert "relative dip" in shipped()["wheel-flat-0.9mm"].read_text()


def test_cosine_dip_has_hand_worked_values() -> None:
    x_m = np.array([-0.03, -0.024, -0.012, 0.0, 0.008, 0.024, 0.03])
    # -d/2 (1 + cos 60 deg) = -3/4 d at a sixth of the length
    np.testing.assert_allclose(cosine_dip(x_m, 0.048, 40e-6) * 1e6, [0, 0, -20, -40, -30, 0, 0], atol=1e-9)
    _, dip = table_of("cosine-dip-48mm")
    _, rise = table_of("cosine-rise-48mm")
    np.testing.assert_array_equal(rise, -dip)
    assert (dip[:10] == 0).all()
    assert (dip[-10:] == 0).all()


def test_ramp_has_hand_worked_values() -> None:
    np.testing.assert_allclose(ramp(np.array([0.0, 1.0, 1.5, 2.0, 3.0]), 1.0, 2.0, 4.0), [0, 0, 2, 4, 4], atol=1e-12)


def test_weld_1_is_a_central_dip_with_the_wavelengths_of_the_paper() -> None:
    x_m, z_m = table_of("weld-1-dip")
    assert x_m[z_m.argmin()] == pytest.approx(0.5)
    assert -z_m.min() > 2 * z_m.max()
    cycles_per_m = np.linspace(0.5, 9.0, 3401)
    spectrum = np.abs(np.exp(-2j * np.pi * np.outer(cycles_per_m, x_m)) @ z_m)
    peak = (spectrum[1:-1] > spectrum[:-2]) & (spectrum[1:-1] > spectrum[2:]) & (spectrum[1:-1] > spectrum.max() / 2)
    np.testing.assert_allclose(1 / cycles_per_m[1:-1][peak], [0.55, 0.25, 0.165], rtol=0.08)


def extrema(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions and heights of the turning points of a shipped weld, in m and um."""
    x_m, z_m = table_of(name)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(z_m))[np.diff(z_m) != 0]) != 0) + 1
    kept = np.flatnonzero(np.diff(z_m) != 0)[turns]
    return x_m[kept], z_m[kept] * 1e6


def test_weld_2_rises_between_two_dips_the_first_larger() -> None:
    x_m, z_um = extrema("weld-2-rise-between-shrinkages")
    assert list(np.sign(z_um)) == [-1, 1, -1]
    assert x_m[0] == pytest.approx(0.47, abs=0.01)
    assert z_um[0] < z_um[2]
    assert z_um[1] == pytest.approx(-z_um[0], rel=0.2)


def test_weld_3_is_a_long_dip_between_two_protrusions() -> None:
    x_m, z_um = extrema("weld-3-long-ground-dip")
    assert list(np.sign(z_um)) == [1, -1, 1]
    assert -z_um[1] > 1.5 * z_um.max()
    _, heights = table_of("weld-3-long-ground-dip")
    assert (heights < 0).mean() > 0.4
    assert x_m[1] == pytest.approx(0.5, abs=0.02)


def test_weld_4_begins_with_the_steepest_ramp_of_all() -> None:
    steepest = {
        name: (np.diff(z) / np.diff(x)).max()
        for name in REFERENCE_SHAPES
        if name[:4] == "weld"
        for x, z in [table_of(name)]
    }
    assert max(steepest, key=lambda name: steepest[name]) == "weld-4-steep-ramp"
    x_m, z_m = table_of("weld-4-steep-ramp")
    assert x_m[np.diff(z_m).argmax()] < 0.25
    assert z_m.min() >= 0.0


def test_weld_5_is_a_protrusion_with_small_central_dips() -> None:
    x_m, z_um = extrema("weld-5-ramp-protrusion")
    _, z_m = table_of("weld-5-ramp-protrusion")
    dips = [z for x, z in zip(x_m, z_um, strict=True) if 0.35 < x < 0.65 and z < 0.9 * z_um.max()]
    assert len(dips) >= 2
    assert min(dips) > 0.5 * z_um.max()
    assert z_m.min() >= 0.0
    assert np.ptp(z_m) < 0.5 * np.ptp(table_of("weld-4-steep-ramp")[1])


def test_name_or_path_is_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(csv_text())
    assert find(path) == path
    assert find(str(path)) == path
    assert find("weld-1-dip") == shipped()["weld-1-dip"]


@pytest.mark.parametrize("name", ["weld-9", "folder/weld.csv", "n" * 5000, "\0"])
def test_unknown_name_lists_the_shipped_ones(name: str) -> None:
    with pytest.raises(ProfileError, match=r"no such file or bundled profile; .*weld-1-dip.*wheel-flat-0\.9mm"):
        find(name)
