import re
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import platformdirs
import pytest
import yaml

from weld_force_ros.errors import InputError, TrackError
from weld_force_ros.physics.passage.hertz import ContactRadii
from weld_force_ros.physics.track.support import Spring, Support, TabulatedSpring
from weld_force_ros.simulation import fit_store, section_file, track_file
from weld_force_ros.simulation.settings import simulation_settings

BILBAO = track_file.load("bilbao").text

CONTINUOUS = """
name: tram
rail:
  mass_kg_per_m: 54.8
  area_cm2: 69.8
  second_moment_cm4: 2337
  youngs_modulus_gpa: 210
  shear_modulus_gpa: 81
  shear_coefficient: 0.4
supports:
  kind: continuous
  spacing_m: 0.75
  pad: {stiffness_kn_per_mm: 90, damping_kns_per_m: 12}
  half_sleeper_mass_kg: 110
  ballast: {stiffness_kn_per_mm: 70, loss_factor: 0.4, damping_kns_per_m: 3}
wheel: {mass_kg: 500, static_load_kn: 55, radius_m: 0.33, hertz_gn_per_m15: 88}
"""


LAYERED = """
name: three layers
rail: {section: 136RE}
supports:
  kind: periodic
  spacing_m: 0.6
  layers:
    - spring: {table: [[10, 90, 0.1], [1000, 120, 0.2]]}
    - mass_kg: 150
    - spring: {stiffness_kn_per_mm: 60, damping_kns_per_m: 30}
    - mass_kg: {value: 0, source: none}
    - spring: {stiffness_kn_per_mm: 120, loss_factor: 1}
wheel: {mass_kg: 500, static_load_kn: 55, radius_m: 0.33, hertz_gn_per_m15: 88}
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    return tmp_path / "weld_force_ros" / "fits"


@pytest.fixture
def fits_made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    made: list[str] = []
    real = fit_store.make
    monkeypatch.setattr(
        fit_store, "make", lambda definition, engine: (made.append(definition.track.name), real(definition, engine))[1]
    )
    return made


def test_users_file_is_read_into_si_units(tmp_path: Path):
    path = tmp_path / "tram.yaml"
    path.write_text(CONTINUOUS)
    found = track_file.load(str(path))
    assert found.track.name == "tram"
    assert found.track.continuous
    assert found.text == CONTINUOUS
    rail, (pad, ballast) = found.track.rail, found.track.support.springs
    assert (rail.mass_kg_per_m, rail.youngs_modulus_pa, rail.loss_factor) == (54.8, 210e9, 0.0)
    assert (rail.area_m2, rail.second_moment_m4) == pytest.approx((69.8e-4, 2337e-8))
    assert (pad.stiffness_n_per_m, pad.damping_ns_per_m, pad.loss_factor) == (90e6, 12e3, 0.0)
    assert (ballast.stiffness_n_per_m, ballast.damping_ns_per_m, ballast.loss_factor) == (70e6, 3e3, 0.4)
    assert (found.wheel.mass_kg, found.wheel.static_load_n, found.wheel.hertz_n_per_m15) == (500, 55e3, 88e9)


def test_layers_are_read_from_rail_to_ground():
    support = track_file.parse(LAYERED, "mine").track.support
    assert support == Support(
        (
            TabulatedSpring(((10.0, 90e6, 0.1), (1000.0, 120e6, 0.2))),
            Spring(60e6, 0.0, 30e3),
            Spring(120e6, 1.0),
        ),
        (150.0, 0.0),
    )


def test_a_sleeper_between_two_springs_is_the_same_track_in_either_form():
    text = track_file.load("johansson-nielsen").text
    lines, start = text.splitlines(), text.splitlines().index("  pad:")
    layers = """  layers:
    - spring: {stiffness_kn_per_mm: 120, damping_kns_per_m: 16}
    - mass_kg: 125
    - spring: {stiffness_kn_per_mm: 140, damping_kns_per_m: 165}""".splitlines()
    rewritten = "\n".join([*lines[:start], *layers, *lines[lines.index("wheel:") :]])
    ours, theirs = track_file.parse(rewritten, "mine"), track_file.load("johansson-nielsen")
    assert ours.track == theirs.track
    assert fit_store.key_of(ours) == fit_store.key_of(theirs)


@pytest.mark.parametrize(
    ("name", "mass_kg_per_m", "area_cm2", "second_moment_cm4"),
    [
        ("60E1", 60.21, 76.70, 3038.3),
        ("60E2", 60.03, 76.48, 3022),
        ("54E1", 54.77, 69.77, 2337.9),
        ("54E2", 53.82, 68.56, 2307.6),
        ("49E1", 49.39, 62.92, 1816),
        ("50E6", 50.90, 64.84, 2017.8),
        ("46E1", 46.17, 58.82, 1641.1),
        ("56E1", 56.30, 71.69, 2321),
        # of North America, by hand from lb/yd, square inches and inches to the fourth
        ("136RE", 136 * 0.45359237 / 0.9144, 13.32 * 2.54**2, 94.9 * 2.54**4),
        ("132RE", 131.6622 * 0.45359237 / 0.9144, 12.9124 * 2.54**2, 87.9 * 2.54**4),
        ("115RE", 114.3757 * 0.45359237 / 0.9144, 11.2171 * 2.54**2, 65.5 * 2.54**4),
        ("CHN60", 60.64, 77.45, 3217),
        ("CHN50", 51.514, 65.8, 2037),
        ("R65", 64.72, 82.65, 3540),
        ("AS60", 60.6, 77.25, 2930),
        ("AS50", 50.64, 64.51, 2010),
    ],
)
def test_rails_come_by_name(name: str, mass_kg_per_m: float, area_cm2: float, second_moment_cm4: float):
    rail = track_file.parse(LAYERED.replace("136RE", name), "mine").track.rail
    assert rail.mass_kg_per_m == pytest.approx(mass_kg_per_m, rel=2e-3)
    assert rail.area_m2 == pytest.approx(area_cm2 * 1e-4, rel=1e-3)
    assert rail.second_moment_m4 == pytest.approx(second_moment_cm4 * 1e-8, rel=1e-3)
    # One steel: density within half a per cent, and a radius of gyration of some 36 % of the height of any rail.
    assert rail.mass_kg_per_m / rail.area_m2 == pytest.approx(7845, rel=5e-3)
    steel = (rail.youngs_modulus_pa, rail.shear_modulus_pa, rail.shear_coefficient, rail.loss_factor)
    assert steel == (210e9, 81e9, 0.4, 0.01)
    assert section_file.load(name).source


def test_a_file_that_states_its_steel_states_its_loss():
    assert track_file.parse(CONTINUOUS, "tram.yaml").track.rail.loss_factor == 0.0


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("    - mass_kg: 150\n", "", "supports.layers are spring, spring, mass, spring; from rail to ground"),
        ("    - spring: {table: [[10, 90, 0.1], [1000, 120, 0.2]]}\n", "", "supports.layers are mass, spring"),
        ("mass_kg: 150", "mass_kg: -150", "supports.layers[2].mass_kg is -150"),
        ("- mass_kg: 150", "- {mass_kg: 150, spring: {stiffness_kn_per_mm: 1}}", "[2] is not one spring, mass_kg or"),
        ("- mass_kg: 150", "- {}", "supports.layers[2] is not one spring, mass_kg or sleeper"),
        ("{stiffness_kn_per_mm: 60, damping", "{damping", "supports.layers[3].spring.stiffness_kn_per_mm is missing"),
        (", damping_kns_per_m: 30", "", "supports.layers[3].spring has no damping"),
        ("damping_kns_per_m: 30", "width_m: 0.2", "supports.layers[3].spring.width_m is not of the spring under"),
        ("[1000, 120, 0.2]", "[5, 120, 0.2]", "supports.layers[1].spring.table[2] has 5 Hz after 10"),
        ("[1000, 120, 0.2]", "[1000, -120, 0.2]", "supports.layers[1].spring.table[2] kN/mm is -120"),
        (", [1000, 120, 0.2]", "", "length >= 2"),
        ("{table:", "{stiffness_kn_per_mm: 9, table:", "supports.layers[1].spring has a table beside other numbers"),
        ("[10, 90, 0.1], [1000, 120, 0.2]", "[10, 90, 0], [1000, 120, 0]", "supports.layers[1].spring has no damping"),
        ("  layers:", "  half_sleeper_mass_kg: 150\n  layers:", "supports has layers beside pad"),
        ("section: 136RE", "section: 137RE", "rail.mass_kg_per_m is missing; give it, or name 115RE, 132RE"),
        ("section: 136RE", "section: 136RE, model: finite-strip", "finite strips of section '136RE', whose outline is"),
        ("section: 136RE", "section: {name: a, description: b, source: c, height_mm: 150, standard: {mass_kg_per_m: 6, "
         "area_cm2: 7, second_moment_cm4: 3}}", "rail.section has height_mm without the rest"),
    ],
    ids=lambda text: text[:40],
)  # fmt: skip
def test_layers_and_rails_that_cannot_be_are_refused_with_one_line(old: str, new: str, complaint: str):
    assert old in LAYERED
    with pytest.raises(TrackError, match=re.escape(complaint)) as caught:
        track_file.parse(LAYERED.replace(old, new, 1), "mine.yaml")
    assert str(caught.value).startswith("track file mine.yaml:")
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


RADII = LAYERED.replace("hertz_gn_per_m15: 88", "transverse_radius_m: 5").replace(
    "section: 136RE", "section: 136RE, crown_radius_m: 0.25"
)


def test_hertz_constant_of_a_track_follows_from_radii(tmp_path: Path):
    found = track_file.parse(RADII, "mine.yaml")
    assert found.wheel.hertz_n_per_m15 == ContactRadii(found.wheel.radius_m, 0.25, 5.0).hertz_n_per_m15
    path = tmp_path / "mine.yaml"
    path.write_text(RADII)
    settings = simulation_settings(track=str(path), wheel_radius_m=0.42)
    assert settings.hertz_n_per_m15 == ContactRadii(0.42, 0.25, 5.0).hertz_n_per_m15
    assert simulation_settings(track=str(path), hertz_n_per_m15=9e10).hertz_n_per_m15 == 9e10


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("transverse_radius_m: 5", "hertz_gn_per_m15: 90", "wheel.hertz_gn_per_m15 beside rail.crown_radius_m"),
        (", crown_radius_m: 0.25", "", "wheel.transverse_radius_m without rail.crown_radius_m; give both"),
        ("crown_radius_m: 0.25", "crown_radius_m: 25", "rail.crown_radius_m is 25; give a number from 0.05 to 2"),
        ("transverse_radius_m: 5", "transverse_radius_m: -0.25", "wheel.transverse_radius_m is -0.25, hollower than"),
        ("transverse_radius_m: 5", "transverse_radius_m: 0", "wheel.transverse_radius_m is 0"),
        ("section: 136RE, crown_radius_m: 0.25", "section: 136RE", "wheel.transverse_radius_m without"),
    ],
)
def test_radii_that_cannot_be_are_refused_with_one_line(old: str, new: str, complaint: str):
    assert old in RADII
    with pytest.raises(TrackError, match=re.escape(complaint)) as caught:
        track_file.parse(RADII.replace(old, new, 1), "mine.yaml")
    assert "\n" not in str(caught.value)


def test_a_wheel_needs_its_hertz_constant_or_a_crown():
    with pytest.raises(TrackError, match=r"wheel\.hertz_gn_per_m15 is missing; give it, or rail\.crown_radius_m"):
        track_file.parse(LAYERED.replace(", hertz_gn_per_m15: 88", ""), "mine.yaml")


SLEEPER = (
    "    - sleeper: {mass_kg: 286, length_m: 2.6, seat_spacing_m: 1.5, area_cm2: 452, second_moment_cm4: 12167,"
    " youngs_modulus_gpa: 46.3, shear_modulus_gpa: 19.3, loss_factor: 0.016, bed: seats}\n"
)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("mass_kg: 286", "mass_kg: 0", "supports.layers[2].sleeper.mass_kg is 0; give a number from"),
        (
            "seat_spacing_m: 1.5",
            "seat_spacing_m: 2.7",
            "supports.layers[2].sleeper.seat_spacing_m is 2.7; give",
        ),
        ("length_m: 2.6", "length_m: 260", "supports.layers[2].sleeper.length_m is 260"),
        ("area_cm2: 452, ", "", "area_cm2"),
        ("bed: seats", "bed: ends", "ends"),
        ("- sleeper:", "- mass_kg: 9\n      sleeper:", "supports.layers[2] is not one spring, mass_kg or sleeper"),
    ],
)
def test_sleepers_that_cannot_be_are_refused_with_one_line(old: str, new: str, complaint: str):
    text = LAYERED.replace("    - mass_kg: 150\n", SLEEPER)
    assert track_file.parse(text, "mine.yaml").track.support.mass_kg == pytest.approx(143)
    assert old in text
    with pytest.raises(TrackError, match=re.escape(complaint)) as caught:
        track_file.parse(text.replace(old, new, 1), "mine.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", track_file.shipped())
def test_every_number_of_a_shipped_track_names_its_source(name: str):
    def walk(node: dict) -> Iterator[tuple[str, object]]:
        for key, value in node.items():
            if isinstance(value, list):
                for layer in value:
                    yield from walk(layer)
            elif isinstance(value, dict) and "value" not in value:
                yield from walk(value)
            else:
                yield key, value

    for key, value in walk(yaml.safe_load(track_file.load(name).text)):
        if not isinstance(value, str):
            assert isinstance(value, dict), f"{key} has no source"
            assert len(value["source"]) > 5


def test_sources_and_layout_are_no_part_of_a_fits_identity():
    bare = re.sub(r"\{value: ([\d.]+), source: \"[^\"]*\"\}", r"\1", BILBAO)
    assert "source" not in bare
    renamed = bare.replace("name: bilbao", "name: my own")
    key = fit_store.key_of(track_file.load("bilbao"))
    assert fit_store.key_of(track_file.parse(renamed, "renamed")) == key
    assert fit_store.key_of(track_file.parse(bare.replace("348.6", "348.7"), "softer")) != key


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("half_sleeper_mass_kg: 110", "", "half_sleeper_mass_kg"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: -110", "half_sleeper_mass_kg is -110"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: .nan", "half_sleeper_mass_kg is nan"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: .inf", "half_sleeper_mass_kg is inf"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: heavy", "half_sleeper_mass_kg"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: true", "half_sleeper_mass_kg"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: 1" + "0" * 400, "out of range"),
        ("half_sleeper_mass_kg: 110", "half_sleeper_mass_kg: 1" + "0" * 5000, "digits"),
        ("mass_kg_per_m", "mass_lb_per_yd", "mass_lb_per_yd"),
        ("damping_kns_per_m: 12", "loss_factor: 0", "supports.pad has no damping"),
        ("spacing_m: 0.75", "spacing_m: 75", "spacing_m is 75; give a number from 0.2 to 2"),
        ("kind: continuous", "kind: floating", "floating"),
        ("name: tram", "name: ''", "name"),
        ("name: tram", "name: 2001-13-45", "month"),
        ("name: tram", "name: !!timestamp tram", "tags"),
        ("name: tram", "name: &n [*n]", "anchors"),
        ("name: tram", "name: " + "[" * 60_000, "nested"),
        ("name: tram", "name: " + "x" * 70_000, "65536"),
        ("name: tram", "name: [", "line"),
        ("name: tram", "name: \ud800", "surrogates"),
    ],
    ids=lambda text: text[:40],
)
def test_file_that_is_no_track_is_refused_with_one_line(old: str, new: str, complaint: str):
    assert old in CONTINUOUS
    with pytest.raises(TrackError, match=re.escape(complaint)) as caught:
        track_file.parse(CONTINUOUS.replace(old, new, 1), "tram.yaml")
    assert str(caught.value).startswith("track file tram.yaml:")
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


def test_yaml_bomb_is_refused_at_once():
    bomb = "a0: &a0 {k: v}\n" + "".join(
        f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}\n" for i in range(1, 12)
    )
    with pytest.raises(TrackError, match="anchors"):
        track_file.parse(bomb, "bomb.yaml")


@pytest.mark.parametrize("name", ["no-such-track", "x" * 5000 + ".yaml", "\0.yaml", "..", "missing.yaml"])
def test_unknown_track_is_refused_with_the_names_there_are(name: str):
    with pytest.raises(InputError, match="bilbao, bilbao-causal, bilbao-continuous"):
        track_file.load(name)


def test_binary_file_is_refused(tmp_path: Path):
    path = tmp_path / "image.yaml"
    path.write_bytes(b"\x89PNG\xff\xfe\0")
    with pytest.raises(TrackError, match=r"image\.yaml"):
        track_file.load(str(path))


def test_shipped_tracks_need_no_fitting(cache: Path, fits_made: list[str]):
    for name in track_file.shipped():
        fit_store.fitted(track_file.load(name))
    assert fits_made == []
    assert not cache.exists()


def test_own_track_is_fitted_once_and_then_read(cache: Path, fits_made: list[str]):
    definition, told = track_file.parse(CONTINUOUS, "tram.yaml"), []
    first = fit_store.fitted(definition, on_fit=told.append)
    again = fit_store.fitted(definition, on_fit=told.append)
    assert fits_made == ["tram"]
    assert len(told) == 1
    assert "tram" in told[0]
    assert msgspec.to_builtins(again) == msgspec.to_builtins(first)
    assert [path.name for path in cache.iterdir()] == [f"{fit_store.key_of(definition)}.json"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda data: b"",
        lambda data: b"\xff" * 100,
        lambda data: re.sub(rb'("residues_re": \[)[^,]*,', rb"\1", data),
        lambda data: data.replace(b'"key": "', b'"key": "x'),
    ],
    ids=["cut", "empty", "binary", "a residue short", "another key"],
)
def test_damaged_cache_entry_is_made_anew(damage, cache: Path, fits_made: list[str]):
    definition = track_file.parse(CONTINUOUS, "tram.yaml")
    good = fit_store.fitted(definition)
    entry = cache / f"{good.key}.json"
    damaged = damage(entry.read_bytes())
    assert damaged != entry.read_bytes()
    entry.write_bytes(damaged)
    assert fit_store.fitted(definition).poles_re_rad_s == pytest.approx(good.poles_re_rad_s, rel=1e-6)
    assert len(fits_made) == 2
    fit_store.fitted(definition)
    assert len(fits_made) == 2


def test_unwritable_cache_costs_only_time(cache: Path):
    cache.parent.write_text("a file where the folder should be")
    fit = fit_store.fitted(track_file.parse(CONTINUOUS, "tram.yaml"))
    assert fit.model().order == fit.order


def test_track_name_is_never_a_path(cache: Path):
    definition = track_file.parse(CONTINUOUS.replace("name: tram", r'name: "../../tram\0"'), "tram.yaml")
    fit_store.fitted(definition)
    assert len(list(cache.iterdir())) == 1


def test_fit_file_gives_back_its_model():
    fit = fit_store.make(track_file.parse(CONTINUOUS, "tram.yaml"))
    model = fit.model()
    assert model.residues.shape == (1, len(model.poles_rad_s))
    assert np.all(model.poles_rad_s.real < 0)
    assert len(fit.bands_hz) == 2 * len(fit.error_by_band)
    assert fit.spacing_m == 0.75
