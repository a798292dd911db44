"""Measurement files: what is read, what is refused and with which words, and what leaves a profile the same."""

import csv
import hashlib
import math
from collections.abc import Callable
from contextlib import suppress
from decimal import Decimal
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import parse_profile, read_profile, write_profile
from weld_force_ros.messages import WeldProfile, encode, profile_sha256

UNITS = "# x_unit: mm\n# z_unit: um\n# z_positive: up\n# noise: none\n"  # short shapes, taken as they are
MM_UM_UP = InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up", noise="none")
unhurried = settings(deadline=None, database=None, max_examples=30)  # the processor is shared
SAMPLES = [(5 * i, (i * 7) % 11) for i in range(21)]  # (mm, um), first height 0, last 8


def rows(samples: list[tuple[object, object]] = SAMPLES, delimiter: str = ",") -> str:
    return "".join(f"{x}{delimiter}{z}\n" for x, z in samples)


def csv_text(header: str = "", samples: list[tuple[object, object]] = SAMPLES) -> str:
    return f"{UNITS}{header}x,z\n{rows(samples)}"


def refused(text: str | bytes, form: InstrumentFormat | None = None) -> str:
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


@pytest.mark.parametrize("header", ["# running: against\n", "# direction: Against\n", "# Fahrtrichtung: against\n"])
def test_the_direction_of_trains_is_read_where_it_is_stated(header: str, tmp_path: Path) -> None:
    profile = parse_profile(csv_text(header), "km12.csv")
    assert profile.running == "against"
    write_profile(profile, tmp_path / "again.csv")
    assert read_profile(tmp_path / "again.csv").running == "against"
    assert parse_profile(csv_text(), "km12.csv").running is msgspec.UNSET
    assert parse_profile(csv_text(), "km12.csv", replace(MM_UM_UP, running="both")).running == "both"
    assert parse_profile(csv_text(header), "km12.csv", replace(MM_UM_UP, running="both")).running == "against"
    # A format whose x falls in the running direction says it, too: its x is turned.
    assert parse_profile(csv_text(), "km12.csv", replace(MM_UM_UP, x_direction="against")).running == "with"


@pytest.mark.parametrize("key", ["running", "direction"])
def test_an_unknown_direction_of_trains_is_refused_in_one_line(key: str) -> None:
    assert refused(csv_text(f"# {key}: uphill\n")) == (
        "km12.csv: line 5: running 'uphill' is unknown; state one of with, against, both"
    )


def test_csv_form_gives_metres_centred_and_detrended() -> None:
    profile = parse_profile(csv_text("# weld_id: KM12-L-004\n"), "km12.csv")
    assert profile.weld_id == "KM12-L-004"
    assert profile.x_m == [round(-0.05 + 0.005 * i, 6) for i in range(21)]
    # The line from 0 to 8 um over 20 intervals is taken off: 7 - 0.4 at the second sample.
    assert profile.z_m[1] == pytest.approx(6.6e-6, abs=1e-15)
    assert profile.z_m[0] == profile.z_m[-1] == 0.0
    encode(profile)  # keeps the contract


def test_design_document_example_is_read() -> None:
    text = "# weld_id: KM12-L-004\n# x_unit: mm\n# z_unit: um\n# z_positive: up\nx,z\n"
    text += "".join(f"{x},{-200 * np.sin(np.pi * x / 1000) ** 4:.1f}\n" for x in range(0, 1005, 5))
    profile = parse_profile(text, "km12.csv")
    assert profile.weld_id == "KM12-L-004"
    assert min(profile.z_m) == pytest.approx(-200e-6, abs=0.2e-6)
    assert (len(profile.measured_x_m), profile.measured_z_m[100]) == (201, pytest.approx(-200e-6, abs=1e-8))


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
    form = replace(MM_UM_UP, skip_rows=2, weld_id="W7", line_speed_kmh=80.0)
    profile = parse_profile("Instrument 3 export\nPosition Height\n" + rows(delimiter=" "), "a.txt", form)
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256
    assert (profile.weld_id, profile.line_speed_kmh) == ("W7", 80.0)
    assert "first 2 lines skipped" in profile.conditioning[0]


def test_one_column_is_laid_out_by_its_spacing() -> None:
    heights = "".join(f"{z}\n" for _, z in SAMPLES)
    form = replace(MM_UM_UP, spacing=5.0)
    assert parse_profile(heights, "a", form).profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_what_a_file_states_itself_goes_before_the_form() -> None:
    form = InstrumentFormat(x_unit="m", z_unit="m", z_positive="down", spacing=0.005, skip_rows=9, weld_id="other")
    form = replace(form, line_speed_kmh=80.0)
    profile = parse_profile(csv_text("# weld_id: own\n"), "a", form)
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256
    assert (profile.weld_id, profile.line_speed_kmh) == ("own", 80.0)


# --- what is mended, and said ---------------------------------------------------------------------------------------


def mended(text: str | bytes, note: str, form: InstrumentFormat | None = None) -> WeldProfile:
    profile = parse_profile(text, "km12.csv", form)
    assert note in " | ".join(profile.conditioning)
    encode(profile)
    return profile


@pytest.mark.parametrize("mark", ["nan", "NaN", "inf", "-", "---", "", "n/a", "Bad", "#N/A"])
def test_missing_height_is_put_by_a_cubic(mark: str) -> None:
    smooth = [(x, 0.01 * (x - 50) ** 2) for x, _ in SAMPLES]
    smooth[6] = (30, mark)
    profile = mended(csv_text("# detrend: none\n", smooth), "1 missing height put by a cubic, longest gap 10 mm")
    assert profile.z_m[6] == pytest.approx(4e-6, abs=1e-12)
    assert len(profile.x_m) == len(SAMPLES)


def test_row_without_its_height_is_a_missing_one() -> None:
    mended(csv_text().replace("30,9\n", "30\n"), "1 missing height put by a cubic")


def test_missing_heights_at_an_end_shorten_the_record() -> None:
    profile = mended(csv_text("", [("-5", "NaN"), *SAMPLES]), "1 sample without a height at the ends left out")
    assert profile.x_m == parse_profile(csv_text(), "a").x_m


def test_gap_of_30_mm_is_bridged_and_a_longer_one_refused() -> None:
    def without(first: int, last: int) -> list[tuple[object, object]]:
        return [(5 * i, (i * 7) % 11) for i in range(31) if not first <= 5 * i <= last]

    mended(csv_text("", without(35, 55)), "put by a cubic, longest gap 30 mm")
    message = refused(csv_text("", without(35, 60)))
    assert "spacing 35 mm from line 12 to 13, at most 30 mm" in message
    assert "check x_unit" in message


def test_spacing_of_20_mm_is_filled_and_a_wider_one_refused() -> None:
    wide = [(x * 4, z) for x, z in SAMPLES]
    profile = mended(csv_text("", wide), "samples 20 mm apart: heights put between them by a cubic")
    assert np.diff(profile.x_m).max() <= 0.010 + 1e-12
    assert "spacing 25 mm" in refused(csv_text("", [(x * 5, z) for x, z in SAMPLES]))


def test_repeated_position_is_left_out() -> None:
    rows_twice = [*SAMPLES[:7], SAMPLES[6], *SAMPLES[7:]]
    profile = mended(csv_text("", rows_twice), "1 repeated position left out, first at line 13")
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_step_back_of_at_most_2_mm_is_put_in_order() -> None:
    slipped = [(24 if i == 6 else x, z) for i, (x, z) in enumerate(SAMPLES)]
    mended(csv_text("", slipped), "1 step back of at most 2 mm put in order, first at line 12")


def test_record_against_the_running_direction_is_turned_round() -> None:
    profile = mended(csv_text("", SAMPLES[::-1]), "x descends: turned round")
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_columns_are_found_by_their_names() -> None:
    swapped = [(z, x) for x, z in SAMPLES]
    text = csv_text("", swapped).replace("x,z", "z,x")
    assert parse_profile(text, "a").profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_column_beside_them_is_left_out_by_name() -> None:
    text = UNITS + "x,z,side\n" + "".join(f"{x},{z},7\n" for x, z in SAMPLES)
    profile = mended(text, "columns not used: side")
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_blank_lines_and_footer_are_no_samples() -> None:
    text = csv_text().replace("30,9\n", "\n30,9\n") + "\nMax: 10\n"
    profile = mended(text, "1 line after the samples left out")
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("inch", 0.0254), ("mil", 25.4e-6), ("nm", 1e-9), ("1/100 mm", 1e-5), ("MM", 1e-3)],
)
def test_units_of_the_trade_are_read(unit: str, metres: float) -> None:
    text = csv_text("# detrend: none\n", [(x, z / 100) for x, z in SAMPLES]).replace("z_unit: um", f"z_unit: {unit}")
    assert parse_profile(text, "a").z_m[1] == pytest.approx(0.07 * metres, abs=1e-12)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8-sig", "cp1252"])
def test_encodings_are_read(encoding: str) -> None:
    text = csv_text("# operator: Müller\n")
    profile = parse_profile(text.encode(encoding), "a")
    assert profile.operator == "Müller"
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


@pytest.mark.parametrize("key", ["z-unit", "Z_Unit", "z unit"])
def test_keys_are_known_in_other_spellings(key: str) -> None:
    assert parse_profile(csv_text().replace("z_unit", key), "a").z_m == parse_profile(csv_text(), "a").z_m


def test_lines_of_text_above_a_plain_table_are_no_samples() -> None:
    text = "Straightedge 7\nPosition Height\n" + rows(delimiter=" ")
    assert parse_profile(text, "a", MM_UM_UP).profile_sha256 == parse_profile(csv_text(), "a").profile_sha256


def test_decimal_commas_in_one_column_are_read() -> None:
    form = InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up", spacing=5.0, noise="none", detrend="none")
    heights = "".join(f"{z},5\n" for _, z in SAMPLES)
    assert parse_profile(heights, "a", form).z_m == [round((z + 0.5) * 1e-6, 12) for _, z in SAMPLES]


# --- what is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["x_unit", "z_unit", "z_positive"])
def test_missing_statement_is_named(key: str) -> None:
    text = "\n".join(line for line in csv_text().split("\n") if key not in line)
    message = refused(text)
    assert f"{key} not stated" in message
    assert f"'# {key}: " in message
    assert f"--{key.replace('_', '-')}" in message


def test_plain_file_without_form_is_told_all_that_is_missing() -> None:
    assert "x_unit, z_unit, z_positive not stated" in refused(rows())


@pytest.mark.parametrize("bad", ["nan", "inf", "-Infinity", "abc"])
def test_position_that_is_no_number_is_refused_with_its_line(bad: str) -> None:
    assert "line 12: " in refused(csv_text("", sample(6, bad, 1)))


@pytest.mark.parametrize("bad", ["abc", "1_000", "0x10", "1e", "--1", "1.2.3", "\u0661", "1e9999"])
def test_height_that_is_no_number_is_refused_with_its_line(bad: str) -> None:
    message = refused(csv_text("", sample(6, 30, bad)))
    assert f"line 12: '30,{bad}' is not a row of numbers" in message
    assert "mark it with #" in message


def test_fewer_than_20_samples_are_refused() -> None:
    assert "19 samples, 20 are needed; measure" in refused(csv_text("", SAMPLES[:19]))
    assert len(parse_profile(csv_text("", SAMPLES[:20]), "a").x_m) == 20


@pytest.mark.parametrize("x", [22, -1])
def test_x_that_goes_back_far_is_refused_with_both_lines(x: float) -> None:
    message = refused(csv_text("", sample(6, x, 1)))
    assert "x does not increase from line 11 to 12" in message
    assert "running direction" in message


def test_two_heights_for_one_place_are_refused() -> None:
    message = refused(csv_text("", sample(6, 25, 1000)))
    assert "x does not increase from line 11 to 12; two heights are stated for one place" in message


def test_positions_all_repeated_are_refused() -> None:
    assert "positions are repeated, the first at line 7" in refused(csv_text("", [s for s in SAMPLES for _ in "ab"]))


def test_record_there_and_back_is_refused() -> None:
    assert "x does not increase" in refused(csv_text("", [*SAMPLES, *SAMPLES[::-1]]))


def test_amplitude_over_10_mm_hints_at_the_unit() -> None:
    message = refused(csv_text("", sample(6, 30, 11)).replace("um", "mm"))
    assert "amplitude" in message
    assert "check z_unit (stated: mm)" in message


def test_tilt_of_the_instrument_does_not_count_as_amplitude() -> None:
    tilted = [(x, z + 200 * x) for x, z in SAMPLES]  # 20 mm over the record
    profile = parse_profile(csv_text("", tilted), "a")
    assert profile.profile_sha256 == parse_profile(csv_text(), "a").profile_sha256
    assert "amplitude" in refused(csv_text("# detrend: none\n", tilted))


def test_length_over_5_m_without_a_weld_is_refused() -> None:
    message = refused(csv_text("", [(10 * i, 0) for i in range(502)]))
    assert "5.01 m of rail, of which 5 m can be read as one weld" in message
    parse_profile(csv_text("", [(10 * i, 0) for i in range(501)]), "a")


@pytest.mark.parametrize("text", ["", "\n \n", "\ufeff"])
def test_empty_file_is_refused(text: str) -> None:
    assert "empty; give a file" in refused(text)


def test_header_without_samples_is_refused() -> None:
    assert "no samples" in refused(UNITS + "x,z\n")


@pytest.mark.parametrize(
    ("raw", "what"),
    [
        (b"\x89PNG\r\n\x1a\n", "binary"),
        (b"x,z\n0,\x000", "binary"),
        (b"0,1\x1b", "binary"),
        (b"\x1f\x8b\x08", "gzip"),
        (b"%PDF-1.7", "PDF"),
        (b"\xd0\xcf\x11\xe0\xa1", "old Excel"),
        (b"<HTML><body>", "HTML"),
        (b"PK\x03\x04 no archive", "archive"),
        ("x;z".encode("utf-16"), "no samples"),
        (b"\xff\xfe0", "utf-16"),
    ],
)
def test_what_is_no_text_is_refused_by_what_it_is(raw: bytes, what: str) -> None:
    assert what in refused(raw)


def test_encoding_that_was_stated_wrongly_is_refused() -> None:
    for encoding in ("ascii", "no-such-encoding"):
        form = InstrumentFormat(encoding=encoding)
        assert f"not {encoding} text" in refused(csv_text("# operator: Müller\n"), form)


def test_oversized_input_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "big.csv"
    path.write_bytes(b"0" * (4 * 2**20 + 1))
    with pytest.raises(ProfileError, match=r"big\.csv: larger than 4 MB; give the rail about the welds"):
        read_profile(path)


@pytest.mark.untraced
def test_too_many_samples_are_refused() -> None:
    assert "50001 samples, at most 50000" in refused(csv_text("", [(f"{i}e-2", 0) for i in range(50_001)]))


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("30,1,2", "3 columns instead of 2"),
        ("30,5,1,2", "4 columns instead of 2"),
        ("30;1", "'30;1' is not a row of numbers"),
    ],
)
def test_wrong_column_count_is_refused_with_its_line(row: str, says: str) -> None:
    assert f"line 12: {says}" in refused(csv_text().replace("30,9\n", f"{row}\n"))


def test_commas_that_are_decimal_marks_and_separators_are_refused() -> None:
    message = refused("".join(f"{x},0,{z},0\n" for x, z in SAMPLES), MM_UM_UP)
    assert "semicolons between the columns" in message


def test_three_columns_without_names_ask_for_a_descriptor() -> None:
    message = refused("".join(f"{x};{z};0\n" for x, z in SAMPLES), MM_UM_UP)
    assert "3 columns without names" in message
    assert "columns: {x: 1, z: 2}" in message


def test_mixed_decimal_marks_are_refused() -> None:
    samples: list[tuple[object, object]] = [(f"{x},0", z) for x, z in SAMPLES[:-1]]
    message = refused(UNITS + rows([*samples, ("100.0", "8")], ";"))
    assert "line 25: decimal points and decimal commas in one column; use one decimal mark" in message


@pytest.mark.parametrize(("key", "meant"), [("center", "centre"), ("x_units", "x_unit"), ("chainag_m", "chainage_m")])
def test_misspelt_key_is_refused_with_the_right_one(key: str, meant: str) -> None:
    assert f"line 5: unknown key '{key}'; write {meant}" in refused(csv_text(f"# {key}: 1\n"))


def test_key_stated_twice_is_refused() -> None:
    assert "line 5: x_unit is stated twice" in refused(csv_text("# x_unit: m\n"))


def test_unit_in_the_heading_against_the_one_stated_is_refused() -> None:
    message = refused(csv_text().replace("x,z\n", "x [mm],z [mm]\n"))
    assert "line 2: z_unit um, but the heading of the column says mm" in message


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [("x_unit: mm", "x_unit: ell", 1), ("z_unit: um", "z_unit: bar", 2), ("z_positive: up", "z_positive: left", 3)],
)
def test_unknown_unit_or_sign_is_refused_with_the_choices(old: str, new: str, line: int) -> None:
    message = refused(csv_text().replace(old, new))
    assert f"line {line}: {new.split(':')[0]} " in message
    assert "state one of" in message


@pytest.mark.parametrize(
    "header",
    [
        *("# detrend: spline", "# centre: 401", "# centre: left", "# line_speed_kmh: nan", "# weld_position_m: here"),
        *("# line_speed_kmh: 0", "# line_speed_kmh: 2000", "# weld_position_m: -0.1", "# rail: " + "x" * 201),
        *("# kind: crossing", "# noise: much", "# noise: -1", "# noise: nan"),
    ],
)
def test_unusable_option_is_refused_by_name(header: str) -> None:
    units = UNITS.replace("# noise: none\n", "") if "noise" in header else UNITS
    message = refused(f"{units}{header}\nx,z\n{rows([(20 * x / 5, z) for x, z in SAMPLES])}")
    assert header[2:].partition(":")[0] in message


def test_wheel_is_no_rail() -> None:
    assert "a wheel, not a rail" in refused(csv_text("# kind: wheel\n"))


@pytest.mark.parametrize("spacing", [0.0, -5.0, math.nan, math.inf, 1e300])
def test_impossible_spacing_is_refused(spacing: float) -> None:
    form = InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up", spacing=spacing)
    assert "spacing" in refused("1\n" * 30, form)


def test_one_column_without_spacing_asks_for_it() -> None:
    assert "state the spacing" in refused("1.0\n" * 30, MM_UM_UP)


def test_number_beyond_any_chainage_is_refused() -> None:
    assert "line 6: x is " in refused(csv_text("", sample(0, "-1e300", 0)))


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
    units = f"# x_unit: {x_unit}\n# z_unit: {z_unit}\n# z_positive: up\n"
    return f"{units}# detrend: none\n# noise: none\n{rows(list(shifted))}"


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
    a, b = (parse_profile(f"# centre: {s[9][0]}\n" + in_units(s, "mm", "um", exact), "a") for s in (samples, moved))
    assert a.profile_sha256 == b.profile_sha256


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
        parse_profile(in_units(s, "mm", "um", exact).replace("detrend: none", "detrend: line"), "a")
        for s in (flatter, tilted)
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
    if profile.weld_id.isprintable() and profile.weld_id == profile.weld_id.strip(' ";,\t'):
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


@pytest.mark.parametrize("place", ["\n30,9\n", ""])
def test_statement_among_or_behind_the_samples_is_one(place: str) -> None:
    text = csv_text().replace(place, f"\n# rail: left{place}") if place else csv_text() + "# rail: left\n"
    assert parse_profile(text, "a").rail == "left"


def test_refusal_is_one_short_printable_line_whatever_the_file_says() -> None:
    names = "x\x0b,z\u2028,\u0085" + "y" * 5000
    text = f"{names}\n" + "".join(f"{x},{z},1\n" for x, z in SAMPLES)
    with pytest.raises(ProfileError) as caught:
        parse_profile(text.replace("z", "h"), "km12\n.csv", MM_UM_UP)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


def test_a_file_says_which_way_its_chainage_goes_and_keeps_saying_so(tmp_path: Path) -> None:
    profile = parse_profile(csv_text("# chainage_direction: Against\n"), "km12.csv")
    assert profile.chainage_direction == "against"
    write_profile(profile, tmp_path / "again.csv")
    assert read_profile(tmp_path / "again.csv").chainage_direction == "against"
    assert parse_profile(csv_text(), "km12.csv").chainage_direction is msgspec.UNSET
    assert refused(csv_text("# chainage_direction: up\n")) == (
        "km12.csv: line 5: chainage_direction 'up' is unknown; state one of with, against"
    )


def test_chainage_as_x_rises_with_x_and_falls_where_x_is_turned() -> None:
    along = csv_text(samples=[(12_345_000 + mm, um) for mm, um in SAMPLES])
    rising, turned = (
        parse_profile(along, "km12.csv", replace(MM_UM_UP, x_direction=direction)) for direction in ("with", "against")
    )
    assert (rising.chainage_m, rising.chainage_direction) == (12345.05, "with")
    assert (turned.chainage_m, turned.chainage_direction) == (12345.05, "against")
    assert turned.z_m == rising.z_m[::-1]
