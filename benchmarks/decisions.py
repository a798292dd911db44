"""Decisions on welds whose truth is known: `python -m benchmarks.decisions [--welds 1000]`.

Synthetic welds of random severity are written as files: every 5 mm, 10 um of noise, in steps of 0.01 mm. Where in the
span they lie and in which direction trains run is drawn, and the software is not told. The truth is what the true
geometry does there under the rule books `force` and `prorail-qi`, values compared with limits.
"""

import argparse
from collections import Counter

import numpy as np
from msgspec.structs import replace
from rich.progress import track as progress

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.measurement.synthetic_welds import population
from weld_force_ros.messages import Verdict, WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

SPEEDS_KMH = np.arange(20.0, 201.0, 5.0).tolist()
LINES_KMH = (80.0, 120.0, 160.0, 200.0)
SEVERITY = (0.3, 2.5)  # factors on the population's heights, evenly in their logarithm
SPACING_M, NOISE_M, STEP_M = 5e-3, 10e-6, 1e-5
TRACK, SPAN_M = "bilbao-viscous", 0.6
_FORM = InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up")


def main() -> None:
    """Print how many welds were decided how, by what is true of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--welds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    generator = np.random.default_rng(arguments.seed)
    limits = load_limits("force,prorail-qi")
    measuring = Simulator(
        simulation_settings(track=TRACK, speeds_kmh=SPEEDS_KMH, positions=15, uncertainty=load_uncertainty(32))
    )
    counted: Counter[tuple[bool, str]] = Counter()
    for weld in progress(list(population(arguments.welds, arguments.seed)), description="welds"):
        factor = np.exp(generator.uniform(*np.log(SEVERITY)))
        x_m, z_m = np.array(weld.x_m), factor * np.array(weld.z_m)
        x_m -= (x_m[0] + x_m[-1]) / 2
        line_kmh, at_m = float(generator.choice(LINES_KMH)), float(generator.uniform(0, SPAN_M))
        turned = bool(generator.integers(2))
        verdict = judge(measuring.force_map(_measured(x_m, z_m, line_kmh, generator)), limits)
        there = Simulator(simulation_settings(track=TRACK, speeds_kmh=SPEEDS_KMH, positions=[at_m], running="with"))
        seen_x, seen_z = (-x_m[::-1], z_m[::-1]) if turned else (x_m, z_m)
        truth = judge(there.force_map(_exact(seen_x, seen_z, line_kmh, at_m)), limits)
        counted[_exceeds(truth), verdict.decision] += 1
    _print(counted)


def _measured(x_m: FloatArray, z_m: FloatArray, line_kmh: float, generator: np.random.Generator) -> WeldProfile:
    x = np.arange(x_m[0], x_m[-1] + SPACING_M / 2, SPACING_M)
    z = np.interp(x, x_m, z_m) + NOISE_M * generator.standard_normal(len(x))
    rows = "".join(f"{a * 1e3:.3f},{b:.3f}\n" for a, b in zip(x, np.round(z / STEP_M) * STEP_M * 1e6, strict=True))
    return replace(parse_profile(f"x,z\n{rows}", "weld.csv", _FORM), line_speed_kmh=line_kmh)


def _exact(x_m: FloatArray, z_m: FloatArray, line_kmh: float, at_m: float) -> WeldProfile:
    rows = "".join(f"{a * 1e3:.6f},{b * 1e6:.6f}\n" for a, b in zip(x_m, z_m, strict=True))
    text = f"# noise: none\n# centre: 0\nx,z\n{rows}"
    return replace(parse_profile(text, "true.csv", _FORM), line_speed_kmh=line_kmh, weld_position_m=at_m)


def _exceeds(truth: Verdict) -> bool:
    return any(not criterion.passed for criterion in truth.criteria if criterion.decides)


def _print(counted: Counter[tuple[bool, str]]) -> None:
    decisions = ("accept", "undecided", "grind", "reject")
    print(f"{'':24}" + "".join(f"{name:>12}" for name in decisions))
    for exceeds in (True, False):
        row = [counted[exceeds, name] for name in decisions]
        print(f"{'over a limit' if exceeds else 'within all limits':24}" + "".join(f"{count:12}" for count in row))
    over, within = (sum(counted[exceeds, name] for name in decisions) for exceeds in (True, False))
    refused = counted[False, "grind"] + counted[False, "reject"]
    print(f"wrongly accepted {counted[True, 'accept'] / max(1, over):.1%} of {over} that exceed a limit")
    print(f"wrongly refused {refused / max(1, within):.1%} of {within} that do not")
    undecided = counted[True, "undecided"] + counted[False, "undecided"]
    print(f"undecided {undecided / max(1, over + within):.1%}")


if __name__ == "__main__":
    main()
