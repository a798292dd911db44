"""Measure a profile's geometry by itself, and that of the samples that a measurement allows."""

from concurrent.futures import Executor
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros.messages import EdgeReading, ProfileMeasures, WeldProfile, known
from weld_force_ros.physics.analysis.geometry import (
    StraightedgeReading,
    classify,
    irregularity_length,
    largest_gradient,
    largest_inclination,
    largest_step,
    straightedge_gap,
    straightedge_readings,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import rounded

_DECIMALS = 9


def profile_measures(profile: WeldProfile) -> ProfileMeasures:
    """Return what a profile's geometry says without a wheel."""
    x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
    exact = not isinstance(profile.noise, UnsetType) and profile.noise.noise_m == 0.0
    geometry, measured, noise = classify(x_m, z_m), known(profile.measured_x_m), known(profile.noise)
    return ProfileMeasures(
        kind=geometry.kind,
        dip_m=geometry.dip_m,
        protrusion_m=geometry.protrusion_m,
        gradient_rad=largest_gradient(x_m, z_m),
        straightedge_m=straightedge_gap(x_m, z_m),
        spacing_m=float(np.diff(x_m if measured is None else measured).max()),
        edges=[EdgeReading(**asdict(edge)) for edge in straightedge_readings(x_m, z_m, level_beyond=exact)],
        inclination_rad=largest_inclination(x_m, z_m),
        length_m=irregularity_length(x_m, z_m),
        step_m=largest_step(x_m, z_m),
        noise_m=UNSET if noise is None else noise.noise_m,
        resolution_m=UNSET if noise is None else noise.resolution_m,
    )


def sampled_measures(
    x_m: FloatArray, geometries_m: FloatArray, nominal: ProfileMeasures | UnsetType, pool: Executor
) -> dict[str, Any]:
    """Return the geometry's columns of `UncertaintyResult`, a value each for every sample.

    Args:
        x_m: (n,), increasing.
        geometries_m: (n_sample, n).
        nominal: whose straightedges are read.
        pool: that computes.
    """
    different, which = np.unique(geometries_m, axis=0, return_inverse=True)  # of an exact profile all are the same
    gradients, gaps, inclinations, steps = (
        np.array(list(pool.map(partial(measure, x_m), different)))[which]
        for measure in (largest_gradient, straightedge_gap, largest_inclination, largest_step)
    )
    found = list(pool.map(partial(_all_readings, x_m), different))
    readings = [found[number] for number in which]
    bases = [] if isinstance(nominal, UnsetType) else [edge.base_m for edge in nominal.edges]
    return {
        "gradient_rad": rounded(gradients, _DECIMALS),
        "straightedge_m": rounded(gaps, _DECIMALS),
        "inclination_rad": rounded(inclinations, _DECIMALS),
        "step_m": rounded(steps, _DECIMALS),
        "edge_base_m": bases,
        "edge_peak_m": rounded(np.array([[of[base].peak_m for of in readings] for base in bases]), _DECIMALS),
        "edge_dip_m": rounded(np.array([[of[base].dip_m for of in readings] for base in bases]), _DECIMALS),
    }


def _all_readings(x_m: FloatArray, z_m: FloatArray) -> dict[float, StraightedgeReading]:
    return {reading.base_m: reading for reading in straightedge_readings(x_m, z_m, level_beyond=True)}
