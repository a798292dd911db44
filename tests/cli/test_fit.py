"""What `weld-force fit` says of how good a fit is."""

import pytest

from weld_force_ros.cli.fit import _show_fit
from weld_force_ros.simulation import fit_store, track_file


def test_a_fit_for_a_moving_wheel_says_how_far_peak_forces_are_off(capsys: pytest.CaptureFixture[str]) -> None:
    definition = track_file.load("bilbao-causal")
    made = fit_store.fitted_moving(definition)
    _show_fit(made, moving=definition.moving)
    said = " ".join("".join(capsys.readouterr()).split())
    assert f"peak forces are {100 * made.error:.1f} % of their dynamic part off engine reference" in said
    assert " all " not in said


def test_a_fit_of_receptances_says_how_far_those_are_off(capsys: pytest.CaptureFixture[str]) -> None:
    made = fit_store.fitted(track_file.load("bilbao"))
    _show_fit(made, moving=False)
    said = "".join(capsys.readouterr())
    assert f"{100 * made.error:.2f}" in said
    assert "moves" not in said
