"""Files as instruments write them: each gives the geometry that was measured, or one clear line."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.harness.foreign_forms import all_forms
from tests.harness.instrument_forms import Form
from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import inspect_file, parse_profiles, read_profile
from weld_force_ros.messages import WeldProfile, encode

FOLDER = Path(__file__).parents[1] / "data" / "instrument_files"
MM_UP = {"x_unit": "mm", "z_unit": "mm", "z_positive": "up"}
FORMS = all_forms()


def dip_m(x_m: np.ndarray, depth_m: float = 4e-4, length_m: float = 0.3) -> np.ndarray:
    return np.where(np.abs(x_m) <= length_m / 2, -depth_m / 2 * (1 + np.cos(2 * np.pi * x_m / length_m)), 0.0)


def largest_error_um(profile: WeldProfile, depth_m: float = 4e-4, length_m: float = 0.3) -> float:
    x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
    return float(np.abs(z_m - dip_m(x_m, depth_m, length_m)).max()) * 1e6


def stated(**more: object) -> InstrumentFormat:
    return msgspec.convert({k: v for k, v in (MM_UP | more).items() if v is not None}, InstrumentFormat)


def refusal(path: Path, form: InstrumentFormat | None) -> str:
    with pytest.raises(ProfileError) as caught:
        inspect_file(path, form)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert len(text.splitlines()) == 1
    assert len(text) < 400
    assert caught.value.remedy
    return text


# --- the files that users met --------------------------------------------------------------------------------------

DIPS = {  # largest error in um, and what is said to have been done
    "00_ok.csv": (0.6, ""),
    "02_tab_comma_plain.txt": (0.6, ""),
    "03b_fixed_width_glued.txt": (0.6, ""),
    "05_utf16le.txt": (0.6, "read as utf-16"),
    "07_crlf.csv": (0.6, ""),
    "09_cr_cr_lf.csv": (0.6, ""),
    "10b_header_units_own.csv": (0.6, ""),
    "11b_railprof_header.txt": (0.6, "columns not used: hor"),
    "14_footer.csv": (0.6, "1 line after the samples left out"),
    "15_trailing_sep.csv": (0.6, ""),
    "17_sci_comma.txt": (0.1, ""),
    "19_neg_zero.csv": (0.6, ""),
    "20b_dashes.csv": (0.6, "1 missing height put by a cubic"),
    "20d_-9999um.csv": (0.6, "1 height -9999 taken as missing"),
    "20f_-9999um_down.csv": (0.6, "1 height -9999 taken as missing"),
    "20h_9.999mm.csv": (0.6, "1 height 9.999 taken as missing"),
    "22_chainage_m.csv": (0.6, "centred on x = 12345.678 m"),
    "22c_chainage_km_plus.csv": (0.6, "centred on x = 12345.678 m"),
    "24_duplicate_row.csv": (0.6, "1 repeated position left out"),
    "26_spacing_20mm.csv": (6.0, "samples 20 mm apart"),
    "28_zipped.csv.zip": (0.6, "unpacked from a ZIP archive"),
    "29 Schweiße №7 – links (Kopie).csv": (0.6, ""),
    "31_sep_line.csv": (0.6, ""),
    "33_ctrl_z.csv": (0.6, "end marks after the last line left out"),
    "34_unicode_minus.csv": (0.6, ""),
    "36_units_row.csv": (0.6, ""),
    "37b_key_upper.csv": (0.6, ""),
    "38b_nm.csv": (0.1, ""),
    "40_heights_only.txt": (0.6, "centred on x = 0.6 m"),
    "44_z_x_order.csv": (0.6, ""),
    "45b_extension.asc": (0.6, ""),
    "45d_extension.tsv": (0.6, ""),
    "header_mm.csv": (0.6, ""),
}
RISES = {  # of 0.2 mm over 250 mm
    "desc.csv": (0.6, "x descends: turned round"),
    "euro.csv": (0.6, "columns not used: Höhe seitlich [mm]"),
    "footer.csv": (0.6, "2 lines after the samples left out"),
    "railprof.txt": (5.1, "columns not used: hor"),
    "spike.csv": (0.6, "1 wrong sample set aside: +3e+03 um at x = 300 mm"),
    "trail.csv": (0.6, ""),
}
REFUSED = {
    "27_gap_positive_no_sign.csv": "z_positive not stated",
    "42_mm_called_um.csv": "heights span 0.4 um",
    "50_empty.csv": "empty",
    "52_comma_both.csv": "semicolons between the columns",
    "53b_thousands_en_all.txt": "heights span 0.4 um",
    "54_x_and_encoder.csv": "no straightedge lies like that",
    "mm_as_um.csv": "heights span 0.2 um",
    "steep.csv": "heights climb 500 mm in a metre",
}
OTHERS = {
    *("12b_several_welds_restart.csv", "48_apostrophe_thousands.csv", "base.csv", "bad_first_sample_0.1mm.csv"),
    *("dip_clean.csv", "quantised_0.01mm_tilted.csv", "quantised_0.1mm_tilted.csv"),
}


def read(name: str) -> WeldProfile:
    profile = read_profile(FOLDER / name, stated(spacing=5.0 if "heights_only" in name else None))
    encode(profile)
    return profile


def test_every_file_has_its_expected_outcome() -> None:
    assert {path.name for path in FOLDER.iterdir()} == {*DIPS, *RISES, *REFUSED, *OTHERS}


@pytest.mark.parametrize("name", DIPS)
def test_file_of_the_dip_gives_its_geometry(name: str) -> None:
    within_um, note = DIPS[name]
    profile = read(name)
    assert largest_error_um(profile) < within_um
    assert (profile.x_m[0], profile.x_m[-1]) == (-0.6, 0.6)
    assert note in " | ".join(profile.conditioning)


@pytest.mark.parametrize("name", RISES)
def test_file_of_the_rise_gives_its_geometry(name: str) -> None:
    within_um, note = RISES[name]
    profile = read(name)
    assert largest_error_um(profile, -2e-4, 0.25) < within_um
    assert note in " | ".join(profile.conditioning)


@pytest.mark.parametrize("name", REFUSED)
def test_file_that_cannot_be_right_is_refused(name: str) -> None:
    form = None if "no_sign" in name else stated()
    assert REFUSED[name] in refusal(FOLDER / name, form)


def test_two_welds_one_after_the_other_are_two() -> None:
    found = [u.profile for u in inspect_file(FOLDER / "12b_several_welds_restart.csv")]
    assert [profile.weld_id for profile in found] == [f"12b_several_welds_restart-{n}" for n in (1, 2)]
    assert all(largest_error_um(profile) < 0.6 for profile in found)


def test_thousands_apostrophes_make_no_hole() -> None:
    assert largest_error_um(read("48_apostrophe_thousands.csv"), 4e-3) < 1.5


def test_wrong_first_sample_does_not_set_the_level() -> None:
    profile = read("bad_first_sample_0.1mm.csv")
    assert "1 wrong sample set aside: -100 um at x = 0 mm" in " | ".join(profile.conditioning)
    assert max(map(abs, profile.z_m[:200])) < 1e-6


@pytest.mark.parametrize(("step", "within_um"), [("0.01", 3.0), ("0.1", 20.0)])
def test_rounding_leaves_the_weld(step: str, within_um: float) -> None:
    """The same weld stands unrounded and level in the file with the wrong first sample."""
    rounded, whole = read(f"quantised_{step}mm_tilted.csv"), read("bad_first_sample_0.1mm.csv")
    assert np.abs(np.subtract(rounded.z_m, whole.z_m)).max() * 1e6 < within_um


def test_every_route_reads_a_file_alike(tmp_path: Path) -> None:
    path = shutil.copy(FOLDER / "euro.csv", tmp_path / "other name.dat")
    (by_bytes,) = parse_profiles((FOLDER / "euro.csv").read_bytes(), "euro.csv", stated())
    by_path = read_profile(path, stated())
    assert by_path.profile_sha256 == by_bytes.profile.profile_sha256 == read("euro.csv").profile_sha256
    assert by_path.conditioning == by_bytes.profile.conditioning


# --- forms after public descriptions -------------------------------------------------------------------------------


def test_forms_are_many_and_each_has_its_source() -> None:
    assert len(FORMS) >= 100
    assert len({form.name for form in FORMS}) == len(FORMS)
    assert all(form.source for form in FORMS)


@pytest.mark.parametrize("form", [f for f in FORMS if f.refused], ids=lambda form: form.name)
def test_form_that_holds_no_weld_is_refused(form: Form, tmp_path: Path) -> None:
    path = tmp_path / form.name
    path.write_bytes(form.data)
    assert form.refused in refusal(path, stated(**form.stated))


@pytest.mark.parametrize("form", [f for f in FORMS if not f.refused], ids=lambda form: form.name)
def test_form_gives_the_geometry(form: Form) -> None:
    found = [u.profile for u in parse_profiles(form.data, form.name, stated(**form.stated))]
    assert len(found) == len(form.welds)
    for profile, depth in zip(found, form.welds, strict=True):
        assert largest_error_um(profile, 4e-4 * depth) < form.within_um
        assert (profile.x_m[0], profile.x_m[-1]) == pytest.approx(form.reach_m, abs=1.5e-3)
        assert form.note in " | ".join(profile.conditioning)
        encode(profile)


def named(name: str) -> Form:
    return next(form for form in FORMS if form.name == name)


def test_header_block_and_columns_name_the_welds() -> None:
    names = {
        "key-value-block.csv": ["W 12"],
        "protocol.xlsx": ["W 12"],
        "weld-column.csv": ["W1", "W2"],
        "weld-blocks.txt": ["1", "2"],
        "comma-line-blocks.csv": ["1", "2"],
    }
    for name, welds in names.items():
        found = [u.profile for u in parse_profiles(named(name).data, name, stated())]
        assert [profile.weld_id for profile in found] == welds
    (block,) = parse_profiles(named("key-value-block.csv").data, "a", stated())
    assert (block.profile.operator, block.profile.measured_on) == ("Mayer", "13.05.2024")
    assert block.profile.instrument == "ESL-1200"


def test_chainage_of_the_record_is_that_of_the_weld() -> None:
    for name in ("chainage-plus.csv", "chainage-km.csv"):
        (found,) = parse_profiles(named(name).data, name, stated())
        assert found.profile.chainage_m == pytest.approx(12345.678, abs=1e-6)


@pytest.mark.parametrize("by_column", [False, True])
def test_welds_of_a_file_that_states_one_name_are_told_apart(by_column: bool) -> None:
    head = "# weld_id: KM12\n# x_unit: mm\n# z_unit: um\n# z_positive: up\n# noise: none\n"
    rows = [f"{mm},{-50.0 if abs(mm) < 50 else 0.0}" for mm in range(-150, 151, 5)]
    if by_column:
        text = head + "weld,x,z\n" + "".join(f"{weld},{row}\n" for weld in "AB" for row in rows)
    else:
        text = head + "x,z\n" + "\n".join([*rows, *rows]) + "\n"
    names = [understood.profile.weld_id for understood in parse_profiles(text, "two.csv")]
    assert names == (["A", "B"] if by_column else ["KM12-1", "KM12-2"])
