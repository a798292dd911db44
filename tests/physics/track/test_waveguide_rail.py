"""The rail by finite strips: alone, and on its supports."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from weld_force_ros.physics.track import waveguide_rail
from weld_force_ros.physics.track.beam import (
    StripRail,
    Track,
    free_decay,
    receptance,
    static_compliance,
    transfer_receptance,
)
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.physics.track.supported_rail import SupportedWaves
from weld_force_ros.simulation import section_file, track_file

pytestmark = pytest.mark.slow

SECTION = section_file.outline_of("60E1")


def with_strips(track: Track, pad_width_m: float = 0.0, wear_m: float = 0.0) -> Track:
    return replace(track, rail=StripRail(**asdict(track.rail), section=SECTION, wear_m=wear_m), pad_width_m=pad_width_m)


@pytest.fixture(scope="module")
def bilbao():
    return track_file.load("bilbao").track


def free_rail(track: Track, refine: int = waveguide_rail.REFINE) -> waveguide_rail.FreeRail:
    return waveguide_rail.rail(SECTION, 0.0, track.rail.steel, refine)


def test_bending_wave_is_the_beams_at_low_frequency(bilbao):
    frequency = np.array([30.0, 100.0, 200.0, 300.0])
    rails = [replace(rail, loss_factor=0.0) for rail in (bilbao.rail, with_strips(bilbao).rail)]
    beam, strips = (np.nanmax(np.where(d.real < 1e-6 * np.abs(d), d.imag, np.nan), axis=0)
                    for d in (free_decay(rail, frequency) for rail in rails))  # fmt: skip
    np.testing.assert_allclose(strips, beam, rtol=0.01)


def test_receptance_is_the_beams_at_low_frequency(bilbao):
    at, frequency = np.linspace(0.0, 0.3, 7), np.linspace(5.0, 500.0, 100)
    beam, strips = receptance(bilbao, frequency, at), receptance(with_strips(bilbao), frequency, at)
    assert np.abs(strips / beam - 1).max() < 0.05
    np.testing.assert_allclose(static_compliance(with_strips(bilbao), at), static_compliance(bilbao, at), rtol=0.02)


def by_mesh(track: Track, frequency_hz: np.ndarray, at_m: np.ndarray, refine: int) -> np.ndarray:
    """Point receptance (n_at, n_frequency) with a mesh whose elements are divided."""
    omega = 2 * np.pi * frequency_hz + 0j
    pad, below = track.support.pad.dynamic_stiffness(omega), track.support.stiffness_below_pad(omega)
    free = free_rail(track, refine).waves(omega, loss_factor=track.rail.loss_factor)
    waves = SupportedWaves(free, track.spacing_m, pad, below, track.pad_width_m)
    return (waves.strength[:, None] * waves.shape(at_m) * waves.shape(-at_m)).sum(axis=0)


@pytest.mark.long
def test_result_does_not_depend_on_the_mesh(bilbao):
    track, frequency, at = with_strips(bilbao), np.linspace(50.0, 3000.0, 25), np.array([0.0, 0.15, 0.3])
    coarse, fine = (
        by_mesh(track, frequency, at, refine) for refine in (waveguide_rail.REFINE, 3 * waveguide_rail.REFINE // 2)
    )
    np.testing.assert_array_equal(coarse, receptance(track, frequency, at))
    assert np.abs(coarse / fine - 1).max() < 0.01


def brute_force(
    track: Track, frequency_hz: np.ndarray, places_m: list[tuple[float, float]], spans: int = 40
) -> list[np.ndarray]:
    """Responses at each place to a force at another, over supports of which the reactions are solved for together."""
    omega = 2 * np.pi * frequency_hz + 0j
    free = free_rail(track).waves(omega, loss_factor=track.rail.loss_factor)
    places, shares = np.polynomial.legendre.leggauss(4 if track.pad_width_m else 1)
    held = (np.arange(-spans, spans + 1)[:, None] * track.spacing_m + places * track.pad_width_m / 2).ravel()
    shares = shares / 2
    pad, below = track.support.pad.dynamic_stiffness(omega), track.support.stiffness_below_pad(omega)
    own = free.foot_foot(np.abs(held[:, None] - held))
    seen, driven = (
        np.stack([free.head_foot(np.abs(held - x)) for x in at_m], axis=1) for at_m in zip(*places_m, strict=True)
    )
    found = [free.head_head(np.array(abs(x - x0))) for x, x0 in places_m]
    for n in range(len(omega)):
        one = np.diag(pad[n] * shares) - pad[n] ** 2 / (pad[n] + below[n]) * np.outer(shares, shares)
        stiffness = np.kron(np.eye(2 * spans + 1), one)
        reactions = np.linalg.solve(np.eye(len(held)) + stiffness @ own[..., n], stiffness @ driven[..., n])
        for place, response in enumerate(found):
            response[n] -= seen[:, place, n] @ reactions[:, place]
    return found


@pytest.mark.parametrize("pad_width_m", [0.0, 0.15])
def test_floquet_waves_are_many_supports_solved_together(bilbao, pad_width_m):
    rail = replace(with_strips(bilbao).rail, loss_factor=0.05)  # a finite number of supports is enough then
    track = replace(with_strips(bilbao, pad_width_m), rail=rail)
    frequency = np.array([20.0, 200.0, 900.0, 1500.0, 3500.0])
    places_m = [(0.02, 0.02), (0.2, 0.2), (0.3, 0.3), (0.75, 0.1), (2.3, 0.45)]
    for (at_m, force_at_m), exact in zip(places_m, brute_force(track, frequency, places_m), strict=True):
        found = transfer_receptance(track, frequency, at_m, force_at_m)[0]
        np.testing.assert_allclose(found, exact, rtol=5e-3)


def test_rails_that_differ_by_their_loss_alone_are_made_once(bilbao):
    rail = with_strips(bilbao).rail
    assert rail.loss_factor != 0
    assert replace(rail, loss_factor=0.0).free is rail.free


@settings(max_examples=20, deadline=None)
@given(
    frequency=st.floats(2.0, 5000.0), at=st.floats(-1.0, 1.0), force_at=st.floats(-1.0, 1.0),
    width=st.sampled_from([0.0, 0.15]),
)  # fmt: skip
def test_track_is_reciprocal_mirrored_and_takes_energy(frequency, at, force_at, width):
    track = with_strips(track_file.load("bilbao").track, width)
    there, back, mirrored, on = (
        transfer_receptance(track, frequency, x, x0)[0, 0]
        for x, x0 in ((at, force_at), (force_at, at), (-at, -force_at), (at, at))
    )
    scale = abs(on)
    assert back == pytest.approx(there, abs=1e-6 * scale)
    assert mirrored == pytest.approx(there, abs=5e-3 * scale)
    assert on.imag < 0


def test_continuous_support_is_the_beams_at_low_frequency():
    track = track_file.load("bilbao-continuous").track
    frequency = np.linspace(10.0, 500.0, 50)
    beam, strips = receptance(track, frequency, 0.0), receptance(with_strips(track), frequency, 0.0)
    assert np.abs(strips / beam - 1).max() < 0.05


def test_wear_makes_the_rail_softer(bilbao):
    new, worn = (static_compliance(with_strips(bilbao, wear_m=wear), 0.3)[0] for wear in (0.0, 5e-3))
    assert 1.001 < worn / new < 1.05


def test_a_wide_pad_resists_rotation(bilbao):
    narrow, wide = (static_compliance(with_strips(bilbao, width), 0.3)[0] for width in (0.0, 0.15))
    assert 0.95 < wide / narrow < 0.999


def test_one_layer_stands_on_ground_that_does_not_move(bilbao):
    """Strips take pad and ground apart: ground of a million times the pad's stiffness must make no difference."""
    pad = bilbao.support.springs[0]
    found, stiff = (
        receptance(with_strips(replace(bilbao, support=support), 0.15), [60.0, 400.0], [0.0, 0.3])
        for support in (Support((pad,)), Support((pad, Spring(pad.stiffness_n_per_m * 1e6)), (100.0,)))
    )
    np.testing.assert_allclose(found, stiff, rtol=1e-4)


def test_track_file_chooses_the_rail():
    text = track_file.load("bilbao").text
    strips = track_file.parse(text.replace("  section: 60E1", "  model: finite-strip\n  section: 60E1", 1), "mine")
    assert isinstance(strips.track.rail, StripRail)
    assert strips.track.rail.section == SECTION
    bare = text.replace("  section: 60E1", "  section: 60E1\n  model: finite-strip")
    lines = [
        line
        for line in bare.splitlines()
        if not line.strip().startswith(("mass_kg_per_m", "area_cm2", "second_moment"))
    ]
    assert track_file.parse("\n".join(lines), "short").track.rail == strips.track.rail


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("section: 60E1", "section: 61E1\n  model: finite-strip", "61E1"),
        ("section: 60E1", "section: {name: mine}\n  model: finite-strip", "section"),
        ("section: 60E1", "section: 60E1\n  model: solid", "model"),
        ("section: 60E1", "section: 60E1\n  model: finite-strip\n  wear_mm: 29", "crosses itself"),
        ("section: 60E1", "section: 60E1\n  wear_mm: 2", "wear_mm of a beam"),
        ("youngs_modulus_gpa: {value: 210", "model: finite-strip\n  youngs_modulus_gpa: {value: 400", "Poisson"),
        ("  pad:", "  pad:\n    width_m: 0.15", "width_m"),
    ],
)
def test_rail_that_cannot_be_is_refused_with_one_line(old, new, said):
    text = track_file.load("bilbao").text
    assert old in text
    with pytest.raises(track_file.TrackError, match=said) as caught:
        track_file.parse(text.replace(old, new, 1), "mine.yaml")
    assert "\n" not in str(caught.value)


def test_the_given_number_of_threads_is_used_and_changes_nothing(bilbao, workers_of_pools):
    track, frequency = with_strips(bilbao), np.array([31.0, 97.0, 411.0, 1733.0])
    receptance(track, frequency[:1], [0.0], threads=1)  # makes the rail, which is kept
    workers_of_pools.clear()
    found = [receptance(track, frequency, [0.0, 0.21], threads=count) for count in (1, 3)]
    assert workers_of_pools == [3]
    np.testing.assert_array_equal(*found)
