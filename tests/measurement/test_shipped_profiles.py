"""The profiles that come with the package: their formulas, their shapes, and how they are found."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.measurement.shapes import REFERENCE_SHAPES, cosine_dip, ramp
from weld_force_ros.physics.arrays import FloatArray

WHEEL_RADIUS_M = 0.45
INFERRED = tuple(f"weld-{number}" for number in range(1, 6))
ALL = sorted({*REFERENCE_SHAPES, *INFERRED})


def table_of(name: str) -> tuple[np.ndarray, np.ndarray]:
    """A shipped file's columns in m, by NumPy's reader."""
    x_mm, z_um = np.loadtxt(shipped()[name], delimiter=",", comments=["#", "x"], unpack=True)
    return x_mm * 1e-3, z_um * 1e-6


def test_every_formula_and_every_inferred_weld_is_shipped_and_nothing_else() -> None:
    assert sorted(shipped()) == ALL


@pytest.mark.parametrize("name", INFERRED)
def test_an_inferred_shape_says_what_it_is_and_how_it_was_found(name: str) -> None:
    header = "".join(line for line in shipped()[name].read_text(encoding="utf-8").splitlines() if line[0] == "#")
    for words in ("Inferred from the text", "not measured, not digitised", "study infer", "seed", "cost"):
        assert words in header


@pytest.mark.parametrize("name", sorted(REFERENCE_SHAPES))
def test_shipped_file_equals_its_formula(name: str) -> None:
    x_m, z_m = table_of(name)
    rounding_m = 0.5e-9 if name.startswith("weld-") else 0.5e-12
    np.testing.assert_allclose(z_m, REFERENCE_SHAPES[name](x_m), rtol=0, atol=1.01 * rounding_m)


@pytest.mark.parametrize("name", ALL)
def test_shipped_file_is_read_under_its_own_name(name: str) -> None:
    profile = read_profile(find(name))
    x_m, z_m = table_of(name)
    assert profile.weld_id == name
    np.testing.assert_allclose(profile.x_m, x_m - (x_m[0] + x_m[-1]) / 2, atol=1e-12)
    np.testing.assert_allclose(profile.z_m, z_m, atol=1e-12)


@pytest.mark.parametrize("name", ALL)
def test_shipped_profile_joins_the_rail_smoothly(name: str) -> None:
    x_m, z_m = table_of(name)
    assert z_m[0] == z_m[-1] == 0.0
    slope = np.diff(z_m) / np.diff(x_m)
    assert max(abs(slope[0]), abs(slope[-1])) < 1e-4
    assert np.abs(np.diff(slope)).max() < 0.10 * np.ptp(slope)  # a corner would turn by a large share at once
    assert np.diff(x_m).max() <= 0.005 + 1e-12


def largest_jump_of_contact(heights_m: np.ndarray, x_m: np.ndarray) -> float:
    """Return the largest jump of the contact point while the wheel's centre advances by one step; a bridge is one."""
    s = x_m[None, :] - x_m[:, None]
    gap = heights_m[None, :] - (WHEEL_RADIUS_M - np.sqrt(np.maximum(WHEEL_RADIUS_M**2 - s**2, 0.0)))
    return float(np.diff(x_m[gap.argmax(axis=1)]).max())


@pytest.mark.parametrize("name", ALL)
def test_wheel_touches_every_shipped_shape_in_one_point(name: str) -> None:
    x_m, _ = table_of(name)
    fine = np.linspace(x_m[0], x_m[-1], 1601)
    z_m = CubicSpline(*table_of(name))(fine) if name in INFERRED else REFERENCE_SHAPES[name](fine)
    share_of_wheel_curvature = np.gradient(np.gradient(z_m, fine), fine).max() * WHEEL_RADIUS_M
    assert share_of_wheel_curvature < (0.85 if name in {"wheel-flat-0.9mm", *INFERRED} else 0.25)
    # Where the profile's curvature is c, the contact advances by 1 / (1 - c R) per unit of the wheel's way.
    step = fine[1] - fine[0]
    assert largest_jump_of_contact(z_m, fine) < step / (1 - share_of_wheel_curvature) + 1.5 * step


def test_a_dip_sharper_than_the_wheel_would_be_found_out() -> None:
    x_m = np.linspace(-0.06, 0.06, 1601)
    assert largest_jump_of_contact(cosine_dip(x_m, 0.048, 0.5e-3), x_m) > 0.005


def test_wheel_flat_has_the_paper_depth_and_length() -> None:
    x_m, z_m = table_of("wheel-flat-0.9mm")
    assert z_m.min() == pytest.approx(-0.9e-3, abs=1e-12)
    assert np.ptp(x_m[z_m < 0]) == pytest.approx(0.1, abs=1.1e-3)
    assert "relative dip" in shipped()["wheel-flat-0.9mm"].read_text()


def test_cosine_dip_has_hand_worked_values() -> None:
    x_m = np.array([-0.03, -0.024, -0.012, 0.0, 0.008, 0.024, 0.03])
    # -d/2 (1 + cos 60 deg) = -3/4 d at a sixth of the length
    np.testing.assert_allclose(cosine_dip(x_m, 0.048, 40e-6) * 1e6, [0, 0, -20, -40, -30, 0, 0], atol=1e-9)
    _, dip = table_of("cosine-dip-48mm")
    _, rise = table_of("cosine-rise-48mm")
    np.testing.assert_array_equal(rise, -dip)
    assert (dip[:10] == 0).all()
    assert (dip[-10:] == 0).all()


def test_ramp_has_hand_worked_values() -> None:
    np.testing.assert_allclose(ramp(np.array([0.0, 1.0, 1.5, 2.0, 3.0]), 1.0, 2.0, 4.0), [0, 0, 2, 4, 4], atol=1e-12)


def test_weld_1_is_a_central_dip_with_the_wavelengths_of_the_paper() -> None:
    x_m, z_m = table_of("weld-1-dip")
    assert x_m[z_m.argmin()] == pytest.approx(0.5)
    assert -z_m.min() > 2 * z_m.max()
    cycles_per_m = np.linspace(0.5, 9.0, 3401)
    spectrum = np.abs(np.exp(-2j * np.pi * np.outer(cycles_per_m, x_m)) @ z_m)
    peak = (spectrum[1:-1] > spectrum[:-2]) & (spectrum[1:-1] > spectrum[2:]) & (spectrum[1:-1] > spectrum.max() / 2)
    np.testing.assert_allclose(1 / cycles_per_m[1:-1][peak], [0.55, 0.25, 0.165], rtol=0.08)


def extrema(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions and heights of the turning points of a shipped weld, in m and um."""
    x_m, z_m = table_of(name)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(z_m))[np.diff(z_m) != 0]) != 0) + 1
    kept = np.flatnonzero(np.diff(z_m) != 0)[turns]
    return x_m[kept], z_m[kept] * 1e6


def test_weld_2_rises_between_two_dips_the_first_larger() -> None:
    x_m, z_um = extrema("weld-2-rise-between-shrinkages")
    assert list(np.sign(z_um)) == [-1, 1, -1]
    assert x_m[0] == pytest.approx(0.47, abs=0.01)
    assert z_um[0] < z_um[2]
    assert z_um[1] == pytest.approx(-z_um[0], rel=0.2)


def test_weld_3_is_a_long_dip_between_two_protrusions() -> None:
    x_m, z_um = extrema("weld-3-long-ground-dip")
    assert list(np.sign(z_um)) == [1, -1, 1]
    assert -z_um[1] > 1.5 * z_um.max()
    _, heights = table_of("weld-3-long-ground-dip")
    assert (heights < 0).mean() > 0.4
    assert x_m[1] == pytest.approx(0.5, abs=0.02)


def test_weld_4_begins_with_the_steepest_ramp_of_all() -> None:
    steepest = {
        name: (np.diff(z) / np.diff(x)).max()
        for name in REFERENCE_SHAPES
        if name[:4] == "weld"
        for x, z in [table_of(name)]
    }
    assert max(steepest, key=lambda name: steepest[name]) == "weld-4-steep-ramp"
    x_m, z_m = table_of("weld-4-steep-ramp")
    assert x_m[np.diff(z_m).argmax()] < 0.25
    assert z_m.min() >= 0.0


def test_weld_5_is_a_protrusion_with_small_central_dips() -> None:
    x_m, z_um = extrema("weld-5-ramp-protrusion")
    _, z_m = table_of("weld-5-ramp-protrusion")
    dips = [z for x, z in zip(x_m, z_um, strict=True) if 0.35 < x < 0.65 and z < 0.9 * z_um.max()]
    assert len(dips) >= 2
    assert min(dips) > 0.5 * z_um.max()
    assert z_m.min() >= 0.0
    assert np.ptp(z_m) < 0.5 * np.ptp(table_of("weld-4-steep-ramp")[1])


def length_of_lowest_dip(height: FloatArray) -> int:
    """Return for how many samples about its lowest one a shape stays below half of that depth."""
    lowest = int(np.argmin(height))
    above = np.flatnonzero(height >= 0.5 * height[lowest])
    return int(above[above > lowest][0] - above[above < lowest][-1])


def test_inferred_shapes_are_what_the_captions_say() -> None:
    heights = {name: table_of(name)[1] * 1e6 for name in INFERRED}
    x_mm = table_of("weld-1")[0] * 1e3 - 500
    central = np.abs(x_mm) <= 100
    # 1: its distinguishing feature is a dip in the central region.
    assert abs(x_mm[np.argmin(heights["weld-1"])]) <= 30
    assert -heights["weld-1"].min() > heights["weld-1"].max()
    # 2: a rise in the central region between shrinkages, the first, close to cm 47, the larger.
    first, rise = np.argmin(heights["weld-2"]), np.argmax(np.where(central, heights["weld-2"], -np.inf))
    assert x_mm[first] == pytest.approx(-30, abs=25)
    assert first < rise
    assert heights["weld-2"][first] < heights["weld-2"][rise:].min() < 0 < heights["weld-2"][rise]
    # 3: a dip in the centre, much longer than that of weld 1, between protrusions.
    lowest = np.argmin(np.where(central, heights["weld-3"], np.inf))
    assert heights["weld-3"][lowest] < 0 < min(heights["weld-3"][:lowest].max(), heights["weld-3"][lowest:].max())
    assert length_of_lowest_dip(heights["weld-3"]) > 2 * length_of_lowest_dip(heights["weld-1"])
    # 4 and 5: no dip, or one that is negligible: a fifth. 4 begins with its ramp, its steepest part, and is the higher.
    assert all(-heights[name].min() < 0.2 * heights[name].max() for name in ("weld-4", "weld-5"))
    steps = np.diff(heights["weld-4"])
    assert steps.max() > -steps.min()
    assert x_mm[np.diff(heights["weld-4"]).argmax()] < -100
    assert heights["weld-4"].max() > heights["weld-5"].max()


def test_name_or_path_is_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("x,z\n")
    assert find(path) == path
    assert find(str(path)) == path
    assert find("weld-1-dip") == shipped()["weld-1-dip"]


@pytest.mark.parametrize("name", ["weld-9", "folder/weld.csv", "n" * 5000, "\0"])
def test_unknown_name_lists_the_shipped_ones(name: str) -> None:
    with pytest.raises(ProfileError, match=r"no such file or bundled profile; .*weld-1-dip.*wheel-flat-0\.9mm"):
        find(name)
