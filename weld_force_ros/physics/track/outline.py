"""Outline of a flat-bottom rail's cross-section: arcs and lines, tangent to each other, from the crown to the foot.

One half, as sections are symmetric about their vertical axis; y from that axis, z from the foot's underside. Between
two straight parts lies a chain of arcs. All but one of its turns are given: that one turns by what is left, and where
the chain begins follows from its having to end on the next straight part.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import FloatArray

_SAMPLE_M = 2e-5


@dataclass(frozen=True)
class Dimensions:
    """A section's published dimensions.

    Attributes:
        height_m: from the underside to the crown.
        crown: arcs from the middle outwards: radius, and half the width of the head where it ends; the last one, of
            width None, ends where the head's side begins.
        side_slope: height over width of the head's side, which widens downwards.
        fishing: height at which the head's underside, prolonged, meets the axis, and its width over height.
        web_m: its thickness where it is thinnest.
        foot_top: as `fishing`, of the foot's upper side next to the web.
        foot_edge: height of the upper side at the foot's edge, and its width over height there.
        foot_width_m: of the underside.
        fillets: arcs between side, fishing surface, web, foot top, its outer part, edge and underside: of each radius,
            and what it turns by in rad, or None for what is left.
    """

    height_m: float
    crown: tuple[tuple[float, float | None], ...]
    side_slope: float
    fishing: tuple[float, float]
    web_m: float
    foot_top: tuple[float, float]
    foot_edge: tuple[float, float]
    foot_width_m: float
    fillets: tuple[tuple[tuple[float, float | None], ...], ...]


@dataclass(frozen=True)
class Outline:
    """Half an outline.

    Attributes:
        points_m: (n, 2), y and z from the crown to the middle of the underside, as dense as a curve.
        corners: indices of points in the middle of what turns most: crown's corner, head's lower corner, upper and
            lower fillet of the web, foot's upper and lower corner.
    """

    points_m: FloatArray
    corners: tuple[int, ...]

    @property
    def area_m2(self) -> float:
        """Return the area of the whole section."""
        y, z = self.points_m.T
        return float(abs(np.sum((y[1:] + y[:-1]) * np.diff(z))))


def outline(dimensions: Dimensions, wear_m: float = 0.0) -> Outline:
    """Return half the outline of a section.

    Args:
        dimensions: as published.
        wear_m: by how much the crown is lower, worn or ground; it keeps its form, but for becoming as much wider as the
            head's side does.

    Raises:
        InputError: dimensions or wear that leave no such section.
    """
    d, half_foot_m = dimensions, dimensions.foot_width_m / 2
    side = -np.arctan(d.side_slope)
    crown = _crown(d, side, wear_m)
    lines = [
        _Line(crown[-1], side),
        _Line((0.0, d.fishing[0]), np.arctan(1 / d.fishing[1]) - np.pi),
        _Line((d.web_m / 2, 0.0), -np.pi / 2),
        _Line((0.0, d.foot_top[0]), -np.arctan(1 / d.foot_top[1])),
        _Line((half_foot_m, d.foot_edge[0]), -np.arctan(1 / d.foot_edge[1])),
        _Line((half_foot_m, 0.0), -np.pi / 2),
        _Line((0.0, 0.0), -np.pi),
    ]
    pieces, corners = [crown], [int(np.argmin(np.abs(_headings(crown) - side / 2)))]
    for (before, after), arcs in zip(itertools.pairwise(lines), d.fillets, strict=True):
        fillet = _fillet(before, after, arcs)
        if np.dot(fillet[0] - pieces[-1][-1], before.direction) < -_SAMPLE_M:
            raise InputError(
                f"a section's outline crosses itself at y {fillet[0][0] * 1e3:.1f}, z {fillet[0][1] * 1e3:.1f} mm",
                "give radii, slopes and wear that leave a straight part between any two fillets",
            )
        pieces.append(_straight(pieces[-1][-1], fillet[0]))
        middle = (before.heading_rad + after.heading_rad) / 2
        corners.append(sum(map(len, pieces)) + int(np.argmin(np.abs(_headings(fillet) - middle))))
        pieces.append(fillet)
    pieces += [_straight(pieces[-1][-1], np.zeros(2)), np.zeros((1, 2))]
    return Outline(np.concatenate(pieces), tuple(corners[k] for k in (0, 1, 2, 3, 5, 6)))


class _Line:
    """A straight part of the outline, run along from crown to foot; `heading_rad` from the y axis, anticlockwise."""

    def __init__(self, through: ArrayLike, heading_rad: float) -> None:
        self.through = np.asarray(through, dtype=np.float64)
        self.heading_rad = float(heading_rad)
        self.direction = np.array([np.cos(heading_rad), np.sin(heading_rad)])


def _crown(d: Dimensions, side: float, wear_m: float) -> FloatArray:
    reaches = [0.0]
    for radius_m, half_width_m in d.crown[:-1]:
        reaches.append(np.nan if half_width_m is None else half_width_m)
        if not 0 < reaches[-1] - reaches[-2] < radius_m:
            raise InputError(
                "a section's crown has an arc that ends before it begins, or nowhere",
                "give half widths that grow, by less than the arcs' radii, and none for the last arc",
            )
    if d.crown[-1][1] is not None:
        raise InputError("the last arc of a section's crown ends at the head's side", "leave out its half width")
    heading, y, arcs = 0.0, 0.0, []
    for radius_m, half_width_m in d.crown:
        end = side if half_width_m is None else -np.arcsin(np.sin(-heading) + (half_width_m - y) / radius_m)
        arcs.append((radius_m, end - heading))
        heading, y = end, y if half_width_m is None else half_width_m
    new = _arcs(np.zeros(2), 0.0, arcs)
    y, depth = new[-1, 0], -new[-1, 1]
    widened = (y + (wear_m - depth) / d.side_slope) / (y - depth / d.side_slope)
    return np.asarray(new * widened + np.array([0.0, d.height_m - wear_m]))


def _fillet(before: _Line, after: _Line, arcs: Sequence[tuple[float, float | None]]) -> FloatArray:
    """Return points of a chain of arcs that leads from one line into the next."""
    turn = after.heading_rad - before.heading_rad
    sign, given = np.sign(turn), sum(own for _, own in arcs if own is not None)
    turns = [(radius_m, sign * (abs(turn) - given if own is None else own)) for radius_m, own in arcs]
    if sum(own is None for _, own in arcs) != 1 or any(sign * own <= 0 for _, own in turns):
        raise InputError(
            "arcs of a section's fillet turn by more or less than it does", "give smaller turns, and none for one arc"
        )
    chain = _arcs(np.zeros(2), before.heading_rad, turns)
    end = before.through + chain[-1] - after.through
    along = -_cross(end, after.direction) / _cross(before.direction, after.direction)
    return chain + before.through + along * before.direction


def _arcs(start: FloatArray, heading: float, arcs: Iterable[tuple[float, float]]) -> FloatArray:
    """Return points of arcs that follow each other: of each its radius, and the angle that it turns by."""
    points = [start[None]]
    for radius_m, turn in arcs:
        angles = heading + np.linspace(0.0, turn, max(3, int(abs(turn) * radius_m / _SAMPLE_M) + 1))
        left = np.sign(turn) * radius_m * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
        points.append((points[-1][-1] + left[0] - left)[1:])
        heading += turn
    return np.concatenate(points)


def _straight(begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return points between two others."""
    count = max(2, int(np.hypot(*(end - begin)) / _SAMPLE_M))
    return (begin + np.linspace(0.0, 1.0, count + 1)[1:-1, None] * (end - begin)).reshape(-1, 2)


def _headings(points: FloatArray) -> FloatArray:
    steps = np.diff(points, axis=0)
    return np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))


def _cross(a: FloatArray, b: FloatArray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
