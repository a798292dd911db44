"""Comparisons with what others published: all within what is allowed, and none that could not fail."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from weld_force_ros.cli.main import main
from weld_force_ros.simulation import track_file
from weld_force_ros.studies import benchmark_study
from weld_force_ros.studies.benchmark_study import euler_deflection_m, jenkins_p2_n, timoshenko_deflection_m


def test_command_finds_every_number_within_what_is_allowed_and_names_what_it_did_not_compare(capfd):
    code = main(["benchmark", "--json", "-"])
    out, err = capfd.readouterr()
    found = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert all(list(one) == ["what", "source", "ours", "theirs", "difference", "allowed", "within"] for one in found)
    compared = [one for one in found if one["within"] is not None]
    assert len(compared) == 32
    for one in compared:
        assert one["difference"] == pytest.approx(one["ours"] / one["theirs"] - 1)
        assert one["within"] is (abs(one["difference"]) <= one["allowed"])
    for kind, count in {"mobility": 14, "deflection": 4, "pinned-pinned": 2, "P2": 12}.items():
        assert sum(one["what"].startswith(kind) for one in compared) == count
    left = [one for one in found if one["within"] is None]
    assert all("not compared" in one["source"] and one["ours"] is one["theirs"] is None for one in left)
    assert "not public here" in err
    assert "32 of 32 within" in err


def test_one_number_outside_ends_with_exit_code_1(capfd, monkeypatch):
    far = benchmark_study.compare("a frequency, Hz", "a book: page 1", 103.0, 100.0, 0.02)
    near = benchmark_study.compare("a frequency, Hz", "a book: page 1", 99.0, 100.0, 0.02)
    monkeypatch.setattr(benchmark_study, "run", lambda: iter([near, far]))
    code = main(["benchmark", "--json", "-"])
    out, err = capfd.readouterr()
    assert code == 1
    assert [json.loads(line)["within"] for line in out.splitlines()] == [True, False]
    assert "1 of 2 within" in err


def test_a_pad_a_hundredth_stiffer_is_outside_of_rolland(monkeypatch):
    published = benchmark_study.rolland()
    stiffer = [
        benchmark_study.PublishedSupport(
            one.layers, [spring.stiffer(1.01) for spring in one.springs], one.masses_kg, one.mobility_m_per_ns
        )
        for one in published.supports
    ]
    other = benchmark_study.PublishedMobilities(
        published.source, published.licence, published.rail, published.spacing_m, published.frequency_hz, stiffer
    )
    monkeypatch.setattr(benchmark_study, "rolland", lambda: other)
    assert sum(not one.within for one in benchmark_study.mobilities()) >= 10


def test_closed_forms_of_a_beam_on_a_foundation_are_its_integral_over_wave_numbers():
    track = track_file.load("bilbao-continuous").track
    rail, k = track.rail, 1 / (1 / 348.6e6 + 1 / 50e6) / 0.6
    bending = rail.youngs_modulus_pa * rail.second_moment_m4
    for softer, closed in ((1.0, timoshenko_deflection_m), (1e-9, euler_deflection_m)):
        ratio = softer * bending / (rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2)

        def integrand(q: float, ratio: float = ratio) -> float:
            return 1 / (k + bending * q**4 / (1 + ratio * q**2)) / np.pi

        assert closed(track, 1.0) == pytest.approx(quad(integrand, 0.0, np.inf, epsabs=0.0)[0], rel=1e-6)


def test_p2_worked_by_hand():
    """One layer under a rail with EI = 6.4 MN m2: beta = 0.8 / m makes k = 10.4858 MN/m2, Kt = 26.2144 MN/m.

    60 kg/m make Mt = 112.5 kg, and 40 kNs/m2 make Ct = 75 kNs/m. A wheel of 1000 kg with 100 kN at 40 m/s over 20 mrad:
    sqrt(Kt Mu) = 161.909 kNs/m, Mu / (Mu + Mt) = 0.898876, sqrt(Kt (Mu + Mt)) = 170.774 kNs/m;
    P2 = 100 + 0.8 x 0.948091 x (1 - pi x 75 / (4 x 170.774)) x 161.909 = 180.45 kN.
    """
    definition = track_file.load("bilbao-continuous")
    rail = replace(definition.track.rail, mass_kg_per_m=60.0, youngs_modulus_pa=200e9, second_moment_m4=3200e-8)
    spring = benchmark_study.Spring(10.48576e6 * 0.6, damping_ns_per_m=40e3 * 0.6)
    track = replace(definition.track, rail=rail, support=benchmark_study.Support((spring,)))
    wheel = replace(definition.wheel, mass_kg=1000.0, static_load_n=100e3)
    assert jenkins_p2_n(track, wheel, 144.0, 0.02) == pytest.approx(180.45e3, rel=1e-4)
