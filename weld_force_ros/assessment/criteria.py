"""Define the criteria by which a weld is judged, as numbers that are the worse the larger they are, and their names."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros._words import english
from weld_force_ros.messages import Criterion, Limit, NormPoint, ProfileMeasures, UncertaintyResult
from weld_force_ros.physics.analysis.geometry import NORM_MRAD
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages


@dataclass(frozen=True)
class ForceCriterion:
    """A criterion of a wheel's passages.

    Attributes:
        value: of every passage; None where that was not computed.
        column: of `Passages`, which the value is a function of; it gets worse with it.
        at_rest: value of a wheel at rest; None: the static wheel load.
    """

    value: Callable[[Passages], FloatArray | None]
    column: str
    at_rest: float | None = None

    @property
    def at_the_peak(self) -> bool:
        """Return whether its place along the rail is that of the maximum force."""
        return self.column == "peak_force_n"


FORCE_CRITERIA: Mapping[str, ForceCriterion] = {
    "peak_force": ForceCriterion(lambda p: p.peak_force_n, "peak_force_n"),
    "p2_force": ForceCriterion(lambda p: p.p2_force_n, "p2_force_n"),
    "force_20hz": ForceCriterion(lambda p: p.force_20hz_n, "force_20hz_n"),
    "dynamic_factor": ForceCriterion(lambda p: p.peak_force_n / p.static_load_n, "peak_force_n", 1.0),
    "hertz_pressure_index": ForceCriterion(lambda p: np.cbrt(p.peak_force_n / p.static_load_n), "peak_force_n", 1.0),
    "unloading": ForceCriterion(lambda p: 1 - p.min_force_n / p.static_load_n, "min_force_n", 0.0),
    "contact_loss": ForceCriterion(lambda p: p.contact_loss_s, "contact_loss_s", 0.0),
}
"""The maximum Hertz pressure grows with the cube root of the force (Johnson, Contact Mechanics, 1985, chapter 4), for
any curvatures: the index is relative to the pressure under static load."""


def value_at_rest(name: str, static_load_n: float) -> float:
    """Return a force criterion's value of a wheel at rest."""
    at_rest = FORCE_CRITERIA[name].at_rest
    return static_load_n if at_rest is None else at_rest


EDGE_CRITERIA: Mapping[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "straightedge_peak": lambda peak, dip: peak,
    "straightedge_dip": lambda peak, dip: dip,
    "straightedge_abs": np.maximum,
}
"""Value of each criterion from the readings, peak and dip, under the straightedge that a limit states."""

GEOMETRY_CRITERIA = ("quality_index", "straightedge", *EDGE_CRITERIA, "inclination", "step")
"""Criteria of the profile itself."""

CRITERIA = (*FORCE_CRITERIA, *GEOMETRY_CRITERIA)

WORDS = english().section("criterion_in_sentence")
"""Name of each criterion in a sentence."""


def criterion_in_words(name: str, base_m: float | UnsetType = UNSET) -> str:
    """Return a criterion's name as it stands in a sentence, with the length of its straightedge or chord."""
    words = WORDS.get(name, name)
    if isinstance(base_m, UnsetType):
        return words
    return f"{words} of {base_m:g} m" if name.startswith("straightedge") else f"{words} on a base of {base_m:g} m"


def sentence_in_words(text: str, criteria: Sequence[Criterion]) -> str:
    """Return a sentence of a verdict with its criteria under their names in words."""
    bases = {c.name: {other.base_m for other in criteria if other.name == c.name} for c in criteria}

    def words(found: re.Match[str]) -> str:
        of_name = bases.get(found[0], {UNSET})
        return criterion_in_words(found[0], next(iter(of_name)) if len(of_name) == 1 else UNSET)

    return re.sub(r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b", words, text)


def geometry_values(
    limit: Limit,
    measured: ProfileMeasures | UncertaintyResult | UnsetType,
    line_kmh: float,
    norm: Sequence[NormPoint],
) -> FloatArray | None:
    """Return a geometry criterion on a line of a speed: () of a profile, (n_sample,) of samples; None if not measured.

    A quality index without a base is relative to the line between the ends of the record, as in earlier versions.

    Args:
        limit: whose criterion is one of `GEOMETRY_CRITERIA`.
        measured: what was measured of the profile, or of each sample.
        line_kmh: the line's speed.
        norm: largest gradient by line speed; that of `weld_force_ros.physics.analysis.geometry.NORM_MRAD` if empty.
    """
    if isinstance(measured, UnsetType):
        return None
    if limit.name in EDGE_CRITERIA:
        readings = _readings(measured).get(limit.base_m)
        return None if readings is None else np.asarray(EDGE_CRITERIA[limit.name](*readings))
    column = {"straightedge": measured.straightedge_m, "step": measured.step_m, "inclination": measured.inclination_rad}
    if limit.name == "quality_index":
        slope = measured.gradient_rad if isinstance(limit.base_m, UnsetType) else measured.inclination_rad
        return None if isinstance(slope, UnsetType) else np.asarray(slope) / gradient_norm_rad(line_kmh, norm)
    found = column[limit.name]
    return None if isinstance(found, UnsetType) else np.asarray(found)


def _readings(measured: ProfileMeasures | UncertaintyResult) -> dict[float | UnsetType, tuple[FloatArray, FloatArray]]:
    """Return peak and dip under each straightedge by its length: () of a profile, (n_sample,) of samples."""
    if isinstance(measured, ProfileMeasures):
        return {edge.base_m: (np.asarray(edge.peak_m), np.asarray(edge.dip_m)) for edge in measured.edges}
    shape = (len(measured.edge_base_m), -1)
    peaks, dips = np.array(measured.edge_peak_m), np.array(measured.edge_dip_m)
    if not len(peaks):
        return {}
    return dict(zip(measured.edge_base_m, zip(peaks.reshape(shape), dips.reshape(shape), strict=True), strict=True))


def gradient_norm_rad(line_kmh: float, norm: Sequence[NormPoint]) -> float:
    """Return the largest gradient allowed on a line of a speed: linear between points, constant beyond them."""
    points = [(p.speed_kmh, p.gradient_rad) for p in norm] or [(speed, 1e-3 * mrad) for speed, mrad in NORM_MRAD]
    speeds, gradients = zip(*points, strict=True)
    return float(np.interp(line_kmh, speeds, gradients))
