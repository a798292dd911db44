"""`weld-force track identify`: from a hammer test's file to a track file that can be simulated with."""

import json
from pathlib import Path

import numpy as np
import pytest

from weld_force_ros.cli.main import main
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.simulation import track_file

TRACK = track_file.load("concrete-soft-pads").track


@pytest.fixture
def hammer_test(tmp_path: Path) -> Path:
    hz = np.arange(20.0, 1600.0, 10.0)
    mobility = 2j * np.pi * hz * receptance(TRACK, hz, TRACK.spacing_m * np.array([0.0, 0.5]))
    rows = np.column_stack([hz, mobility[0].real, mobility[0].imag, mobility[1].real, mobility[1].imag])
    path = tmp_path / "hammer.csv"
    path.write_text(
        "# unit: m/s/N\nfrequency_hz,sleeper_real,sleeper_imag,midspan_real,midspan_imag\n"
        + "\n".join(",".join(f"{v:.8g}" for v in row) for row in rows)
    )
    return path


def test_a_measured_track_is_one_to_simulate_with(hammer_test: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    out, plot = tmp_path / "mine.yaml", tmp_path / "mine.png"
    arguments = [
        "--like",
        "bilbao",
        "--half-sleeper-mass",
        "150",
        "--out",
        str(out),
        "--plot",
        str(plot),
        "--json",
        "-",
    ]
    assert main(["track", "identify", str(hammer_test), *arguments]) == 0
    printed = capfd.readouterr()
    content = json.loads(printed.out)
    assert content["parameters"]["pad_n_per_m"]["value"] == pytest.approx(85.4e6, rel=1e-3)
    assert content["misfit"]["0.0"] < 1e-4
    assert "pad stiffness" in printed.err
    assert "85.4" in printed.err
    assert "unloaded" in printed.err
    assert plot.stat().st_size > 10_000
    written = track_file.load(str(out))
    assert (written.track.name, written.wheel) == ("mine", track_file.load("bilbao").wheel)
    for own, true in zip(written.track.support.springs, TRACK.support.springs, strict=True):
        assert own.stiffness_n_per_m == pytest.approx(true.stiffness_n_per_m, rel=1e-3)
        assert own.damping_ns_per_m == pytest.approx(true.damping_ns_per_m, rel=1e-3)
    assert "identified from hammer.csv (sha256 " in out.read_text()
    assert "20 to 1500 Hz" not in out.read_text()
    assert "30 to 1500 Hz" in out.read_text()


def test_rail_spacing_and_mass_can_be_others(hammer_test: Path, tmp_path: Path):
    out = tmp_path / "other.yaml"
    arguments = [
        "--rail",
        "54E1",
        "--spacing",
        "0.65",
        "--find-sleeper-mass",
        "--damping",
        "loss-factor",
        "--out",
        str(out),
    ]
    assert main(["track", "identify", str(hammer_test), *arguments]) == 0
    track = track_file.load(str(out)).track
    assert (track.spacing_m, track.rail.mass_kg_per_m) == (0.65, pytest.approx(54.77))
    assert not track.causal
    assert "identified" in out.read_text().split("half_sleeper_mass_kg")[1].split("ballast:")[0]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--band", "5"], "--band '5' cannot be read; write FROM:TO in Hz, such as 30:1500"),
        (["--band", "900:100"], "no band of positive frequencies"),
        (["--band", "30:60"], "hammer.csv: 4 frequencies of 30 to 60 Hz; give another --band: 10 are needed"),
        (["--damping", "oil"], "--damping 'oil' is not known"),
        (["--like", "nowhere"], "no track 'nowhere'; use bending-sleepers, bilbao"),
        (["--like", "embedded-rail"], "has no sleepers between pad and ballast; give --half-sleeper-mass"),
        (["--rail", "99X"], "rail.mass_kg_per_m is missing"),
        (["--spacing", "60"], "supports.spacing_m is 60; give a number from 0.2 to 2"),
        (["--half-sleeper-mass", "0"], "--half-sleeper-mass 0; give 5 to 1000 kg"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], complaint: str, hammer_test: Path, capfd: pytest.CaptureFixture):
    assert main(["track", "identify", str(hammer_test), *arguments]) == 2
    printed = capfd.readouterr()
    assert complaint in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""


def test_a_file_is_not_written_over(hammer_test: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    out = tmp_path / "mine.yaml"
    out.write_text("mine")
    assert main(["track", "identify", str(hammer_test), "--out", str(out)]) == 2
    assert "is there already" in capfd.readouterr().err
    assert out.read_text() == "mine"


def test_the_causal_twin_is_a_track_to_simulate_with(tmp_path: Path, capfd: pytest.CaptureFixture):
    out = tmp_path / "mine.yaml"
    assert main(["track", "causal", "bilbao", "--out", str(out), "--json", "-"]) == 0
    printed = capfd.readouterr()
    content = json.loads(printed.out)
    assert 0.1 < content["difference"] < 0.13
    assert "no track that answers after it is pushed" in " ".join(printed.err.split())
    found, given = track_file.load(str(out)), track_file.load("bilbao")
    assert found.track.causal
    assert found.track.rail == given.track.rail
    assert found.wheel == given.wheel
    bundled = track_file.load("bilbao-causal").track.support
    assert found.track.support.masses_kg == bundled.masses_kg
    for spring, as_bundled in zip(found.track.support.springs, bundled.springs, strict=True):
        np.testing.assert_allclose(spring.rows, as_bundled.rows, rtol=1e-4)  # versions of SciPy differ in last digits
    assert main(["track", "causal", "bilbao", "--out", str(out)]) == 2
    assert "is there already" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["bilbao-viscous"], "is causal already"),
        (["bilbao", "--at", "-1"], "--at -1 Hz"),
        (["bilbao", "--at", "nan"], "--at nan Hz"),
        (["no-such-track"], "no-such-track"),
    ],
)
def test_what_has_no_twin_is_one_line(arguments: list[str], says: str, capfd: pytest.CaptureFixture):
    assert main(["track", "causal", *arguments]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert says in line
