"""The library gives the numbers of the command line, to the last bit."""

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import weld_force_ros as wf
from weld_force_ros.cli.main import main
from weld_force_ros.measurement.profile_file import write_profile
from weld_force_ros.messages import WeldProfile, decode
from weld_force_ros.recording.recording import open_recording

GRID = ("--track", "bilbao", "--speeds", "60,120,160", "--positions", "0.1,0.4")
SPEEDS, POSITIONS = [60.0, 120.0, 160.0], [0.1, 0.4]
WELD = "weld-4-steep-ramp"
DEMO = Path(__file__).parents[2] / "bags" / "demo"
HEADER = {"stamp", "publisher", "sequence", "elapsed_s"}


def command_line(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The JSON lines of a command."""
    monkeypatch.setattr(sys, "argv", ["weld-force", *arguments, "--json", "-"])
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):
        main()
    return [json.loads(line) for line in out.getvalue().splitlines()]


def cells(found: dict[str, Any], name: str) -> np.ndarray:
    shape = (len(found["speeds_kmh"]), len(found["positions_m"]))
    return np.stack([np.array(each[name]).reshape(shape) for each in (found, found["against"])], axis=-1)


def test_a_force_map_is_that_of_weld_force_simulate(monkeypatch: pytest.MonkeyPatch):
    (line,) = command_line("simulate", WELD, *GRID, monkeypatch=monkeypatch)
    model, weld = wf.Model("bilbao"), wf.read_profile(WELD)

    found = model.force_map(weld, SPEEDS, POSITIONS)

    assert found.peak_force_n.dims == ("speed_kmh", "position_m", "running")
    for name in ("peak_force_n", "peak_x_m", "min_force_n", "contact_loss_s", "p2_force_n", "force_20hz_n"):
        np.testing.assert_array_equal(found[name].values, cells(line, name))
    for name in ("config_sha256", "profile_sha256", "model_error", "span_m", "static_load_n", "track", "engine"):
        assert found.attrs[name] == line[name]
    assert found.running.values.tolist() == ["with", "against"]

    curve = model.force_curve(weld, SPEEDS, POSITIONS)
    np.testing.assert_array_equal(curve.speed_kmh.values, line["curve"]["speeds_kmh"])
    np.testing.assert_array_equal(curve.peak_force_n.values, line["curve"]["peak_force_n"])
    np.testing.assert_array_equal(curve.worst_position_m.values, line["curve"]["at_m"])
    np.testing.assert_array_equal(curve.worst_running.values == "against", line["curve"]["against"])


def test_many_maps_are_those_of_one_by_one():
    model, welds = wf.Model("bilbao"), wf.read_profiles(["weld-1", "weld-2", "weld-3"])
    for weld, found in zip(welds, model.force_maps(iter(welds), [80.0], 2), strict=True):
        alone = model.force_map(weld, [80.0], 2)
        assert found.equals(alone)
        assert found.attrs == alone.attrs


def test_a_verdict_is_that_of_weld_force_assess(monkeypatch: pytest.MonkeyPatch):
    (line,) = command_line("assess", WELD, *GRID, "--line-speed", "120", monkeypatch=monkeypatch)
    weld = wf.read_profile(WELD, line_speed_kmh=120)

    verdict = wf.assess(weld, wf.Model("bilbao"), speeds_kmh=SPEEDS, positions=POSITIONS)

    own = json.loads(msgspec.json.encode(verdict.message))
    assert {k: v for k, v in own.items() if k not in HEADER} == {k: v for k, v in line.items() if k not in HEADER}
    assert own["hanging"], "what hanging sleepers would do is in it"
    assert verdict.criteria["value"].tolist() == [criterion["value"] for criterion in line["criteria"]]
    assert verdict.force_map.sizes["sample"] == line["samples"]
    assert float(verdict.passage.force_n.max()) == pytest.approx(line["peak_force_n"], rel=1e-3)


def test_of_several_vehicles_the_one_that_decides_is_named(monkeypatch: pytest.MonkeyPatch):
    named = ("--vehicle", "metro", "--vehicle", "freight-22.5t", "--uncertainty-samples", "0")
    grid = ("--track", "bilbao-continuous", "--speeds", "60,120,160", "--positions", "1")
    (line,) = command_line("assess", WELD, *grid, *named, monkeypatch=monkeypatch)
    models = [wf.Model("bilbao-continuous", vehicle) for vehicle in ("metro", "freight-22.5t")]

    verdict = wf.assess(wf.read_profile(WELD), models, speeds_kmh=SPEEDS, positions=1, uncertainty_samples=0)

    assert verdict.message.vehicle == line["vehicle"]
    assert verdict.force_map.attrs["vehicle"] == line["vehicle"]
    assert verdict.message.peak_force_n == line["peak_force_n"]


def test_arrays_are_the_weld_that_a_file_of_them_is(tmp_path: Path):
    x = np.arange(-40, 41) * 5e-3
    z = -1.5e-4 * np.exp(-((x / 0.03) ** 2))
    of_arrays = wf.Profile(x, z, weld_id="dip", line_speed_kmh=140, weld_position_m=0.2, running="with")
    write_profile(of_arrays.message, tmp_path / "dip.csv")

    of_file = wf.read_profile(tmp_path / "dip.csv")

    assert of_file.profile_sha256 == of_arrays.profile_sha256
    model = wf.Model("bilbao")
    assert model.force_map(of_file, [80.0], 2).identical(model.force_map(of_arrays, [80.0], 2))
    noisy = wf.Profile(x, z, weld_id="dip", noise="auto")
    text = (tmp_path / "dip.csv").read_text().replace("noise: none", "noise: auto")
    (tmp_path / "noisy.csv").write_text(text)
    assert noisy.profile_sha256 == wf.read_profile(tmp_path / "noisy.csv").profile_sha256
    assert noisy.message.noise.noise_m > 0


def test_a_receptance_is_that_of_weld_force_receptance(monkeypatch: pytest.MonkeyPatch):
    asked = ("--track", "johansson-nielsen", "--at", "0.0,0.3", "--freq", "100,900")
    (line,) = command_line("receptance", *asked, monkeypatch=monkeypatch)
    found = wf.Track("johansson-nielsen").receptance([100.0, 900.0], [0.0, 0.3])
    np.testing.assert_array_equal(found.values.real.ravel(), line["real_m_per_n"])
    np.testing.assert_array_equal(found.values.imag.ravel(), line["imag_m_per_n"])


def test_a_recording_gives_what_was_recorded():
    recorded, recording = open_recording(DEMO), wf.Recording(DEMO)
    assert recording.verdicts["peak_force_n"].tolist() == [v.peak_force_n for v in recorded.verdicts]
    assert recording.verdicts["decision"].tolist() == [v.decision for v in recorded.verdicts]
    assert len(recording.criteria) == sum(len(v.criteria) for v in recorded.verdicts)
    assert [weld.profile_sha256 for weld in recording.profiles] == [key[1] for key in recorded.profiles]
    for found, message in zip(recording.maps, recorded.force_maps, strict=True):
        both = [message, *([message.against] if message.running == "both" else [])]
        largest = max(max(each.peak_force_n) for each in both)
        assert float(found.peak_force_n.max()) == largest
        assert found.weld_id.item() == message.weld_id


def test_messages_go_out_to_nodes_and_come_back():
    weld = wf.read_profile(WELD, line_speed_kmh=120)
    sent = decode(WeldProfile, msgspec.json.encode(weld.message))
    assert wf.Profile.from_message(sent).message == weld.message
