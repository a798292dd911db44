"""Shorten numbers and curves to what a page shows."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

DIGITS = 5


def significant(value: float, digits: int = DIGITS) -> float:
    """Return a number rounded to significant digits."""
    return float(f"{value:.{digits}g}")


def decimals(values: ArrayLike, places: int) -> list[float]:
    """Return numbers rounded to decimals: fewer characters than significant digits where all are of one quantity."""
    # Adding zero makes of -0.0, which costs a character and means nothing, 0.0.
    rounded: list[float] = (np.round(np.asarray(values, dtype=np.float64), places) + 0.0).tolist()
    return rounded


def short(content: Any) -> Any:
    """Return JSON content with every number rounded to `DIGITS` significant digits."""
    match content:
        case dict():
            return {name: short(value) for name, value in content.items()}
        case list():
            return [short(value) for value in content]
        case float():
            return significant(content)
    return content


def without_none(content: dict[str, Any]) -> dict[str, Any]:
    """Return JSON content without the names whose value is None."""
    return {name: value for name, value in content.items() if value is not None}


def thinned(values: ArrayLike, at_most: int) -> NDArray[np.intp]:
    """Return the indices of samples to draw of a curve: its ends, and the extremes of each of its equal parts.

    Args:
        values: of the curve, (n,).
        at_most: number of samples; if there are no more, all are drawn.
    """
    values = np.asarray(values)
    if len(values) <= at_most:
        return np.arange(len(values))
    parts = np.array_split(np.arange(len(values)), (at_most - 2) // 2)
    extremes = [part[pick(values[part])] for part in parts for pick in (np.argmin, np.argmax)]
    return np.unique([0, *extremes, len(values) - 1])
