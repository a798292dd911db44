"""Divide a removal of metal into the spots that are ground, and bound what a hand grinder makes of them."""

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros.assessment.grinding_search import Profile, Removal
from weld_force_ros.messages import ChainageDirection, GrindingSpot, RailSide
from weld_force_ros.physics.arrays import FloatArray

NOTABLE_M = 5e-6
"""Removal from which on a place is said to be ground."""
_WORDS = {
    "rising chainage": "towards rising chainage",
    "falling chainage": "against rising chainage",
    "both": "on both sides",
}
_UNKNOWN = "chainage not stated"


def grinding_spots(removal: Removal, chainage: ChainageDirection | UnsetType = UNSET) -> list[GrindingSpot]:
    """Return where metal is removed, piece by piece in the order of x.

    Args:
        removal: of the weld.
        chainage: which way it goes along x, where that is known.
    """
    x, depth = removal.x_m, removal.removal_m
    spots = []
    for piece in _pieces(depth):
        deepest = piece.start + int(depth[piece].argmax())
        first, last = float(x[piece.start]), float(x[piece.stop - 1])
        spots.append(
            GrindingSpot(
                from_m=first,
                to_m=last,
                depth_m=float(depth[deepest]),
                deepest_m=float(x[deepest]),
                side=_side(first, last, chainage),
            )
        )
    return spots


def side_in_words(spot: GrindingSpot) -> str:
    """Return on which side of the weld's centre a spot lies, as people say it along the line."""
    if not isinstance(spot.side, UnsetType):
        return _WORDS[spot.side]
    where = "on both sides" if spot.from_m < 0 < spot.to_m else "x > 0" if spot.from_m >= 0 else "x < 0"
    return where if spot.from_m < 0 < spot.to_m else f"{where}; {_UNKNOWN}"


def ends_in_words(chainage: ChainageDirection | UnsetType) -> tuple[str, str]:
    """Return what lies beyond the ends of a weld, that of falling x and that of rising x."""
    if isinstance(chainage, UnsetType):
        return f"x < 0 ({_UNKNOWN})", "x > 0"
    ends = ("falling chainage", "rising chainage")
    return ends if chainage == "with" else (ends[1], ends[0])


def by_hand(removal: Removal, margin_m: float) -> list[Profile]:
    """Return the shapes that a hand grinder may leave instead: its depth off by a margin wherever it grinds.

    Everywhere too deep, everywhere too shallow, and in each spot one end too deep and the other too shallow. Nowhere
    less than nothing is removed, and where the removal is shallower than the margin it is off by itself.

    Args:
        removal: as advised.
        margin_m: of its depth.
    """
    x, ground = removal.x_m, removal.ground_m
    off = np.minimum(margin_m, removal.removal_m)
    tilt = np.zeros(len(x))
    for piece in _pieces(removal.removal_m):
        first, last = x[piece.start], x[piece.stop - 1]
        tilt[piece] = np.sin(2 * np.pi * (x[piece] - first) / max(last - first, 1e-9))
    return [(x, ground + sign * off * shape) for shape in (np.ones(len(x)), tilt) for sign in (-1.0, 1.0)]


def _pieces(removal_m: FloatArray) -> list[slice]:
    """Return the stretches of a removal (n,) that are notable; of a shallow one those deeper than half of it."""
    ground = removal_m > min(NOTABLE_M, removal_m.max() / 2)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ground, [False]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _side(first_m: float, last_m: float, chainage: ChainageDirection | UnsetType) -> RailSide | UnsetType:
    if isinstance(chainage, UnsetType):
        return UNSET
    if first_m < 0 < last_m:
        return "both"
    return "rising chainage" if (first_m >= 0) == (chainage == "with") else "falling chainage"
