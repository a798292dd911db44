"""`weld-force inspect` and `assess`: from an instrument's file to what was understood, and to a verdict."""

import json
import math
from pathlib import Path

import pytest

from tests.cli.test_main import run
from weld_force_ros.messages import ForceMap, Rejection, Verdict, decode

SHARED = Path(__file__).parents[1] / "data" / "instrument_files"
QUICK = ["--speeds", "80,160", "--positions", "0.30", "--track", "bilbao-viscous"]


@pytest.fixture
def export(tmp_path: Path) -> Path:
    """A rise of 0.2 mm over 250 mm as a German instrument exports it, with a wrong sample."""
    rows = []
    for mm in range(-500, 501, 5):
        height = 0.1 * (1 + math.cos(2 * math.pi * mm / 250)) if abs(mm) < 125 else 0.0
        rows.append(f"{mm},0;{3.0 if mm == -200 else height:.3f};0,010".replace(".", ","))
    path = tmp_path / "Schweiße 7.txt"
    text = "Schweißung;KM12-R\nDatum;2026-11-28\nWeg [mm];Höhe vertikal [mm];Höhe seitlich [mm]\n" + "\n".join(rows)
    path.write_bytes(text.encode("cp1252") + b"\r\nMax;0,200\r\n")
    return path


def test_inspect_tells_what_was_understood(capfd: pytest.CaptureFixture[str], export: Path) -> None:
    code, (line,), err = run(capfd, "inspect", str(export), "--json", "-")
    found = json.loads(line)
    assert code == 0
    assert (found["source"], found["weld_id"], found["samples"]) == (export.name, "KM12-R", 201)
    assert (found["spacing_m"], found["resolution_m"]) == (0.005, 1e-6)
    assert found["noise_m"] < 1e-6
    assert found["outliers"] == [pytest.approx(-0.2)]
    assert found["problems"] == []
    for word in ("KM12-R", "5 mm apart", "1 set aside", "not UTF-8", "Höhe seitlich"):
        assert word in err


def test_inspect_of_a_file_that_cannot_be_read_says_why_and_goes_on(
    capfd: pytest.CaptureFixture[str], export: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("x;z\n1;2\n")
    code, lines, err = run(capfd, "inspect", str(bad), str(export), "--json", "-")
    first, second = map(json.loads, lines)
    assert code == 2
    assert "x_unit, z_unit, z_positive not stated" in first["problems"][0]
    assert second["weld_id"] == "KM12-R"
    assert "x_unit, z_unit, z_positive not stated" in err


def test_inspect_tells_the_form_error_of_the_instrument(capfd: pytest.CaptureFixture[str]) -> None:
    file = Path(__file__).parent.parent / "data" / "instrument_files" / "railprof.txt"
    code, (line,), err = run(capfd, "inspect", str(file), "--json", "-")
    assert code == 0
    assert json.loads(line)["form_error_m"] == 1.7e-5
    assert "17 um over 0.5 m, counted in intervals" in " ".join(err.replace("│", " ").split())


def test_inspect_of_an_exact_shape_takes_it_as_it_is(capfd: pytest.CaptureFixture[str]) -> None:
    code, (line,), err = run(capfd, "inspect", "weld-1-dip", "--json", "-")
    assert code == 0
    assert json.loads(line)["noise_m"] == 0.0
    assert json.loads(line)["form_error_m"] is None
    assert "samples taken as they are" in err


def test_assess_gives_a_verdict_with_intervals_and_the_page(
    capfd: pytest.CaptureFixture[str], export: Path, tmp_path: Path
) -> None:
    page = tmp_path / "welds.html"
    code, (line,), err = run(
        capfd, "assess", str(export), *QUICK, "--uncertainty-samples", "8", "--json", "-", "--report", str(page)
    )
    verdict = decode(Verdict, line)
    peak = next(c for c in verdict.criteria if c.name == "peak_force")
    assert code == (0 if verdict.decision == "accept" else 1)
    assert verdict.weld_id == "KM12-R"
    assert peak.low < peak.value * 1.05
    assert peak.low < peak.high
    assert peak.value == pytest.approx(125.9e3, rel=0.02)
    assert "KM12-R" in err
    assert "set aside" in page.read_text()


def test_assess_ends_each_file_in_a_verdict_or_a_rejection(
    capfd: pytest.CaptureFixture[str], export: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_bytes(b"\x1f\x8b\x08")
    code, lines, err = run(capfd, "assess", str(bad), str(export), *QUICK, "--uncertainty-samples", "0", "--json", "-")
    assert code == 2
    assert decode(Rejection, lines[0]).source == "bad.csv"
    assert decode(Verdict, lines[1]).samples == 0
    assert "UNREADABLE" in err


@pytest.mark.parametrize(
    ("name", "stated"),
    [
        ("railprof.txt", []),
        ("euro.csv", []),
        ("footer.csv", []),
        ("desc.csv", []),
        ("trail.csv", []),
        ("spike.csv", []),
    ],
)
def test_the_shared_files_come_out_as_the_weld_they_are_of(
    capfd: pytest.CaptureFixture[str], name: str, stated: list[str]
) -> None:
    """A rise of 0.2 mm over 250 mm: 113.2 kN at 80 km/h and 125.9 at 160, as the note on these files says."""
    code, (line,), _ = run(capfd, "simulate", str(SHARED / name), *QUICK, *stated, "--json", "-")
    assert code == 0
    assert decode(ForceMap, line).peak_force_n == pytest.approx([113.2e3, 125.9e3], rel=0.02)


@pytest.mark.parametrize("name", ["steep.csv", "mm_as_um.csv"])
def test_the_shared_files_that_are_no_weld_are_refused(capfd: pytest.CaptureFixture[str], name: str) -> None:
    code, lines, err = run(capfd, "simulate", str(SHARED / name), *QUICK, "--json", "-")
    assert (code, lines) == (2, [])
    assert "check z_unit" in err
    assert len(err.strip().splitlines()) == 1


def test_options_that_cannot_be_are_one_line(capfd: pytest.CaptureFixture[str], export: Path) -> None:
    for options, word in (
        (["--format", "nowhere.yaml"], "nowhere.yaml"),
        (["--noise", "much"], "auto, none"),
        (["--contact-patch", "wide"], "on or off"),
    ):
        code, _, err = run(capfd, "simulate", str(export), *QUICK, *options)
        assert code == 2
        assert word in err
        assert len(err.strip().splitlines()) == 1


def test_contact_patch_and_noise_can_be_switched_off(capfd: pytest.CaptureFixture[str]) -> None:
    exact = ["simulate", "cosine-dip-48mm", *QUICK, "--json", "-"]
    _, (on,), _ = run(capfd, *exact)
    _, (off,), _ = run(capfd, *exact, "--contact-patch", "off", "--noise", "none")
    on_n, off_n = (max(decode(ForceMap, line).peak_force_n) for line in (on, off))
    assert 0.97 * off_n < on_n < off_n
