"""Piecewise cubics through samples: splines, and cubics that make no peak of their own.

The same numbers as of `scipy.interpolate` (to 1e-14) without its import: that takes a third of a second, more than the
simulation of a weld.
"""

from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics import _tridiagonal
from weld_force_ros.physics.arrays import FloatArray

Values = TypeVar("Values", bound=NDArray[np.inexact[Any]])


@dataclass(frozen=True)
class PiecewiseCubic:
    """A cubic between each two knots.

    Attributes:
        knots: (n,), increasing.
        coefficients: (4, n - 1, ...), of the powers 3 to 0 of the distance from the knot before.
    """

    knots: FloatArray
    coefficients: NDArray[np.inexact[Any]]

    def __call__(self, at: FloatArray) -> NDArray[np.inexact[Any]]:
        """Return the values at places, shape of `at` and behind it that of a sample; the outer cubics go on beyond."""
        along, (third, second, first, constant) = self._piece(at)
        return np.asarray(constant + first * along + second * along**2 + third * (along**2 * along))

    def slope(self, at: FloatArray) -> NDArray[np.inexact[Any]]:
        """Return the first derivative, as the values."""
        along, (third, second, first, _) = self._piece(at)
        return np.asarray(first + 2 * second * along + 3 * third * along**2)

    def _piece(self, at: FloatArray) -> tuple[FloatArray, NDArray[np.inexact[Any]]]:
        """Return the distance from the knot before, and the coefficients there."""
        piece = np.searchsorted(self.knots[1:-1], at, side="right")
        along = at - self.knots[piece]
        return along.reshape(along.shape + (1,) * (self.coefficients.ndim - 2)), self.coefficients[:, piece]


def spline(knots: FloatArray, samples: Values) -> PiecewiseCubic:
    """Return the spline whose third derivative has no step at the second and the last but one knot ("not a knot").

    Args:
        knots: (n,), increasing, at least two; through two goes a line, through three a parabola.
        samples: (n, ...).
    """
    width, slope = _widths_and_slopes(knots, samples)
    if len(width) == 1:
        return _through(knots, samples, np.repeat(slope, 2, axis=0))
    if len(width) == 2:
        middle = (width[1] * slope[0] + width[0] * slope[1]) / (width[0] + width[1])
        return _through(knots, samples, np.stack([2 * slope[0] - middle, middle, 2 * slope[1] - middle]))
    column = _as_column(width, samples)
    bands = np.zeros((3, len(knots)))
    bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = width[:-1], 2 * (width[:-1] + width[1:]), width[1:]
    bands[1, [0, -1]] = width[1], width[-2]
    first, last = knots[2] - knots[0], knots[-1] - knots[-3]
    bands[0, 1], bands[2, -2] = first, last
    right = np.empty(samples.shape, dtype=samples.dtype)
    right[1:-1] = 3 * (column[1:] * slope[:-1] + column[:-1] * slope[1:])
    right[0] = ((width[0] + 2 * first) * width[1] * slope[0] + width[0] ** 2 * slope[1]) / first
    right[-1] = (width[-1] ** 2 * slope[-2] + (2 * last + width[-1]) * width[-2] * slope[-1]) / last
    return _through(knots, samples, _solved(bands, right))


def periodic_spline(knots: FloatArray, samples: Values) -> PiecewiseCubic:
    """Return the spline of a period, which goes on after its last knot as it begins.

    Args:
        knots: (n,), increasing, at least four, the last a period after the first.
        samples: (n, ...), the last that of the first.
    """
    width, slope = _widths_and_slopes(knots, samples)
    column = _as_column(width, samples)
    right = 3 * (column * np.roll(slope, 1, axis=0) + np.roll(column, 1, axis=0) * slope)
    # The slope at the last of the n - 1 knots apart: what the others have without it, and what each unit of it adds.
    bands = np.zeros((3, len(knots) - 2))
    bands[0, 1:] = np.roll(width, 1)[: len(knots) - 3]
    bands[1], bands[2, :-1] = 2 * (np.roll(width, 1) + width)[:-1], width[1:-1]
    added = np.zeros(len(knots) - 2)
    added[0], added[-1] = -width[0], -width[-3]
    without: NDArray[np.inexact[Any]] = _solved(bands, right[:-1])
    with_unit = _as_column(_solved(bands, added), samples)
    alone = 2 * (width[-1] + width[-2]) + width[-2] * with_unit[0] + width[-1] * with_unit[-1]
    last = (right[-1] - width[-2] * without[0] - width[-1] * without[-1]) / alone
    inner = without + last * with_unit
    return _through(knots, samples, np.concatenate([inner, last[None], inner[:1]]))


def monotone_cubics(knots: FloatArray, samples: FloatArray) -> PiecewiseCubic:
    """Return cubics that rise and fall where the samples do, after Fritsch & Butland (1984).

    Args:
        knots: (n,), increasing, at least two, between which they are a line.
        samples: (n,).
    """
    width, slope = _widths_and_slopes(knots, samples)
    if len(width) == 1:
        return _through(knots, samples, np.repeat(slope, 2))
    same_way = np.sign(slope[1:]) * np.sign(slope[:-1]) > 0
    before, after = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (before / slope[:-1] + after / slope[1:]) / (before + after)
        inner = np.where(same_way, 1.0 / mean, 0.0)
    ends = _slope_at_end(width[:2], slope[:2]), _slope_at_end(width[:-3:-1], slope[:-3:-1])
    return _through(knots, samples, np.concatenate([ends[:1], inner, ends[1:]]))


def _slope_at_end(width: FloatArray, slope: FloatArray) -> float:
    """Return the slope at an end of its parabola through three knots, as far as it keeps the shape."""
    parabolas = ((2 * width[0] + width[1]) * slope[0] - width[0] * slope[1]) / (width[0] + width[1])
    if np.sign(parabolas) != np.sign(slope[0]):
        return 0.0
    turns = np.sign(slope[0]) != np.sign(slope[1]) and abs(parabolas) > 3.0 * abs(slope[0])
    return float(3.0 * slope[0] if turns else parabolas)


def _widths_and_slopes(knots: FloatArray, samples: Values) -> tuple[FloatArray, Values]:
    width = np.diff(knots)
    return width, np.diff(samples, axis=0) / _as_column(width, samples)


def _as_column(values: FloatArray, samples: NDArray[np.inexact[Any]]) -> FloatArray:
    return values.reshape(values.shape + (1,) * (samples.ndim - 1))


def _solved(bands: FloatArray, right: Values) -> Values:
    solution = right.reshape(len(right), -1).copy()
    _tridiagonal.solve(bands[2, :-1], bands[1], bands[0, 1:], solution)
    return cast(Values, solution.reshape(right.shape))


def _through(knots: FloatArray, samples: Values, slopes: Values) -> PiecewiseCubic:
    """Return the cubics that have these slopes at the knots (Hermite)."""
    width, secant = _widths_and_slopes(knots, samples)
    column = _as_column(width, samples)
    twist = (slopes[:-1] + slopes[1:] - 2 * secant) / column
    coefficients = np.stack([twist / column, (secant - slopes[:-1]) / column - twist, slopes[:-1], samples[:-1]])
    return PiecewiseCubic(knots, coefficients)
