"""What more passages cost: time and peak memory, each size in a fresh process."""

import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks import study, timing

SIZES = (500, 5_000, 50_000)
_ROUNDS = 10


def growth(repetitions: int) -> dict[str, Any]:
    """Measure seconds and peak memory of the study's welds over and over; sizes in turn."""
    found: dict[int, list[tuple[float, float]]] = {size: [] for size in SIZES}
    for _ in range(repetitions):
        for size in SIZES:
            found[size].append(_in_fresh_process(size))
    per_passage = {size: [1e6 * s for s, _ in found[size]] for size in SIZES}
    memory = {size: statistics.median(mb for _, mb in found[size]) for size in SIZES}
    small, large = SIZES[1], SIZES[2]
    result: dict[str, Any] = {}
    for size in SIZES:
        result |= timing.figure(f"per_passage_us_of_{size}", per_passage[size])
        result[f"peak_memory_mb_of_{size}"] = memory[size]
    ratios = [b / a for a, b in zip(per_passage[small], per_passage[large], strict=True)]
    return {
        **result,
        **timing.figure(f"per_passage_{large}_to_{small}", ratios),
        f"peak_memory_mb_{large}_over_{small}": memory[large] - memory[small],
    }


def _in_fresh_process(passages: int) -> tuple[float, float]:
    command = [sys.executable, "-m", __name__, str(passages)]
    printed = subprocess.run(command, capture_output=True, check=True).stdout
    return msgspec.json.decode(printed, type=tuple[float, float])


def _roll(passages: int) -> tuple[float, float]:
    """Return seconds a passage for about so many, tables made before, and the process's peak memory in MB."""
    workload, vehicle_track = study.study(), study.vehicle_track()
    rounds = -(-passages // workload.passages)
    row_count = max(1, round(passages / rounds / len(workload.welds) / study.POSITIONS))
    rows = np.linspace(0, len(workload.speeds_kmh) - 1, row_count).astype(int)
    speeds = workload.speeds_kmh[rows]

    stream = rounds * list(workload.wheel_paths.values())

    def simulate() -> None:
        for _ in vehicle_track.peak_maps(stream, speeds, workload.positions_m):
            pass

    simulate()
    # Few passages are soon done: repeated, so that every size is timed about as long.
    repeated = max(1, _ROUNDS // rounds)
    taken = sum(timing.seconds(simulate) for _ in range(repeated))
    simulated = repeated * len(stream) * row_count * study.POSITIONS
    return taken / simulated, _peak_memory_mb()


def _peak_memory_mb() -> float:
    """Return this process's; what getrusage gives began with the process that started it."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 1024


if __name__ == "__main__":
    print(msgspec.json.encode(_roll(int(sys.argv[1]))).decode())
