"""What a step of the kernel costs in operations, and how near that comes to what a core can do."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from benchmarks import _solvers, study, timing
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage._simd import LANES, PLACES, SPEEDS
from weld_force_ros.physics.passage.batch import PassageStarts, make_batch

_STEPS = 1 << 14
_GROUPS = 4  # of places
_ROUNDS = 1_000_000
_CHAINS = 4

# Counted in `peaks_in_lanes`: sums, products, quotients and roots are one each, a multiply-add two, comparisons none.
_PER_POLE = 20
_PER_CONTACT = 78  # 39 of them in single precision: the first guess and three improvements


def operations_per_step(poles: int) -> int:
    """Return the operations of one lane."""
    return _PER_POLE * poles + _PER_CONTACT


def arithmetic(repetitions: int) -> dict[str, object]:
    """Time passages over a smooth wave of fixed length, and independent multiply-adds, on one thread."""
    model = study.model()
    solver = study.vehicle_track(1).solver
    positions = np.arange(PLACES * _GROUPS)
    wave = 1e-5 * np.sin(0.05 * np.arange(_STEPS + 1)) * np.ones((len(positions), 1))
    weld = PassageStarts(37 * solver.longest_stride * positions, np.full(len(positions), _STEPS), wave)
    at, speeds = np.divmod(np.arange(SPEEDS * len(positions)), SPEEDS)
    pool = ThreadPoolExecutor(1)
    batch = make_batch(solver, np.linspace(60.0, 200.0, SPEEDS), solver.longest_stride)

    def simulate() -> FloatArray:
        return batch.peaks(weld, speeds, at, pool, 1)

    # All lanes of a group of places go on until the last of them is done.
    steps = LANES * simulate()[:, 5].reshape(_GROUPS, LANES).max(axis=1).sum()
    numbers = np.full(LANES * (_CHAINS + 2), 0.5)
    taken = timing.interleaved(
        {
            "kernel": simulate,
            "peak": lambda: _solvers.multiply_adds(numbers, _ROUNDS),
        },
        repetitions,
    )
    operations = operations_per_step(len(model.poles_rad_s))
    kernel = [operations * steps / t / 1e9 for t in taken["kernel"]]
    peak = [2 * _CHAINS * LANES * _ROUNDS / t / 1e9 for t in taken["peak"]]
    return {
        "kernel_operations_per_step": operations,
        **timing.figure("kernel_step_ns", [1e9 * t / steps for t in taken["kernel"]]),
        **timing.figure("kernel_gflops", kernel),
        **timing.figure("multiply_add_peak_gflops", peak),
        **timing.figure("kernel_share_of_peak", [k / p for k, p in zip(kernel, peak, strict=True)]),
    }
