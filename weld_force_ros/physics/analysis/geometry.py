"""What a weld's geometry says by itself: dip or protrusion, gradient quality index, readings under a straightedge.

The paper (section 4) sorts welds by their main characteristic: a dip; or no dip, or one that is secondary to "a
protrusion having an amplitude much larger than that of the dip". A weld whose dip and protrusion are "similar in size"
counts as one with a dip. Heights are relative to their surroundings, so that small dips on top of a protrusion are
small (weld 5) and a dip between protrusions is deep (weld 3):

- the dip is the deepest water that the profile would hold with the smooth rail on either side,
- the protrusion is the same of the profile upside down,
- a protrusion is much larger if it is over twice as high as the dip is deep. The factor is this package's reading of
  "much larger"; no force was looked at to choose it.

Rule books limit peak and dip apart, under a straightedge of a stated length that is laid over the weld: the chord
between the rail's heights at the edge's two ends, whose middle is the weld's centre.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.physics.analysis import _straightedge
from weld_force_ros.physics.arrays import FloatArray

MUCH_LARGER = 2.0

_SAMPLING_M = 5e-3
_AVERAGED = 5  # samples
STRAIGHTEDGE_M = 1.0
EDGES_M = (0.1, 1.0, 1.5, 3.0)
"""Lengths of straightedge that rule books prescribe."""
_COVERED = 0.95  # of an edge that a record has to show
_STEP_WITHIN_M = 0.01
_OFFSETS = 10  # of the 5 mm grid: the largest gradient must not hang on where sampling began

NORM_MRAD = ((40.0, 3.2), (300.0, 1.0))
"""Largest gradient in mrad by line speed in km/h, ProRail, as esveld.com gives it for the lowest and highest speed."""


@dataclass(frozen=True)
class Geometry:
    """A weld's class.

    Attributes:
        kind: the main characteristic.
        dip_m: deepest place below its surroundings.
        protrusion_m: highest place above its surroundings.
        ratio: protrusion over dip; infinite without a dip, 0 for a level rail.
    """

    kind: Literal["dip", "protrusion"]
    dip_m: float
    protrusion_m: float
    ratio: float


@dataclass(frozen=True)
class QualityIndex:
    """Gradient quality index of Steenbergen & Esveld; over 1 the weld has to be ground.

    Attributes:
        index: largest gradient over its norm.
        gradient_rad: largest gradient.
        norm_rad: its norm at the line's speed.
        verified: whether the norm was checked against the standard.
    """

    index: float
    gradient_rad: float
    norm_rad: float
    verified: bool = False


def classify(x_m: ArrayLike, z_m: ArrayLike) -> Geometry:
    """Return the class of a weld's geometry by the paper's criterion.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up, 0 at the smooth rail's level.

    Raises:
        InputError: not of that form.
    """
    z = _checked(x_m, z_m)[1]
    dip, protrusion = _deepest_water(z), _deepest_water(-z)
    ratio = protrusion / dip if dip > 0 else np.inf if protrusion > 0 else 0.0
    return Geometry("protrusion" if ratio > MUCH_LARGER else "dip", dip, protrusion, float(ratio))


def quality_index(
    x_m: ArrayLike,
    z_m: ArrayLike,
    line_speed_kmh: float,
    norm_mrad: Sequence[tuple[float, float]] = NORM_MRAD,
) -> QualityIndex:
    """Return the gradient quality index after Steenbergen & Esveld, Proc. IMechE F 220 (2006).

    As the makers of the instrument describe it (esveld.com, railprof.com): heights every 5 mm, averaged over five
    samples, their gradient from sample to sample, the largest one over a norm. Here the 5 mm grid is laid at ten
    offsets. The norm is linear between the speeds that are given and constant beyond them; the default's two values
    stand on esveld.com, the line between them is an assumption, and nothing was checked against the standard.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up, 0 at the smooth rail's level.
        line_speed_kmh: permitted speed.
        norm_mrad: largest gradient in mrad by speed in km/h, speeds increasing.

    Raises:
        InputError: not of that form.
    """
    gradient = largest_gradient(x_m, z_m)
    speeds, norms = zip(*norm_mrad, strict=True)
    norm = float(np.interp(line_speed_kmh, speeds, norms)) * 1e-3
    return QualityIndex(gradient / norm, gradient, norm)


def largest_gradient(x_m: ArrayLike, z_m: ArrayLike) -> float:
    """Return the largest gradient of heights averaged over 25 mm, rad: what `quality_index` holds against its norm.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), level beyond the ends.

    Raises:
        InputError: not of that form.
    """
    x, z = _checked(x_m, z_m)
    step, chord = _SAMPLING_M / _OFFSETS, _AVERAGED * _OFFSETS
    chord_m = chord * step
    heights = np.interp(np.arange(x[0] - chord_m, x[-1] + chord_m + step, step), x, z)  # level beyond the ends
    # The averages of neighbouring fives differ by what comes in and what drops out.
    return float(np.max(np.abs(heights[chord:] - heights[:-chord])) / chord_m)


def straightedge_gap(x_m: ArrayLike, z_m: ArrayLike) -> float:
    """Return the largest distance between the rail and a straightedge of 1 m that lies on it, wherever it is laid, m.

    Heights are read every 5 mm; the rail is level beyond the ends.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up.

    Raises:
        InputError: not of that form.
    """
    x, z = _checked(x_m, z_m)
    grid = np.arange(x[0] - STRAIGHTEDGE_M, x[-1] + STRAIGHTEDGE_M, _SAMPLING_M)
    return float(_straightedge.straightedge_gap(np.interp(grid, x, z), round(STRAIGHTEDGE_M / _SAMPLING_M)))


@dataclass(frozen=True)
class StraightedgeReading:
    """Readings under a straightedge laid over the weld, both positive.

    Attributes:
        base_m: length of the straightedge.
        peak_m: highest place of the rail above the line between the edge's ends.
        dip_m: lowest place of the rail below it.
    """

    base_m: float
    peak_m: float
    dip_m: float


def straightedge_readings(x_m: ArrayLike, z_m: ArrayLike, *, level_beyond: bool = False) -> list[StraightedgeReading]:
    """Return the readings under each straightedge of `EDGES_M` that the record is long enough for.

    Args:
        x_m: (n,), increasing, 0 at the weld's centre.
        z_m: (n,), positive up.
        level_beyond: whether the rail is known to be level beyond the record, as an exact shape's is.

    Raises:
        InputError: not of that form.
    """
    x, z = _checked(x_m, z_m)
    bases = [base for base in EDGES_M if level_beyond or min(-x[0], x[-1]) >= _COVERED * base / 2]
    readings = []
    for base in bases:
        ends = np.interp([-base / 2, base / 2], x, z)
        below = np.abs(x) < base / 2
        above_chord = z[below] - np.interp(x[below], [-base / 2, base / 2], ends)
        readings.append(
            StraightedgeReading(
                base, float(above_chord.max(initial=0.0)), float(np.maximum(0.0, -above_chord).max(initial=0.0))
            )
        )
    return readings


def inclinations(x_m: ArrayLike, z_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the rail's inclination along the weld as the quality index is defined: places and rad, each (n,).

    Relative to the chord of 1 m over the weld, whatever the record's length: the definition is in versines on a base of
    1 m, so that a bent rail has the same index from a long record as from a short one. Heights are averaged over 25 mm,
    which is the gradient between heights 25 mm apart.

    Args:
        x_m: (n,), increasing, 0 at the weld's centre.
        z_m: (n,), level beyond the ends.

    Raises:
        InputError: not of that form.
    """
    x, z = _checked(x_m, z_m)
    half, averaged = STRAIGHTEDGE_M / 2, _SAMPLING_M * _AVERAGED
    middles = np.arange(-half + averaged / 2, half - averaged / 2 + 1e-9, _SAMPLING_M / _OFFSETS)
    slopes = (np.interp(middles + averaged / 2, x, z) - np.interp(middles - averaged / 2, x, z)) / averaged
    first, last = np.interp([-half, half], x, z)
    return middles, slopes - (last - first) / STRAIGHTEDGE_M


def largest_inclination(x_m: ArrayLike, z_m: ArrayLike) -> float:
    """Return the largest of the `inclinations` along the weld, rad.

    Raises:
        InputError: not of that form.
    """
    return float(np.abs(inclinations(x_m, z_m)[1]).max())


def irregularity_length(x_m: ArrayLike, z_m: ArrayLike) -> float:
    """Return the length of a weld's main irregularity, m: twice the width at half height of its largest departure.

    Of a cosine dip that is its wavelength.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up, 0 at the smooth rail's level.

    Raises:
        InputError: not of that form.
    """
    x, z = _checked(x_m, z_m)
    at = int(np.abs(z).argmax())
    inside = np.sign(z[at]) * z >= abs(z[at]) / 2
    if z[at] == 0.0:
        return 0.0
    outside = np.flatnonzero(~inside)
    first = int(outside[outside < at].max(initial=0))
    last = int(outside[outside > at].min(initial=len(x) - 1))
    return float(2 * (x[last] - x[first]))


def largest_step(x_m: ArrayLike, z_m: ArrayLike) -> float:
    """Return the largest difference of heights within 10 mm, m: the step where two rail ends do not meet.

    Args:
        x_m: (n,), increasing.
        z_m: (n,), positive up.

    Raises:
        InputError: not of that form.
    """
    x, z = _checked(x_m, z_m)
    grid = np.arange(x[0], x[-1] + 1e-9, _SAMPLING_M / _OFFSETS)
    heights, apart = np.interp(grid, x, z), round(_STEP_WITHIN_M * _OFFSETS / _SAMPLING_M)
    return float(np.abs(heights[apart:] - heights[:-apart]).max(initial=0.0))


def _checked(x_m: ArrayLike, z_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
    x, z = np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64)
    if x.ndim != 1 or x.shape != z.shape or len(x) < 2 or np.any(np.diff(x) <= 0):
        raise InputError(
            f"places of shape {x.shape} for heights of shape {z.shape} make no profile",
            "give increasing places and one height for each",
        )
    return x, z


def _deepest_water(z: FloatArray) -> float:
    """Return the depth of the deepest basin between smooth rail at level 0 on either side."""
    shores = np.concatenate([[0.0], z, [0.0]])
    behind = np.maximum.accumulate(shores)
    ahead = np.maximum.accumulate(shores[::-1])[::-1]
    return float(np.max(np.minimum(behind, ahead) - shores))
