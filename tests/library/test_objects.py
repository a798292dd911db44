"""What the objects of the library say, refuse and keep."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import weld_force_ros as wf

X = np.arange(-50, 51) * 5e-3
Z = -1e-4 * np.exp(-((X / 0.04) ** 2))


def test_waves_of_the_cut_off_length_keep_half_their_amplitude():
    """As ISO 16610-21 defines it; half of it 1/16, twice of it 2^(-1/4)."""
    x = np.arange(-2000, 2001) * 1e-3
    for length_m, kept in ((0.2, 0.5), (0.1, 1 / 16), (0.4, 0.5**0.25)):
        wave = wf.Profile(x, 1e-4 * np.cos(2 * np.pi * x / length_m), centre_m=0.0).smoothed(0.2)
        inside = np.abs(x) < 0.5
        assert np.abs(wave.z_m[inside]).max() == pytest.approx(1e-4 * kept, rel=0.01)


def test_a_gradient_of_a_ramp_is_its_slope_less_the_chord():
    x = np.arange(-120, 121) * 5e-3
    ramp = wf.Profile(x, 2e-3 * np.clip(x, 0, None), centre_m=0.0)  # 2 mrad from the centre on: the chord has 1 mrad
    slope = ramp.gradient()
    assert float(slope.sel(x_m=0.3, method="nearest")) == pytest.approx(1e-3)
    assert float(slope.sel(x_m=-0.3, method="nearest")) == pytest.approx(-1e-3)
    index = ramp.quality_index(170)  # the norm there: halfway between 3.2 and 1.0 mrad
    assert float(index.max()) == pytest.approx(1e-3 / 2.1e-3)


def test_a_weld_turned_round_is_met_the_other_way():
    weld, model = wf.read_profile("weld-4-steep-ramp"), wf.Model("bilbao")
    places = [0.1, 0.25, 0.5]  # mirrored in the span of 0.6 m: 0.5, 0.35, 0.1
    straight = model.force_map(weld, [80.0, 120.0], places).peak_force_n
    turned = model.force_map(weld.reversed(), [80.0, 120.0], [0.1, 0.35, 0.5]).peak_force_n
    np.testing.assert_allclose(turned.sel(running="with").values[:, ::-1], straight.sel(running="against"), rtol=1e-6)


def test_a_track_of_parts_is_that_of_a_file(tmp_path: Path):
    parts = {"pad_stiffness_n_per_m": 348.6e6, "pad_loss_factor": 0.29, "half_sleeper_mass_kg": 162.0}
    parts |= {"ballast_stiffness_n_per_m": 50e6, "ballast_loss_factor": 1.0}
    own, bundled = wf.Track.from_parts(**parts, name="bilbao again"), wf.Track("bilbao")
    h = own.receptance([50.0, 500.0], 0.2)
    np.testing.assert_allclose(h, bundled.receptance([50.0, 500.0], 0.2), rtol=5e-3)  # 60E1 of the section's file
    assert h.dims == ("frequency_hz",)
    own.save(tmp_path / "own.yaml")
    assert wf.Model(str(tmp_path / "own.yaml")).settings().track_definition == own.definition.text


def test_what_a_vehicle_is_made_of_reaches_the_simulation():
    vehicle = wf.Vehicle.from_parts(static_load_n=40e3, unsprung_mass_kg=450, wheel_radius_m=0.3, name="tram")
    settings = wf.Model("bilbao", vehicle).settings()
    assert (settings.static_load_n, settings.wheel_mass_kg, settings.wheel_radius_m) == (40e3, 450.0, 0.3)
    assert settings.vehicle == "tram"


def test_a_folder_is_read_as_far_as_it_can_be(tmp_path: Path):
    statements = "# x_unit: mm\n# z_unit: um\n# z_positive: up\nx,z\n"
    rows = "".join(f"{1e3 * x:g},{1e6 * z:.3f}\n" for x, z in zip(X, Z, strict=True))
    (tmp_path / "a.csv").write_text(statements + rows)
    (tmp_path / "b.csv").write_text("x,z\n" + rows)
    (tmp_path / "c.csv.part").write_text("half")
    problems: list[wf.ProfileError] = []
    (weld,) = wf.read_profiles(tmp_path, on_problem=problems.append)
    assert weld.weld_id == "a"
    (problem,) = problems
    assert "b.csv" in problem.reason
    with pytest.warns(UserWarning, match="b.csv"):
        wf.read_profiles(tmp_path)
    assert len(wf.read_profiles(tmp_path, x_unit="mm", z_unit="um", z_positive="up")) == 2


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: wf.Profile(X, Z[:-1]), "101 positions but 100 heights"),
        (lambda: wf.Profile(X[::-1], Z), "x does not increase from sample 1"),
        (lambda: wf.Profile(X * 10, Z), "spacing 50 mm after sample 2, at most 10 mm"),
        (lambda: wf.Profile(X, Z * 1e3), "amplitude 100 mm, at most 10 mm"),
        (lambda: wf.Profile(X, np.where(X == 0, np.nan, Z)), "sample 51: z is not a finite number"),
        (lambda: wf.Profile(X, np.stack([Z, Z])), "x_m of shape (101,) and z_m of shape (2, 101)"),
        (lambda: wf.Profile(X, Z, running="backwards"), "running"),
        (lambda: wf.Profile(X, Z, noise="some"), "noise 'some'"),
        (lambda: wf.Profile(X, Z).assign(speed=3), "speed cannot be stated"),
        (lambda: wf.Profile(X, Z).quality_index(), "the line's speed is not known"),
        (lambda: wf.Model("bilbao", engine="magic"), "engine 'magic'"),
        (lambda: wf.Model("bilbao").force_map(wf.Profile(X, Z), [80, 60]), "must increase"),
        (lambda: wf.Model("bilbao").force_map(wf.Profile(X, Z), [80], 0), "positions is 0"),
        (lambda: wf.Model("bilbao").force_map(wf.Profile(X, Z, weld_position_m=30), [80], 2), "30 m lies beyond"),
        (lambda: wf.Model("bilbao").passage(wf.Profile(X, Z), 80), "its position in the span is not known"),
        (lambda: wf.Model("bilbao").passage(wf.Profile(X, Z), 80, 0.1, running="both"), "'both' is not one direction"),
        (lambda: wf.Track("bilbao").receptance([0.0]), "a frequency is not positive"),
        (lambda: wf.Track("bilbao").save("track.txt"), "no ending .yaml"),
        (lambda: wf.Vehicle.from_parts(static_load_n=-1, unsprung_mass_kg=1, wheel_radius_m=1), "static_load_n is -1"),
        (lambda: wf.Limits("en14730-2"), "ships without numbers"),
        (lambda: wf.assess(wf.Profile(X, Z), []), "no model to assess by"),
    ],
)
def test_bad_input_is_one_line_with_a_remedy(make, words: str):
    with pytest.raises(wf.InputError, match=re.escape(words)) as caught:
        make()
    assert caught.value.remedy
    assert "\n" not in str(caught.value)


def test_a_dataset_survives_netcdf(tmp_path: Path):
    found = wf.Model("bilbao").force_map(wf.Profile(X, Z), [80.0], 1)
    found.to_netcdf(tmp_path / "map.nc", engine="scipy")
    with xr.open_dataset(tmp_path / "map.nc", engine="scipy") as again:
        assert again.attrs == found.attrs
        np.testing.assert_array_equal(again.peak_force_n, found.peak_force_n)


def test_notebooks_show_text_from_outside_as_text():
    weld = wf.Profile(X, Z, weld_id="<script>alert(1)</script>")
    html = weld._repr_html_()
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    for shown in (wf.Track("bilbao"), wf.Vehicle("metro"), wf.Model("bilbao"), wf.Limits()):
        assert shown._repr_html_().startswith("<div>")
        assert len(repr(shown)) < 120
