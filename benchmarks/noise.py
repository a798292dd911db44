"""Measured welds against true ones: error of the peak force by noise and spacing, and how often its interval is right.

`python -m benchmarks.noise [--seeds N]` prints the table of docs/validation/noise.md. Each weld is written as a file
with noise, rounded to 0.01 mm, read, and simulated on `bilbao-viscous`, 20 to 200 km/h, four positions; the true peak
is that of the weld without noise. The interval is that of the geometry alone: track, contact and wheel are
the nominal ones.
"""

import argparse
from collections.abc import Callable, Mapping

import numpy as np

from weld_force_ros.assessment.probability import interval
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.profile_file import parse_profile
from weld_force_ros.messages import WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.measured_geometry import sampled_geometries
from weld_force_ros.simulation.settings import parse_speeds, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

Shape = Callable[[FloatArray], FloatArray]
_SAMPLES = 32
_FORM = InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up")


def _wave(length_m: float, height_m: float, centre_m: float = 0.0) -> Shape:
    """Return a cosine wave of one period: a rise, or a dip where the height is negative."""
    return lambda x: np.where(
        np.abs(x - centre_m) < length_m / 2, height_m * np.cos(np.pi * (x - centre_m) / length_m) ** 2, 0.0
    )


def _sum(*shapes: Shape) -> Shape:
    return lambda x: np.sum([shape(x) for shape in shapes], axis=0)


def _ramp(height_m: float, length_m: float, back_m: float) -> Shape:
    """Return a steep rise that falls back slowly."""

    def shape(x: FloatArray) -> FloatArray:
        up = 0.5 * (1 - np.cos(np.pi * np.clip((x + length_m) / length_m, 0, 1)))
        down = 0.5 * (1 + np.cos(np.pi * np.clip(x / back_m, 0, 1)))
        return np.asarray(height_m * up * down)

    return shape


SHAPES: Mapping[str, Shape] = {
    "rise 0.15 mm over 400 mm": _wave(0.4, 0.15e-3),
    "dip 0.2 mm over 250 mm": _wave(0.25, -0.2e-3),
    "dip 0.1 mm over 80 mm": _wave(0.08, -0.1e-3),
    "long rise with two short waves": _sum(_wave(0.7, 0.25e-3), _wave(0.09, 0.1e-3, -0.1), _wave(0.1, -0.1e-3, 0.12)),
    "dip 0.4 mm over 300 mm": _wave(0.3, -0.4e-3),
    "rise between shrinkages": _sum(_wave(0.3, 0.2e-3), _wave(0.09, -0.1e-3, -0.2), _wave(0.09, -0.1e-3, 0.2)),
    "steep ramp 0.4 mm in 100 mm": _ramp(0.4e-3, 0.1, 0.4),
    "dip 0.04 mm over 48 mm": _wave(0.048, -0.04e-3),
}


def measured(shape: Shape, spacing_m: float, noise_m: float, seed: int, step_m: float = 1e-5) -> WeldProfile:
    """Return a weld as it is read from a file of noisy samples, written in steps."""
    x = np.arange(-0.6, 0.6 + spacing_m / 2, spacing_m)
    z = shape(x) + noise_m * np.random.default_rng(seed).standard_normal(len(x))
    written = np.round(z / step_m) * step_m * 1e6
    rows = "".join(f"{a * 1e3:.3f},{b:.3f}\n" for a, b in zip(x, written, strict=True))
    return parse_profile(f"x,z\n{rows}", f"seed-{seed}.csv", _FORM)


def true(shape: Shape) -> WeldProfile:
    """Return the weld itself, every millimetre."""
    rows = "".join(f"{mm},{shape(np.array([mm * 1e-3]))[0] * 1e6:.6f}\n" for mm in range(-600, 601))
    return parse_profile(f"# noise: none\nx,z\n{rows}", "true.csv", _FORM)


def table(simulator: Simulator, spacing_m: float, noise_m: float, seeds: int) -> None:
    """Print errors, coverage and noise of every shape."""
    print(f"\nnoise {noise_m * 1e6:g} um, every {spacing_m * 1e3:g} mm, steps of 0.01 mm, {seeds} seeds")
    print("| weld | true kN | mean error % | RMS % | 90 % interval holds % | its width % | noise found um |")
    print("|---|---|---|---|---|---|---|")
    held, errors = [], []
    for name, shape in SHAPES.items():
        truth = _peaks(simulator, [true(shape)])[0]
        welds = [measured(shape, spacing_m, noise_m, seed) for seed in range(seeds)]
        error = 100 * (_peaks(simulator, welds) / truth - 1)
        ends = np.array([_interval(simulator, weld) for weld in welds])
        inside = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
        found = [weld.noise.noise_m * 1e6 for weld in welds]
        held += inside.tolist()
        errors += error.tolist()
        print(
            f"| {name} | {truth / 1e3:.1f} | {error.mean():+.1f} | {np.sqrt(np.mean(error**2)):.1f} | "
            f"{100 * inside.mean():.0f} | {100 * np.mean(ends[:, 1] - ends[:, 0]) / truth:.1f} | "
            f"{np.mean(found):.1f} ± {np.std(found):.1f} |",
            flush=True,
        )
    rms = np.sqrt(np.mean(np.square(errors)))
    print(f"all {len(held)} cases: interval holds {100 * np.mean(held):.0f} %, RMS {rms:.1f} %")


def _peaks(simulator: Simulator, welds: list[WeldProfile]) -> FloatArray:
    return np.array([max(one.peak_force_n) for one in simulator.force_maps(welds)])


def _interval(simulator: Simulator, weld: WeldProfile) -> tuple[float, float]:
    drawn = sampled_geometries(weld, _SAMPLES, 1)
    variants = [] if drawn is None else [_with_heights(weld, z) for z in drawn]
    return interval(_peaks(simulator, variants)[:, None])


def _with_heights(weld: WeldProfile, z_m: FloatArray) -> WeldProfile:
    from msgspec.structs import replace

    return replace(weld, z_m=z_m.tolist())


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=25)
    seeds = parser.parse_args().seeds
    settings = simulation_settings(
        track="bilbao-viscous", speeds_kmh=parse_speeds("20:200:10"), positions=4, running="with"
    )
    simulator = Simulator(settings, curves=False)
    for spacing_m, noise_m in ((5e-3, 1e-5), (1e-3, 1e-5), (5e-3, 2e-5), (1e-3, 2e-5)):
        table(simulator, spacing_m, noise_m, seeds)
    rounding(simulator)
    noise(seeds)


def rounding(simulator: Simulator) -> None:
    """Print the error of the peak by the step in which a tilted weld is written."""
    print("\nerror of the peak % without noise, written in steps, every 5 mm")
    print("| weld | 0.01 mm | 0.05 mm | 0.1 mm |\n|---|---|---|---|")
    for name, shape in SHAPES.items():
        truth = _peaks(simulator, [true(shape)])[0]
        tilted = [measured(lambda x: shape(x) + 1e-3 * x, 5e-3, 0.0, 0, step) for step in (1e-5, 5e-5, 1e-4)]  # noqa: B023
        errors = 100 * (_peaks(simulator, tilted) / truth - 1)
        print(f"| {name} | " + " | ".join(f"{error:+.1f}" for error in errors) + " |", flush=True)


def noise(seeds: int) -> None:
    """Print the noise that is found, over all shapes."""
    print("\nnoise found, um (mean ± standard deviation over all welds), steps of 0.01 mm")
    print("| true | 5 mm | 1 mm |\n|---|---|---|")
    for noise_m in (3e-6, 5e-6, 1e-5, 2e-5, 3e-5):
        cells = []
        for spacing_m in (5e-3, 1e-3):
            found = [
                measured(shape, spacing_m, noise_m, seed).noise.noise_m * 1e6
                for shape in SHAPES.values()
                for seed in range(min(seeds, 8))
            ]
            cells.append(f"{np.mean(found):.1f} ± {np.std(found):.1f}")
        total = np.hypot(noise_m, 1e-5 / np.sqrt(12)) * 1e6
        print(f"| {noise_m * 1e6:g} ({total:.1f} with rounding) | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
