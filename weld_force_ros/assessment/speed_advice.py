"""Advise on speed: force is not monotonic in it, so that a speed restriction can make things worse.

Where fit error and model uncertainty are known, no difference smaller than they are is told: neither a local minimum
nor a maximum, nor what a restriction changes, nor a speed beyond limits.

A speed is within limits if every force criterion that decides is; limits for lines of certain speeds are those of a
line of that speed. Geometry criteria do not depend on speed and are left out.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from weld_force_ros.assessment.limits import within_limits
from weld_force_ros.messages import CurveClass, HollowBand, Limit, Restriction, SpeedBand
from weld_force_ros.physics.analysis.speed_curve import curve_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages

RESTRICTION_STEP_KMH = 20.0
_ROUNDED_KMH = 5.0  # downwards: a speed in words
_WORTH_SAYING = 0.01  # of the peak


class SpeedAdvice(msgspec.Struct, frozen=True, kw_only=True):
    """Advice on speed from a force-speed curve: fields of `weld_force_ros.messages.Verdict`."""

    curve_class: CurveClass
    maxima_kmh: list[float]
    hollows: list[HollowBand]
    permitted_speed_kmh: float | UnsetType
    avoid: list[SpeedBand]
    restrictions: list[Restriction]
    advice: list[str]
    advice_step_kmh: float


def advise(
    speeds_kmh: FloatArray, worst: Passages, limits: Sequence[Limit], error_share: float | None = None
) -> SpeedAdvice:
    """Return advice on speed.

    Args:
        speeds_kmh: (n,), increasing, up to the line's speed.
        worst: (n,), the worst over all relevant positions at each speed.
        limits: those for force criteria count.
        error_share: fit error and model uncertainty, a standard deviation as a share of the force's dynamic part; with
            None, as in earlier versions, every difference is told and speeds in words are not rounded.
    """
    share, rest_n = error_share or 0.0, worst.static_load_n
    up_to_within = within_limits(speeds_kmh, worst.accumulated(), limits)
    within_up_to = len(speeds_kmh) if up_to_within.all() else int(np.argmin(up_to_within))
    permitted = float(speeds_kmh[within_up_to - 1]) if within_up_to else None
    restrictions = _restrictions(speeds_kmh, worst.peak_force_n, up_to_within)
    maxima, hollows = _shape(speeds_kmh, worst.peak_force_n, share, rest_n)
    return SpeedAdvice(
        curve_class="hollow" if hollows else "rises",
        maxima_kmh=maxima,
        hollows=hollows,
        permitted_speed_kmh=UNSET if permitted is None else permitted,
        avoid=_avoid(speeds_kmh, worst, limits, share),
        restrictions=restrictions,
        advice=[
            _on_permitted(permitted, speeds_kmh) if error_share is None else _on_highest(permitted, speeds_kmh),
            *_on_restrictions(restrictions, share, rest_n),
            *_on_hollows(hollows),
        ],
        advice_step_kmh=float(np.diff(speeds_kmh).max()) if len(speeds_kmh) > 1 else 1.0,
    )


def _avoid(speeds_kmh: FloatArray, worst: Passages, limits: Sequence[Limit], share: float) -> list[SpeedBand]:
    """Return the speeds beyond limits, of those bands that reach beyond them by more than `error_share`."""
    clearly = ~within_limits(speeds_kmh, lessened(worst, share), limits)
    bands = runs(~within_limits(speeds_kmh, worst, limits))
    return [
        SpeedBand(from_kmh=float(speeds_kmh[band][0]), to_kmh=float(speeds_kmh[band][-1]))
        for band in bands
        if clearly[band].any()
    ]


def lessened(worst: Passages, share: float) -> Passages:
    """Return passages whose forces depart less from rest, by a share: what is beyond limits even so clearly is."""
    rest_n = worst.static_load_n
    less: dict[str, Any] = {
        name: values if name == "contact_loss_s" else rest_n + (1 - share) * (values - rest_n)
        for name, values in worst.columns.items()
    }
    return replace(worst, **less)


def runs(inside: NDArray[np.bool_]) -> list[slice]:
    """Return the runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]))).reshape(-1, 2)
    return [slice(first, last) for first, last in edges.tolist()]


def _restrictions(speeds_kmh: FloatArray, peak_n: FloatArray, up_to_within: NDArray[np.bool_]) -> list[Restriction]:
    """Return the highest speed, then every step below it."""
    return [
        Restriction(
            speed_kmh=float(speeds_kmh[i]),
            peak_force_n=float(peak_n[i]),
            change=float(peak_n[i] / peak_n[-1] - 1),
            within_limits=bool(up_to_within[i]),
        )
        for i in restricted(speeds_kmh)
    ]


def restricted(speeds_kmh: FloatArray) -> list[int]:
    """Return the indices of the highest speed, then of every step below it: the nearest speed that is not above it."""
    top = float(speeds_kmh[-1])
    below = np.arange(np.ceil(top / RESTRICTION_STEP_KMH) - 1, 0, -1) * RESTRICTION_STEP_KMH
    at = np.searchsorted(speeds_kmh, [top, *below[below >= speeds_kmh[0]]], side="right") - 1
    return [*dict.fromkeys(at.tolist())]


def _shape(
    speeds_kmh: FloatArray, peak_n: FloatArray, share: float, rest_n: float
) -> tuple[list[float], list[HollowBand]]:
    if len(speeds_kmh) < 3:
        return [], []
    features = curve_features(speeds_kmh, peak_n)
    before_n = np.maximum.accumulate(peak_n)
    summits_n = np.interp([hollow.from_kmh for hollow in features.hollows], speeds_kmh, before_n)
    hollows = [
        HollowBand(**asdict(hollow))
        for hollow, summit_n in zip(features.hollows, summits_n, strict=True)
        if hollow.depth_n >= share * (summit_n - rest_n)
    ]
    maxima = [
        maximum.speed_kmh for maximum in features.maxima if maximum.prominence_n >= share * (maximum.force_n - rest_n)
    ]
    return maxima, hollows


def _on_permitted(permitted_kmh: float | None, speeds_kmh: FloatArray) -> str:
    first, top = float(speeds_kmh[0]), float(speeds_kmh[-1])
    if permitted_kmh is None:
        return f"forces are over the limit at {first:g} km/h already, the lowest speed computed"
    if permitted_kmh == top:
        return f"forces are within limits at all speeds from {first:g} to {top:g} km/h"
    return f"forces are within limits up to {permitted_kmh:g} km/h"


def _on_highest(highest_kmh: float | None, speeds_kmh: FloatArray) -> str:
    first, top = float(speeds_kmh[0]), float(speeds_kmh[-1])
    if highest_kmh is None or highest_kmh == top:
        return _on_permitted(highest_kmh, speeds_kmh)
    return f"highest computed speed with all forces within limits: {in_prose_kmh(highest_kmh, first):g} km/h"


def in_prose_kmh(speed_kmh: float, lowest_kmh: float = 0.0) -> float:
    """Return a speed as words have it: rounded down to 5 km/h, but not below the lowest that was computed."""
    rounded = float(np.floor(speed_kmh / _ROUNDED_KMH) * _ROUNDED_KMH)
    return rounded if rounded >= max(lowest_kmh, _ROUNDED_KMH) else speed_kmh


def _on_restrictions(restrictions: Sequence[Restriction], share: float, rest_n: float) -> list[str]:
    """Describe the mildest restriction that helps, if one is needed, and the one that harms most, if one does."""
    top, *slower = restrictions
    harms = max(slower, key=lambda r: r.change, default=top)
    helps = next((r for r in slower if r.within_limits), None)
    words = []
    if helps is not None and not top.within_limits and _differ(top, helps, share, rest_n):
        words.append(f"{_slowing(top, helps)} and brings it within limits")
    if harms.change > _WORTH_SAYING and _differ(top, harms, share, rest_n):
        words.append(_slowing(top, harms))
    return words


def _differ(one: Restriction, other: Restriction, share: float, rest_n: float) -> bool:
    highest_n, lowest_n = sorted((one.peak_force_n, other.peak_force_n), reverse=True)
    return highest_n - lowest_n >= share * (highest_n - rest_n)


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
