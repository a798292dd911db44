"""A weld's geometry from noisy samples: against SciPy's smoothing spline, known noise, and known shapes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from weld_force_ros.physics.analysis import adaptive_spline
from weld_force_ros.physics.analysis.adaptive_spline import Estimate, estimate

ROOT = Path(__file__).parents[3]
X_M = np.arange(-0.5, 0.5001, 0.005)


def rise(x_m: np.ndarray) -> np.ndarray:
    """A weld of 0.2 mm over 400 mm, as smooth as a Gaussian."""
    return 2e-4 * np.exp(-((x_m / 0.12) ** 2))


def dip(x_m: np.ndarray, depth_m: float = 2e-4, length_m: float = 0.25) -> np.ndarray:
    return np.where(np.abs(x_m) <= length_m / 2, -depth_m / 2 * (1 + np.cos(2 * np.pi * x_m / length_m)), 0.0)


def measured(noise_m: float, seed: int = 1, shape=dip, x_m: np.ndarray = X_M, step_m: float = 0.0) -> np.ndarray:
    z_m = shape(x_m) + np.random.default_rng(seed).normal(0, noise_m, len(x_m))
    return np.round(z_m / step_m) * step_m if step_m else z_m


def errors_um(found: Estimate, shape=dip, x_m: np.ndarray = X_M) -> np.ndarray:
    return 1e6 * (found.geometry_m - shape(found.x_m + x_m[0]))


def from_zero(z_m: np.ndarray, x_m: np.ndarray = X_M, **how) -> Estimate:
    return estimate(x_m - x_m[0], z_m, **({"resolution_m": 0.0} | how))


def test_mean_agrees_with_scipys_smoothing_spline_on_a_smooth_weld() -> None:
    """Two estimators of one smooth curve differ by less than the noise, and ours is no further from the truth."""
    ours, theirs = [], []
    for seed in range(3):
        z_m = measured(10e-6, seed, rise)
        found = from_zero(z_m)
        spline = make_smoothing_spline(X_M - X_M[0], z_m * 1e6)
        assert np.abs(spline(found.x_m) - found.geometry_m * 1e6).max() < 9
        ours.append(np.std(errors_um(found, rise)))
        theirs.append(np.std(spline(found.x_m) - 1e6 * rise(found.x_m + X_M[0])))
    assert np.mean(ours) < 1.1 * np.mean(theirs)
    assert np.mean(ours) < 4


@pytest.mark.parametrize("noise_um", [3, 10, 30])
@pytest.mark.parametrize("shape", [dip, rise])
def test_noise_is_recovered(noise_um: float, shape) -> None:
    found = [from_zero(measured(noise_um * 1e-6, seed, shape)).noise_m * 1e6 for seed in range(5)]
    assert np.mean(found) == pytest.approx(noise_um, rel=0.15)


def test_noise_of_rounded_samples_holds_the_rounding() -> None:
    found = [from_zero(measured(10e-6, seed, step_m=1e-5), resolution_m=1e-5).noise_m * 1e6 for seed in range(5)]
    assert np.mean(found) == pytest.approx(np.hypot(10, 10 / 12**0.5), rel=0.15)


def test_stated_noise_is_taken() -> None:
    z_m = measured(10e-6)
    quiet, loud = (from_zero(z_m, noise_m=noise_m) for noise_m in (3e-6, 30e-6))
    assert quiet.noise_m == pytest.approx(3e-6, rel=0.1)
    assert loud.noise_m == pytest.approx(30e-6, rel=0.1)
    rest_m = [np.std(z_m - np.interp(X_M - X_M[0], f.x_m, f.geometry_m)) for f in (quiet, loud)]
    assert rest_m[0] < rest_m[1]  # what is not noise is geometry


@pytest.mark.parametrize(("at", "off_m"), [(60, 3e-3), (140, -3e-3), (90, 1e-4), (0, -3e-4), (200, 3e-4)])
@pytest.mark.parametrize("noise_m", [0.0, 3e-6])
def test_wrong_sample_is_set_aside(at: int, off_m: float, noise_m: float) -> None:
    z_m = measured(noise_m, step_m=1e-6)
    clean = from_zero(z_m, resolution_m=1e-6, set_aside=[at])
    z_m[at] += off_m
    found = from_zero(z_m, resolution_m=1e-6)
    assert found.set_aside == (at,)
    np.testing.assert_allclose(found.geometry_m, clean.geometry_m, atol=1e-7)


@pytest.mark.parametrize("noise_m", [1e-6, 5e-6, 20e-6])
def test_good_samples_are_not_set_aside(noise_m: float) -> None:
    assert sum(len(from_zero(measured(noise_m, seed)).set_aside) for seed in range(4)) == 0


def test_known_wrong_samples_are_not_looked_for() -> None:
    z_m = measured(3e-6)
    z_m[60] += 3e-3
    assert from_zero(z_m, set_aside=[60]).set_aside == (60,)
    assert from_zero(z_m, set_aside=[]).set_aside == ()


def test_edge_of_the_rail_survives() -> None:
    """An insulated joint's step of 0.1 mm is no wrong sample, and stays about as steep as it was sampled."""
    found = from_zero(np.where(X_M < 0.0024, 0.0, 1e-4), resolution_m=1e-6)
    assert found.set_aside == ()
    steps_um = 1e6 * np.diff(np.interp(X_M - X_M[0], found.x_m, found.geometry_m))
    assert steps_um.max() > 90


def test_short_dip_without_noise_survives() -> None:
    x_m = np.arange(-0.3, 0.3001, 0.001)

    def short(x: np.ndarray) -> np.ndarray:
        return dip(x, 40e-6, 0.048)

    z_m = np.round(short(x_m), 9)
    found = from_zero(z_m, x_m, resolution_m=1e-9)
    assert np.abs(errors_um(found, short, x_m)).max() < 0.5


@pytest.mark.parametrize(("step_m", "within_um"), [(1e-5, 3.0), (1e-4, 20.0)])
def test_rounding_of_a_tilted_rail_is_taken_out(step_m: float, within_um: float) -> None:
    z_m = np.round((dip(X_M) + 1.3e-3 * X_M) / step_m) * step_m
    found = from_zero(z_m, resolution_m=step_m)
    line_m = 1.3e-3 * (found.x_m + X_M[0])
    assert np.abs(1e6 * (found.geometry_m - line_m - dip(found.x_m + X_M[0]))).max() < within_um
    assert found.noise_m == pytest.approx(step_m / 12**0.5, rel=0.15)


def test_samples_need_not_be_equidistant() -> None:
    x_m = np.sort(np.random.default_rng(2).uniform(-0.5, 0.5, 201))
    x_m[[0, -1]] = -0.5, 0.5
    found = from_zero(measured(5e-6, x_m=x_m), x_m)
    assert np.std(errors_um(found, dip, x_m)) < 4


def test_a_line_is_kept_exactly() -> None:
    z_m = measured(5e-6)
    level, tilted = from_zero(z_m), from_zero(z_m + 1e-3 + 2e-3 * X_M)
    line_m = 1e-3 + 2e-3 * (level.x_m + X_M[0])
    np.testing.assert_allclose(tilted.geometry_m - line_m, level.geometry_m, atol=1e-7)


def test_same_samples_give_the_same_bits() -> None:
    z_m = measured(10e-6)
    first, second = (from_zero(z_m, samples=8, seed=3) for _ in "ab")
    for name in ("geometry_m", "deviation_m", "samples_m"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    other = from_zero(z_m, samples=8, seed=4)
    assert other.geometry_m.tobytes() == first.geometry_m.tobytes()
    assert other.samples_m.tobytes() != first.samples_m.tobytes()


def test_drawn_geometries_scatter_as_the_posterior_says() -> None:
    found = from_zero(measured(10e-6), samples=200)
    inner = slice(50, -50)
    spread = found.samples_m.std(axis=0)[inner]
    assert np.mean(spread / found.deviation_m[inner]) == pytest.approx(1.1, abs=0.25)  # and the hyperparameters' own
    off = (found.samples_m.mean(axis=0) - found.geometry_m)[inner]
    assert np.sqrt(np.mean(off**2)) < np.mean(found.deviation_m)
    assert found.noise_range_m[0] < found.noise_m < found.noise_range_m[1]
    assert found.noise_range_m[0] < 10e-6 < found.noise_range_m[1]


def test_true_geometry_lies_within_two_deviations_about_as_often_as_it_should() -> None:
    within = [np.mean(np.abs(errors_um(f)) < 2e6 * f.deviation_m) for f in map(from_zero, map(noisy, range(6)))]
    assert 0.85 < np.mean(within) <= 1.0


def noisy(seed: int) -> np.ndarray:
    return measured(10e-6, seed)


def test_draws_come_in_antithetic_pairs() -> None:
    """Of each pair one lies above the mean where the other lies below: their mean scatters less than one of them."""
    found = from_zero(measured(10e-6), samples=100)
    off = found.samples_m - found.samples_m.mean(axis=0)
    correlation = np.mean([np.corrcoef(a, b)[0, 1] for a, b in zip(off[::2], off[1::2], strict=True)])
    assert correlation < -0.5


_KERNELS = """
import json
import numpy as np
from weld_force_ros.physics.analysis import adaptive_spline as a
x = np.arange(0.0, 151.0, 5.0)
z = np.round(60 * np.exp(-((x - 75) / 30) ** 2) + np.random.default_rng(1).normal(0, 3, len(x)))
problem = a._Problem(x, z, 1.0, None)
used = np.ones(len(x))
used[4] = 0.0
problem.use(used)
u, gradient = problem.mean + 0.1, np.empty(len(problem.mean))
density = a.log_density(u, gradient, True, *problem._arguments)
mean, covariance = problem.posterior(u)
metric = a.hessian(u, *problem._arguments)
parameters, curves = problem.draw(u, 2, np.random.default_rng(2))
precision = used / problem.floor
scaled = precision * z
a.propagate(problem.cell, problem.weight, mean, covariance, z, used, 1.0, 0.3, precision, scaled)
results = [density, gradient, mean, covariance[:-3], metric, parameters, curves, precision, scaled]
print(json.dumps([np.asarray(r).ravel().tolist() for r in results]))
"""


def kernels(**environment: str) -> list[np.ndarray]:
    run = subprocess.run(
        [sys.executable, "-c", _KERNELS], cwd=ROOT, env=os.environ | environment, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    return [np.array(values) for values in json.loads(run.stdout)]


@pytest.mark.slow
def test_compiled_kernels_equal_their_own_python() -> None:
    compiled, interpreted = kernels(), kernels(NUMBA_DISABLE_JIT="1")
    for fast, plain in zip(compiled, interpreted, strict=True):
        np.testing.assert_allclose(fast, plain, rtol=1e-5, atol=1e-6 * np.abs(plain).max())


def test_gradient_is_that_of_the_density() -> None:
    problem = adaptive_spline._Problem(1e3 * (X_M - X_M[0]), 1e6 * measured(10e-6), 0.0, None)
    problem.use(np.ones(len(X_M)))
    u, gradient, unused = problem.mean + 0.3, np.empty(len(problem.mean)), np.empty(len(problem.mean))
    adaptive_spline.log_density(u, gradient, True, *problem._arguments)
    for i in range(0, len(u), 7):
        up, down = u.copy(), u.copy()
        up[i], down[i] = u[i] + 1e-4, u[i] - 1e-4
        difference = np.subtract(
            *(adaptive_spline.log_density(v, unused, False, *problem._arguments) for v in (up, down))
        )
        assert difference / 2e-4 == pytest.approx(gradient[i], rel=1e-3, abs=1e-3)
