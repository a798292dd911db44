"""Descriptors of instruments: validated, recognised, and ten lines long."""

import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from tests.soak.malformed import check_refusal
from weld_force_ros.errors import InputError, ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat, format_of, load, recognised, shipped
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.messages import FormError, MeasurementNoise, encode

X_MM = np.arange(-600, 601, 5)
Z_MM = np.where(abs(X_MM) <= 150, -0.2 * (1 + np.cos(2 * np.pi * X_MM / 300)), 0.0)
TEN_LINES = """\
name: Straightedge 7
recognise: ['^Straightedge 7']
encoding: cp1252
separator: semicolon
decimal: comma
columns: {x: Weg, z: [Spalt 1, Spalt 2]}
header: {weld_id: Stoß, chainage_m: Ort}
x_unit: mm
z_unit: 1/100 mm
z_positive: down
"""


def lines_of(factor: float = 100) -> str:
    rows = "".join(f"{x};{-factor * z:.1f};{-factor * z + 1:.1f};0,3\n" for x, z in zip(X_MM, Z_MM, strict=True))
    return "Straightedge 7\nStoß;W 12\nOrt;12,345 km\nWeg;Spalt 1;Spalt 2;Temperatur\n" + rows.replace(".", ",")


def descriptor(folder: Path, text: str) -> str:
    path = folder / "mine.yaml"
    path.write_text(text)
    return str(path)


def test_ten_lines_describe_a_new_instrument(tmp_path: Path) -> None:
    form = load(descriptor(tmp_path, TEN_LINES))
    profile = parse_profile(lines_of().encode("cp1252"), "a", form)
    true_m = np.interp(profile.x_m, X_MM / 1e3, Z_MM / 1e3)
    np.testing.assert_allclose(profile.z_m, true_m, atol=2e-6)
    assert (profile.weld_id, profile.chainage_m, profile.format) == ("W 12", 12345.0, "Straightedge 7")
    told = " | ".join(profile.conditioning)
    assert "columns not used: Temperatur" in told
    assert "2 passes averaged" in told


def test_passes_are_averaged_and_their_scatter_is_the_noise(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    passes = Z_MM[:, None] + generator.normal(0, 0.010, (len(X_MM), 3)) + [0.0, 0.5, -0.2] + X_MM[:, None] * 1e-4
    rows = "".join(f"{x};" + ";".join(f"{z:.4f}" for z in zs) + "\n" for x, zs in zip(X_MM, passes, strict=True))
    form = format_of(x_unit="mm", z_unit="mm", z_positive="up", columns={"x": 1, "z": [2, 3, 4]})
    profile = parse_profile(rows, "a", form)
    (told,) = [step for step in profile.conditioning if "passes" in step]
    assert told.startswith("3 passes averaged, repeatability ")
    assert float(told.split()[4]) == pytest.approx(10, rel=0.15)
    assert profile.noise.noise_m == pytest.approx(10e-6 / 3**0.5, rel=0.15)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name: [1]", "name"),
        ("colour: red", "colour"),
        ("separator: colon", "separator"),
        ("columns: {y: 1}", "columns"),
        ("columns: {x: 0}", "columns"),
        ("skip_rows: -1", "skip_rows"),
        ("spacing: 0", "spacing"),
        ("spacing: .inf", "spacing"),
        ("spacing: .nan", "spacing"),
        ("x_unit: ell", "x_unit 'ell' is unknown"),
        ("z_positive: left", "z_positive"),
        ("recognise: ['(']", "recognise '('"),
        ("encoding: klingon", "encoding 'klingon' is unknown"),
        ("header: {colour: Farbe}", "header"),
        ("- a list", "mine.yaml"),
        ("a: [", "mine.yaml"),
        ("", "mine.yaml"),
    ],
)
def test_wrong_descriptor_is_refused_by_the_field(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load(descriptor(tmp_path, text))
    message = str(caught.value)
    assert says in message
    assert len(message.splitlines()) == 1
    assert caught.value.remedy


def test_unknown_format_lists_the_shipped_ones() -> None:
    with pytest.raises(InputError, match=r"no-such.*; name one of graw-rsg, .*railprof"):
        load("no-such")


def test_shipped_descriptors_name_their_source() -> None:
    assert {"graw-rsg", "miniprof", "railprof", "weld-force"} <= set(shipped())
    assert all((form.name and form.source) or name == "weld-force" for name, form in shipped().items())


def test_format_that_is_named_goes_before_the_one_recognised() -> None:
    text = "x\tvert\thor\n" + "".join(f"{x}\t0.00\t{z:.2f}\n" for x, z in zip(X_MM, Z_MM, strict=True))
    by_content = InstrumentFormat()
    with pytest.raises(ProfileError, match="all heights are equal"):
        parse_profile(text, "a", by_content)
    lateral = format_of(x_unit="mm", z_unit="mm", z_positive="up", columns={"x": "x", "z": "hor"}, name="side")
    assert min(parse_profile(text, "a", lateral).z_m) == pytest.approx(-4e-4, abs=5e-6)


def test_user_goes_before_the_format_and_the_file_before_both() -> None:
    form = format_of("railprof", z_positive="down", x_unit="cm")
    assert form is not None
    assert (form.name, form.z_positive, form.x_unit, form.z_unit) == ("RAILPROF", "down", "cm", "mm")
    text = "# z_positive: up\nx\tvert\thor\n" + "".join(f"{x}\t{z:.3f}\t0\n" for x, z in zip(X_MM, Z_MM, strict=True))
    profile = parse_profile(text, "a", format_of("railprof", z_positive="down"))
    assert min(profile.z_m) == pytest.approx(-4e-4, abs=2e-6)


def test_file_of_two_formats_asks_for_one() -> None:
    lines = ["x vert hor", "Basic profile; Waviness"]
    with pytest.raises(ProfileError, match=r"could be of .* or .*; say which, with --format"):
        recognised(lines)
    assert recognised(lines[:1]) is shipped()["railprof"]
    assert recognised(["1,2"]) is None


def test_options_that_say_nothing_are_no_format() -> None:
    assert format_of() is None
    assert format_of("", x_unit="", spacing=0.0, skip_rows=0, noise=None) is None


@pytest.mark.parametrize(("noise", "read"), [("auto", "auto"), ("none", "none"), ("5e-6", 5e-6)])
def test_noise_is_a_word_or_metres(noise: str, read: object) -> None:
    form = format_of(noise=noise)
    assert form is not None
    assert form.noise == read


@pytest.mark.parametrize(
    "stated",
    [
        {"noise": "much"},
        {"noise": "nan"},
        {"noise": "-1"},
        {"spacing": float("inf")},
        {"skip_rows": -1},
        {"hue": "red"},
    ],
)
def test_option_that_cannot_be_is_refused(stated: dict[str, object]) -> None:
    with pytest.raises(InputError) as caught:
        format_of(**stated)
    assert next(iter(stated)) in str(caught.value)


def test_own_form_needs_no_layout_from_the_user() -> None:
    rows = "".join(f"{x},{z:.3f}\n" for x, z in zip(X_MM, Z_MM, strict=True))
    own = f"# x_unit: mm\n# z_unit: mm\n# z_positive: up\nx,z\n{rows}"
    other = format_of(spacing=1.0, skip_rows=9, separator="tab", columns={"x": 7, "z": 8})
    assert parse_profile(own, "a", other).profile_sha256 == parse_profile(own, "a").profile_sha256


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 70) | st.floats() | st.text(max_size=6)
    | st.sampled_from(["mm", "up", "x", "z", "utf-16", "tab", "comma", "rot13", "against", "none", "("]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["x", "z", "weld_id", "a"]), inner),
    max_leaves=4,
)  # fmt: skip


@settings(deadline=None, database=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(st.sampled_from(InstrumentFormat.__struct_fields__) | st.text(max_size=4), _VALUES, max_size=5))
def test_any_descriptor_reads_a_file_or_is_refused_in_one_line(tmp_path: Path, fields: dict[str, object]) -> None:
    path = tmp_path / "any.yaml"
    path.write_text(json.dumps(fields))
    text = "x;z\n" + "".join(f"{5 * i};{i * i % 7}\n" for i in range(40))
    try:
        form = load(str(path)).with_statements(InstrumentFormat(noise="none"))
    except InputError as error:
        check_refusal(error)
        return
    with suppress(ProfileError):
        encode(parse_profile(text, "a", form))


def test_an_instrument_states_its_form_error_which_its_profiles_carry(tmp_path: Path) -> None:
    error = "form_error: {deviation: 2.0e-5, length: 0.5, source: its data sheet}\n"
    form = load(descriptor(tmp_path, TEN_LINES + error))
    noise = parse_profile(lines_of(), "a", form).noise
    assert noise.form_error == FormError(deviation_m=2e-5, length_m=0.5, source="its data sheet")
    assert parse_profile(lines_of(), "a", load(descriptor(tmp_path, TEN_LINES))).noise.form_error is UNSET
    # Samples that are taken as they are have none: exact shapes stay exact.
    exact = form.with_statements(InstrumentFormat(noise="none"))
    assert parse_profile(lines_of(), "a", exact).noise == MeasurementNoise(method="none", noise_m=0.0)


@pytest.mark.parametrize(
    ("error", "says"),
    [
        ("{deviation: 0, length: 0.5, source: x}", "form_error.deviation"),
        ("{deviation: 20, length: 0.5, source: x}", "form_error.deviation"),
        ("{deviation: 2.0e-5, length: 0.001, source: x}", "form_error.length"),
        ("{deviation: 2.0e-5, length: 0.5}", "source"),
    ],
)
def test_a_form_error_that_cannot_be_is_refused_by_the_field(error: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load(descriptor(tmp_path, TEN_LINES + f"form_error: {error}\n"))
    assert says in str(caught.value)


def test_the_bundled_straightedge_has_the_deviation_of_its_data_sheet() -> None:
    """0.030 mm either way, all values alike: a standard deviation of 0.030 mm / sqrt(3)."""
    error = shipped()["railprof"].form_error
    assert error is not None
    assert error.deviation == pytest.approx(0.030e-3 / 3**0.5, rel=0.02)
    assert "not verified" in error.source
