"""Passages side by side are the same passages one after the other."""

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from weld_force_ros.errors import NumericalError
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage import batch
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file


def vehicle_track(name: str) -> VehicleTrackModel:
    definition = track_file.load(name)
    return VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)


def altered(known: VehicleTrackModel, softness: float, pitch: float, spacing_m: float) -> VehicleTrackModel:
    """Another track: all compliances and all resonances scaled, the span stretched."""
    model = known.model
    other = replace(
        model,
        poles_rad_s=pitch * model.poles_rad_s,
        residues=softness * pitch * model.residues,
        section_m=model.section_m * spacing_m / model.spacing_m,
        spacing_m=spacing_m,
    )
    return VehicleTrackModel(replace(other, _grids={}), known.wheel)


def cosine(length_m: float, depth_m: float) -> WheelPath:
    x = np.linspace(-length_m / 2, length_m / 2, 201)
    return wheel_path_over(x, cosine_dip(x, length_m, depth_m), 0.45)


def columns(peak_map: PeakMap) -> list[np.ndarray]:
    return [peak_map.peak_force_n, peak_map.peak_x_m, peak_map.min_force_n, peak_map.contact_loss_s]


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["bilbao", "bilbao-continuous", "johansson-nielsen"]),
    softness=st.floats(0.6, 1.6),
    pitch=st.floats(0.8, 1.2),
    spacing_m=st.floats(0.5, 0.75),
    speeds=st.lists(st.floats(10.0, 350.0), min_size=1, max_size=19, unique=True),
    positions=st.lists(st.floats(-0.3, 0.9), min_size=1, max_size=4, unique=True),
    length_m=st.floats(0.03, 0.5),
    depth_um=st.integers(-500, 1200),
)
def test_lanes_equal_the_scalar_kernel(
    monkeypatch, name, softness, pitch, spacing_m, speeds, positions, length_m, depth_um
):
    shape, track = cosine(length_m, depth_um * 1e-6), altered(vehicle_track(name), softness, pitch, spacing_m)
    with monkeypatch.context() as one_by_one:
        one_by_one.setattr(batch, "USE_SIMD", False)
        try:
            scalar = VehicleTrackModel(track.model, track.wheel).peak_map(shape, speeds, positions)
        except NumericalError as refused:  # an altered fit on which no force settles: both say so
            one_by_one.undo()
            with pytest.raises(NumericalError, match=re.escape(str(refused))):
                VehicleTrackModel(track.model, track.wheel).peak_map(shape, speeds, positions)
            return
    side_by_side = VehicleTrackModel(track.model, track.wheel).peak_map(shape, speeds, positions)
    for fast, plain in zip(columns(side_by_side)[::2], columns(scalar)[::2], strict=True):
        np.testing.assert_allclose(fast, plain, rtol=1e-9)
    np.testing.assert_allclose(side_by_side.contact_loss_s, scalar.contact_loss_s, rtol=1e-9)
    # Where the weld leaves the smooth rail's own peak the largest, it recurs in every span: the place is one of those.
    stands_out = scalar.peak_force_n > scalar.min_force_n * (1 + 1e-6)
    spans = ((side_by_side.peak_x_m - scalar.peak_x_m) / spacing_m)[stands_out]
    np.testing.assert_allclose(spans, np.round(spans), atol=1e-6)


def test_contact_loss_is_the_same_in_lanes(monkeypatch):
    flat, speeds = cosine(0.1, 0.9e-3), [150.0, 200.0, 250.0, 300.0]
    fast = vehicle_track("johansson-nielsen").peak_map(flat, speeds, [0.1, 0.4])
    monkeypatch.setattr(batch, "USE_SIMD", False)
    plain = vehicle_track("johansson-nielsen").peak_map(flat, speeds, [0.1, 0.4])
    assert fast.contact_loss_s.min() > 1e-4
    np.testing.assert_allclose(fast.contact_loss_s, plain.contact_loss_s, rtol=1e-9)
    assert fast.min_force_n.min() == 0.0


def test_results_do_not_depend_on_other_speeds_order_or_threads():
    shape = cosine(0.1, 0.3e-3)
    speeds, positions = np.arange(20.0, 300.0, 17.0), np.arange(5) * 0.12
    whole = columns(vehicle_track("bilbao").peak_map(shape, speeds, positions))
    backwards = columns(vehicle_track("bilbao").peak_map(shape, speeds[::-1], positions[::-1]))
    alone = columns(vehicle_track("bilbao").peak_map(shape, speeds[3:4], positions[2:3]))
    definition = track_file.load("bilbao")
    on_one_thread = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel, threads=1)
    one_thread = columns(on_one_thread.peak_map(shape, speeds, positions))
    for a, b, c, d in zip(whole, backwards, alone, one_thread, strict=True):
        np.testing.assert_array_equal(a, b[::-1, ::-1])
        np.testing.assert_array_equal(a[3:4, 2:3], c)
        np.testing.assert_array_equal(a, d)


def test_a_model_remembers_its_tables_and_gives_the_same_again():
    shape, reused = cosine(0.05, 40e-6), vehicle_track("bilbao")
    reused.peak_map(cosine(0.2, 0.2e-3), [40.0, 90.0], [0.0])
    again, fresh = (
        reused.peak_map(shape, [40.0, 90.0], [0.0]),
        vehicle_track("bilbao").peak_map(shape, [40.0, 90.0], [0.0]),
    )
    np.testing.assert_array_equal(again.peak_force_n, fresh.peak_force_n)


@pytest.mark.slow
@pytest.mark.parametrize("processes", [2])
def test_processes_that_compile_at_once_agree(tmp_path, processes):
    code = (
        "from weld_force_ros.simulation.settings import simulation_settings;"
        "from weld_force_ros.simulation.simulator import Simulator;"
        "from weld_force_ros.measurement.profile_file import find, read_profile;"
        "s = Simulator(simulation_settings(speeds_kmh=[80], positions=[0.1]));"
        "print(s.force_history(read_profile(find('weld-1-dip')), 80.0, 0.1).force_n)"  # the quickest to compile
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    running = [
        subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(processes)
    ]
    answers = {process.communicate(timeout=200)[0] for process in running}
    assert [process.returncode for process in running] == [0] * processes
    assert len(answers) == 1
