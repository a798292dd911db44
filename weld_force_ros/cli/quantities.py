"""Options that are quantities, as people write them: a number and its unit, `112.5kN`, `0.03 mm`, `80km/h`.

A number without a unit has the first of its dimension: N, m, kg, km/h. Each function is the callback of an option that
arrives as text (`parser=str`).
"""

import math
import re
from collections.abc import Mapping

import typer

from weld_force_ros.errors import InputError

_FORCES_N = {"N": 1.0, "kN": 1e3}
_LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_MASSES_KG = {"kg": 1.0, "t": 1e3}
_SPEEDS_KMH = {"km/h": 1.0}


def force_n(option: typer.CallbackParam, given: str | None) -> float | None:
    """Return a force in N."""
    return _quantity(option, given, _FORCES_N, "100kN")


def length_m(option: typer.CallbackParam, given: str | None) -> float | None:
    """Return a length in m."""
    return _quantity(option, given, _LENGTHS_M, "0.46m or 460mm")


def mass_kg(option: typer.CallbackParam, given: str | None) -> float | None:
    """Return a mass in kg."""
    return _quantity(option, given, _MASSES_KG, "600kg")


def speed_kmh(option: typer.CallbackParam, given: str | None) -> float | None:
    """Return a speed in km/h."""
    return _quantity(option, given, _SPEEDS_KMH, "80 or 80km/h")


def _quantity(option: typer.CallbackParam, given: str | None, units: Mapping[str, float], example: str) -> float | None:
    """Return a number in the first of its units; None if the option is not given.

    Raises:
        InputError: no number, or another unit.
    """
    if given is None:
        return None
    found = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*([a-zA-Zµ/]*)\s*", given)
    factor = None if found is None else units.get(found[2] or next(iter(units)))
    try:
        if found is None or factor is None or not math.isfinite(value := float(found[1])):
            raise ValueError
    except ValueError:
        raise InputError(
            f"{option.opts[0]} {given!r} cannot be read", f"write {example}; units are {', '.join(units)}"
        ) from None
    return value * factor
