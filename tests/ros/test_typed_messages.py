"""Typed messages of a verdict, number by number."""

import math

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.ros.test_node_suite import plotted
from weld_force_ros.messages import Criterion, Verdict
from weld_force_ros.ros.typed_messages import criteria


def criterion(name: str, value: float, limit: float) -> Criterion:
    return Criterion(name=name, value=value, limit=limit, unit="1", passed=value <= limit, source="hand")


VERDICT = Verdict(
    weld_id="KM12",
    profile_sha256="a" * 64,
    config_sha256="b" * 64,
    limits_sha256="c" * 64,
    software="hand",
    decision="grind",
    reason="over the limit: unloading",
    criteria=[criterion("unloading", 0.5, 0.25), criterion("contact_loss", 0.1, 0.0)],
    peak_force_n=180e3,
    static_load_n=90e3,
    worst_speed_kmh=120.0,
    worst_position_m=0.3,
    worst_x_m=0.3,
    judged_speed_kmh=160.0,
)


@pytest.mark.parametrize(("decision", "level"), [("accept", 0), ("grind", 1), ("reject", 2), ("undecided", 3)])
def test_decision_is_a_level(decision, level):
    assert plotted(criteria(replace(VERDICT, decision=decision)))["weld/level"] == level


def test_every_number_is_finite_and_named_alike_for_every_weld():
    numbers = plotted(criteria(VERDICT))
    assert numbers["weld/unloading/ratio"] == 2.0
    assert numbers["weld/contact_loss/value"] == 0.1
    assert "weld/contact_loss/ratio" not in numbers  # there is none beyond a limit of zero
    assert all(math.isfinite(n) for n in numbers.values() if isinstance(n, float))
    assert plotted(criteria(replace(VERDICT, weld_id="KM13"))).keys() == numbers.keys()


@pytest.mark.parametrize(
    ("permitted", "step", "plotted_kmh"), [(80.0, 5.0, 80.0), (UNSET, 5.0, 0.0), (UNSET, UNSET, None)]
)
def test_no_speed_within_limits_is_zero_and_nothing_said_is_absent(permitted, step, plotted_kmh):
    found = plotted(criteria(replace(VERDICT, permitted_speed_kmh=permitted, advice_step_kmh=step)))
    assert found.get("weld/permitted_speed_kmh") == plotted_kmh


def test_of_two_limits_for_the_same_the_stricter_is_plotted():
    both = [criterion("force_20hz", 100.0, 50.0), criterion("force_20hz", 100.0, 200.0)]
    assert plotted(criteria(replace(VERDICT, criteria=both)))["weld/force_20hz/limit"] == 50.0
