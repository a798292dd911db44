"""Read numbers, lengths and units as people and instruments write them; numbers become exact decimals."""

import re
from decimal import Decimal
from functools import lru_cache

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement.text_file import quoted

METRES: dict[str, Decimal] = {
    "m": Decimal(1),
    "cm": Decimal("0.01"),
    "mm": Decimal("0.001"),
    "um": Decimal("0.000001"),
    "nm": Decimal("0.000000001"),
    "km": Decimal(1000),
    "0.1mm": Decimal("0.0001"),
    "0.01mm": Decimal("0.00001"),
    "in": Decimal("0.0254"),
    "mil": Decimal("0.0000254"),
}
"""Metres in each unit of length that files are read in."""

_FARTHEST_M = Decimal(10**7)  # no chainage is longer; a number beyond it has the wrong unit
_SPELLINGS = {
    "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometer": "um", "micrometre": "um",
    "meter": "m", "metre": "m", "millimeter": "mm", "millimetre": "mm", "inch": "in", "inches": "in", '"': "in",
    "thou": "mil", "mils": "mil", "1/100mm": "0.01mm", "mm/100": "0.01mm", "1/10mm": "0.1mm", "mm/10": "0.1mm",
    "1/1000mm": "um", "0.001mm": "um",
}  # fmt: skip
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([ed][+-]?\d{1,3})?", re.ASCII | re.IGNORECASE)
_SIMPLE = re.compile(r"[+-]?\d+(?:[.,]\d+)?", re.ASCII)  # nearly every field: what follows is for the others
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_THOUSANDS = re.compile(r"(?<=\d)['’\u00a0\u202f](?=\d{3}(?!\d))")
_KILOMETRE_PLUS = re.compile(r"(\d{1,4})\+(\d{3,4}(?:\.\d*)?)", re.ASCII)
_MISSING = ("", "-", "--", "---", "nan", "n/a", "na", "#n/a", "null", "none", "bad", "*", "***", "?", "inf", "∞", "ol",
            "epäluku", "empty", "missing")  # fmt: skip
_REMEMBERED = 2**14  # fields: a file's are looked at again and again


@lru_cache(_REMEMBERED)
def unit_of(text: str) -> str | None:
    """Return the unit of length that a text names, as a key of `METRES`, or None."""
    if _SIMPLE.fullmatch(text):
        return None
    plain = text.strip().strip(".").replace(" ", "").casefold()
    plain = _SPELLINGS.get(plain) or _SPELLINGS.get(plain.removesuffix("s"), plain)
    return plain if plain in METRES else None


def plain_number(text: str, *, decimal_comma: bool) -> str:
    """Return a number's text with an ASCII sign, a decimal point and no thousands separators."""
    if _SIMPLE.fullmatch(text):
        return text.replace(",", ".", 1) if decimal_comma else text
    text = _THOUSANDS.sub("", text.strip().strip('"').strip().replace("\u2212", "-"))
    if "," in text and "." in text:
        thousands = "," if text.rindex(",") < text.rindex(".") else "."
        text = re.sub(rf"(?<=\d){re.escape(thousands)}(?=\d{{3}}(?!\d))", "", text)
        return text.replace(",", ".", 1)
    return text.replace(",", ".", 1) if decimal_comma else text


def is_missing(text: str, marks: tuple[str, ...] = ()) -> bool:
    """Return whether a field says that there is no value."""
    if not marks and _SIMPLE.fullmatch(text):
        return False
    plain = text.strip().strip('"').strip()
    return plain.casefold() in _MISSING or plain in marks


def is_kilometre_plus(text: str) -> bool:
    """Return whether a position is a chainage in kilometres and metres, such as 12+345.678, which is in m as it is."""
    return "+" in text and bool(_KILOMETRE_PLUS.fullmatch(plain_number(text, decimal_comma=True)))


@lru_cache(_REMEMBERED)
def is_number(text: str) -> bool:
    """Return whether a field is a number, with either decimal mark, or a chainage such as 12+345.678."""
    if _SIMPLE.fullmatch(text):
        return True
    plain = plain_number(text, decimal_comma=True)
    return bool(_NUMBER.fullmatch(plain) or _KILOMETRE_PLUS.fullmatch(plain))


def number(text: str, name: str, *, decimal_comma: bool = False) -> Decimal:
    """Return the finite decimal number that a text holds; `12+345.678`, kilometres and metres, is 12345.678.

    Args:
        text: as written.
        name: says in messages where it stands.
        decimal_comma: whether a comma is a decimal mark.

    Raises:
        ProfileError: not a number, or not a finite one.
    """
    if _SIMPLE.fullmatch(text) and (decimal_comma or "," not in text):
        return Decimal(text.replace(",", ".", 1))
    plain = plain_number(text, decimal_comma=decimal_comma)
    if _NUMBER.fullmatch(plain):
        return Decimal(plain.lower().replace("d", "e"))
    if chainage := _KILOMETRE_PLUS.fullmatch(plain):
        return Decimal(chainage[1]) * 1000 + Decimal(chainage[2])
    if _NOT_FINITE.fullmatch(plain):
        raise ProfileError(f"{name} is {plain}, not a finite number", "correct it or measure it again")
    raise ProfileError(
        f"{name} {quoted(text)} is not a number", "write numbers such as 1.25; mark lines of text with #"
    )


def in_metres(value: Decimal, unit: str, name: str) -> Decimal:
    """Return a length in metres.

    Args:
        value: in its unit.
        unit: a key of `METRES`.
        name: says in messages where it stands.

    Raises:
        ProfileError: longer than any chainage.
    """
    metres = value * METRES[unit]
    if abs(metres) > _FARTHEST_M:
        raise ProfileError(f"{name} is {metres:.3g} m", f"check the value and its unit (stated: {unit})")
    return metres
