"""Reference shapes of welds and wheel flats: heights in m, positive up, as functions of the position in m.

The cosine shapes are exact. The five welds are modelled after what the text of the 2018 paper says about its figures
9, 14, 15, 18 and 19; their amplitudes and lengths are assumptions in the usual range of welds measured with a 1 m
straightedge. They are for demonstrations and tests; the studies use the shapes inferred from what the text says of the
forces (`weld-1` to `weld-5`, no formulas). Every shape begins and ends at zero with zero slope and has no kink.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRAIGHTEDGE_LENGTH_M = 1.0


def cosine_dip(x_m: Array, length_m: float, depth_m: float) -> Array:
    """Return one full cosine wave as a dip about x = 0, zero elsewhere; a negative depth makes it a protrusion.

    z = -depth/2 (1 + cos(2 pi x / length)) within half a length of 0.
    """
    inside = np.abs(x_m) <= length_m / 2
    return np.where(inside, -depth_m / 2 * (1 + np.cos(2 * np.pi * x_m / length_m)), 0.0)


def ramp(x_m: Array, start_m: float, end_m: float, height_m: float) -> Array:
    """Return a half cosine wave from 0 at `start_m` to `height_m` at `end_m`, constant outside."""
    share = np.clip((x_m - start_m) / (end_m - start_m), 0.0, 1.0)
    return np.asarray(height_m / 2 * (1 - np.cos(np.pi * share)))


def _bump(x_m: Array, centre_m: float, length_m: float, height_m: float) -> Array:
    return cosine_dip(x_m - centre_m, length_m, -height_m)


def weld_1_dip(x_m: Array) -> Array:
    """Return weld 1 (Fig. 9): a central dip of mixed scale, with components of 55, 25 and 16.5 cm wavelength.

    The positions of this and the other welds run from the start of the straightedge, 0 to 1 m.
    """
    s = x_m - STRAIGHTEDGE_LENGTH_M / 2
    components = ((0.55, 0.06e-3), (0.25, 0.065e-3), (0.165, 0.065e-3))
    waves = sum(amplitude * np.cos(2 * np.pi * s / wavelength) for wavelength, amplitude in components)
    return _bump(x_m, STRAIGHTEDGE_LENGTH_M / 2, STRAIGHTEDGE_LENGTH_M, -1.0) * waves


def weld_2_rise_between_shrinkages(x_m: Array) -> Array:
    """Return weld 2 (Fig. 14): a central rise between two shrinkages, the first and larger one at 47 cm."""
    return _bump(x_m, 0.47, 0.09, -0.10e-3) + _bump(x_m, 0.545, 0.10, 0.10e-3) + _bump(x_m, 0.62, 0.09, -0.06e-3)


def weld_3_long_ground_dip(x_m: Array) -> Array:
    """Return weld 3 (Fig. 15): a long dip in the central ground zone between protrusions at the start and the end."""
    return _bump(x_m, 0.16, 0.32, 0.14e-3) + _bump(x_m, 0.50, 0.66, -0.30e-3) + _bump(x_m, 0.85, 0.30, 0.12e-3)


def weld_4_steep_ramp(x_m: Array) -> Array:
    """Return weld 4 (Fig. 18): a steep upward ramp at the beginning, then a long way down."""
    return ramp(x_m, 0.10, 0.20, 0.40e-3) - ramp(x_m, 0.25, 0.95, 0.40e-3)


def weld_5_ramp_protrusion(x_m: Array) -> Array:
    """Return weld 5 (Fig. 19): an upward ramp at the beginning of a protrusion with small dips about the centre."""
    protrusion = ramp(x_m, 0.10, 0.25, 0.14e-3) - ramp(x_m, 0.70, 0.95, 0.14e-3)
    return (
        protrusion
        + _bump(x_m, 0.42, 0.10, -0.03e-3)
        + _bump(x_m, 0.50, 0.10, 0.02e-3)
        + _bump(x_m, 0.58, 0.10, -0.025e-3)
    )


REFERENCE_SHAPES: dict[str, Callable[[Array], Array]] = {
    "weld-1-dip": weld_1_dip,
    "weld-2-rise-between-shrinkages": weld_2_rise_between_shrinkages,
    "weld-3-long-ground-dip": weld_3_long_ground_dip,
    "weld-4-steep-ramp": weld_4_steep_ramp,
    "weld-5-ramp-protrusion": weld_5_ramp_protrusion,
    "cosine-dip-48mm": lambda x_m: cosine_dip(x_m, 0.048, 40e-6),
    "cosine-dip-96mm": lambda x_m: cosine_dip(x_m, 0.096, 40e-6),
    "cosine-rise-48mm": lambda x_m: cosine_dip(x_m, 0.048, -40e-6),
    "wheel-flat-0.9mm": lambda x_m: cosine_dip(x_m, 0.100, 0.9e-3),
}
"""Formulas of the shipped profiles; x is 0 at the straightedge's start for the welds, at the centre for the rest."""
