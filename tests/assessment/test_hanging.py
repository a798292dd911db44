import pytest
from msgspec import UNSET
from msgspec.structs import replace as changed

from weld_force_ros.assessment import hanging
from weld_force_ros.assessment.hanging import UNKNOWN, HangingSleepers, hanging_in_words, support_sentences
from weld_force_ros.assessment.judge import assess
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import WeldProfile, parse_support
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator


@pytest.fixture(scope="module")
def profile() -> WeldProfile:
    return changed(shipped_profile("weld-1-dip"), line_speed_kmh=160.0)


SETTINGS = simulation_settings(track="bilbao-viscous", speeds_kmh=[80.0, 120.0, 160.0], positions=4)


def test_what_hangs_is_simulated_as_if_it_had_been_stated(profile):
    limits = load_limits(None)
    outcomes = HangingSleepers(SETTINGS, limits).outcomes(profile)
    assert [outcome.support for outcome in outcomes] == ["0=0.02", "0=0.02,1=0.02"]
    stated = simulation_settings(
        track="bilbao-viscous", speeds_kmh=[80.0, 120.0, 160.0], positions=4, support="0=0.02,1=0.02"
    )
    verdict = assess(profile, Simulator(stated), limits).verdict
    assert outcomes[1].peak_force_n == pytest.approx(verdict.peak_force_n, rel=1e-9)
    assert outcomes[1].worst_speed_kmh == verdict.worst_speed_kmh

    usual = assess(profile, Simulator(SETTINGS), limits).verdict
    usual.hanging = outcomes
    sentences = hanging_in_words(usual)
    assert len(sentences) == 3
    more = round(100 * (outcomes[0].peak_force_n / usual.peak_force_n - 1))
    assert f"{more} % more" in sentences[0]
    assert "Look under the sleepers" in sentences[2]


def test_of_what_is_stated_nothing_is_asked(profile):
    own = changed(profile, support=parse_support("0=0.5"))
    assert HangingSleepers(SETTINGS, load_limits(None)).outcomes(own) == []
    assert HangingSleepers(simulation_settings(track="bilbao-continuous"), load_limits(None)).outcomes(profile) == []


def test_a_verdict_says_what_it_may_hide(profile):
    verdict = assess(profile, Simulator(SETTINGS), load_limits(None)).verdict
    assert support_sentences(verdict, UNSET) == [UNKNOWN]
    assert "2 % of its support" in support_sentences(verdict, parse_support("0=0.02"))[0]


def test_nothing_is_fitted_before_a_weld_is_asked_about(profile, monkeypatch):
    made: list[str] = []
    monkeypatch.setattr(hanging, "Simulator", lambda *_args, **_kwargs: made.append("simulator"))
    asked = HangingSleepers(SETTINGS, load_limits(None))
    asked.outcomes(changed(profile, support=parse_support("0=0.5")))
    assert made == []
