"""Tracks under welds: what is computed when."""

import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.messages import parse_support
from weld_force_ros.simulation import track_at_weld, track_file
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.track_at_weld import TracksAtWelds


def test_the_exact_track_is_ready_without_its_error_in_time(monkeypatch: pytest.MonkeyPatch):
    asked: list[str] = []
    real = track_at_weld.acausal
    monkeypatch.setattr(
        track_at_weld, "acausal", lambda track, *args, **more: (asked.append(track.name), real(track, *args, **more))[1]
    )
    settings = simulation_settings(track="bilbao", engine="reference")
    usual = TracksAtWelds(track_file.load("bilbao"), settings).usual
    assert asked == []
    assert usual.fit_error == usual.fit_error > 0
    assert asked == ["bilbao"]


def test_a_sleeper_that_bends_has_no_gap_below_it():
    settings = simulation_settings(track="bending-sleepers", engine="reference", support="0=gap:0.8mm")
    tracks = TracksAtWelds(track_file.load("bending-sleepers"), settings)
    with pytest.raises(InputError, match="a sleeper over a gap cannot bend here"):
        tracks.supported(tuple(parse_support("0=gap:0.8mm")))
