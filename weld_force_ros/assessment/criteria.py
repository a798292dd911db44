"""Criteria that a weld is held against: what is computed of it as numbers that are the worse the larger they are."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import UnsetType

from weld_force_ros.messages import NormPoint, ProfileMeasures
from weld_force_ros.physics.analysis.geometry import NORM_MRAD
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages

FORCE_CRITERIA: Mapping[str, Callable[[Passages], FloatArray | None]] = {
    "peak_force": lambda p: p.peak_n,
    "p2_force": lambda p: p.p2_n,
    "force_20hz": lambda p: p.below_20hz_n,
    "dynamic_factor": lambda p: p.peak_n / p.static_n,
    "hertz_pressure_index": lambda p: np.cbrt(p.peak_n / p.static_n),
    "unloading": lambda p: 1 - p.min_n / p.static_n,
    "contact_loss": lambda p: p.contact_loss_s,
}
"""What each says of every passage. The largest Hertz pressure goes with the cube root of the force (Johnson, Contact
Mechanics, 1985, chapter 4), whatever the curvatures: so the index is relative to the pressure at rest."""

AT_THE_PEAK = ("peak_force", "dynamic_factor", "hertz_pressure_index")
"""Those whose place along the rail is that of the greatest force."""

GEOMETRY_CRITERIA = ("quality_index", "straightedge")
"""What the profile says by itself."""

CRITERIA = (*FORCE_CRITERIA, *GEOMETRY_CRITERIA)


def geometry_value(
    name: str, measures: ProfileMeasures | UnsetType, line_kmh: float, norm: Sequence[NormPoint]
) -> float | None:
    """The value of a geometry criterion on a line of a speed; None if the profile was not measured for it.

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
    """Largest gradient on a line of a speed: linear between points, constant beyond them."""
    points = [(p.speed_kmh, p.gradient_rad) for p in norm] or [(speed, 1e-3 * mrad) for speed, mrad in NORM_MRAD]
    speeds, gradients = zip(*points, strict=True)
    return float(np.interp(line_kmh, speeds, gradients))
