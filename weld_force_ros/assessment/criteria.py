"""Define the criteria by which a weld is judged, as numbers that are the worse the larger they are."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import UnsetType

from weld_force_ros.messages import NormPoint, ProfileMeasures
from weld_force_ros.physics.analysis.geometry import NORM_MRAD
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages

FORCE_CRITERIA: Mapping[str, Callable[[Passages], FloatArray | None]] = {
    "peak_force": lambda p: p.peak_force_n,
    "p2_force": lambda p: p.p2_force_n,
    "force_20hz": lambda p: p.force_20hz_n,
    "dynamic_factor": lambda p: p.peak_force_n / p.static_load_n,
    "hertz_pressure_index": lambda p: np.cbrt(p.peak_force_n / p.static_load_n),
    "unloading": lambda p: 1 - p.min_force_n / p.static_load_n,
    "contact_loss": lambda p: p.contact_loss_s,
}
"""Value of each criterion in every passage. The maximum Hertz pressure grows with the cube root of the force (Johnson,
Contact Mechanics, 1985, chapter 4), for any curvatures: the index is relative to the pressure under static load."""

AT_THE_PEAK = ("peak_force", "dynamic_factor", "hertz_pressure_index")
"""Criteria whose place along the rail is that of the maximum force."""

GEOMETRY_CRITERIA = ("quality_index", "straightedge")
"""Criteria of the profile itself."""

CRITERIA = (*FORCE_CRITERIA, *GEOMETRY_CRITERIA)


def geometry_value(
    name: str, measures: ProfileMeasures | UnsetType, line_kmh: float, norm: Sequence[NormPoint]
) -> float | None:
    """Return the value of a geometry criterion on a line of a speed; None if the profile was not measured for it.

    Args:
        name: of `GEOMETRY_CRITERIA`.
        measures: of the profile.
        line_kmh: the line's speed.
        norm: largest gradient by line speed; that of `weld_force_ros.physics.analysis.geometry.NORM_MRAD` if empty.
    """
    if isinstance(measures, UnsetType):
        return None
    if name == "straightedge":
        return measures.straightedge_m
    return measures.gradient_rad / gradient_norm_rad(line_kmh, norm)


def gradient_norm_rad(line_kmh: float, norm: Sequence[NormPoint]) -> float:
    """Return the largest gradient allowed on a line of a speed: linear between points, constant beyond them."""
    points = [(p.speed_kmh, p.gradient_rad) for p in norm] or [(speed, 1e-3 * mrad) for speed, mrad in NORM_MRAD]
    speeds, gradients = zip(*points, strict=True)
    return float(np.interp(line_kmh, speeds, gradients))
