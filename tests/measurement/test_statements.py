"""What a header block states of a weld: keys in several languages, units, and what is refused."""

import pytest

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.sample_table import Statement
from weld_force_ros.measurement.statements import Stated, chainage_m, stated_number, statements, with_format

NEEDED = {key: Stated(text, f"line {n}: ") for n, (key, text) in enumerate(
    {"x_unit": "mm", "z_unit": "um", "z_positive": "up"}.items(), start=1)}  # fmt: skip


def found(*pairs: tuple[str, str], comment: bool = False, form: InstrumentFormat | None = None) -> dict[str, str]:
    lines = [Statement(n, key, value, comment) for n, (key, value) in enumerate(pairs, start=1)]
    return {key: stated.text for key, stated in statements(lines, form or InstrumentFormat()).items()}


@pytest.mark.parametrize(
    ("key", "value", "ours"),
    [
        ("Schweißung", "W 12", "weld_id"),
        ("Schweissstoß-Nr.", "7", "weld_id"),
        ("WELD NO", "7", "weld_id"),
        ("Prüfer", "Mayer", "operator"),
        ("Bediener", "Mayer", "operator"),
        ("Strecke", "1750", "line"),
        ("Calibrated on", "2026-03-01", "calibration"),
        ("Datum", "13.05.2024", "measured_on"),
        ("Measured on", "2024-05-13", "measured_on"),
        ("Gerät", "ESL-1200", "instrument"),
        ("Schiene", "links", "rail"),
        ("Count", "241", "samples"),
        ("#UnitX", "mm", "x_unit"),
    ],
)
def test_keys_are_known_in_the_words_of_the_trade(key: str, value: str, ours: str) -> None:
    assert found((key, value)) == {ours: value}


def test_free_text_states_nothing() -> None:
    assert found(("Temperature", "21.5"), ("Messlänge [mm]", "1200"), ("remark", "wet"), comment=True) == {}


def test_support_of_an_instruments_header_is_free_text_unless_it_names_sleepers() -> None:
    assert found(("Support", "+44 20 7946 0000")) == {}
    assert found(("support", "0=0.02")) == {"support": "0=0.02"}
    assert found(("support", "some"), comment=True) == {"support": "some"}  # refused where it is read


def test_descriptor_names_the_keys_of_its_instrument() -> None:
    form = InstrumentFormat(header={"weld_id": "Stoß", "operator": "Prüfling"})
    assert found(("stoss", "7"), ("PRÜFLING", "B"), form=form) == {"weld_id": "7", "operator": "B"}


def test_descriptor_names_the_key_of_the_number_of_samples() -> None:
    assert found(("NPTS", "241"), form=InstrumentFormat(samples="npts")) == {"samples": "241"}
    assert "samples" not in with_format(NEEDED, InstrumentFormat(samples="npts"))


@pytest.mark.parametrize(
    ("key", "text", "metres"),
    [
        ("chainage", "12+345.678", "12345.678"),
        ("km", "12,345678", "12345.678"),
        ("Chainage [km]", "12.345678", "12345.678"),
        ("station", "12345.678 m", "12345.678"),
        ("station", "km 12.345678", None),
        ("chainage", "12345.678", None),
        ("chainage", "somewhere", None),
    ],
)
def test_chainage_needs_its_unit(key: str, text: str, metres: str | None) -> None:
    value = chainage_m(text, key)
    assert value is None if metres is None else float(value or 0) == float(metres)


def test_own_key_goes_before_a_synonym() -> None:
    assert found(("weld", "a"), ("weld_id", "b"), ("joint", "c")) == {"weld_id": "b"}


def test_own_key_stated_twice_differently_is_refused() -> None:
    assert found(("rail", "left"), ("rail", "left"), comment=True) == {"rail": "left"}
    with pytest.raises(ProfileError, match="line 2: rail is stated twice"):
        found(("rail", "left"), ("rail", "right"), comment=True)


def test_file_goes_before_user_and_format() -> None:
    form = InstrumentFormat(x_unit="m", rail="left", noise=5e-6)
    merged = with_format(NEEDED | {"rail": Stated("right", "line 4: ")}, form)
    assert {key: merged[key].text for key in ("x_unit", "rail", "noise")} == {
        "x_unit": "mm",
        "rail": "right",
        "noise": "5e-06",
    }


@pytest.mark.parametrize(
    ("key", "text", "says"),
    [
        ("x_unit", "ell", "line 9: x_unit 'ell' is unknown; state one of m, cm, mm"),
        ("z_positive", "left", "line 9: z_positive 'left' is unknown; state one of up, down"),
        ("detrend", "spline", "line 9: detrend 'spline' is unknown; state one of line, none"),
        ("kind", "crossing", "line 9: kind 'crossing' is unknown; state one of weld, joint, squat"),
        ("kind", "Wheel", "line 9: a wheel, not a rail"),
    ],
)
def test_what_cannot_be_is_refused_with_the_choices(key: str, text: str, says: str) -> None:
    with pytest.raises(ProfileError, match=says):
        with_format(NEEDED | {key: Stated(text, "line 9: ")}, InstrumentFormat())


@pytest.mark.parametrize("key", NEEDED)
def test_unit_and_sign_are_never_guessed(key: str) -> None:
    with pytest.raises(ProfileError, match=f"{key} not stated; add a line such as '# {key}: "):
        with_format({k: v for k, v in NEEDED.items() if k != key}, InstrumentFormat())


@pytest.mark.parametrize("text", ["many", "nan", "1e999", ""])
def test_number_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ProfileError, match="line 3: centre"):
        stated_number(Stated(text, "line 3: "), "centre")


@pytest.mark.parametrize(
    ("key", "text", "meant"),
    [
        ("line_speed_kmh", "100 mph", "write 160.934, in km/h"),
        ("line_speed_kmh", "44 m/s", "write 158.4, in km/h"),
        ("weld_position_m", "30 cm", "write 0.3, in m"),
        ("weld_position_m", "300mm", "write 0.3, in m"),
        ("chainage_m", "12.345 km", "write 12345, in m"),
    ],
)
def test_a_number_in_another_unit_is_refused_with_what_is_meant(key: str, text: str, meant: str) -> None:
    with pytest.raises(ProfileError, match="is in another unit") as caught:
        stated_number(Stated(text, "line 3: "), key)
    assert caught.value.remedy == meant


@pytest.mark.parametrize(
    ("key", "text", "number"),
    [("line_speed_kmh", "160 km/h", 160.0), ("weld_position_m", "0.3 m", 0.3), ("chainage_m", "12+345", 12345.0)],
)
def test_a_number_may_carry_its_own_unit(key: str, text: str, number: float) -> None:
    assert stated_number(Stated(text, ""), key) == number
