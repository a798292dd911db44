"""Advice on grinding with the simulator in the loop: within limits afterwards, by the reference too."""

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from weld_force_ros.assessment import grinding
from weld_force_ros.assessment.grinding import Adviser, advise
from weld_force_ros.assessment.grinding_search import Grinder
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.cli.main import main
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.messages import (
    AssessmentSettings,
    GrindingAdvice,
    Limit,
    MeasurementNoise,
    WeldProfile,
    decode,
    encode,
    limits_sha256,
    profile_sha256,
)
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

pytestmark = pytest.mark.slow

SPEEDS = [60.0, 80.0, 100.0, 120.0, 140.0]
X = np.linspace(-0.2, 0.2, 201)
LIMIT_N = 125e3
MACHINE = Grinder(hand_margin_m=0.0)


def limits(most_n: float, reject_n: float = 350e3) -> AssessmentSettings:
    rows = [Limit(name="peak_force", limit=most_n, reject_limit=reject_n, unit="N", source="by hand")]
    settings = AssessmentSettings(limits_sha256="0" * 64, limits=rows)
    settings.limits_sha256 = limits_sha256(settings)
    return settings


def adviser(
    most_n: float, speeds_kmh: list[float] = SPEEDS, positions: int = 4, grinder: Grinder | None = None
) -> Adviser:
    settings = simulation_settings(
        track="bilbao-viscous", speeds_kmh=speeds_kmh, positions=positions, contact_patch="off"
    )
    return Adviser(settings, limits(most_n), grinder)


def profile(height_m: float, length_m: float = 0.2) -> WeldProfile:
    z = cosine_dip(X, length_m, -height_m).tolist()
    return WeldProfile(
        weld_id="cosine", source="test", x_m=X.tolist(), z_m=z, profile_sha256=profile_sha256(X.tolist(), z)
    )


@pytest.fixture(autouse=True)
def one_reference_passage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keeps the reference in the loop with one passage of nine; `protrusion` asks it about four."""
    monkeypatch.setattr(grinding, "_REFERENCE_SPEEDS", 1)
    monkeypatch.setattr(grinding, "_REFERENCE_POSITIONS", 1)


@pytest.fixture(scope="module")
def protrusion() -> GrindingAdvice:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grinding, "_REFERENCE_SPEEDS", 2)
        patch.setattr(grinding, "_REFERENCE_POSITIONS", 2)
        return adviser(LIMIT_N).advise(profile(0.2e-3))


def test_ground_weld_is_within_limits_when_rolled_by_itself(protrusion: GrindingAdvice):
    encode(protrusion)
    assert protrusion.reached
    assert (protrusion.decision_before, protrusion.decision_after) == ("grind", "accept")
    assert protrusion.removed_m2 > 0
    x, ground = np.array(protrusion.x_m), np.array(protrusion.z_m) - np.array(protrusion.removal_m)
    simulator = Simulator(
        simulation_settings(track="bilbao-viscous", speeds_kmh=SPEEDS, positions=12, contact_patch="off")
    )
    path = wheel_path_over(x, ground, 0.45)
    for in_either_direction in (path, path.mirrored):
        rolled = simulator.vehicle_track.peak_map(
            in_either_direction, np.arange(60.0, 141.0, 5.0), simulator.settings.positions_m
        )
        assert rolled.peak_force_n.max() < 1.01 * LIMIT_N  # between the speeds and places that were asked for


def test_ground_by_hand_it_is_within_limits_when_rolled_by_itself(protrusion: GrindingAdvice):
    """3 hundredths too deep or too shallow, as far as metal goes: more than that nobody sees who grinds by hand."""
    x, removal = np.array(protrusion.x_m), np.array(protrusion.removal_m)
    assert protrusion.hand_margin_m == 0.03e-3
    simulator = Simulator(
        simulation_settings(track="bilbao-viscous", speeds_kmh=SPEEDS, positions=4, contact_patch="off", running="with")
    )
    peaks = []
    for off in (-1.0, 1.0):
        ground = np.array(protrusion.z_m) - removal + off * np.minimum(protrusion.hand_margin_m, removal)
        rolled = simulator.vehicle_track.peak_map(
            wheel_path_over(x, ground, 0.45), SPEEDS, simulator.settings.positions_m
        )
        peaks.append(rolled.peak_force_n.max())
    assert max(protrusion.peak_after_n) < max(peaks) <= protrusion.peak_by_hand_n * (1 + 1e-9) <= LIMIT_N * (1 + 1e-9)


def test_reference_engine_agrees(protrusion: GrindingAdvice):
    assert protrusion.reference_checked == protrusion.reference_within > 0
    assert protrusion.reference_peak_n <= LIMIT_N
    exact = Simulator(
        simulation_settings(
            track="bilbao-viscous", engine="reference", speeds_kmh=[140.0], positions=4, contact_patch="off"
        )
    )
    x, ground = np.array(protrusion.x_m), np.array(protrusion.z_m) - np.array(protrusion.removal_m)
    rolled = exact.vehicle_track.peak_map(wheel_path_over(x, ground, 0.45), [140.0], exact.settings.positions_m)
    assert rolled.peak_force_n.max() <= LIMIT_N * (1 + 1e-6)


def test_a_protrusion_is_ground_with_less_metal_than_a_dip_of_the_same_wave():
    """Metal only comes off: a protrusion is ground itself, a dip can only be drawn out, and a dip it stays."""
    areas = []
    for height_m in (0.2e-3, -0.2e-3):
        peak_n = max(adviser(1e6, [100.0, 140.0], 2).advise(profile(height_m)).peak_before_n)
        limit_n = 100e3 + 0.8 * (peak_n - 100e3)
        advice = adviser(limit_n, [100.0, 140.0], 2, MACHINE).advise(profile(height_m))
        assert advice.reached
        areas.append(advice.removed_m2)
        ground = np.array(advice.z_m) - np.array(advice.removal_m)
        assert (ground.max() > 0.1e-3) if height_m > 0 else (ground.max() < 1e-6)
    assert areas[0] < 0.5 * areas[1]


def test_weld_within_limits_is_left_alone():
    advice = adviser(300e3).advise(profile(0.2e-3))
    assert (advice.reached, advice.removed_m2, advice.decision_after) == (True, 0.0, "accept")
    assert "nothing to grind" in advice.reason
    assert advice.peak_after_n == advice.peak_before_n


def test_flat_is_not_ground_away_and_nothing_is_advised():
    advice = adviser(120e3, [100.0, 140.0], 2).advise(read_profile(find("wheel-flat-0.9mm")))
    assert not advice.reached
    assert advice.reason.startswith("replace")
    assert advice.removed_m2 == 0.0
    assert advice.peak_after_n == advice.peak_before_n


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def test_command_writes_advice_and_its_picture(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    own = tmp_path / "limits.yaml"
    own.write_text("- {name: peak_force, limit: 1.0e+6, reject_limit: 2.0e+6, unit: N, source: ours}\n")
    code = run(
        "grind", "weld-5-ramp-protrusion", "--speeds", "60,100", "--positions", "2", "--limits", own,
        "--json", "-", "--plot", tmp_path / "ground.png",
    )  # fmt: skip
    out, err = capfd.readouterr()
    assert code == 0
    (line,) = out.splitlines()
    assert decode(GrindingAdvice, line).reached
    assert json.loads(line)["weld_id"] == "weld-5-ramp-protrusion"
    assert "nothing to grind" in " ".join(err.replace("│", " ").split())
    assert (tmp_path / "ground.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("nowhere.csv",), "nowhere"),
        (("weld-1-dip", "--band-limit", "0"), "band-limit"),
        (("weld-1-dip", "--stone-radius", "-1"), "stone_radius"),
        (("weld-1-dip", "--limits", "none.yaml"), "none.yaml"),
    ],
)
def test_bad_input_is_one_line(arguments: tuple[str, ...], complaint: str, capfd: pytest.CaptureFixture[str]):
    assert run("grind", *arguments) == 2
    err = capfd.readouterr().err
    assert complaint in err
    assert len(err.splitlines()) == 1


def peaked(height_m: float, line_kmh: float) -> WeldProfile:
    x = np.linspace(-0.6, 0.6, 601)
    z = np.where(np.abs(x) < 0.25, height_m / 2 * (1 + np.cos(np.pi * x / 0.25)), 0.0)
    return WeldProfile(
        weld_id="peak", source="test", x_m=x.tolist(), z_m=z.tolist(), profile_sha256=profile_sha256(x, z),
        line_speed_kmh=line_kmh, noise=MeasurementNoise(method="none", noise_m=0.0),
    )  # fmt: skip


def test_a_peak_is_ground_to_the_straightedge_of_a_rule_book_that_knows_no_forces():
    """0.45 mm over the line between the ends of 1 m, 0.3 mm allowed: 0.15 mm come off, and no more than that."""
    grid = {"speeds_kmh": [60.0, 100.0, 140.0], "positions": 2, "running": "with"}
    settings = simulation_settings(track="bilbao-viscous", **grid)
    advice = advise(peaked(0.45e-3, 140.0), settings, load_limits("banenor-531"), MACHINE)
    assert advice.reached
    assert advice.most_removed_m == pytest.approx(0.15e-3, abs=0.02e-3)
    assert {c.name: c.passed for c in advice.after} == {"straightedge_peak": True, "straightedge_dip": True}


def test_what_is_ground_under_both_answers_is_accepted_at_the_risk():
    """Ramps are ground until the model's uncertainty is within the accepted risk, not until the limit is met."""
    ramp = replace(read_profile(find("weld-4-steep-ramp")), line_speed_kmh=140.0)
    settings = simulation_settings(
        track="bilbao-viscous", speeds_kmh=[40.0, *np.arange(50.0, 141.0, 10.0).tolist()], positions=4, running="with"
    )
    advice = advise(ramp, settings, load_limits("force,prorail-qi"))
    assert advice.reached
    assert (advice.decision_before, advice.decision_after) == ("grind", "accept")
    assert max(advice.peak_after_n) < 150e3 - 1.6 * 0.12 / (1 + 1.6 * 0.12) * 50e3


def quality_indices(advice: GrindingAdvice, off_m: np.ndarray, norm_rad: float) -> np.ndarray:
    """Inclinations between heights 25 mm apart, less that of the chord of 1 m, over the norm."""
    x, z = np.array(advice.x_m), np.array(advice.z_m) - np.array(advice.removal_m) + off_m
    at = np.arange(-0.5, 0.475, 0.001)
    chord = (np.interp(0.5, x, z) - np.interp(-0.5, x, z)) / 1.0
    return np.abs((np.interp(at + 0.025, x, z) - np.interp(at, x, z)) / 0.025 - chord) / norm_rad


def worst_by_hand(advice: GrindingAdvice, margin_m: float, norm_rad: float) -> float:
    """The worst index if the depth is off by the margin, as far as metal goes: all over, or by a wave in each spot."""
    x, removal = np.array(advice.x_m), np.array(advice.removal_m)
    off = np.minimum(margin_m, removal)
    wave = np.zeros(len(x))
    for spot in advice.spots:
        inside = (x >= spot.from_m) & (x <= spot.to_m)
        wave[inside] = np.sin(2 * np.pi * (x[inside] - spot.from_m) / (spot.to_m - spot.from_m))
    shapes = [sign * off * shape for sign in (-1, 1) for shape in (1.0, wave)]
    return max(float(quality_indices(advice, shape, norm_rad).max()) for shape in shapes)


@pytest.mark.long
def test_the_margin_of_a_hand_grinder_is_kept_and_costs_metal():
    """0.6 mm over 500 mm: a quality index of 1.6 at 140 km/h, whose norm is 3.2 - 2.2 * 100 / 260 = 2.354 mrad."""
    norm_rad, margin_m = (3.2 - 2.2 * 100 / 260) * 1e-3, 0.05e-3
    settings = simulation_settings(track="bilbao-viscous", speeds_kmh=[60.0, 140.0], positions=2, running="with")
    advices = [
        advise(peaked(0.6e-3, 140.0), settings, load_limits("prorail-qi"), Grinder(hand_margin_m=margin))
        for margin in (margin_m, 0.0)
    ]
    by_hand, by_machine = advices
    assert by_hand.reached
    assert by_machine.reached
    assert by_hand.gradient_norm_rad == pytest.approx(norm_rad)
    assert quality_indices(by_machine, np.zeros(len(by_machine.x_m)), norm_rad).max() == pytest.approx(1.0, abs=0.01)
    assert worst_by_hand(by_machine, margin_m, norm_rad) > 1.1
    assert worst_by_hand(by_hand, margin_m, norm_rad) <= 1.0 + 1e-6
    assert by_hand.removed_m2 > by_machine.removed_m2
    assert f"also with {margin_m * 1e3:.2f} mm more or less" in by_hand.reason


def test_what_only_a_machine_can_grind_is_not_advised_by_hand():
    """At 300 km/h the norm is 1 mrad, which a wave of 0.2 mm across a spot of half a metre exceeds by itself."""
    settings = simulation_settings(track="bilbao-viscous", speeds_kmh=[100.0, 300.0], positions=2, running="with")
    advice = advise(peaked(0.3e-3, 300.0), settings, load_limits("prorail-qi"), Grinder(hand_margin_m=0.2e-3))
    assert not advice.reached
    assert advice.reason.startswith("grind more exactly than by hand")
    assert advice.most_removed_m > 0
