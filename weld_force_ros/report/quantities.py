"""Write numbers with their units as people read them."""

from collections.abc import Callable
from typing import Final

from weld_force_ros._words import Words
from weld_force_ros.assessment.speed_advice import in_prose_kmh

UNITS: Final[dict[str, tuple[float, str]]] = {
    "%": (100.0, "%"), "N": (1e-3, "kN"), "s": (1e3, "ms"), "m": (1e3, "mm"), "rad": (1e3, "mrad"), "1": (1.0, ""),
}  # fmt: skip
"""Factor and unit under which a quantity in SI units is written."""
_SHARES = ("unloading",)  # read as per cent

Formatter = Callable[[float], str]


def number(value: float, digits: int = 3) -> str:
    """Return a number of so many significant digits, from 100 on as a whole number."""
    rounded = float(f"{value:.{digits}g}") + 0.0
    text = f"{round(value)}" if abs(rounded) >= 100 else f"{rounded:.10g}"
    return text.replace("-", "−")


def quantity(value: float, unit: str) -> str:
    """Return a quantity in SI units under the unit that people use; no length is finer than a micrometre."""
    factor, shown = UNITS.get(unit, (1.0, unit))
    return f"{number(round(value * factor, 3) if unit == 'm' else value * factor)} {shown}".rstrip()


def unit_of(name: str, unit: str) -> str:
    """Return the unit that a criterion is written in; shares are read as per cent."""
    return "%" if name in _SHARES else unit


def kilonewtons(force_n: float) -> str:
    """Return a force in kN."""
    return quantity(force_n, "N")


def kmh(speed_kmh: float) -> str:
    """Return a speed with its unit."""
    return f"{number(speed_kmh, 4)} km/h"


def prose_kmh(speed_kmh: float) -> str:
    """Return a computed speed in a sentence: rounded down to 5 km/h."""
    return kmh(in_prose_kmh(speed_kmh))


def centimetres(length_m: float) -> str:
    """Return a length in whole cm, without the unit."""
    return f"{round(length_m * 100) + 0:d}".replace("-", "−")


def hundredths(length_m: float) -> str:
    """Return a depth of cut in mm; no stone removes less than a hundredth."""
    return f"{length_m * 1e3:.2f} mm"


def percent(share: float) -> str:
    """Return a share in per cent; tenths only where a whole number would say nothing."""
    size = abs(share * 100)
    return f"{size:.1f} %" if 0 < size < 1 else f"{round(size)} %"


def probability(share: float, words: Words) -> str:
    """Return a probability; what is neither none nor all is not shown as such."""
    if 0 < share < 0.01:
        return words("answer.below_one_percent")
    return words("answer.above_99_percent") if 0.99 < share < 1 else percent(share)


def kilometres(chainage_m: float) -> str:
    """Return a chainage as `km 12.035`."""
    return f"km {chainage_m / 1e3:.3f}"
