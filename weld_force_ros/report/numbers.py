"""Numbers as a page needs them: short, and of few points where a screen shows no more."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

DIGITS = 5


def significant(value: float, digits: int = DIGITS) -> float:
    """A number with so many significant digits."""
    return float(f"{value:.{digits}g}")


def decimals(values: ArrayLike, places: int) -> list[float]:
    """Numbers with so many decimals; fewer characters than significant digits where all are of one quantity."""
    # Adding zero makes of -0.0, which costs a character and means nothing, 0.0.
    rounded: list[float] = (np.round(np.asarray(values, dtype=np.float64), places) + 0.0).tolist()
    return rounded


def short(content: Any) -> Any:
    """JSON content with every number shortened to significant digits."""
    match content:
        case dict():
            return {name: short(value) for name, value in content.items()}
        case list():
            return [short(value) for value in content]
        case float():
            return significant(content)
    return content


def thinned(values: ArrayLike, at_most: int) -> NDArray[np.intp]:
    """Which samples to draw of a curve: the ends, and of equal stretches the least and the greatest value."""
    values = np.asarray(values)
    if len(values) <= at_most:
        return np.arange(len(values))
    stretches = np.array_split(np.arange(len(values)), (at_most - 2) // 2)
    extremes = [stretch[pick(values[stretch])] for stretch in stretches for pick in (np.argmin, np.argmax)]
    return np.unique([0, *extremes, len(values) - 1])
