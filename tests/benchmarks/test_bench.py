"""The bench measures what it says: its solvers agree, its study is the issue's, its counts add up."""

import subprocess
import sys

import msgspec
import pytest

from benchmarks import arithmetic, growth, solver, study, timing


@pytest.fixture(scope="module")
def workload() -> study.Study:
    return study.study()


def test_the_study_is_seven_welds_48_speeds_15_positions(workload: study.Study):
    assert (len(workload.welds), len(workload.speeds_kmh), len(workload.positions_m)) == (7, 48, 15)
    assert workload.passages == 5040


@pytest.mark.parametrize("weld", ["weld-1-dip", "wheel-flat-0.9mm"])
def test_both_solvers_and_the_kernel_find_one_peak(workload: study.Study, weld: str):
    vehicle_track, wheel_path = study.vehicle_track(), workload.wheel_paths[weld]
    peak_map = vehicle_track.peak_map(wheel_path, [90.0], [0.12])
    passage = solver.SolvedPassage(vehicle_track, wheel_path, 90.0, 0.12, peak_map.peak_x_m[0, 0])
    exact = passage.peak_by_lsoda(1e-10)
    assert passage.peak_by_runge_kutta() == pytest.approx(exact, rel=2e-4)
    assert peak_map.peak_force_n[0, 0] == pytest.approx(exact, rel=1e-3)


def test_the_sample_has_every_weld_and_no_chance_in_it(workload: study.Study):
    cells = solver.sampled(workload)
    assert cells == solver.sampled(workload)
    assert {name for name, _, _ in cells} == set(study.WELDS)
    assert len(cells) == solver.SAMPLE


def test_what_is_compared_takes_turns():
    calls: list[str] = []
    taken = timing.interleaved({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 2)
    assert calls == ["a", "b"] * 3
    assert {name: len(times) for name, times in taken.items()} == {"a": 2, "b": 2}


def test_arithmetic_counts_whole_steps():
    found = arithmetic.arithmetic(1)
    step_ns, operations = found["kernel_step_ns"], found["kernel_operations_per_step"]
    assert operations == 20 * 4 + 78
    assert found["kernel_gflops"] == pytest.approx(operations / step_ns)
    assert found["kernel_share_of_peak"] == pytest.approx(found["kernel_gflops"] / found["multiply_add_peak_gflops"])


def test_growth_measures_a_fresh_process():
    printed = subprocess.run(
        [sys.executable, "-m", growth.__name__, "500"], capture_output=True, check=True, timeout=120
    ).stdout
    seconds, memory_mb = msgspec.json.decode(printed, type=tuple[float, float])
    assert 0 < seconds < 1
    assert 50 < memory_mb < 1000
