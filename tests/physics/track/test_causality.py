"""The acausal part of a receptance, against a spring whose Hilbert transform is known and tracks that have none."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from weld_force_ros.physics.track import causality
from weld_force_ros.simulation import track_file


def test_a_viscous_track_answers_after_the_impulse_only():
    definition = track_file.load("johansson-nielsen")
    found = causality.acausal(definition.track, 0.2)
    assert found.energy_share < 1e-4
    assert found.floor(definition.wheel.compliance, (5.0, 2500.0)) < 0.004


def test_a_loss_factor_of_one_puts_three_per_cent_of_the_energy_before_the_impulse():
    # physics.md: "3 % of the energy of bilbao's impulse response lies at negative time".
    definition = track_file.load("bilbao")
    assert causality.acausal(definition.track, 0.3).energy_share == pytest.approx(0.03, abs=0.01)


def test_the_cut_of_a_hysteretic_oscillator_is_what_its_poles_say(monkeypatch):
    """1 / (k (1 + i eta sign w) - m w^2) = A(w) on w > 0: its real-time response by quadrature, cut by hand."""
    k, m, eta = 1.0e8, 160.0, 0.6

    def oscillator(track, frequency_hz, at_m):
        omega = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
        return (1 / (k * (1 + 1j * eta) - m * omega**2))[None, :]

    monkeypatch.setattr(causality.beam, "receptance", oscillator)
    monkeypatch.setattr(causality.beam, "static_compliance", lambda track, at_m: np.array([1 / k]))
    monkeypatch.setattr(causality.beam, "velocity_jump", lambda rail: 0.0)
    found = causality.acausal(track_file.load("bilbao").track, 0.0)
    omega = np.linspace(0.0, 2 * np.pi * 3000.0, 40_001)
    spectrum = 1 / (k * (1 + 1j * eta) - m * omega**2)
    times = np.linspace(0.0, 0.08, 801)
    # At negative time the sum of cos and sin parts has the other sign: both halves from two quadratures.
    even = np.array([trapezoid(spectrum.real * np.cos(omega * t), omega) for t in times]) / np.pi
    odd = np.array([trapezoid(spectrum.imag * np.sin(omega * t), omega) for t in times]) / np.pi
    after, before = even - odd, even + odd
    share = trapezoid(before**2, times) / (trapezoid(before**2, times) + trapezoid(after**2, times))
    assert found.energy_share == pytest.approx(share, rel=0.05)
