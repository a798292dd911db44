"""Seconds from profile to verdict, plain and with 200 samples of the unknown: `python -m benchmarks.verdicts`."""

import time

import numpy as np

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

SPEEDS_KMH = np.linspace(20.0, 255.0, 48).tolist()
SAMPLES = 200


def main() -> None:
    """Print a line a weld; the second weld on is warm."""
    limits = load_limits()
    settings = {"speeds_kmh": SPEEDS_KMH, "positions": 15}
    plain = Simulator(simulation_settings(**settings, running="with"))
    sampled = Simulator(simulation_settings(**settings, running="with", uncertainty=load_uncertainty(SAMPLES)))
    profiles = [read_profile(find(name)) for name in shipped()]
    print(f"{SAMPLES} samples x {len(SPEEDS_KMH)} speeds x 15 positions; seconds from profile to verdict")
    for warming, profile in enumerate([profiles[0], *profiles]):
        seconds = []
        for simulator in (plain, sampled):
            began = time.perf_counter()
            verdict = judge(simulator.force_map(profile), limits)
            seconds.append(time.perf_counter() - began)
        if warming:
            beyond = max(c.exceeding for c in verdict.criteria if c.decides)
            print(
                f"{profile.weld_id:32} plain {seconds[0]:6.3f}  sampled {seconds[1]:6.2f}  {verdict.decision:10}"
                f" {beyond:4.0%} of samples over a limit"
            )


if __name__ == "__main__":
    main()
