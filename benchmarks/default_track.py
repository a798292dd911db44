"""What the default track changes against the paper's own: `python -m benchmarks.default_track`, some ten seconds.

The bundled welds on both, at the default speeds and positions: every peak force by itself, the worst up to 160 km/h of
each weld, its verdict on a line of that speed by the default limits, and the processor time of both.
"""

import time

import numpy as np
from msgspec.structs import replace

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.simulation.settings import (
    DEFAULT_TRACK,
    DEFAULT_UNCERTAINTY_SAMPLES,
    load_uncertainty,
    simulation_settings,
)
from weld_force_ros.simulation.simulator import Simulator

PAPERS = "bilbao"
LINE_KMH = 160.0


def main() -> None:
    """Print a line a weld, then the median and the largest change of all peaks."""
    limits, names = load_limits(), [name for name in shipped() if not name.startswith("wheel-flat")]
    unknown = load_uncertainty(DEFAULT_UNCERTAINTY_SAMPLES)
    simulators = [Simulator(simulation_settings(track=track, uncertainty=unknown)) for track in (PAPERS, DEFAULT_TRACK)]
    changes, seconds = [], np.zeros(len(simulators))
    for name in names:
        profile = replace(read_profile(find(name)), line_speed_kmh=LINE_KMH)
        maps = []
        for number, simulator in enumerate(simulators):
            began = time.process_time()
            maps.append(simulator.force_map(profile))
            seconds[number] += time.process_time() - began if changes else 0.0  # the first is warming up
        before, after = (np.array(force_map.peak_force_n) for force_map in maps)
        changes.append(100 * (after / before - 1))
        verdicts = [judge(force_map, limits) for force_map in maps]
        worst = ", ".join(f"{verdict.peak_force_n / 1e3:.1f} kN {verdict.decision}" for verdict in verdicts)
        print(f"{name:32} {PAPERS}, {DEFAULT_TRACK}: {worst}; up to {np.abs(changes[-1]).max():.1f} %", flush=True)
    off = np.concatenate(changes)
    print(f"{len(off)} peaks: median {np.median(np.abs(off)):.2f} %, RMS {np.sqrt(np.mean(off**2)):.1f} %, "
          f"from {off.min():+.1f} to {off.max():+.1f} %; "
          f"processor time {seconds[1] / seconds[0]:.2f} times")  # fmt: skip


if __name__ == "__main__":
    main()
