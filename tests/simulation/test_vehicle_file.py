"""Vehicles by name: their numbers as their sources give them, and files of one's own."""

import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.physics.passage.hertz import ContactRadii
from weld_force_ros.simulation import vehicle_file
from weld_force_ros.simulation.settings import simulation_settings

G = 9.81


@pytest.mark.parametrize(
    ("name", "static_load_n", "unsprung_mass_kg"),
    [
        # Masses of body, two bogies and four wheelsets, an eighth of them a wheel; half a wheelset.
        ("passenger", (32000 + 2 * 2615 + 4 * 1813) / 8 * G, 1813 / 2),
        ("high-speed", (47800 + 2 * 3500 + 4 * 1800) / 8 * G, 1800 / 2),
        # Of one rail: half a body on four wheels, half a bogie on two, a wheel.
        ("locomotive", (27500 / 4 + 3000 / 2 + 2250) * G, 2250),
        ("freight-22.5t", 22.5e3 / 2 * G, 700),
        ("metro", 66.1e3, 1539 / 2),
    ],
)
def test_a_bundled_vehicle_is_what_its_source_makes_of_it(name: str, static_load_n: float, unsprung_mass_kg: float):
    vehicle = vehicle_file.load(name)
    assert vehicle.static_load_n == pytest.approx(static_load_n, rel=2e-3)
    assert vehicle.unsprung_mass_kg == pytest.approx(unsprung_mass_kg, rel=2e-3)
    assert 0.4 <= vehicle.wheel_radius_m <= 0.5
    assert len(vehicle.sources) == 3
    assert all("read 2026-11-28" in text or "judgement" in text or "Esveld" in text for text in vehicle.sources)


def test_settings_take_the_vehicles_wheel_and_what_is_stated_goes_before_it():
    settings = simulation_settings(track="bilbao", vehicle="freight-22.5t", wheel_radius_m=0.43)
    assert (settings.vehicle, settings.static_load_n, settings.wheel_mass_kg) == ("freight-22.5t", 110.4e3, 700.0)
    assert settings.wheel_radius_m == 0.43
    assert settings.hertz_n_per_m15 == simulation_settings(track="bilbao").hertz_n_per_m15


def test_a_file_of_ones_own(tmp_path):
    own = tmp_path / "railcar.yaml"
    own.write_text(
        "name: railcar\nstatic_load_kn: 45\nunsprung_mass_kg: {value: 500, source: weighed}\nwheel_radius_m: 0.385\n"
        "hertz_gn_per_m15: 90\n"
    )
    vehicle = vehicle_file.load(str(own))
    assert (vehicle.name, vehicle.static_load_n, vehicle.hertz_n_per_m15) == ("railcar", 45e3, 90e9)
    assert vehicle.sources == ("weighed",)


OWN = "name: railcar\nstatic_load_kn: 45\nunsprung_mass_kg: 500\nwheel_radius_m: 0.385\n"


def test_hertz_constant_follows_from_radii_where_they_are_stated(tmp_path):
    of_track = simulation_settings(track="bilbao")
    crowned = simulation_settings(track="bilbao", crown_radius_m=0.3)
    assert crowned.hertz_n_per_m15 == ContactRadii(0.45, 0.3).hertz_n_per_m15
    assert crowned.contact_patch_m == of_track.contact_patch_m
    flatter = simulation_settings(track="bilbao", crown_radius_m=0.5)
    assert flatter.hertz_n_per_m15 == pytest.approx(105.98e9, rel=1e-3)
    assert flatter.contact_patch_m < of_track.contact_patch_m
    smaller = simulation_settings(track="bilbao", crown_radius_m=0.3, wheel_radius_m=0.40)
    assert smaller.hertz_n_per_m15 == ContactRadii(0.40, 0.3).hertz_n_per_m15
    own = tmp_path / "worn.yaml"
    own.write_text(OWN + "wheel_transverse_radius_m: {value: -0.5, source: measured}\n")
    hollow = simulation_settings(track="bilbao", vehicle=str(own))
    assert hollow.hertz_n_per_m15 == ContactRadii(0.385, 0.3, -0.5).hertz_n_per_m15
    own.write_text(OWN + "hertz_gn_per_m15: 90\n")
    assert simulation_settings(track="bilbao", vehicle=str(own)).hertz_n_per_m15 == 90e9
    assert simulation_settings(track="bilbao", vehicle=str(own), crown_radius_m=0.3).hertz_n_per_m15 < 89.9e9


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"crown_radius_m": 0.3, "hertz_n_per_m15": 9e10}, "hertz_n_per_m15 beside crown_radius_m, which gives it"),
        ({"crown_radius_m": 300.0}, "crown_radius_m is 300; give a number from 0.05 to 2"),
        ({"crown_radius_m": float("nan")}, "crown_radius_m is nan"),
        ({"crown_radius_m": 0.6}, "a tread of -0.5 m is hollower than the crown of 0.6 m"),
    ],
)
def test_radii_that_cannot_be_are_one_line(given, complaint: str, tmp_path):
    own = tmp_path / "worn.yaml"
    own.write_text(OWN + "wheel_transverse_radius_m: -0.5\n")
    with pytest.raises(InputError, match=complaint):
        simulation_settings(track="bilbao", vehicle=str(own), **given)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (OWN + "hertz_gn_per_m15: 90\nwheel_transverse_radius_m: 0.5\n", "beside wheel_transverse_radius_m"),
        ("name: x\nstatic_load_kn: -1\nunsprung_mass_kg: 1\nwheel_radius_m: 1\n", "static_load_kn"),
        ("name: x\nstatic_load_kn: 1\nunsprung_mass_kg: 1\n", "wheel_radius_m"),
        ("name: x\nstatic_load_kn: 1\nunsprung_mass_kg: 1\nwheel_radius_m: 1\naxles: 4\n", "axles"),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line(tmp_path, text: str, complaint: str):
    file = tmp_path / "own.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        vehicle_file.load(str(file))
    assert "\n" not in str(caught.value)


def test_an_unknown_vehicle_lists_those_that_there_are():
    with pytest.raises(InputError, match=r"vehicle 'tram' is unknown; use freight-22\.5t, .*passenger"):
        vehicle_file.load("tram")
