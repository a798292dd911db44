"""Know what a header block states of a measurement: weld, place, date, instrument, units."""

import difflib
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from decimal import Decimal
from typing import NamedTuple

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.measurement.numbers import METRES, number, unit_of
from weld_force_ros.measurement.sample_table import Statement
from weld_force_ros.measurement.text_file import quoted

REQUIRED = ("x_unit", "z_unit", "z_positive")
TEXTS = ("weld_id", "line", "rail", "instrument", "calibration", "operator", "measured_on")
NUMBERS = ("chainage_m", "line_speed_kmh", "weld_position_m")
KINDS = ("weld", "joint", "squat")
DIRECTIONS = ("running", "chainage_direction")
RUNNING = ("with", "against", "both")
KEYS = (*REQUIRED, *TEXTS, *NUMBERS, *DIRECTIONS, "support", "kind", "detrend", "centre", "noise", "samples")

_CHOICES = {
    "z_positive": ("up", "down"), "detrend": ("line", "none"), "kind": (*KINDS, "wheel"), "running": RUNNING,
    "chainage_direction": ("with", "against"),
}  # fmt: skip
_WORDS = {
    "weld_id": ("weld", "weld id", "weld no", "weld number", "weld name", "joint", "joint id", "schweissung",
                "schweissung nr", "schweissstoss", "schweissstoss nr", "las", "lasnummer"),
    "line": ("line", "route", "line no", "line number", "strecke", "streckennummer"),
    "rail": ("rail", "schiene", "spoorstaaf"),
    "chainage_m": ("chainage", "chainage m", "chainage km", "km", "kilometer", "kilometrierung", "stationierung",
                   "station", "location"),
    "line_speed_kmh": ("line speed", "vmax", "speed limit", "streckengeschwindigkeit", "baanvaksnelheid"),
    "running": ("direction", "running direction", "train direction", "direction of running", "fahrtrichtung",
                "rijrichting"),
    "measured_on": ("date", "datum", "measured", "measured on", "measurement date", "messdatum", "date and time"),
    "operator": ("operator", "bediener", "prufer", "inspector", "surveyor"),
    "instrument": ("instrument", "gerat", "messgerat", "device", "serial number", "serial no"),
    "calibration": ("calibration", "calibrated", "calibrated on", "calibration date"),
    "samples": ("samples", "points", "count", "npoints", "xypoints", "anzahl", "number of samples"),
    "x_unit": ("unitx", "unit x", "x unit", "xunits"),
    "z_unit": ("unitz", "unit z", "z unit", "yunits", "unity"),
}  # fmt: skip


class Stated(NamedTuple):
    """What is stated, and where: a prefix for messages such as `line 3: `, or nothing for the format and the user."""

    text: str
    where: str


def statements(found: Iterable[Statement], form: InstrumentFormat) -> dict[str, Stated]:
    """Return what a header block states; what is not known is free text.

    Args:
        found: keys and values of the block.
        form: whose `header` names the keys of the instrument.

    Raises:
        ProfileError: a statement that cannot be, one made twice, or a key that is a known one misspelt.
    """
    own_keys = {_plain(key): ours for ours, key in form.header.items()}
    if form.samples is not None:
        own_keys[_plain(form.samples)] = "samples"
    stated: dict[str, Stated] = {}
    own = set[str]()  # stated by our own keys, which go before other words for them
    for statement in found:
        exact = _KNOWN.get(statement.key.strip().casefold())
        key = exact or own_keys.get(_plain(statement.key)) or _SYNONYMS.get(_plain(_without_unit(statement.key)))
        if key is None:
            if statement.is_comment:
                _refuse_misspelling(statement)
            continue
        value = _value(key, statement, exact is not None)
        if value is None:
            continue
        if exact and key in own and stated[key].text != value:
            raise ProfileError(f"line {statement.line}: {key} is stated twice", "keep one statement, one weld a file")
        own |= {key} if exact else set()
        if key not in stated or exact:
            stated[key] = Stated(value, f"line {statement.line}: ")
    return stated


def with_format(stated: Mapping[str, Stated], form: InstrumentFormat) -> dict[str, Stated]:
    """Return what the file states, and beside it what format and user do.

    Raises:
        ProfileError: units or sign are stated by nobody, or are none.
    """
    keys = [key for key in KEYS if key != "samples"]  # of which a format names the key alone
    by_form = {key: Stated(str(value), "") for key in keys if (value := getattr(form, key, None)) is not None}
    merged = {**by_form, **stated}
    if missing := [key for key in REQUIRED if key not in merged]:
        example = "up" if missing[0] == "z_positive" else "mm"
        option = f"--{missing[0].replace('_', '-')} {example}"
        raise ProfileError(
            f"{', '.join(missing)} not stated",
            f"add a line such as '# {missing[0]}: {example}', or state it with {option}",
        )
    for key in ("x_unit", "z_unit"):
        unit = unit_of(merged[key].text)
        if unit is None:
            raise ProfileError(
                f"{merged[key].where}{key} {quoted(merged[key].text)} is unknown", f"state one of {', '.join(METRES)}"
            )
        merged[key] = Stated(unit, merged[key].where)
    for key, choices in _CHOICES.items():
        if key in merged:
            text = merged[key].text.casefold()
            if text not in choices:
                raise ProfileError(
                    f"{merged[key].where}{key} {quoted(merged[key].text)} is unknown",
                    f"state one of {', '.join(choices)}",
                )
            merged[key] = Stated(text, merged[key].where)
    if "kind" in merged and merged["kind"].text == "wheel":
        raise ProfileError(
            f"{merged['kind'].where}a wheel, not a rail", "give measurements of rails; wheels are not judged"
        )
    return merged


def chainage_m(text: str, key: str) -> Decimal | None:
    """Return a chainage with its unit, such as `12+345.678`, `12.345 km` or `12345 m`; None without a unit."""
    plain = text.strip().replace(",", ".")
    found = re.fullmatch(r"(?:km\s*)?([\d.+]+)\s*(km|m)?", plain, re.IGNORECASE)
    if found is None:
        return None
    if "+" in found[1]:
        return number(found[1], key)
    unit = found[2] or _unit_in_key(key)
    return None if unit is None else number(found[1], key) * METRES[unit.casefold()]


def stated_number(statement: Stated, key: str) -> float:
    """Return a statement's value as a number.

    Raises:
        ProfileError: not a finite number, one in another unit, or one that only another unit makes sense of.
    """
    text, units = statement.text, _UNITS.get(key, {})
    found = re.fullmatch(r"([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([a-zA-Z/]+)", text.strip())
    factor = units.get(found[2].casefold()) if found else None
    if found and factor is not None:
        text = found[1]
    value = float(number(text, statement.where + key))
    if not math.isfinite(value):
        raise ProfileError(f"{statement.where}{key} {quoted(statement.text)} is too large", "correct this statement")
    if factor not in (None, 1.0):
        meant, unit = value * float(factor or 1.0), next(unit for unit, one in units.items() if one == 1.0)
        raise ProfileError(
            f"{statement.where}{key} {quoted(statement.text)} is in another unit", f"write {meant:.6g}, in {unit}"
        )
    return value


_UNITS: dict[str, dict[str, float]] = {
    "line_speed_kmh": {"km/h": 1.0, "kmh": 1.0, "kph": 1.0, "mph": 1.609344, "m/s": 3.6},
    "weld_position_m": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "chainage_m": {"m": 1.0, "km": 1000.0},
}
"""Units that a number may be written with, as what they come to in the key's own."""


def _value(key: str, statement: Statement, is_exact: bool) -> str | None:
    """Return a statement's value as our own files write it; None if it says nothing that can be used."""
    if key == "support" and not statement.is_comment and "=" not in statement.value:
        return None  # of an instrument's header: its telephone number, say
    if is_exact:
        return statement.value
    if key == "chainage_m":
        metres = chainage_m(statement.value, statement.key)
        return None if metres is None else str(metres)
    if key == "line_speed_kmh":
        return _kilometres_per_hour(statement)
    if key == "running":  # other words, such as a measurement's direction, say nothing of trains
        return statement.value if statement.value.strip().casefold() in RUNNING or statement.is_comment else None
    if key == "samples":
        return statement.value if statement.value.isdecimal() else None
    return statement.value


def _kilometres_per_hour(statement: Statement) -> str | None:
    """Return a speed that says, in its key or its value, that it is in km/h."""
    found = re.fullmatch(r"(\d+(?:[.,]\d+)?)\s*(km/h)?", statement.value.strip(), re.IGNORECASE)
    if found is None or not (found[2] or "km/h" in statement.key.casefold()):
        return None
    return found[1].replace(",", ".")


def _unit_in_key(key: str) -> str | None:
    found = re.search(r"(?:^|[\s\[(_])(km|m)[\])]?$", key.strip(), re.IGNORECASE)
    return found[1] if found else None


def _without_unit(key: str) -> str:
    return re.sub(r"\s*[\[(].*$", "", key)


def _plain(key: str) -> str:
    text = unicodedata.normalize("NFKD", key.casefold().replace("ß", "ss"))
    return " ".join(re.findall(r"[a-z0-9]+", "".join(c for c in text if not unicodedata.combining(c))))


def _refuse_misspelling(statement: Statement) -> None:
    if similar := difflib.get_close_matches(statement.key.casefold(), KEYS, n=1, cutoff=0.8):
        raise ProfileError(
            f"line {statement.line}: unknown key {quoted(statement.key)}",
            f"write {similar[0]}, if that is what is meant",
        )


_KNOWN = {key: key for key in KEYS}
_SYNONYMS = {word: key for key, words in _WORDS.items() for word in words}
