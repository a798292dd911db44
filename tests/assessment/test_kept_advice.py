"""Advice on grinding is searched for once, and again where anything that it depends on has changed."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from weld_force_ros import _files
from weld_force_ros.assessment import kept_advice
from weld_force_ros.assessment.kept_advice import advice_of
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import GrindingAdvice, Stamp, WeldProfile, profile_sha256
from weld_force_ros.simulation.settings import simulation_settings

SETTINGS = simulation_settings(track="bilbao-viscous", speeds_kmh=[80.0], positions=1)
LIMITS = load_limits()
WELD = shipped_profile("weld-1-dip")


class Search:
    """Counts its searches and gives advice that is not true."""

    def __init__(self) -> None:
        self.searches = 0

    def __call__(self, profile: WeldProfile) -> GrindingAdvice:
        self.searches += 1
        x = profile.x_m
        return GrindingAdvice(
            weld_id=profile.weld_id, profile_sha256=str(profile.profile_sha256), config_sha256=SETTINGS.config_sha256,
            limits_sha256=LIMITS.limits_sha256, software="test", reached=True, reason="test", x_m=x, z_m=profile.z_m,
            removal_m=np.zeros(len(x)).tolist(), most_removed_m=0.0, removed_m2=0.0, band_limit_m=0.1,
            stone_radius_m=0.15, decision_before="grind", decision_after="accept", before=[], after=[],
            speeds_kmh=[80.0], peak_before_n=[1e5], peak_after_n=[1e5], elapsed_s=1.0,
        )  # fmt: skip


@pytest.fixture
def search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Search:
    monkeypatch.setattr(_files, "cache_folder", lambda kind: tmp_path / kind)
    return Search()


def test_the_same_weld_published_again_is_not_searched_again(search: Search):
    first = advice_of(WELD, SETTINGS, LIMITS, search)
    again = replace(WELD, publisher="another day", sequence=7, stamp=Stamp(sec=9))
    assert advice_of(again, SETTINGS, LIMITS, search) == first
    assert search.searches == 1


def test_another_weld_line_speed_setting_limit_or_software_is_searched(search: Search, monkeypatch: pytest.MonkeyPatch):
    advice_of(WELD, SETTINGS, LIMITS, search)
    z = (1.001 * np.array(WELD.z_m)).tolist()
    higher = replace(WELD, z_m=z, profile_sha256=profile_sha256(WELD.x_m, z))
    advice_of(higher, SETTINGS, LIMITS, search)
    advice_of(replace(WELD, line_speed_kmh=90.0), SETTINGS, LIMITS, search)
    advice_of(WELD, simulation_settings(track="bilbao-viscous", speeds_kmh=[90.0], positions=1), LIMITS, search)
    advice_of(WELD, SETTINGS, load_limits("force,banenor-531"), search)
    monkeypatch.setattr(kept_advice, "_software", lambda: "of tomorrow")
    advice_of(WELD, SETTINGS, LIMITS, search)
    assert search.searches == 6


def test_a_damaged_or_unwritable_cache_costs_only_time(search: Search, tmp_path: Path):
    found = advice_of(WELD, SETTINGS, LIMITS, search)
    (kept,) = (tmp_path / "grinding").iterdir()
    kept.write_bytes(kept.read_bytes()[:100])
    assert advice_of(WELD, SETTINGS, LIMITS, search) == found
    kept.unlink()
    kept.parent.rmdir()
    kept.parent.write_text("a file where the folder should be")
    assert advice_of(WELD, SETTINGS, LIMITS, search) == found
    assert search.searches == 3
