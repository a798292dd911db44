"""What to say about speed: force is not monotonic in it, so that a restriction can make things worse.

A speed counts as within limits if every force criterion is on which the decision hangs; limits for lines of certain
speeds are those of a line whose speed it is. What the geometry says by itself does not hang on speed and is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.assessment.limits import held_values
from weld_force_ros.messages import HollowBand, Limit, Restriction, SpeedBand
from weld_force_ros.physics.analysis.speed_curve import curve_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages

RESTRICTION_STEP_KMH = 20.0
_WORTH_SAYING = 0.01  # of the peak


@dataclass(frozen=True)
class Advice:
    """What a force-speed curve says to whoever sets the speed; see `weld_force_ros.messages.Verdict`."""

    permitted_kmh: float | None
    avoid: tuple[SpeedBand, ...]
    restrictions: tuple[Restriction, ...]
    maxima_kmh: tuple[float, ...]
    hollows: tuple[HollowBand, ...]
    words: tuple[str, ...]
    step_kmh: float


def advise(speeds_kmh: FloatArray, worst: Passages, limits: Sequence[Limit]) -> Advice:
    """Advice on speed.

    Args:
        speeds_kmh: (n,), increasing, up to the line's speed.
        worst: (n,), the worst over all positions that count at each speed.
        limits: those for criteria of force count.
    """
    upto_within, beyond = _within(speeds_kmh, worst, limits)
    first_bad = int(np.argmin(upto_within)) if not upto_within.all() else len(speeds_kmh)
    permitted = float(speeds_kmh[first_bad - 1]) if first_bad else None
    restrictions = _restrictions(speeds_kmh, worst.peak_n, upto_within)
    maxima, hollows = _shape(speeds_kmh, worst.peak_n)
    return Advice(
        permitted_kmh=permitted,
        avoid=_bands(speeds_kmh, beyond),
        restrictions=restrictions,
        maxima_kmh=maxima,
        hollows=hollows,
        words=(_on_permitted(permitted, speeds_kmh), *_on_restrictions(restrictions), *_on_hollows(hollows)),
        step_kmh=float(np.diff(speeds_kmh).max()) if len(speeds_kmh) > 1 else 1.0,
    )


def _within(
    speeds_kmh: FloatArray, worst: Passages, limits: Sequence[Limit]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether all speeds up to each are within the limits of a line of that speed, and whether each itself is not."""
    upto_within = np.ones(len(speeds_kmh), dtype=bool)
    beyond = np.zeros(len(speeds_kmh), dtype=bool)
    for limit, held, values in held_values(speeds_kmh, worst, limits):
        upto_within &= ~held | (np.maximum.accumulate(values) <= limit.limit)
        beyond |= held & (values > limit.limit)
    return upto_within, beyond


def _bands(speeds_kmh: FloatArray, inside: NDArray[np.bool_]) -> tuple[SpeedBand, ...]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]))).reshape(-1, 2)
    return tuple(
        SpeedBand(from_kmh=float(speeds_kmh[first]), to_kmh=float(speeds_kmh[last - 1])) for first, last in edges
    )


def _restrictions(
    speeds_kmh: FloatArray, peak_n: FloatArray, upto_within: NDArray[np.bool_]
) -> tuple[Restriction, ...]:
    """The highest speed, then every step below it; each at the nearest computed speed that is not above it."""
    top = float(speeds_kmh[-1])
    below = np.arange(np.ceil(top / RESTRICTION_STEP_KMH) - 1, 0, -1) * RESTRICTION_STEP_KMH
    at = np.searchsorted(speeds_kmh, [top, *below[below >= speeds_kmh[0]]], side="right") - 1
    return tuple(
        Restriction(
            speed_kmh=float(speeds_kmh[i]),
            peak_force_n=float(peak_n[i]),
            change=float(peak_n[i] / peak_n[-1] - 1),
            within_limits=bool(upto_within[i]),
        )
        for i in dict.fromkeys(at.tolist())
    )


def _shape(speeds_kmh: FloatArray, peak_n: FloatArray) -> tuple[tuple[float, ...], tuple[HollowBand, ...]]:
    if len(speeds_kmh) < 3:
        return (), ()
    features = curve_features(speeds_kmh, peak_n)
    hollows = (
        HollowBand(from_kmh=h.from_kmh, lowest_kmh=h.lowest_kmh, to_kmh=h.to_kmh, depth_n=h.depth_n)
        for h in features.hollows
    )
    return tuple(maximum.speed_kmh for maximum in features.maxima), tuple(hollows)


def _on_permitted(permitted_kmh: float | None, speeds_kmh: FloatArray) -> str:
    first, top = float(speeds_kmh[0]), float(speeds_kmh[-1])
    if permitted_kmh is None:
        return f"forces are over the limit at {first:g} km/h already, the lowest speed computed"
    if permitted_kmh == top:
        return f"forces are within limits at all speeds from {first:g} to {top:g} km/h"
    return f"forces are within limits up to {permitted_kmh:g} km/h"


def _on_restrictions(restrictions: Sequence[Restriction]) -> list[str]:
    """The mildest restriction that helps, if one is needed, and the one that harms most, if one does."""
    top, *slower = restrictions
    harms = max(slower, key=lambda r: r.change, default=top)
    helps = next((r for r in slower if r.within_limits), None)
    words = []
    if helps is not None and not top.within_limits:
        words.append(f"{_slowing(top, helps)} and brings it within limits")
    if harms.change > _WORTH_SAYING:
        words.append(_slowing(top, harms))
    return words


def _slowing(top: Restriction, to: Restriction) -> str:
    does = "raises" if to.change > 0 else "lowers"
    return f"slowing from {top.speed_kmh:g} to {to.speed_kmh:g} km/h {does} the peak by {abs(to.change) * 100:.0f} %"


def _on_hollows(hollows: Sequence[HollowBand]) -> list[str]:
    return [
        f"between {h.from_kmh:.0f} and {h.to_kmh:.0f} km/h the peak is up to {h.depth_n / 1e3:.0f} kN less than at "
        f"{h.from_kmh:.0f} km/h"
        for h in hollows
        if h.depth_n >= 500.0
    ]
