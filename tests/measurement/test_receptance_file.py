"""Measured receptances in files: units, columns, and what is refused with one line."""

import re
from pathlib import Path

import numpy as np
import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.receptance_file import read_receptance

HZ = np.linspace(50.0, 500.0, 12)
EXACT = 1 / (2e8 * (1 + 0.3j) - 150 * (2 * np.pi * HZ) ** 2)  # an oscillator


def text(unit: str, factor: np.ndarray | float, comma: str = ",") -> str:
    values = EXACT * factor
    rows = [comma.join(f"{v:.9g}" for v in (f, h.real, h.imag)) for f, h in zip(HZ, values, strict=True)]
    return (
        f"# Hammer test\n# Unit: {unit}\n{comma.join(('frequency_hz', 'sleeper_real', 'sleeper_imag'))}\n"
        + "\n".join(rows)
    )


def read(tmp_path: Path, content: str):
    path = tmp_path / "test.csv"
    path.write_text(content, encoding="utf-8")
    return read_receptance(path)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("m/N", 1.0), ("µm/N", 1e6), ("mm/kN", 1e6), ("m/s/N", 2j * np.pi * HZ), ("(mm/s)/N", 2e3j * np.pi * HZ),
        ("m/s²/N", -((2 * np.pi * HZ) ** 2)), ("1/kg", -((2 * np.pi * HZ) ** 2)),
        ("g/kN", -((2 * np.pi * HZ) ** 2) / 9.80665 * 1e3),
    ],
)  # fmt: skip
def test_every_unit_comes_to_displacement(unit: str, factor: np.ndarray | float, tmp_path: Path):
    found = read(tmp_path, text(unit, factor))
    np.testing.assert_allclose(found.m_per_n, EXACT[None], rtol=1e-7)
    np.testing.assert_allclose(found.frequency_hz, HZ, rtol=1e-8)
    assert found.at_spans.tolist() == [0.0]


def test_magnitude_and_phase_beside_real_and_imaginary_part_and_decimal_commas(tmp_path: Path):
    rows = [
        ";".join(f"{v:.9g}" for v in (f, abs(h), np.degrees(np.angle(h)), h.real, h.imag)).replace(".", ",")
        for f, h in zip(HZ, EXACT, strict=True)
    ]
    head = "# unit: m/N\nFrequency_Hz; midspan_magnitude; midspan_phase_deg; sleeper_real; sleeper_imag\n"
    found = read(tmp_path, head + "\n".join(rows) + "\n")
    assert found.at_spans.tolist() == [0.0, 0.5]
    np.testing.assert_allclose(found.m_per_n, [EXACT, EXACT], rtol=1e-7)


GOOD = text("m/N", 1.0)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("# Unit: m/N\n", "", "its unit is not stated; write `# unit: m/N` (receptance)"),
        ("# Unit: m/N", "# Unit: m/N\n# unit: g/N", "its unit is stated twice"),
        ("# Unit: m/N", "# Unit: furlong/N", "unit 'furlong/N' is not known; state one of m/N"),
        ("frequency_hz", "f", "no column frequency_hz"),
        ("sleeper_imag", "imag", "column sleeper_real without sleeper_imag"),
        ("sleeper_real,sleeper_imag", "a,b", "no response among the columns"),
        ("\n50,", "\n50,7,", "line 4 has 4 cells, not 3"),
        ("\n50,", "\nfifty,", "line 4: 'fifty,"),
        ("\n50,", "\nnan,", "line 4 holds a value that is not finite"),
        ("\n50,", "\n0,", "frequencies do not rise from above 0"),
        ("\n50,", "\n500,", "frequencies do not rise from above 0"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_with_one_line(old: str, new: str, complaint: str, tmp_path: Path):
    assert old in GOOD
    with pytest.raises(InputError, match=re.escape(complaint)) as caught:
        read(tmp_path, GOOD.replace(old, new, 1))
    assert "test.csv: " in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "empty"),
        ("# unit: m/N\n", "no columns"),
        ("# unit: m/N\nfrequency_hz,sleeper_real,sleeper_imag\n1,1,-1\n", "1 frequencies"),
        (text("m/N", 0.0), "a response of 0"),
        (GOOD.replace("# Unit: m/N", "# Unit: m/s2/N"), "the rail's displacement leads its force"),
    ],
)
def test_files_without_a_receptance_are_refused(content: str, complaint: str, tmp_path: Path):
    with pytest.raises(InputError, match=re.escape(complaint)):
        read(tmp_path, content)


def test_the_other_sign_of_phase_is_noticed(tmp_path: Path):
    lines = [line.replace(",-", ",") if line[0].isdigit() else line for line in GOOD.splitlines()]
    with pytest.raises(InputError, match="leads its force"):
        read(tmp_path, "\n".join(lines))


def test_a_missing_file_is_one_line(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.csv: No such file"):
        read_receptance(tmp_path / "none.csv")
